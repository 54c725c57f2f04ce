//! Things made to be looked at: contact sheets, the gallery page of a library, the measures of a run.

pub mod contact_sheet;
pub mod gallery;
pub mod measured;
