//! Things made to be looked at: contact sheets, the page of a run, the gallery page of a library, the measures of a run,
//! and the page that shows methods beside each other.

pub mod animate;
pub mod arrays;
pub mod beside;
pub mod comparison;
pub mod contact_sheet;
pub mod gallery;
pub mod measured;
pub mod measuring;
mod page;
pub mod plot;
pub mod run;
mod run_page;
pub mod slice;
pub mod small_plot;
pub mod yardstick;
