//! What may be behind the fluid, made of the rest of the picture: image completion by patches, coarse to fine (Wexler,
//! Shechtman & Irani 2007), with the nearest patches found by PatchMatch (Barnes et al. 2009), on the patch engine.

use super::extrapolate::fill;
use crate::base::error::Result;
use crate::base::observe::Silent;
use crate::patch::data::channels::{Channel, Layout, Role};
use crate::patch::data::pose::Upright;
use crate::patch::engine::{Engine, Image, Layer, Settings, Target};
use crate::patch::rules::{Constraint, Plain};
use crate::patch::session::Session;
use crate::patch::vote::Manner;
use crate::raster::image::{Color, Plane};
use crate::raster::pyramid::reduce;

/// A patch reaches this many pixels from its centre.
const RADIUS: usize = 3;
/// The coarsest level's shorter side is not below this many pixels.
const MIN_SIDE: usize = 24;
/// Rounds of search and vote on the coarsest level, and on the finest.
const ROUNDS: (usize, usize) = (12, 4);
/// The search in a round: farthest random places of a refined level in pixels.
const SEARCH: Plain = Plain { sweeps: 2, near: Some(32) };
/// Seed of the random choices.
const SEED: u64 = 0x1a9a;

/// The picture with `hole` (above 0 = not known) filled with what fits its surroundings. Nothing random but what the
/// pixels decide; where the picture is too small or too covered to take patches from, colours are only continued.
pub fn inpaint(picture: &Color, hole: &Plane) -> Color {
    let known = hole.map(|h| if h > 0.0 { 0.0 } else { 1.0 });
    let mut levels = vec![Level::new(picture, &known)];
    while let Some(coarser) = levels.last().and_then(Level::coarser) {
        levels.push(coarser);
    }
    let [red, green, blue] = levels[0].planes.clone();
    // Without a patch to copy there is nothing but the continued colours.
    let planes = completed(&levels).unwrap_or_else(|_| vec![red, green, blue]);
    let mut planes = planes.into_iter();
    Color::from_planes(std::array::from_fn(|c| planes.next().unwrap_or_else(|| levels[0].planes[c].clone())))
}

/// The finest level, completed by the engine.
fn completed(levels: &[Level]) -> Result<Vec<Plane>> {
    let channel = |name: &str| Channel::new(name, 1.0, Role::Synthesised);
    let layout = Layout::new(RADIUS, ["red", "green", "blue"].map(channel).to_vec())?;
    let settings =
        Settings { iterations: ROUNDS, manner: Manner::Likely, tolerance: 0.0, seed: SEED, ..Settings::default() };
    let engine = Engine::new(layout, settings);
    let layers = |whole: bool| levels.iter().map(|level| level.layer(whole)).collect::<Vec<_>>();
    let source = engine.prepared(&layers(true))?;
    let image = Image { planes: levels[0].planes.to_vec(), blurred: None };
    let target = [Target { prepared: Some(layers(false)), ..Target::new(image) }];
    let rule = || -> Box<dyn Constraint<Upright>> { Box::new(SEARCH) };
    let mut session = Session::begin(&engine, &source, &target, &rule, None, &Silent)?;
    for level in (0..session.levels()).rev() {
        session.enter(level, 0);
        session.work(level, 0, &Silent)?;
    }
    Ok(session.finish(0)?.planes)
}

/// The picture at one size.
struct Level {
    /// Colours; in the hole those around, continued.
    planes: [Plane; 3],
    known: Plane,
    /// Whether a pixel is the centre of a patch that is known throughout.
    whole: Vec<bool>,
}

impl Level {
    fn new(picture: &Color, known: &Plane) -> Self {
        let filled = fill(&picture.planes.each_ref(), known);
        let mut filled = filled.into_iter();
        let planes = std::array::from_fn(|c| filled.next().unwrap_or_else(|| picture.planes[c].clone()));
        Self { planes, known: known.clone(), whole: eroded(known) }
    }

    /// Half the size, unless that is too small or leaves no patch to copy.
    fn coarser(&self) -> Option<Self> {
        if self.known.width.min(self.known.height) < 2 * MIN_SIDE {
            return None;
        }
        let total = reduce(&self.known);
        let plane = |plane: &Plane| {
            let weighted = plane.data.iter().zip(&self.known.data).map(|(p, k)| p * k).collect();
            let mut sum = reduce(&Plane::from_vec(plane.width, plane.height, weighted));
            sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s /= t.max(1e-6));
            sum
        };
        let known = total.map(|t| if t > 0.5 { 1.0 } else { 0.0 });
        let level = Self::new(&Color::from_planes(self.planes.each_ref().map(plane)), &known);
        level.whole.contains(&true).then_some(level)
    }

    /// As the engine takes it: patches to copy are known throughout, those to complete are not; what is known stays.
    fn layer(&self, whole: bool) -> Layer {
        let centres = self.whole.iter().map(|&w| w == whole).collect();
        let fixed = self.known.data.iter().map(|&k| k > 0.0).collect();
        Layer { centres: Some(centres), fixed: Some(fixed), ..Layer::new(self.planes.to_vec(), None) }
    }
}

/// Centres of patches that lie in the picture and are known throughout.
fn eroded(known: &Plane) -> Vec<bool> {
    let (width, height) = (known.width, known.height);
    let run = |row: &[bool], x: usize| {
        x >= RADIUS && x + RADIUS < row.len() && row[x - RADIUS..=x + RADIUS].iter().all(|&k| k)
    };
    let rows: Vec<Vec<bool>> = (0..height)
        .map(|y| {
            let row: Vec<bool> = known.row(y).iter().map(|&k| k > 0.0).collect();
            (0..width).map(|x| run(&row, x)).collect()
        })
        .collect();
    let column =
        |x: usize, y: usize| y >= RADIUS && y + RADIUS < height && rows[y - RADIUS..=y + RADIUS].iter().all(|r| r[x]);
    (0..width * height).map(|i| column(i % width, i / width)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::{par, rng};

    fn hole(width: usize, height: usize) -> Plane {
        Plane::from_fn(width, height, |x, y| {
            let d = (x as f32 - width as f32 / 2.0).hypot(y as f32 - height as f32 / 2.0);
            if d < height as f32 / 5.0 { 1.0 } else { 0.0 }
        })
    }

    fn grey(plane: &Plane) -> Color {
        Color::from_planes(std::array::from_fn(|_| plane.clone()))
    }

    #[test]
    fn a_pattern_goes_on_through_the_hole_and_the_rest_stays() {
        let stripes = Plane::from_fn(160, 120, |x, y| if (x + y / 3) / 6 % 2 == 0 { 0.2 } else { 0.8 });
        let mask = hole(160, 120);
        let torn = Plane::from_fn(160, 120, |x, y| if mask.at(x, y) > 0.0 { 0.5 } else { stripes.at(x, y) });
        let out = inpaint(&grey(&torn), &mask);
        let mut wrong = 0;
        for (i, (o, s)) in out.planes[1].data.iter().zip(&stripes.data).enumerate() {
            if mask.data[i] == 0.0 {
                assert_eq!(o, s);
            } else if (o - s).abs() > 0.2 {
                wrong += 1;
            }
        }
        let size = mask.data.iter().filter(|&&m| m > 0.0).count();
        assert!(wrong * 6 < size, "{wrong} of {size}");
    }

    #[test]
    fn threads_do_not_change_it() {
        let noise = Plane::from_fn(90, 70, |x, y| rng::unit(rng::hash(3, &[x as u64 / 3, y as u64 / 3])));
        let once = |threads| par::with_threads(threads, || inpaint(&grey(&noise), &hole(90, 70))).unwrap();
        assert_eq!(once(1), once(3));
    }

    #[test]
    fn a_picture_without_patches_is_continued() {
        let ramp = Plane::from_fn(60, 50, |x, _| x as f32 / 60.0);
        let edges = Plane::from_fn(60, 50, |x, _| if (2..58).contains(&x) { 1.0 } else { 0.0 });
        let out = inpaint(&grey(&ramp), &edges);
        assert!(out.planes[0].data.iter().all(|v| v.is_finite()));
        assert!(out.planes[0].at(10, 20) < out.planes[0].at(50, 20));
        let nothing = inpaint(&grey(&ramp), &Plane::filled(60, 50, 1.0));
        assert!(nothing.planes[0].data.iter().all(|v| v.is_finite()));
    }
}
