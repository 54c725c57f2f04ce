//! The blind test: videos without names for people to choose between, and what their votes say.
//!
//! [`key::Key::make`] gives every video a name that tells nothing, [`write_page`] makes the page that shows them in
//! pairs, [`votes`] reads what people chose, [`BlindTest`] is what follows.

pub mod findings;
pub mod key;
pub mod result;
mod section;
pub mod votes;
mod voting_page;
mod words;

pub use findings::BlindTest;
pub use key::{FOLDER, KEY, Key, PAGE};
pub(super) use section::section;
pub use voting_page::write as write_page;
