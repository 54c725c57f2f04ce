//! The hybrid of `advect` and the database method (ours): the picture itself is carried along, and the pieces'
//! differences make it change on its way. Band by band the clips tell how much of the fluid moves at all; of that the
//! pieces bring a share, and the carried picture brings the rest. What does not move in the clips stays in its place.
//!
//! Okabe, Anjyo & Onai name what their blurred average loses: trajectories disappear (2011, §7.2). The stages are those of
//! [`PieceMethod`]; what the differences are added to is not a still average but a picture that flows.

use crate::base::error::Result;
use crate::base::options::{Declared, Table, declare_options, refuse_unknown};
use crate::synth::method::MethodEntry;
use crate::synth::pieces::options;
use crate::synth::pieces::piece_method::PieceMethod;
use crate::synth::pieces::run::Carrying;

declare_options! {
    /// Options of the hybrid, besides those it shares with the database method.
    pub struct Options named "hybrid" {
        /// Longest time that detail of the picture travels before it starts again, at 25 frames a second.
        life: f32 = 40.0, in 8, 1000, "frames", "methods §2.4";
        /// Share of that time in which the old and the new are seen together.
        fade: f32 = 0.5, in 0.1, 1, "ratio", "Holynski 2021, §4.2";
        /// Contrast of the pieces' part relative to what the picture's contrast and the clip's still part leave for it; the
        /// rest is the picture's own detail. More changes more, and is less sharp.
        strength: f32 = 0.3, in 0, 4, "ratio", "methods §2.4";
        /// Factor of the speed that the pieces' texture is measured to have, where none is asked for.
        pace: f32 = 1.0, in 0, 10, "ratio", "methods §1.6";
        /// How strongly the picture is swayed by what the pieces' motion does besides its mean: curls, surges, tongues.
        sway: f32 = 1.0, in 0, 4, "ratio", "methods §1.9";
        /// Time until a displacement by that has shrunk to 1/e, at 25 frames a second.
        memory: f32 = 12.0, in 1, 250, "frames", "methods §1.9", EXPERT;
    }
}

/// Options of the database method that mean nothing where the picture is carried, and one with another default here.
const UNSHARED: [&str; 5] = ["shutter", "blur", "recovery", "drift", "strength"];

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "hybrid",
    summary: "carries the picture along the motion and lets pieces of a library's clips change it on its way",
    citation: "ours, from Okabe, Anjyo & Onai 2011 and Holynski, Curless, Seitz & Szeliski, \"Animating Pictures with \
               Eulerian Motion Fields\", CVPR 2021",
    library: true,
    exemplars: 0,
    designed: false,
    options: declared,
    complete: |table| {
        let (own, shared) = read(table)?;
        Ok(own.to_table().into_iter().chain(shared.to_table().into_iter().filter(|(name, _)| known(name))).collect())
    },
    preview: options::Options::shrink,
    build: |table| {
        let (own, shared) = read(table)?;
        let Options { life, fade, pace, sway, memory, .. } = own;
        Ok(Box::new(PieceMethod::new(ENTRY.name, shared, Some(Carrying { life, fade, pace, sway, memory }))))
    },
};

fn known(name: &str) -> bool {
    !UNSHARED.contains(&name)
}

fn declared() -> Vec<Declared> {
    let shared = options::Options::declared().into_iter().filter(|d| known(d.name));
    Options::declared().into_iter().chain(shared).collect()
}

/// The hybrid's own options and those of the stages it shares.
fn read(table: &Table) -> Result<(Options, options::Options)> {
    let names: Vec<&str> = declared().iter().map(|d| d.name).collect();
    refuse_unknown(ENTRY.name, table.keys().map(String::as_str), &names)?;
    let own_names: Vec<&str> = Options::declared().iter().map(|d| d.name).collect();
    let (own, shared): (Table, Table) =
        table.clone().into_iter().partition(|(name, _)| own_names.contains(&name.as_str()));
    let shared = options::Options::from_table_of(ENTRY.name, &shared)?.checked(ENTRY.name)?;
    let own = Options::from_table(&own)?;
    let shared = options::Options { strength: own.strength, ..shared };
    Ok((own, shared))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;
    use crate::base::options::Value;

    #[test]
    fn every_option_has_a_name_of_its_own_and_keeps_its_value() {
        let names: BTreeSet<&str> = declared().iter().map(|d| d.name).collect();
        assert_eq!(names.len(), declared().len());
        for option in declared() {
            let complete = (ENTRY.complete)(&Table::new()).unwrap();
            assert_eq!(complete[option.name], option.default, "{}", option.name);
        }
        let table =
            [("pace", 2.0), ("speed", 0.3), ("strength", 0.4)].map(|(name, v)| (name.to_owned(), Value::Number(v)));
        let (own, shared) = read(&(ENTRY.complete)(&table.into_iter().collect()).unwrap()).unwrap();
        assert_eq!((own.pace, shared.speed, shared.strength), (2.0, 0.3, 0.4));
    }
}
