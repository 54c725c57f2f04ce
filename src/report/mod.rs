//! Things made to be looked at: contact sheets, and the gallery page of a library.

pub mod contact_sheet;
pub mod gallery;
