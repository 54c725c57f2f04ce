//! Things made to be looked at: contact sheets, the page of a run, the gallery page of a library, the measures of a run.

pub mod contact_sheet;
pub mod gallery;
pub mod measured;
mod page;
pub mod plot;
pub mod run;
mod run_page;
