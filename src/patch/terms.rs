//! What a method adds to the comparison of a site with a place.

use super::data::patches::Place;
use super::data::pose::Pose;

/// Which level of which frame is worked on.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Pass {
    /// Level, 0 the finest.
    pub level: usize,
    /// Number of the target's frame in its session.
    pub frame: usize,
}

/// Terms of the energy beside weighted squared differences of channels. Asked about every candidate: answer fast, and the
/// same on every call.
pub trait Terms<P: Pose>: Sync {
    /// What is added to the distance, in its whole numbers ([`super::data::channels::Layout::to_distance`]).
    fn cost(&self, _pass: Pass, _site: usize, _place: Place, _pose: P) -> u32 {
        0
    }

    /// Whether the site is compared with its swapped channels ([`super::data::image::Target::swapped`]).
    fn is_swapped(&self, _pass: Pass, _site: usize, _place: Place, _pose: P) -> bool {
        false
    }

    /// The poses to be tried for a place, where the search came with `led`: that one, unless something is known of it.
    fn poses(&self, _pass: Pass, _site: usize, _place: Place, led: P, out: &mut Vec<P>) {
        out.push(led);
    }
}
