//! Pictures and pages that show what was made.

pub mod contact_sheet;
