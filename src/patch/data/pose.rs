//! How a patch of the source lies on its site: upright, turned, or by a matrix that is given.

use std::f64::consts::PI;
use std::fmt::Debug;
use std::sync::LazyLock;

/// 1 in the fixed-point numbers of a [`Matrix`].
pub const ONE: i32 = 1 << 16;

/// From an offset on the target to the offset in the source that shows there, in 65536ths. Whole numbers, so that every
/// machine samples the same places.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Matrix {
    /// How far across in the source a step across goes.
    pub xx: i32,
    /// How far across a step down goes.
    pub xy: i32,
    /// How far down a step across goes.
    pub yx: i32,
    /// How far down a step down goes.
    pub yy: i32,
}

impl Matrix {
    /// Offsets are the same on both sides.
    pub const IDENTITY: Self = Self { xx: ONE, xy: 0, yx: 0, yy: ONE };

    /// From `[[xx, xy], [yx, yy]]`, each of at most 1000 in size.
    pub fn new(rows: [[f32; 2]; 2]) -> Self {
        let fixed = |v: f32| (f64::from(v.clamp(-1000.0, 1000.0)) * f64::from(ONE)).round() as i32;
        Self { xx: fixed(rows[0][0]), xy: fixed(rows[0][1]), yx: fixed(rows[1][0]), yy: fixed(rows[1][1]) }
    }

    /// First `other`, then this.
    #[must_use]
    pub fn after(self, other: Self) -> Self {
        let sum = |a: i32, b: i32, c: i32, d: i32| {
            ((i64::from(a) * i64::from(b) + i64::from(c) * i64::from(d) + i64::from(ONE / 2)) >> 16) as i32
        };
        Self {
            xx: sum(self.xx, other.xx, self.xy, other.yx),
            xy: sum(self.xx, other.xy, self.xy, other.yy),
            yx: sum(self.yx, other.xx, self.yy, other.yx),
            yy: sum(self.yx, other.xy, self.yy, other.yy),
        }
    }

    /// Where an offset of whole pixels leads, in 65536ths of a pixel.
    #[inline]
    pub fn apply(self, dx: i32, dy: i32) -> (i32, i32) {
        (self.xx * dx + self.xy * dy, self.yx * dx + self.yy * dy)
    }

    /// The same in whole pixels.
    #[inline]
    pub fn step(self, dx: i32, dy: i32) -> (isize, isize) {
        let (x, y) = self.apply(dx, dy);
        (((x + ONE / 2) >> 16) as isize, ((y + ONE / 2) >> 16) as isize)
    }
}

/// How a patch of the source is laid on a site; what a search may choose besides the place.
pub trait Pose: Copy + Eq + Ord + Debug + Default + Send + Sync + 'static {
    /// Whether there is but one, which leaves offsets as they are: patches are compared where they lie.
    const UPRIGHT: bool;
    /// Half the first window of random poses; 0 where there is nothing to choose.
    const REACH: u32;

    /// From offsets on the target to offsets in the source.
    fn matrix(self) -> Matrix;

    /// One that differs by at most `reach`, by chance.
    #[must_use]
    fn near(self, reach: u32, chance: u64) -> Self;
}

/// As it stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Upright;

impl Pose for Upright {
    const UPRIGHT: bool = true;
    const REACH: u32 = 0;

    #[inline]
    fn matrix(self) -> Matrix {
        Matrix::IDENTITY
    }

    #[inline]
    fn near(self, _: u32, _: u64) -> Self {
        self
    }
}

/// Turned by whole degrees, 0 to 359, clockwise as seen with y down. Half a degree moves no pixel of the largest patch by a
/// tenth of a pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Turn(u16);

/// Degrees of a whole turn.
const WHOLE: u16 = 360;

/// The matrices of all turns.
static TURNS: LazyLock<[Matrix; WHOLE as usize]> = LazyLock::new(|| {
    std::array::from_fn(|degrees| {
        let (sin, cos) = (degrees as f64 * PI / 180.0).sin_cos();
        // The patch is turned by the angle, so what shows at an offset lay at the offset turned back.
        Matrix::new([[cos as f32, sin as f32], [-sin as f32, cos as f32]])
    })
});

impl Turn {
    /// By the nearest whole degree; any number is allowed.
    pub fn degrees(degrees: f32) -> Self {
        Self((degrees.round() as i64).rem_euclid(i64::from(WHOLE)) as u16)
    }

    /// Degrees, 0 to 359.
    pub fn in_degrees(self) -> u16 {
        self.0
    }

    /// The other way round: turned by half a turn more.
    #[must_use]
    pub fn opposite(self) -> Self {
        Self((self.0 + WHOLE / 2) % WHOLE)
    }
}

impl Pose for Turn {
    const UPRIGHT: bool = false;
    const REACH: u32 = WHOLE as u32 / 2;

    #[inline]
    fn matrix(self) -> Matrix {
        TURNS[usize::from(self.0)]
    }

    fn near(self, reach: u32, chance: u64) -> Self {
        let shift = ((chance >> 32) * u64::from(2 * reach + 1)) >> 32;
        let whole = u32::from(WHOLE);
        Self(((u32::from(self.0) + whole + shift as u32 - reach.min(whole)) % whole) as u16)
    }
}

/// By the matrix of its site alone, see [`super::sites::Sites::frame`]: nothing to choose, but places are sampled between
/// pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Given;

impl Pose for Given {
    const UPRIGHT: bool = false;
    const REACH: u32 = 0;

    #[inline]
    fn matrix(self) -> Matrix {
        Matrix::IDENTITY
    }

    #[inline]
    fn near(self, _: u32, _: u64) -> Self {
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    #[test]
    fn a_quarter_turn_shows_above_what_lay_to_the_left() {
        // Turned clockwise, what lay left of the middle comes to lie above it.
        assert_eq!(Turn::degrees(90.0).matrix().step(0, -1), (-1, 0));
        assert_eq!(Turn::degrees(-270.0), Turn::degrees(90.0));
        assert_eq!(Turn::degrees(450.0).opposite().in_degrees(), 270);
        let (back, there) = (Turn::degrees(-37.0).matrix(), Turn::degrees(37.0).matrix());
        let both = back.after(there);
        assert!((both.xx - ONE).abs() < 4 && both.xy.abs() < 4, "{both:?}");
    }

    #[test]
    fn turns_by_chance_stay_within_reach_and_meet_all_of_it() {
        let mut seen = [0; 7];
        for k in 0..700 {
            let turn = Turn::degrees(1.0).near(3, rng::mix(k));
            seen[(i32::from(turn.in_degrees()) + 2).rem_euclid(360) as usize] += 1;
        }
        assert!(seen.iter().all(|&n| n > 50), "{seen:?}");
        let far: std::collections::BTreeSet<u16> =
            (0..9000).map(|k| Turn::default().near(Turn::REACH, rng::mix(k)).in_degrees()).collect();
        assert_eq!(far.len(), 360);
        assert_eq!(size_of::<Upright>(), 0);
    }
}
