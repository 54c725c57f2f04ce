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

/// The method of a picture with a library when none is named: the picture itself is moved by the clips' motion.
pub const LIBRARY_METHOD: &str = hybrid::ENTRY.name;
/// The same with a library of fire: a picture that is carried keeps the forms it has, and flames' edges show as rings.
pub const FIRE_METHOD: &str = database::ENTRY.name;
/// The method of an exemplar, and of a designed target, when none is named.
pub const EXEMPLAR_METHOD: &str = lazyfluids::ENTRY.name;
/// The method that needs neither library nor exemplar: what the others are seen beside.
pub const PLAIN_METHOD: &str = advect::ENTRY.name;
