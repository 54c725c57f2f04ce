//! Pieces that move as a person asks: a gate before the candidates (Okabe et al. 2011, §5, "User-Specified Motion
//! Field") and a term among the data terms.

use crate::assign::candidates::Gate;
use crate::assign::nodes::NodeGrid;
use crate::library::piece::PieceIx;
use crate::library::tile::Tile;
use crate::library::variant::PIECE;
use crate::scene::asked::Wish;
use crate::scene::scene::Still;

/// Steps after which every piece is admitted.
const STEPS: u32 = 6;
/// Angle that is admitted at once, and that each step adds, degrees.
const STEP_DEGREES: f32 = 30.0;
/// Octaves of speed beyond the reach of playback that are admitted at once, and that each step adds.
const STEP_OCTAVES: f32 = 0.5;
/// Share of a piece's motion that must have one direction for it to have any.
const COHERENT: f32 = 0.25;
/// Octaves by which playback can change a speed (see [`super::playback`]).
const REACH: f32 = 1.0;
/// A speed below this counts as this, pixels per frame: ratios of nothing mean nothing.
const LEAST_SPEED: f32 = 0.02;

/// What is asked of every node, in the grid's order.
pub fn wishes(grid: &NodeGrid, still: &Still) -> Vec<Wish> {
    let wish = |x: u32, y: u32| {
        let square =
            |asked: &crate::scene::asked::Asked| asked.square(&still.working_matte, x as usize, y as usize, PIECE);
        still.asked.as_ref().map(square).unwrap_or_default()
    };
    grid.nodes.iter().map(|n| wish(n.x, n.y)).collect()
}

/// How a piece moves as a whole.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PieceMotion {
    /// Direction of its mean motion, a unit vector; none when it moves this way and that.
    direction: Option<(f32, f32)>,
    /// Mean length of its motion, pixels per output frame.
    speed: f32,
}

impl PieceMotion {
    /// Over the moving cells of a piece, shown at `pace` library frames per output frame.
    pub fn of(tile: &Tile, pace: f32) -> Self {
        let (u, v) = tile.mean_motion();
        let (mut activity, mut moving) = (0.0, 1e-6);
        for cell in &tile.cells {
            let weight = cell.significant.to_f32();
            (activity, moving) = (activity + weight * cell.activity.to_f32(), moving + weight);
        }
        let (norm, activity) = (u.hypot(v), activity / moving);
        let coherent = norm > 0.0 && norm >= COHERENT * activity;
        Self { direction: coherent.then(|| (u / norm, v / norm)), speed: pace * activity }
    }

    /// Cosine of the angle to a wished direction; none when nothing is wished, 0 for a piece without a direction.
    fn cosine(&self, wish: &Wish) -> Option<f32> {
        let (u, v) = wish.direction?;
        Some(self.direction.map_or(0.0, |(x, y)| u * x + v * y))
    }

    /// Octaves between its speed and the wished one that playback cannot make up for; none when nothing is wished.
    fn octaves(&self, wish: &Wish) -> Option<f32> {
        Some((octaves(wish.speed?, self.speed).abs() - REACH).max(0.0))
    }

    /// How far it is from a wish: `direction` times (1 − cos) / 2 plus `speed` times the octaves out of reach.
    pub fn misfit(&self, wish: &Wish, direction: f32, speed: f32) -> f32 {
        let turned = self.cosine(wish).map_or(0.0, |cos| 0.5 - 0.5 * cos);
        direction * turned + speed * self.octaves(wish).unwrap_or(0.0)
    }

    /// Steps of widening after which a gate for `wish` admits it.
    fn steps(&self, wish: &Wish) -> u32 {
        let angle = self.cosine(wish).map_or(0.0, |cos| match self.direction {
            Some(_) => cos.clamp(-1.0, 1.0).acos().to_degrees() / STEP_DEGREES,
            None => STEPS as f32,
        });
        let octaves = self.octaves(wish).map_or(0.0, |o| o / STEP_OCTAVES);
        (angle.max(octaves) as u32).min(STEPS)
    }
}

/// log₂ of how many times faster `wished` is than `own`, pixels per frame.
pub fn octaves(wished: f32, own: f32) -> f32 {
    (wished.max(LEAST_SPEED) / own.max(LEAST_SPEED)).log2()
}

/// Admits the pieces whose motion differs little from the wish of a node: by at most 30° and a factor of 1.4 beyond what
/// playback makes up for, and by as much more with every step of widening. Speeds are compared as ratios, since optical
/// flow underestimates fast water.
pub struct MotionGate<'a> {
    /// Per node.
    pub wishes: &'a [Wish],
    /// Per usable piece.
    pub pieces: Vec<PieceMotion>,
}

impl Gate for MotionGate<'_> {
    fn admits(&self, node: usize, piece: PieceIx, widening: u32) -> bool {
        self.pieces[piece.0 as usize].steps(&self.wishes[node]) <= widening
    }

    fn steps(&self) -> u32 {
        STEPS
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;
    use crate::library::grid::Cell;
    use crate::library::variant::PIECE_CELLS;

    fn piece(u: f32, v: f32, activity: f32) -> PieceMotion {
        let cell = Cell {
            mean: [u, v].map(f16::from_f32),
            activity: f16::from_f32(activity),
            significant: f16::ONE,
            ..Cell::default()
        };
        PieceMotion::of(&Tile { cells: [cell; PIECE_CELLS * PIECE_CELLS] }, 1.0)
    }

    #[test]
    fn the_gate_widens_by_angle_and_by_ratio() {
        let steps = |piece: PieceMotion, wish: Wish| piece.steps(&wish);
        let down = Wish { direction: Some((0.0, 1.0)), speed: None };
        assert_eq!(steps(piece(0.1, 1.0, 1.2), down), 0);
        assert_eq!(steps(piece(1.0, 1.0, 1.5), down), 1);
        assert_eq!(steps(piece(0.0, -1.0, 1.2), down), STEPS);
        assert_eq!(steps(piece(0.0, 0.1, 2.0), down), STEPS, "it has no direction");
        let fast = Wish { direction: None, speed: Some(4.0) };
        assert_eq!(steps(piece(0.0, 2.1, 2.1), fast), 0, "playback doubles it");
        assert_eq!(steps(piece(0.0, 1.1, 1.1), fast), 1);
        assert_eq!(steps(piece(0.0, 0.0, 0.0), fast), STEPS);
        assert_eq!(steps(piece(1.0, 0.0, 1.0), Wish::default()), 0);
        let gate = MotionGate { wishes: &[down], pieces: vec![piece(0.0, 1.0, 1.0), piece(0.0, -1.0, 1.0)] };
        assert!(gate.admits(0, PieceIx(0), 0) && !gate.admits(0, PieceIx(1), STEPS - 1));
        assert!(gate.admits(0, PieceIx(1), gate.steps()));
    }

    #[test]
    fn the_term_grows_with_angle_and_missing_speed() {
        let wish = Wish { direction: Some((1.0, 0.0)), speed: Some(1.0) };
        assert!(piece(1.0, 0.0, 1.0).misfit(&wish, 0.4, 0.1).abs() < 1e-3);
        assert!((piece(-1.0, 0.0, 1.0).misfit(&wish, 0.4, 0.1) - 0.4).abs() < 1e-3);
        assert!((piece(8.0, 0.0, 8.0).misfit(&wish, 0.4, 0.1) - 0.2).abs() < 1e-3);
        assert!((piece(0.0, 0.0, 1.0).misfit(&wish, 0.4, 0.1) - 0.2).abs() < 1e-3);
        assert_eq!(piece(-1.0, 0.0, 9.0).misfit(&Wish::default(), 0.4, 0.1), 0.0);
    }
}
