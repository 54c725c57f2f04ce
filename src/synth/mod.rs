//! Methods that animate a scene, each behind one trait.
//!
//! A method ([`methods`]) is made from what rooms before it hold: the library's route ([`pieces`]), what looks come from
//! ([`exemplar`]) and frames made one from the other ([`sequence`]). What a method is ([`method`]) comes before all of them.

pub mod default_method;
pub mod exemplar;
pub mod maps;
pub mod memory;
pub mod method;
pub mod methods;
pub mod pieces;
pub mod record;
pub mod run;
pub mod separation;
pub mod sequence;
pub mod writing;
