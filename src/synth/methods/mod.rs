//! The methods, a file and one line of [`REGISTRY`] each.

pub mod advect;
pub mod database;
pub mod hybrid;
pub mod kwatra;
pub mod lazyfluids;
pub mod okabe2009;

use super::method::MethodEntry;

/// All methods.
pub const REGISTRY: &[MethodEntry] =
    &[database::ENTRY, advect::ENTRY, hybrid::ENTRY, lazyfluids::ENTRY, kwatra::ENTRY, okabe2009::ENTRY];

/// The method that needs neither library nor exemplar: what the others are seen beside.
pub const PLAIN_METHOD: &str = "advect";
