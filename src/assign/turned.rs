//! Which place of one clip serves each square of a picture, turned so that it moves as is asked there (Okabe, Anjyo,
//! Igarashi & Seidel 2009: residuals are transferred to places of like motion).
//!
//! One clip has few places, but any place may be turned to any angle. Squares that continue their neighbours' footage are
//! preferred, so that waves larger than a square stay whole, and places that many squares show already are not: a splash
//! stamped over square after square is seen as a grid. Costs are minimised square by square in a fixed order
//! (Besag 1986, "iterated conditional modes"), from the best place of each and from what continues its neighbours.

use super::nodes::NodeGrid;
use crate::base::par;
use crate::base::rng;
use crate::library::variant::PIECE;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;

/// Bands of texture that are compared.
pub const BANDS: usize = 4;
/// Window over which a place is described, pixels (σ).
const WINDOW: f32 = 12.0;
/// Distance between places of the clip that are tried, pixels.
const STEP: usize = 8;
/// Places that every square keeps to choose from.
const KEPT: usize = 24;
/// Rounds over all squares, at most.
const ROUNDS: usize = 10;
/// Displacement at which footage no longer continues its neighbour's, pixels.
const CONTINUES: f32 = 4.0;
/// Side of the regions of the clip whose use is counted, pixels.
const REGION: f32 = 24.0;
/// Uses of a region that cost half of what the most would.
const OFTEN: f32 = 2.0;
/// Octaves of speed or texture that count as all the difference there can be.
const OCTAVES: f32 = 3.0;
/// Contrast that is noise, luma.
const NOISE: f32 = 0.002;
/// Speed that is none, pixels per frame.
const SLOW: f32 = 0.02;

/// A square of the picture and the footage that lies on it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Turned {
    /// Centre of the square, pixels of the picture.
    pub centre: (f32, f32),
    /// What of the clip is seen there, pixels of the clip.
    pub source: (f32, f32),
    /// By what the footage is turned, radians: its direction on the picture less that in the clip.
    pub turn: f32,
    /// Which of the clip's phases is shown.
    pub phase: usize,
}

impl Turned {
    /// What of the clip is seen at `(x, y)` of the picture.
    #[inline]
    pub fn place(&self, x: f32, y: f32) -> (f32, f32) {
        let (sin, cos) = self.turn.sin_cos();
        let (dx, dy) = (x - self.centre.0, y - self.centre.1);
        (self.source.0 + cos * dx + sin * dy, self.source.1 - sin * dx + cos * dy)
    }

    /// How much this footage and the other's are the same at `(x, y)` of the picture, 0 to 1, where a displacement by
    /// `length` pixels makes them strangers.
    #[inline]
    pub fn alike(&self, other: &Self, (x, y): (f32, f32), length: f32) -> f32 {
        if self.phase != other.phase {
            return 0.0;
        }
        let (a, b) = (self.place(x, y), other.place(x, y));
        let squared = (a.0 - b.0).powi(2) + (a.1 - b.1).powi(2);
        (-squared / (length * length)).exp()
    }
}

/// Motion and texture, averaged around every pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct Features {
    /// Mean motion, pixels per frame.
    motion: [Plane; 2],
    /// Mean length of the motion.
    activity: Plane,
    /// Root mean square of what moves (of the clip) or is seen (of the picture), band by band, octaves.
    texture: Vec<Plane>,
    /// Share of what is seen that stands still, 0 to 1.
    still: Plane,
}

impl Features {
    /// Averages what is within `weight`: motion and its length in pixels per frame, squares of bands of luma that move and
    /// of those that are seen, all at one size.
    ///
    /// # Panics
    /// When there are fewer than [`BANDS`] bands.
    pub fn new(motion: [&Plane; 2], activity: &Plane, (squares, seen): (&[Plane], &[Plane]), weight: &Plane) -> Self {
        assert!(squares.len().min(seen.len()) >= BANDS);
        let total = gaussian(weight, WINDOW);
        let mean = |plane: &Plane| {
            let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
            let mut sum = gaussian(&Plane::from_vec(plane.width, plane.height, weighted), WINDOW);
            sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s /= t.max(1e-6));
            sum
        };
        let octaves = |v: f32| 0.5 * (v.max(0.0) + NOISE * NOISE).log2();
        let [moving, seen] = [squares, seen].map(|bands| mean(&sum(&bands[..BANDS])));
        let pairs = moving.data.iter().zip(&seen.data);
        let still = pairs.map(|(m, s)| 1.0 - (m.max(0.0) / (s + NOISE * NOISE)).min(1.0).sqrt()).collect();
        Self {
            still: Plane::from_vec(weight.width, weight.height, still),
            motion: motion.map(mean),
            activity: mean(activity),
            texture: par::map(BANDS, |k| mean(&squares[k]).map(octaves)),
        }
    }

    fn at(&self, (x, y): (f32, f32)) -> Feature {
        let [u, v] = self.motion.each_ref().map(|p| p.bilinear(x, y));
        let activity = self.activity.bilinear(x, y);
        let speed = u.hypot(v);
        Feature {
            angle: v.atan2(u),
            speed: speed.max(SLOW).log2(),
            fitful: 1.0 - (speed / activity.max(SLOW)).min(1.0),
            texture: std::array::from_fn(|k| self.texture[k].bilinear(x, y)),
            still: self.still.bilinear(x, y),
        }
    }
}

fn sum(planes: &[Plane]) -> Plane {
    let mut sum = planes[0].clone();
    for plane in &planes[1..] {
        sum.data.iter_mut().zip(&plane.data).for_each(|(s, v)| *s += v);
    }
    sum
}

/// One place.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Feature {
    /// Direction of the mean motion, radians.
    angle: f32,
    /// Octaves.
    speed: f32,
    /// Share of the motion that goes no way, 0 to 1.
    fitful: f32,
    texture: [f32; BANDS],
    /// Share of its contrast that stands still, 0 to 1.
    still: f32,
}

impl Feature {
    fn moves(&self) -> bool {
        self.texture.iter().any(|&t| t > NOISE.log2() + 1.0)
    }
}

/// What counts how much.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// Speed that is not the one asked for.
    pub speed: f32,
    /// Texture unlike the picture's.
    pub texture: f32,
    /// Places that stand still for the most part: a shore or a horizon that shakes is no fluid.
    pub still: f32,
    /// Footage that breaks off between neighbours.
    pub smooth: f32,
    /// Places that are shown elsewhere as well.
    pub repeat: f32,
}

/// What else a choice depends on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Choice {
    /// Width and height of the clip, pixels.
    pub clip: (usize, usize),
    /// Phases of the clip: footage that begins anew begins at any of them.
    pub phases: usize,
    /// Of their order.
    pub seed: u64,
}

/// Footage for every node of a grid, in its order; none where nothing in the clip moves.
pub fn choose(
    grid: &NodeGrid,
    picture: &Features,
    clip: &Features,
    weights: &Weights,
    choice: &Choice,
) -> Option<Vec<Turned>> {
    let lattice = lattice(clip, choice.clip);
    if lattice.is_empty() {
        return None;
    }
    let wanted: Vec<Feature> = centres(grid).map(|c| picture.at(c)).collect();
    let solver = Solver { grid, clip, weights, choice, shift: shift(&wanted, &lattice), wanted };
    let own = par::map(grid.nodes.len(), |node| solver.best(node, &lattice));
    Some(solver.solve(&own))
}

fn centres(grid: &NodeGrid) -> impl Iterator<Item = (f32, f32)> {
    let half = 0.5 * PIECE as f32;
    grid.nodes.iter().map(move |node| (node.x as f32 + half, node.y as f32 + half))
}

/// Places in the clip, whole squares of which lie in it, at which something moves.
fn lattice(clip: &Features, (width, height): (usize, usize)) -> Vec<((f32, f32), Feature)> {
    let axis = |size: usize| {
        let half = (PIECE / 2).min(size / 2);
        (half..=size - half).step_by(STEP)
    };
    let places = axis(height).flat_map(|y| axis(width).map(move |x| (x as f32, y as f32)));
    places.map(|place| (place, clip.at(place))).filter(|(_, feature)| feature.moves()).collect()
}

/// Octaves by which the picture's texture is stronger than the clip's on the whole, band by band: clips are softer than
/// pictures, and what counts is where there is more and where less.
fn shift(wanted: &[Feature], lattice: &[((f32, f32), Feature)]) -> [f32; BANDS] {
    let mean = |features: &mut dyn Iterator<Item = &Feature>, k: usize| {
        let (sum, count) = features.fold((0.0, 0), |(sum, count), f| (sum + f.texture[k], count + 1));
        sum / count.max(1) as f32
    };
    std::array::from_fn(|k| mean(&mut wanted.iter(), k) - mean(&mut lattice.iter().map(|(_, f)| f), k))
}

struct Solver<'a> {
    grid: &'a NodeGrid,
    clip: &'a Features,
    weights: &'a Weights,
    choice: &'a Choice,
    shift: [f32; BANDS],
    wanted: Vec<Feature>,
}

impl Solver<'_> {
    /// What a place of the clip costs, turned as it should be.
    fn unlike(&self, node: usize, place: &Feature) -> f32 {
        let wanted = &self.wanted[node];
        let share = |octaves: f32| (octaves.abs() / OCTAVES).min(1.0);
        let texture = (0..BANDS).map(|k| share(wanted.texture[k] - self.shift[k] - place.texture[k])).sum::<f32>();
        self.weights.speed * (share(wanted.speed - place.speed) + place.fitful)
            + self.weights.texture * texture / BANDS as f32
            + self.weights.still * place.still
    }

    /// The places that are most like what a node wants.
    fn best(&self, node: usize, lattice: &[((f32, f32), Feature)]) -> Vec<Turned> {
        let mut costs: Vec<(f32, usize)> =
            lattice.iter().enumerate().map(|(i, (_, feature))| (self.unlike(node, feature), i)).collect();
        costs.sort_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        let phase = rng::below(rng::hash(self.choice.seed, &[node as u64]), self.choice.phases as u64) as usize;
        let turned = |&(_, i): &(f32, usize)| {
            let (source, feature) = lattice[i];
            Turned { centre: self.centre(node), source, turn: self.wanted[node].angle - feature.angle, phase }
        };
        costs.iter().take(KEPT).map(turned).collect()
    }

    fn centre(&self, node: usize) -> (f32, f32) {
        let (half, node) = (0.5 * PIECE as f32, self.grid.nodes[node]);
        (node.x as f32 + half, node.y as f32 + half)
    }

    /// The neighbour's footage where `node` is, if there is some.
    fn continued(&self, node: usize, neighbour: &Turned) -> Option<Turned> {
        let centre = self.centre(node);
        let source = neighbour.place(centre.0, centre.1);
        let inside = |v: f32, size: usize| {
            let half = (PIECE / 2).min(size / 2) as f32;
            v >= half && v <= size as f32 - half
        };
        let fits = inside(source.0, self.choice.clip.0) && inside(source.1, self.choice.clip.1);
        (fits && self.clip.at(source).moves()).then_some(Turned { centre, source, ..*neighbour })
    }

    /// What footage costs by itself.
    fn alone(&self, node: usize, footage: &Turned) -> f32 {
        let place = self.clip.at(footage.source);
        let off = self.wanted[node].angle - place.angle - footage.turn;
        self.unlike(node, &place) + 0.5 * (1.0 - off.cos())
    }

    fn between(&self, a: &Turned, b: &Turned) -> f32 {
        let middle = (0.5 * (a.centre.0 + b.centre.0), 0.5 * (a.centre.1 + b.centre.1));
        self.weights.smooth * (1.0 - a.alike(b, middle, CONTINUES))
    }

    /// Goes over the nodes there and back until nothing changes.
    fn solve(&self, own: &[Vec<Turned>]) -> Vec<Turned> {
        let neighbours = self.neighbours();
        let mut chosen: Vec<Option<Turned>> = vec![None; own.len()];
        let mut uses = Uses::new(self.choice.clip);
        for round in 0..ROUNDS {
            let mut changed = false;
            for i in 0..own.len() {
                let node = if round % 2 == 0 { i } else { own.len() - 1 - i };
                let around: Vec<Turned> = neighbours[node].iter().filter_map(|&n| chosen[n]).collect();
                chosen[node].iter().for_each(|c| uses.add(c, -1));
                let best = self.cheapest(node, &own[node], chosen[node], &around, &uses);
                uses.add(&best, 1);
                changed |= chosen[node] != Some(best);
                chosen[node] = Some(best);
            }
            if !changed {
                break;
            }
        }
        chosen.into_iter().map(|c| c.expect("every node is gone over")).collect()
    }

    fn cheapest(&self, node: usize, own: &[Turned], now: Option<Turned>, around: &[Turned], uses: &Uses) -> Turned {
        let continued = around.iter().filter_map(|n| self.continued(node, n));
        // As it is now comes first: what is no cheaper changes nothing.
        let candidates = now.into_iter().chain(own.iter().copied()).chain(continued);
        let cost = |c: &Turned| {
            let repeat = self.weights.repeat * uses.share(c);
            self.alone(node, c) + repeat + around.iter().map(|n| self.between(c, n)).sum::<f32>()
        };
        candidates.map(|c| (cost(&c), c)).min_by(|a, b| a.0.total_cmp(&b.0)).expect("a node has places of its own").1
    }

    fn neighbours(&self) -> Vec<Vec<usize>> {
        let mut out = vec![Vec::new(); self.grid.nodes.len()];
        for edge in &self.grid.edges {
            out[edge.a as usize].push(edge.b as usize);
            out[edge.b as usize].push(edge.a as usize);
        }
        out
    }
}

/// How many squares show each region of the clip.
struct Uses {
    columns: usize,
    counts: Vec<i32>,
}

impl Uses {
    fn new((width, height): (usize, usize)) -> Self {
        let regions = |size: usize| (size as f32 / REGION) as usize + 1;
        Self { columns: regions(width), counts: vec![0; regions(width) * regions(height)] }
    }

    fn region(&self, footage: &Turned) -> usize {
        (footage.source.1 / REGION) as usize * self.columns + (footage.source.0 / REGION) as usize
    }

    fn add(&mut self, footage: &Turned, count: i32) {
        let region = self.region(footage);
        self.counts[region] += count;
    }

    /// From 0 for none to 1 for very many.
    fn share(&self, footage: &Turned) -> f32 {
        let count = self.counts[self.region(footage)] as f32;
        count / (count + OFTEN)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: (usize, usize) = (240, 192);
    const WEIGHTS: Weights = Weights { speed: 1.0, texture: 1.0, still: 0.0, smooth: 0.0, repeat: 0.0 };

    fn grid() -> NodeGrid {
        NodeGrid::over(&Plane::filled(SIZE.0, SIZE.1, 1.0), 0.02).unwrap()
    }

    /// Motion to the right, slow on the left half and fast on the right; texture of one strength, of which `seen` times the
    /// squares are seen on the left half.
    fn clip(seen: f32) -> Features {
        let plane = |f: &dyn Fn(usize) -> f32| Plane::from_fn(SIZE.0, SIZE.1, |x, _| f(x));
        let speed = plane(&|x| if x < 120 { 1.0 } else { 4.0 });
        let moving = vec![plane(&|_| 0.01); BANDS];
        let seen = vec![plane(&|x| if x < 120 { 0.01 * seen } else { 0.01 }); BANDS];
        Features::new([&speed, &plane(&|_| 0.0)], &speed, (&moving, &seen), &plane(&|_| 1.0))
    }

    /// Motion of `speed` towards `angle` everywhere.
    fn wanted(speed: f32, angle: f32) -> Features {
        let plane = |v: f32| Plane::filled(SIZE.0, SIZE.1, v);
        let (u, v) = (plane(speed * angle.cos()), plane(speed * angle.sin()));
        let seen = vec![plane(0.04); BANDS];
        Features::new([&u, &v], &plane(speed), (&seen, &seen), &plane(1.0))
    }

    fn chosen(picture: &Features, clip: &Features, weights: Weights) -> Vec<Turned> {
        choose(&grid(), picture, clip, &weights, &Choice { clip: SIZE, phases: 3, seed: 1 }).unwrap()
    }

    #[test]
    fn footage_is_turned_until_it_moves_as_is_asked() {
        for angle in [0.0f32, 1.2, -2.8] {
            for footage in chosen(&wanted(1.0, angle), &clip(1.0), Weights { smooth: 0.2, ..WEIGHTS }) {
                // A step along what is asked is a step to the right in the clip.
                let (x, y) = footage.centre;
                let (from, to) = (footage.place(x, y), footage.place(x + 5.0 * angle.cos(), y + 5.0 * angle.sin()));
                assert!((to.0 - from.0 - 5.0).abs() < 0.1 && (to.1 - from.1).abs() < 0.1, "{footage:?}");
                assert_eq!(from, footage.source);
            }
        }
    }

    #[test]
    fn the_place_of_the_nearest_speed_is_taken_unless_it_stands_still() {
        let left = |speed: f32, seen: f32, still: f32| {
            let footage = chosen(&wanted(speed, 0.5), &clip(seen), Weights { still, ..WEIGHTS });
            footage.iter().filter(|f| f.source.0 < 120.0).count() as f32 / footage.len() as f32
        };
        assert!(left(1.0, 1.0, 1.0) == 1.0 && left(4.0, 1.0, 1.0) == 0.0);
        assert!(left(1.0, 50.0, 0.0) == 1.0 && left(1.0, 50.0, 1.0) == 0.0);
    }

    #[test]
    fn neighbours_continue_each_other_where_that_is_wanted() {
        let broken = |smooth: f32| {
            let (grid, footage) = (grid(), chosen(&wanted(1.0, 0.3), &clip(1.0), Weights { smooth, ..WEIGHTS }));
            let alike = |e: &super::super::nodes::Edge| {
                let (a, b) = (&footage[e.a as usize], &footage[e.b as usize]);
                a.alike(b, (0.5 * (a.centre.0 + b.centre.0), 0.5 * (a.centre.1 + b.centre.1)), 2.0) > 0.5
            };
            grid.edges.iter().filter(|e| !alike(e)).count() as f32 / grid.edges.len() as f32
        };
        assert!(broken(0.0) > 0.8 && broken(0.3) < 0.5, "{} {}", broken(0.0), broken(0.3));
    }

    #[test]
    fn places_are_not_shown_over_and_over() {
        let most = |repeat: f32| {
            let mut uses = Uses::new(SIZE);
            let footage = chosen(&wanted(1.0, 0.5), &clip(1.0), Weights { repeat, ..WEIGHTS });
            footage.iter().for_each(|f| uses.add(f, 1));
            uses.counts.into_iter().max().unwrap()
        };
        assert!(most(0.3) * 2 < most(0.0), "{} {}", most(0.0), most(0.3));
    }

    #[test]
    fn a_clip_in_which_nothing_moves_has_nothing_to_give() {
        let zero = Plane::zeros(SIZE.0, SIZE.1);
        let none = vec![zero.clone(); BANDS];
        let still = Features::new([&zero, &zero], &zero, (&none, &none), &zero.map(|_| 1.0));
        let choice = Choice { clip: SIZE, phases: 1, seed: 1 };
        assert!(choose(&grid(), &wanted(1.0, 0.0), &still, &WEIGHTS, &choice).is_none());
    }
}
