//! What may be behind the fluid, made of the rest of the picture: image completion by patches, coarse to fine (Wexler,
//! Shechtman & Irani 2007), with the nearest patches found by PatchMatch (Barnes et al. 2009).

use super::extrapolate::fill;
use crate::base::{par, rng};
use crate::raster::image::{Color, Plane};
use crate::raster::pyramid::reduce;

/// A patch reaches this many pixels from its centre.
const RADIUS: usize = 3;
/// The coarsest level's shorter side is not below this many pixels.
const MIN_SIDE: usize = 24;
/// Rounds of search and vote on the coarsest level, and on each finer one.
const ROUNDS: (usize, usize) = (12, 4);
/// Steps of propagation and random search in a round.
const SEARCHES: usize = 2;
/// Farthest random search of a refined level, pixels.
const NEAR: usize = 32;
/// A patch whose distance is this many times the mean one has e⁻¹ of its vote.
const DOUBT: f32 = 0.5;
/// Salt of the random choices.
const SEED: u64 = 0x1a9a;

/// The picture with `hole` (above 0 = not known) filled with what fits its surroundings. Nothing random but what the
/// pixels decide; where the picture is too small or too covered to take patches from, colours are only continued.
pub fn inpaint(picture: &Color, hole: &Plane) -> Color {
    let known = hole.map(|h| if h > 0.0 { 0.0 } else { 1.0 });
    let mut levels = vec![Level::new(picture, &known)];
    while let Some(coarser) = levels.last().and_then(Level::coarser) {
        levels.push(coarser);
    }
    let mut matches: Option<Matches> = None;
    for (depth, level) in levels.iter_mut().enumerate().rev() {
        let first = matches.is_none();
        let found = match matches.take() {
            None => Matches::random(level, depth),
            Some(coarse) => coarse.refined(level, depth),
        };
        if found.targets.is_empty() {
            continue;
        }
        matches = Some(found);
        if let Some(matches) = &mut matches {
            if !first {
                matches.vote(level);
            }
            for round in 0..if first { ROUNDS.0 } else { ROUNDS.1 } {
                for search in 0..SEARCHES {
                    let reach = if first { level.width.max(level.height) } else { NEAR };
                    matches.search(level, reach, rng::hash(SEED, &[depth as u64, round as u64, search as u64]));
                }
                matches.vote(level);
            }
        }
    }
    levels[0].color()
}

/// The picture at one size.
struct Level {
    width: usize,
    height: usize,
    /// Packed colours; in the hole what is thought so far.
    pixels: Vec<f32>,
    known: Plane,
    /// Centres of patches that are known throughout, in order.
    sources: Vec<u32>,
    /// Whether a pixel is such a centre.
    whole: Vec<bool>,
}

impl Level {
    fn new(picture: &Color, known: &Plane) -> Self {
        let (width, height) = (known.width, known.height);
        let filled = fill(&picture.planes.each_ref(), known);
        let pixels = (0..width * height).flat_map(|i| filled.iter().map(move |p| p.data[i])).collect();
        let whole = eroded(known);
        let sources = (0..whole.len()).filter(|&i| whole[i]).map(|i| i as u32).collect();
        Self { width, height, pixels, known: known.clone(), sources, whole }
    }

    /// Half the size, unless that is too small or leaves no patch to copy.
    fn coarser(&self) -> Option<Self> {
        if self.width.min(self.height) < 2 * MIN_SIDE {
            return None;
        }
        let total = reduce(&self.known);
        let plane = |c: usize| {
            let weighted = self.pixels.iter().skip(c).step_by(3).zip(&self.known.data).map(|(p, k)| p * k).collect();
            let mut sum = reduce(&Plane::from_vec(self.width, self.height, weighted));
            sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s /= t.max(1e-6));
            sum
        };
        let known = total.map(|t| if t > 0.5 { 1.0 } else { 0.0 });
        let level = Self::new(&Color::from_planes([plane(0), plane(1), plane(2)]), &known);
        (!level.sources.is_empty()).then_some(level)
    }

    fn color(&self) -> Color {
        let plane = |c: usize| self.pixels.iter().skip(c).step_by(3).copied().collect();
        Color::from_planes([0, 1, 2].map(|c| Plane::from_vec(self.width, self.height, plane(c))))
    }

    /// Sum of squared differences of two patches, given up once it is above `limit`.
    fn distance(&self, a: usize, b: usize, limit: f32) -> f32 {
        const ROW: usize = 3 * (2 * RADIUS + 1);
        let start = |centre: usize, j: usize| 3 * (centre + j * self.width - RADIUS * self.width - RADIUS);
        let mut sum = 0.0;
        for j in 0..=2 * RADIUS {
            let (a, b) = (&self.pixels[start(a, j)..][..ROW], &self.pixels[start(b, j)..][..ROW]);
            sum += a.iter().zip(b).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
            if sum > limit {
                break;
            }
        }
        sum
    }

    /// A patch to copy, by chance.
    fn any_source(&self, chance: u64) -> usize {
        self.sources[rng::below(chance, self.sources.len() as u64) as usize] as usize
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

/// For every patch that touches the hole, the known patch most like it.
struct Matches {
    width: usize,
    /// Centres of the patches that touch the hole, in order.
    targets: Vec<u32>,
    /// Per pixel: its number among the targets, or none.
    numbers: Vec<u32>,
    /// Per target: centre of its match and their distance.
    found: Vec<(u32, f32)>,
}

/// No target.
const NONE: u32 = u32::MAX;

impl Matches {
    fn new(level: &Level, mut choose: impl FnMut(usize) -> usize) -> Self {
        let (width, height) = (level.width, level.height);
        let inside = |i: &usize| {
            let (x, y) = (i % width, i / width);
            x >= RADIUS && x + RADIUS < width && y >= RADIUS && y + RADIUS < height
        };
        let centres = (0..width * height).filter(inside).filter(|&i| !level.whole[i]);
        let targets: Vec<u32> = if level.sources.is_empty() { Vec::new() } else { centres.map(|i| i as u32).collect() };
        let mut numbers = vec![NONE; width * height];
        targets.iter().enumerate().for_each(|(n, &t)| numbers[t as usize] = n as u32);
        let found = targets.iter().map(|&t| (choose(t as usize) as u32, f32::INFINITY)).collect();
        Self { width, targets, numbers, found }
    }

    fn random(level: &Level, depth: usize) -> Self {
        Self::new(level, |t| level.any_source(rng::hash(SEED, &[depth as u64, t as u64])))
    }

    /// The matches of the next finer level.
    fn refined(&self, level: &Level, depth: usize) -> Self {
        let rows = self.numbers.len() / self.width;
        Self::new(level, |t| {
            let (x, y) = (t % level.width, t / level.width);
            let coarse = |v: usize, size: usize| (v / 2).clamp(RADIUS, size - 1 - RADIUS);
            let (cx, cy) = (coarse(x, self.width), coarse(y, rows));
            let source = match self.numbers[cy * self.width + cx] {
                NONE => None,
                n => {
                    let (source, _) = self.found[n as usize];
                    let (sx, sy) = (source as usize % self.width, source as usize / self.width);
                    let (sx, sy) = (2 * sx + x - 2 * cx.min(x / 2), 2 * sy + y - 2 * cy.min(y / 2));
                    (sx < level.width && sy < level.height && level.whole[sy * level.width + sx])
                        .then_some(sy * level.width + sx)
                }
            };
            source.unwrap_or_else(|| level.any_source(rng::hash(SEED, &[depth as u64, t as u64])))
        })
    }

    /// Improves every match from those of its neighbours, as they were, and by chance within `reach` and less.
    fn search(&mut self, level: &Level, reach: usize, seed: u64) {
        let rows = self.targets.len().div_ceil(CHUNK);
        let better = par::map(rows, |row| {
            let range = row * CHUNK..((row + 1) * CHUNK).min(self.targets.len());
            range.map(|n| self.improved(level, n, reach, seed)).collect::<Vec<_>>()
        });
        self.found = better.into_iter().flatten().collect();
    }

    fn improved(&self, level: &Level, n: usize, reach: usize, seed: u64) -> (u32, f32) {
        let target = self.targets[n] as usize;
        let mut best = self.found[n].0 as usize;
        let mut least = level.distance(target, best, f32::INFINITY);
        let mut offer = |source: usize, least: &mut f32| {
            let distance = level.distance(target, source, *least);
            if distance < *least {
                (best, *least) = (source, distance);
            }
            best
        };
        for step in [1, 4].into_iter().flat_map(|k| [k as isize, -(k as isize)]) {
            for offset in [step, step * self.width as isize] {
                let Some(&number) = target.checked_add_signed(offset).and_then(|i| self.numbers.get(i)) else {
                    continue;
                };
                if number != NONE {
                    let source = (self.found[number as usize].0 as usize).checked_add_signed(-offset);
                    if let Some(source) = source.filter(|&s| level.whole.get(s) == Some(&true)) {
                        offer(source, &mut least);
                    }
                }
            }
        }
        let (mut radius, mut k) = (reach, 0);
        let mut centre = offer(self.found[n].0 as usize, &mut least);
        while radius > 0 {
            let chance = rng::hash(seed, &[target as u64, k]);
            let shift = |bits: u64| rng::below(bits, 2 * radius as u64 + 1) as isize - radius as isize;
            let (x, y) = (centre % self.width, centre / self.width);
            let moved = x.checked_add_signed(shift(chance)).zip(y.checked_add_signed(shift(rng::hash(chance, &[1]))));
            if let Some((x, y)) = moved.filter(|&(x, y)| x < level.width && y < level.height)
                && level.whole[y * level.width + x]
            {
                centre = offer(y * level.width + x, &mut least);
            }
            (radius, k) = (radius / 2, k + 1);
        }
        (best as u32, least)
    }

    /// Gives every pixel of the hole the mean of what the patches over it have there, the better their match the more.
    fn vote(&self, level: &mut Level) {
        let finite = self.found.iter().map(|f| f.1).filter(|d| d.is_finite());
        let mean = (finite.clone().sum::<f32>() / finite.count().max(1) as f32).max(1e-6);
        let weights: Vec<f32> = self
            .found
            .iter()
            .map(|f| if f.1.is_finite() { (-f.1 / (DOUBT * mean)).exp() + 1e-6 } else { 1.0 })
            .collect();
        let (width, pixels) = (level.width, &level.pixels);
        let rows = par::map(level.height, |y| {
            let holes = (0..width).filter(|&x| level.known.at(x, y) == 0.0);
            holes.map(|x| (x, self.pixel(pixels, (x, y), &weights))).collect::<Vec<_>>()
        });
        for (y, row) in rows.into_iter().enumerate() {
            for (x, colour) in row {
                if let Some(colour) = colour {
                    level.pixels[3 * (y * width + x)..][..3].copy_from_slice(&colour);
                }
            }
        }
    }

    fn pixel(&self, pixels: &[f32], (x, y): (usize, usize), weights: &[f32]) -> Option<[f32; 3]> {
        let mut sum = [0.0; 3];
        let mut total = 0.0;
        let rows = self.numbers.len() / self.width;
        for cy in y.saturating_sub(RADIUS)..(y + RADIUS + 1).min(rows) {
            for cx in x.saturating_sub(RADIUS)..(x + RADIUS + 1).min(self.width) {
                let number = self.numbers[cy * self.width + cx];
                if number != NONE {
                    let source = self.found[number as usize].0 as usize;
                    let from = source + y * self.width + x - (cy * self.width + cx);
                    let weight = weights[number as usize];
                    sum.iter_mut().zip(&pixels[3 * from..][..3]).for_each(|(s, p)| *s += weight * p);
                    total += weight;
                }
            }
        }
        (total > 0.0).then(|| sum.map(|s| s / total))
    }
}

/// Targets that one thread improves at a time.
const CHUNK: usize = 1024;

#[cfg(test)]
mod tests {
    use super::*;

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
