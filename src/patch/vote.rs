//! Voting: every pixel becomes the mean, or the median, of what the patches over it have there (Wexler et al. 2007).

use macro_rules_attribute::apply;

use super::data::channels::{Layout, MAX_SIDE, Stack};
use super::data::field::{Cell, Nnf};
use super::data::patches::{Patches, Place, Sampler};
use super::data::pose::{Pose, Upright};
use super::data::sites::{BAND, Sites};
use crate::base::instructions::kernel;
use crate::base::options::Words;
use crate::base::par;
use crate::raster::image::Plane;
use crate::raster::pyramid::reduce;

/// A patch whose distance is this many times the mean one has e⁻¹ of its vote, where likeness counts.
const DOUBT: f32 = 0.5;
/// Steps from the mean towards the geometric median, which they nearly reach.
const MEDIAN_STEPS: usize = 3;
/// Levels of 255 by which pixels that agree may differ.
const AGREED: f32 = 2.0;

/// How overlapping patches make one pixel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Manner {
    /// Their mean: the least squares that the energy asks for.
    Mean,
    /// Their mean weighted by how near a pixel is to their centres, a Gaussian of σ = a third of the patch's reach: where patches
    /// disagree, fewer are blended, so that frames made one from another stay sharper (ours).
    Centred,
    /// As `Centred` while the frame is made, and the frame itself is their geometric median, with these weights and three steps of
    /// Weiszfeld's from the mean (1937): where patches disagree, most of them are followed instead of a blur that is like none (ours).
    Median,
    /// Their mean weighted by their squared distance to the power −0.6, so that outliers count less (Kwatra et al. 2005, r = 0.8).
    Robust,
    /// The one of them nearest to their mean, so that nothing is blended (Han et al. 2006).
    Discrete,
    /// Their mean weighted by the exponential of minus their distance, in halves of the mean one: as likely as they are alike
    /// (Wexler, Shechtman & Irani 2007).
    Likely,
}

impl Words for Manner {
    const ALL: &'static [(&'static str, Self)] = &[
        ("mean", Self::Mean),
        ("centred", Self::Centred),
        ("median", Self::Median),
        ("robust", Self::Robust),
        ("discrete", Self::Discrete),
        ("likely", Self::Likely),
    ];
}

impl Manner {
    /// Whether pixels are means by weights that do not depend on how well patches fit.
    pub(super) fn blends(self) -> bool {
        matches!(self, Self::Mean | Self::Centred | Self::Median)
    }
}

/// An image that the synthesised channels are held to: with weight `a` the energy has the term `Σ_p a(p) ‖X(p) − X̂(p)‖²`, `X̂` the
/// previous frame carried along the flow (Kwatra et al. 2005; LazyFluids, Eq. 3).
#[derive(Debug, Clone)]
pub struct Anchor {
    /// One plane a synthesised channel, values in [0, 1].
    pub planes: Vec<Plane>,
    /// Weight at every pixel, at least 0; 1 is as much as one of the n² patches over it.
    pub weight: Plane,
}

impl Anchor {
    /// The next coarser level.
    pub(super) fn reduced(&self) -> Self {
        Self { planes: self.planes.iter().map(reduce).collect(), weight: reduce(&self.weight) }
    }

    /// What `image` differs from it, in units of squared values in [0, 1] at weight 1.
    pub(super) fn energy(&self, layout: &Layout, image: &Stack) -> f64 {
        let squared = |i: usize| {
            let differences = image.pixel(i).iter().zip(&self.planes).zip(layout.channels());
            differences.map(|((&b, p), c)| c.weight * (f32::from(b) / 255.0 - p.data[i]).powi(2)).sum::<f32>()
        };
        let weights = self.weight.data.iter().enumerate();
        weights.map(|(i, &a)| if a > 0.0 { f64::from(a * squared(i)) } else { 0.0 }).sum()
    }
}

/// Source patches that vote at a target patch besides its own match.
#[derive(Debug)]
pub struct Votes {
    starts: Vec<u32>,
    places: Vec<Place>,
}

impl Votes {
    /// For every target pixel those source patches whose match, in `field` from source to target, it is.
    pub fn new(field: &Nnf, targets: usize) -> Self {
        let mut starts = vec![0u32; targets + 1];
        field.assigned().for_each(|(_, cell)| starts[cell.place.index() + 1] += 1);
        (0..targets).for_each(|i| starts[i + 1] += starts[i]);
        let mut next = starts.clone();
        let mut places = vec![Place::NONE; starts[targets] as usize];
        for (source, cell) in field.assigned() {
            let slot = &mut next[cell.place.index()];
            places[*slot as usize] = Place(source as u32);
            *slot += 1;
        }
        Self { starts, places }
    }

    /// Those at target pixel `at`.
    fn at(&self, at: usize) -> &[Place] {
        &self.places[self.starts[at] as usize..self.starts[at + 1] as usize]
    }

    /// How many there are.
    pub fn count(&self) -> usize {
        self.places.len()
    }
}

/// A field among those that are voted, and its weight.
#[derive(Debug, Clone, Copy)]
pub struct Weighted<'a, P = Upright> {
    /// The field.
    pub nnf: &'a Nnf<P>,
    /// Its weight, above 0.
    pub weight: f32,
}

/// What a rule has to say on voting.
#[derive(Debug, Clone, Copy)]
pub struct Voting<'a> {
    /// How the overlapping patches make one pixel.
    pub manner: Manner,
    /// Source patches that vote besides.
    pub back: Option<&'a Votes>,
}

/// What is voted: fields, and the image whose pixels their places name.
#[derive(Debug, Clone, Copy)]
pub(super) struct Vote<'a, P = Upright> {
    /// All of one size.
    pub fields: &'a [Weighted<'a, P>],
    /// The target, whose frames turn what is laid on it.
    pub target: &'a Patches,
    pub source: &'a Patches,
    /// The voted channels of the source alone, where patches are upright.
    pub colours: &'a Stack,
    /// Reach of a patch.
    pub radius: usize,
    /// How many channels are voted, the first ones.
    pub channels: usize,
    /// How the overlapping patches make one pixel.
    pub manner: Manner,
    /// Source patches that vote besides, and the weight of each.
    pub back: Option<(&'a Votes, f32)>,
    /// An image that votes besides.
    pub anchor: Option<&'a Anchor>,
    /// What a distance is multiplied by, where likeness counts.
    pub doubt: f32,
}

/// What distances are multiplied by in [`Manner::Likely`].
pub(super) fn doubt<P: Pose>(fields: &[Weighted<P>]) -> f32 {
    let (sum, count) = fields.iter().fold((0, 0), |(s, n), f| (s + f.nnf.total(), n + f.nnf.assigned().count()));
    (count as f32 / (DOUBT * sum.max(1) as f32)).min(1e6)
}

impl<P: Pose> Vote<'_, P> {
    /// Width and height of the target in pixels.
    fn size(&self) -> (usize, usize) {
        (self.target.stack.width, self.target.stack.height)
    }

    /// Overwrites the voted channels of `target`, rounded to bytes; pixels under no patch become 0.
    pub fn write(&self, target: &mut Stack) {
        let (width, channels) = (target.width, target.channels);
        par::for_each_chunk(target.bytes_mut(), BAND * width * channels, |band, bytes| {
            let mut sums = vec![0.0; width * self.channels];
            for (j, row) in bytes.chunks_exact_mut(width * channels).enumerate() {
                self.row(band * BAND + j, &mut sums);
                for (pixel, sums) in row.chunks_exact_mut(channels).zip(sums.chunks_exact(self.channels)) {
                    pixel.iter_mut().zip(sums).for_each(|(p, s)| *p = (s + 0.5) as u8);
                }
            }
        });
    }

    /// The voted channels of a finished frame as planes with values in [0, 1], not rounded.
    pub fn planes(&self) -> Vec<Plane> {
        let (width, height) = self.size();
        let rows = par::map(height, |y| {
            let mut sums = vec![0.0; width * self.channels];
            self.row(y, &mut sums);
            if self.manner == Manner::Median {
                (0..MEDIAN_STEPS).for_each(|_| self.towards_medians(y, &mut sums));
            }
            sums
        });
        let value = |c: usize, x: usize, y: usize| rows[y][x * self.channels + c] * (1.0 / 255.0);
        (0..self.channels).map(|c| Plane::from_fn(width, height, |x, y| value(c, x, y))).collect()
    }

    /// The voted bytes of row `y`, not rounded.
    fn row(&self, y: usize, sums: &mut [f32]) {
        let mut totals = vec![0.0; self.size().0];
        sums.fill(0.0);
        match (self.channels, self.radius) {
            (3, 2) => add_patches::<P, 15>(self, y, sums, &mut totals),
            (4, 2) => add_patches::<P, 20>(self, y, sums, &mut totals),
            _ => add_patches::<P, 0>(self, y, sums, &mut totals),
        }
        self.divide(y, sums, &mut totals, |_, _| 1.0);
        if self.manner == Manner::Discrete {
            self.snap(y, sums);
        }
    }

    /// From sums to means, the anchor among them; `weigh(x, pixel)` weighs it besides.
    fn divide(&self, y: usize, sums: &mut [f32], totals: &mut [f32], weigh: impl Fn(usize, &[u8]) -> f32) {
        if let Some(anchor) = self.anchor {
            let mut held = vec![0; self.channels];
            for (x, total) in totals.iter_mut().enumerate().filter(|(_, total)| **total > 0.0) {
                held.iter_mut().zip(&anchor.planes).for_each(|(h, p)| *h = (p.at(x, y).clamp(0.0, 1.0) * 255.0) as u8);
                let weight = anchor.weight.at(x, y) * weigh(x, &held);
                let sum = &mut sums[x * self.channels..][..self.channels];
                sum.iter_mut().zip(&anchor.planes).for_each(|(s, p)| *s += weight * 255.0 * p.at(x, y));
                *total += weight;
            }
        }
        for (pixel, &total) in sums.chunks_exact_mut(self.channels).zip(totals.iter()) {
            let share = if total > 0.0 { 1.0 / total } else { 0.0 };
            pixel.iter_mut().for_each(|s| *s *= share);
        }
    }

    /// Moves the means of row `y` a step towards the geometric medians of what is voted: every pixel weighs by how near it
    /// is to them.
    fn towards_medians(&self, y: usize, means: &mut [f32]) {
        let (channels, window, before) = (self.channels, self.window(), means.to_vec());
        let near = |x: usize, pixel: &[u8]| {
            let differences = before[x * channels..].iter().zip(pixel).map(|(m, &p)| m - f32::from(p));
            (AGREED * AGREED + differences.map(|d| d * d).sum::<f32>()).sqrt().recip()
        };
        let mut totals = vec![0.0; self.size().0];
        means.fill(0.0);
        self.overlapping(y, |first, pixels, weight| {
            for (k, pixel) in pixels.chunks_exact(channels).enumerate() {
                let weight = weight * window[k] * near(first + k, pixel);
                let sum = &mut means[(first + k) * channels..][..channels];
                sum.iter_mut().zip(pixel).for_each(|(s, &p)| *s += weight * f32::from(p));
                totals[first + k] += weight;
            }
        });
        self.divide(y, means, &mut totals, near);
    }

    /// Replaces every mean by the voted pixel that is nearest to it.
    fn snap(&self, y: usize, means: &mut [f32]) {
        let channels = self.channels;
        let mut nearest = vec![f32::INFINITY; self.size().0];
        let mut chosen = means.to_vec();
        self.overlapping(y, |first, pixels, _| {
            for (k, pixel) in pixels.chunks_exact(channels).enumerate() {
                let x = first + k;
                let mean = &means[x * channels..][..channels];
                let distance = mean.iter().zip(pixel).map(|(m, &p)| (m - f32::from(p)).powi(2)).sum::<f32>();
                if distance < nearest[x] {
                    nearest[x] = distance;
                    chosen[x * channels..][..channels].iter_mut().zip(pixel).for_each(|(c, &p)| *c = f32::from(p));
                }
            }
        });
        means.copy_from_slice(&chosen);
    }

    /// Calls `visit(x, pixels, weight)` for all that is voted in row `y`, in a fixed order: a row of a patch, where it
    /// begins, and the row's weight.
    #[inline(always)]
    fn overlapping(&self, y: usize, mut visit: impl FnMut(usize, &[u8], f32)) {
        let ((width, height), radius) = (self.size(), self.radius);
        let (bytes, length) = (self.colours.bytes(), (2 * radius + 1) * self.channels);
        let window = self.window();
        let in_place = P::UPRIGHT && self.target.in_place();
        let mut sampled = vec![0; if in_place { 0 } else { length }];
        for cy in y.saturating_sub(radius)..(y + radius + 1).min(height) {
            let down = y as isize - cy as isize;
            let across = window[(radius as isize + down) as usize];
            let mut patch = |cx: usize, place: Place, weight: f32| {
                // A patch lies within its image on both sides.
                let first = (place.index() as isize + down * self.colours.width as isize) as usize - radius;
                visit(cx - radius, &bytes[first * self.channels..][..length], weight * across);
            };
            if !in_place {
                self.sampled(cy, down as i32, &mut sampled, |x, pixels, weight| visit(x, pixels, weight * across));
                continue;
            }
            for cx in 0..width {
                let at = cy * width + cx;
                for field in self.fields {
                    let cell = field.nnf.cells[at];
                    if cell.place != Place::NONE {
                        patch(cx, cell.place, field.weight * self.weight(cell));
                    }
                }
                if let Some((votes, weight)) = self.back {
                    votes.at(at).iter().for_each(|&place| patch(cx, place, weight));
                }
            }
        }
    }

    /// The same for the sites of row `cy`, of patches that are sampled between pixels: what each has `down` pixels below.
    fn sampled(&self, cy: usize, down: i32, row: &mut [u8], mut visit: impl FnMut(usize, &[u8], f32)) {
        let (width, radius) = (self.size().0, self.radius);
        for (cx, at) in (0..width).map(|cx| (cx, cy * width + cx)) {
            for field in self.fields {
                let cell = field.nnf.cells[at];
                if cell.place != Place::NONE {
                    let matrix = cell.pose.matrix().after(self.target.frame(at));
                    Sampler::new(self.source, cell.place, matrix).row((radius as i32, down), self.channels, row);
                    visit(cx - radius, row, field.weight * self.weight(cell));
                }
            }
        }
    }

    /// Weight of every column, and row, of a patch; 1 on average.
    fn window(&self) -> [f32; MAX_SIDE] {
        let (radius, side) = (self.radius as f32, 2 * self.radius + 1);
        let weight = |k: usize| match self.manner {
            Manner::Centred | Manner::Median => (-0.5 * ((k as f32 - radius) / (radius / 3.0)).powi(2)).exp(),
            Manner::Mean | Manner::Robust | Manner::Discrete | Manner::Likely => 1.0,
        };
        let sum: f32 = (0..side).map(weight).sum();
        std::array::from_fn(|k| weight(k) * side as f32 / sum)
    }

    fn weight(&self, cell: Cell<P>) -> f32 {
        match self.manner {
            Manner::Mean | Manner::Centred | Manner::Median | Manner::Discrete => 1.0,
            Manner::Robust => (cell.distance as f32 + 1.0).powf(-0.6),
            // Nobody is without a say, or a place where all are unlike would have no colour.
            Manner::Likely => (-self.doubt * cell.distance as f32).exp() + 1e-6,
        }
    }
}

/// Adds the patches over row `y` to `sums`, and their weights to `totals`. A row of a patch has `N` bytes, or any number
/// where `N` is 0.
#[apply(kernel)]
fn add_patches<P: Pose, const N: usize>(vote: &Vote<P>, y: usize, sums: &mut [f32], totals: &mut [f32]) {
    let (channels, side) = (vote.channels, 2 * vote.radius + 1);
    let length = if N > 0 { N } else { side * channels };
    let window = vote.window();
    let weights: Vec<f32> = (0..length).map(|i| window[i / channels]).collect();
    vote.overlapping(y, |x, pixels, weight| {
        let sums = &mut sums[x * channels..][..length];
        for ((sum, &pixel), &across) in sums.iter_mut().zip(&pixels[..length]).zip(&weights[..length]) {
            *sum += weight * across * f32::from(pixel);
        }
        totals[x..][..side].iter_mut().zip(&window[..side]).for_each(|(total, across)| *total += weight * across);
    });
}

#[cfg(test)]
mod tests {
    use super::super::data::pose::Turn;
    use super::super::testing::{grey_patches, texture};
    use super::*;

    fn voted(cells: &[(usize, u32, u32)], manner: Manner) -> Plane {
        let (source, target) = (grey_patches(&texture(20, 20, 0.0), 1), grey_patches(&Plane::zeros(9, 7), 1));
        let mut nnf = Nnf { width: 9, cells: vec![Cell::NONE; 63] };
        cells.iter().for_each(|&(i, place, distance)| nnf.cells[i] = Cell::new(Place(place), distance));
        votes(&[Weighted { nnf: &nnf, weight: 1.0 }], &target, &source, manner)
    }

    fn votes<P: Pose>(fields: &[Weighted<P>], target: &Patches, source: &Patches, manner: Manner) -> Plane {
        let (colours, doubt) = (&source.stack, doubt(fields));
        let (back, anchor) = (None, None);
        Vote { fields, target, source, colours, radius: 1, channels: 1, manner, back, anchor, doubt }.planes().remove(0)
    }

    #[test]
    fn pixels_are_means_of_the_patches_over_them_and_0_elsewhere() {
        let source = grey_patches(&texture(20, 20, 0.0), 1).stack;
        let value = |i: usize| f32::from(source.pixel(i)[0]) / 255.0;
        // Patches round (3, 3) and (4, 3).
        let both = [(30, 45, 0), (31, 150, 0)];
        let mean = voted(&both, Manner::Mean);
        assert!((mean.at(3, 3) - (value(45) + value(149)) / 2.0).abs() < 1e-6);
        assert!((mean.at(2, 2) - value(45 - 21)).abs() < 1e-6 && (mean.at(5, 4) - value(150 + 21)).abs() < 1e-6);
        assert_eq!((mean.at(1, 3), mean.at(6, 3), mean.at(3, 5)), (0.0, 0.0, 0.0));
        // Round (3, 3) one patch has its middle there, the other its side: weights 1 and exp(-9 / 2).
        let (side, centred) = ((-4.5f32).exp(), voted(&both, Manner::Centred));
        assert!((centred.at(3, 3) - (value(45) + side * value(149)) / (1.0 + side)).abs() < 1e-5);
        let discrete = voted(&both, Manner::Discrete);
        assert!([value(45), value(149)].iter().any(|v| (discrete.at(3, 3) - v).abs() < 1e-6));
        // Two that agree and one that does not: nearer to the two than their mean is.
        let three = [(30, 45, 0), (31, 46, 0), (29, 150, 0)];
        let far = |manner| (voted(&three, manner).at(3, 3) - value(45)).abs();
        assert!(far(Manner::Median) < far(Manner::Centred), "{} {}", far(Manner::Median), far(Manner::Centred));
        assert!((voted(&both[..1], Manner::Median).at(3, 3) - value(45)).abs() < 1e-5);
        let robust = voted(&[(30, 45, 0), (31, 150, 1_000_000)], Manner::Robust);
        assert!((robust.at(3, 3) - value(45)).abs() < 1e-3);
    }

    #[test]
    fn several_fields_vote_by_their_weights_and_turned_patches_between_pixels() {
        let (source, target) = (grey_patches(&texture(20, 20, 0.0), 1), grey_patches(&Plane::zeros(9, 7), 1));
        let field = |place: u32, pose: Turn| {
            let mut nnf = Nnf { width: 9, cells: vec![Cell::none(); 63] };
            nnf.cells[30] = Cell { place: Place(place), distance: 0, pose };
            nnf
        };
        let value = |i: usize| f32::from(source.stack.pixel(i)[0]) / 255.0;
        let (a, b) = (field(45, Turn::degrees(0.0)), field(150, Turn::degrees(90.0)));
        let both = [Weighted { nnf: &a, weight: 3.0 }, Weighted { nnf: &b, weight: 1.0 }];
        let mean = votes(&both, &target, &source, Manner::Mean);
        assert!((mean.at(3, 3) - (3.0 * value(45) + value(150)) / 4.0).abs() < 1e-5);
        // What shows above the middle of a patch turned clockwise lay to its left.
        assert!((mean.at(3, 2) - (3.0 * value(45 - 20) + value(150 - 1)) / 4.0).abs() < 1e-5);
        let likely = voted(&[(30, 45, 10), (31, 150, 90)], Manner::Likely);
        let (near, far) = ((-10.0f32 / 25.0).exp(), (-90.0f32 / 25.0).exp());
        assert!((likely.at(3, 3) - (near * value(45) + far * value(149)) / (near + far)).abs() < 1e-4);
    }
}
