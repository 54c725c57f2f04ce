//! The picture's own fluid as its exemplar: its parts keep to themselves, and what comes in over an edge is more of the
//! fluid beside it.
//!
//! LazyFluids leaves new fluid to chance (λ_q = 0, Eq. 6), and with equal use it is made of what is left over: foam in the
//! sky. Here it is the picture mirrored at that edge, as it would have come in had it been there (ours).

use crate::base::par;
use crate::base::rng;
use crate::flow::field::Field;
use crate::raster::components::Components;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::premultiplied::Premultiplied;
use crate::render::mirror::Mirror;

/// Alpha from which on a pixel belongs to a part of the fluid.
const SEEN: f32 = 0.5 / 255.0;
/// Parts besides the largest that are told apart; the rest count as one.
const PARTS: usize = 8;
/// How far around a part its number holds, pixels (σ).
const NEAR: f32 = 2.0;
/// How deep the mirror is looked into before it begins anew, pixels of the working image.
const DEPTH: f32 = 128.0;
/// Motion that brings in nothing, pixels a frame.
const STILL: f32 = 0.01;
/// Places begin anew at different times: size of a place (σ, pixels) and deviation of its time, as a share.
const PLACE: (f32, f32) = (64.0, 0.25);

/// A fluid that is its own exemplar.
#[derive(Debug, Clone)]
pub struct Own {
    picture: Premultiplied,
    mirror: Mirror,
    /// When a place begins anew, in shares of how long it takes.
    phase: Plane,
    /// Number in [0, 1] of the part that a pixel is in or near, the largest ones farthest apart; without it there is one part.
    pub parts: Option<Plane>,
}

impl Own {
    /// For the fluid of a picture, which must not be transparent all over.
    pub fn new(picture: &Premultiplied, seed: u64) -> Self {
        let (width, height) = picture.size();
        let noise = Plane::from_fn(width, height, |x, y| rng::unit(rng::hash(seed, &[x as u64, y as u64])) - 0.5);
        // The mean of white noise over a Gaussian has 1 / (2 √π σ) of its deviation, which is 1 / √12.
        let spread = PLACE.1 * 2.0 * (12.0 * std::f32::consts::PI).sqrt() * PLACE.0;
        let phase = gaussian(&noise, PLACE.0).map(|v| v * spread);
        let mirror = Mirror::new(picture.alpha());
        Self { picture: picture.clone(), mirror, phase, parts: parts(picture.alpha()) }
    }

    /// Adds to `before`, the frame before as carried to frame `t` along `flow`, what comes in: where it is less opaque than
    /// the picture.
    pub fn fill(&self, before: &mut Premultiplied, flow: &Field, t: i64) {
        let (width, alpha) = (flow.width(), self.picture.alpha());
        let came = par::map(alpha.data.len(), |i| {
            let missing = alpha.data[i] - before.alpha().data[i];
            if missing <= SEEN {
                return [0.0; 4];
            }
            let (x, y) = self.origin((i % width, i / width), flow, t);
            let sample = self.picture.planes.each_ref().map(|p| p.bilinear(x, y));
            sample.map(|v| missing * v / sample[3].max(SEEN))
        });
        for (c, plane) in before.planes.iter_mut().enumerate() {
            plane.data.iter_mut().zip(&came).for_each(|(v, came)| *v = (*v + came[c]).min(1.0));
        }
    }

    /// Where in the picture, pixels with centres at ½, that lies which comes in at a pixel in frame `t`.
    fn origin(&self, (x, y): (usize, usize), flow: &Field, t: i64) -> (f32, f32) {
        let (u, v) = (flow.u.at(x, y), flow.v.at(x, y));
        let span = (DEPTH / u.hypot(v).max(STILL)).max(1.0);
        let frames = 1.0 + (t.unsigned_abs() as f32 + self.phase.at(x, y) * span).rem_euclid(span);
        self.mirror.place(x as f32 + 0.5 - frames * u, y as f32 + 0.5 - frames * v)
    }
}

/// Numbers of the parts, from the largest on: 1, 0, ½, ¼, ¾, … (van der Corput), so that large ones are far apart.
fn parts(alpha: &Plane) -> Option<Plane> {
    let parts = Components::above(alpha, SEEN);
    if parts.sizes.len() < 2 {
        return None;
    }
    let mut order: Vec<usize> = (0..parts.sizes.len()).collect();
    order.sort_by_key(|&k| std::cmp::Reverse(parts.sizes[k]));
    let mut numbers = vec![1.0; 1 + parts.sizes.len()];
    for (rank, &k) in order.iter().enumerate().skip(1) {
        numbers[1 + k] = halves(rank.min(PARTS) - 1);
    }
    // Just outside too, where patches reach.
    let times = |number: &dyn Fn(u32) -> f32| {
        let data = parts.labels.iter().zip(&alpha.data).map(|(&l, a)| a * number(l)).collect();
        gaussian(&Plane::from_vec(alpha.width, alpha.height, data), NEAR)
    };
    let (mut near, weight) = (times(&|l| numbers[l as usize]), times(&|_| 1.0));
    near.data.iter_mut().zip(&weight.data).for_each(|(n, w)| *n = if *w > 1e-4 { *n / w } else { 0.0 });
    Some(near)
}

/// 0, ½, ¼, ¾, ⅛, …
fn halves(mut n: usize) -> f32 {
    let (mut sum, mut share) = (0.0, 0.5);
    while n > 0 {
        sum += share * (n % 2) as f32;
        n /= 2;
        share /= 2.0;
    }
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::image::Color;

    /// Fluid in columns 10 to 29, red growing downwards.
    fn own(alpha: impl Fn(usize, usize) -> f32) -> (Premultiplied, Own) {
        let alpha = Plane::from_fn(40, 60, alpha);
        let red = Plane::from_fn(40, 60, |_, y| y as f32 / 60.0);
        let colour = Color::from_planes([red, Plane::filled(40, 60, 0.5), Plane::filled(40, 60, 0.2)]);
        let picture = Premultiplied::new(&colour, &alpha);
        (picture.clone(), Own::new(&picture, 1))
    }

    #[test]
    fn what_comes_in_is_the_fluid_beside_the_edge_and_nothing_else_changes() {
        let (picture, own) = own(|x, _| f32::from((10..30).contains(&x)));
        assert_eq!(own.parts, None);
        let flow = Field { u: Plane::zeros(40, 60), v: Plane::filled(40, 60, 2.0) };
        let mut before = picture.clone();
        for plane in &mut before.planes {
            plane.data[..2 * 40].fill(0.0);
        }
        own.fill(&mut before, &flow, 5);
        assert_eq!(before.alpha(), picture.alpha());
        for x in 10..30 {
            let (red, green) = (before.planes[0].at(x, 1), before.planes[1].at(x, 1));
            assert!((0.0..=1.0).contains(&red) && (green - 0.5).abs() < 1e-4, "{x}: {red} {green}");
        }
        for (a, b) in before.planes.iter().zip(&picture.planes) {
            assert_eq!(a.data[2 * 40..], b.data[2 * 40..]);
        }
    }

    #[test]
    fn new_fluid_joins_what_came_in_before() {
        let (_, mut own) = own(|_, _| 1.0);
        own.phase = Plane::zeros(40, 60);
        let flow = Field { u: Plane::zeros(40, 60), v: Plane::filled(40, 60, 2.0) };
        // What comes in at the top at t lies next to what came in at t + 1, one step deeper.
        let depth = |t: i64, y: usize| own.origin((20, y), &flow, t).1;
        assert!((depth(3, 0) - depth(3, 1) - 1.0).abs() < 1e-3, "{} {}", depth(3, 0), depth(3, 1));
        assert!((depth(4, 1) - depth(3, 0) - 1.0).abs() < 1e-3, "{} {}", depth(4, 1), depth(3, 0));
    }

    #[test]
    fn parts_are_numbered_by_size() {
        let (_, own) = own(|x, y| f32::from(x < 5 || (x > 8 && y > 30) || (x > 30 && y < 10)));
        let parts = own.parts.unwrap();
        for (x, y, number) in [(20, 50, 1.0), (2, 2, 0.0), (5, 2, 0.0), (35, 2, 0.5)] {
            assert!((parts.at(x, y) - number).abs() < 1e-4, "{x}, {y}: {}", parts.at(x, y));
        }
    }
}
