//! How fast each stretch of footage is played, so that it moves as fast as is asked: a library is seldom large enough to
//! hold every speed.

use super::gate::octaves;
use crate::render::layout::Layout;
use crate::scene::asked::Wish;

/// Rates of playback: library seconds per second of output. Few, since a clip is looped and read for each.
pub const RATES: [f32; 5] = [0.5, 2.0 / 3.0, 1.0, 1.5, 2.0];
/// Number of the rate of one.
pub const PLAIN: usize = 2;

/// Per placement, the number of its rate: the one that brings the speed of its whole stretch of continuous footage
/// nearest to what is asked there, and [`PLAIN`] where nothing is. `speed` is a placement's own speed, in the unit of the
/// wishes; the layout's sources must be whole clips.
pub fn choose(layout: &Layout, wishes: &[Wish], speed: impl Fn(usize) -> f32) -> Vec<usize> {
    let groups = layout.groups();
    let mut means = vec![(0.0f32, 0.0f32, 0.0f32); groups.len()];
    for (i, wish) in wishes.iter().enumerate() {
        if let Some(wished) = wish.speed {
            let (asked, own, count) = &mut means[groups[i]];
            (*asked, *own, *count) = (*asked + wished, *own + speed(i), *count + 1.0);
        }
    }
    let rate = |(asked, own, count): (f32, f32, f32)| {
        let misses = |k: usize| (octaves(asked / count, own / count) - RATES[k].log2()).abs();
        let nearest = (0..RATES.len()).min_by(|&a, &b| misses(a).total_cmp(&misses(b)));
        nearest.filter(|_| count > 0.0).unwrap_or(PLAIN)
    };
    groups.iter().map(|&group| rate(means[group])).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::library::variant::Variant;
    use crate::render::layout::Placement;

    fn placement(node: (usize, usize), piece: (usize, usize)) -> Placement {
        Placement { node, source: 0, variant: Variant::from_index(0).unwrap(), piece, cells: Vec::new() }
    }

    #[test]
    fn a_stretch_shares_one_rate_near_what_is_asked() {
        let placements = vec![
            placement((0, 0), (0, 0)),
            placement((24, 0), (24, 0)),
            placement((48, 0), (0, 0)),
            placement((72, 0), (200, 0)),
        ];
        let layout = Layout { canvas: (120, 48), sources: vec![(320, 240)], placements };
        let wish = |speed: f32| Wish { direction: None, speed: Some(speed) };
        let wishes = [wish(2.4), wish(3.6), wish(0.9), Wish::default()];
        let rates = choose(&layout, &wishes, |_| 2.0);
        assert_eq!(rates.iter().map(|&r| RATES[r]).collect::<Vec<_>>(), [1.5, 1.5, 0.5, 1.0]);
        assert_eq!(RATES[PLAIN], 1.0);
    }
}
