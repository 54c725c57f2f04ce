//! Channels of a patch: what is compared, how much it counts, and how it lies in memory.
//!
//! All channels of a pixel lie side by side as bytes, so that a row of a patch is one short run of memory. The distance of
//! two patches is `Σ_pixels Σ_c w_c (z_c − x_c)²` (LazyFluids, Eq. 9), with `w_c` as whole numbers up to [`MAX_WEIGHT`].

use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Plane;

/// Bytes of a row compared at a time.
pub(in crate::patch) const LANES: usize = 32;
/// Most channels; a row of a patch may have any number of lanes.
pub const MAX_CHANNELS: usize = 64;
/// Longest side of a patch.
pub const MAX_SIDE: usize = 9;
/// Largest weight of a channel in whole numbers: a difference of bytes times it still fits 16 bits.
pub const MAX_WEIGHT: u32 = 128;
/// Steps of the spatially varying weight; 0 switches the modulated channels off, this is their full weight.
pub const MODULATION: u8 = 64;

/// What the engine does with a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// Made by voting.
    Synthesised,
    /// Given, and compared with its weight everywhere.
    Guide,
    /// Given, and compared with its weight times the target's modulation at the patch centre (λ_q of LazyFluids, Eq. 6).
    Modulated,
}

/// One channel.
#[derive(Debug, Clone, PartialEq)]
pub struct Channel {
    /// Its name, for messages and debug pictures.
    pub name: String,
    /// Its weight in the distance, at least 0.
    pub weight: f32,
    /// What is done with it.
    pub role: Role,
}

impl Channel {
    /// A channel from its parts.
    pub fn new(name: &str, weight: f32, role: Role) -> Self {
        Self { name: name.to_owned(), weight, role }
    }
}

/// The channels of a method and the size of its patches.
///
/// # Quantisation
/// Values are bytes, `v × 255` rounded. Weights are whole numbers `W_c`, at most [`MAX_WEIGHT`], chosen with one scale `s` so
/// that the largest relative error of `W_c / s` is least; it is below ½ / (s w_c). LazyFluids' weights 1, 3, η = 3, λ = 0.2 and
/// 3 λ are exact (40, 120, 120, 8, 24). The modulation has [`MODULATION`] steps.
#[derive(Debug, Clone)]
pub struct Layout {
    channels: Vec<Channel>,
    synthesised: usize,
    radius: usize,
    /// Distance in whole numbers of a squared difference of 1 at weight 1.
    unit: f64,
    /// Bytes of a row of a patch, in whole lanes.
    row: usize,
    /// For every step of the modulation the weights of one row of a patch, one number a byte; 0 beyond the patch.
    weights: Vec<Box<[i16]>>,
}

impl Layout {
    /// Patches of side `2 radius + 1` over `channels`, the synthesised ones first.
    ///
    /// # Errors
    /// A radius outside 1 to 4, no synthesised channel, one behind a guide, a weight that is negative or not finite, no
    /// positive weight, or more than [`MAX_CHANNELS`] channels.
    pub fn new(radius: usize, channels: Vec<Channel>) -> Result<Self> {
        let side = 2 * radius + 1;
        let refuse = |problem: String| Error::new(Kind::Usage, "patch channels", problem);
        if !(1..=4).contains(&radius) {
            return Err(refuse(format!("a patch radius of {radius}")).allowed("1 to 4"));
        }
        let synthesised = channels.iter().take_while(|c| c.role == Role::Synthesised).count();
        if synthesised == 0 || channels[synthesised..].iter().any(|c| c.role == Role::Synthesised) {
            return Err(refuse("the synthesised channels must come first, and there must be one".into()));
        }
        if channels.len() > MAX_CHANNELS {
            return Err(refuse(format!("{} channels", channels.len())).allowed(format!("at most {MAX_CHANNELS}")));
        }
        if let Some(bad) = channels.iter().find(|c| !(c.weight.is_finite() && c.weight >= 0.0)) {
            return Err(refuse(format!("the weight of {} is {}", bad.name, bad.weight)).allowed("0 or more"));
        }
        let scale = scale(channels.iter().map(|c| f64::from(c.weight)), side)
            .ok_or_else(|| refuse("all weights are 0".into()))?;
        let weights = (0..=MODULATION).map(|step| row_weights(&channels, side, scale, step).into()).collect();
        let row = (side * channels.len()).next_multiple_of(LANES);
        Ok(Self { channels, synthesised, radius, unit: scale * 255.0 * 255.0, row, weights })
    }

    /// The channels in the order in which they lie in memory.
    pub fn channels(&self) -> &[Channel] {
        &self.channels
    }

    /// How many of them are synthesised; these come first.
    pub fn synthesised(&self) -> usize {
        self.synthesised
    }

    /// Reach of a patch from its centre in pixels.
    pub fn radius(&self) -> usize {
        self.radius
    }

    /// Side of a patch in pixels.
    pub fn side(&self) -> usize {
        2 * self.radius + 1
    }

    /// A distance in whole numbers, as searches find it, in units of squared values in [0, 1] at weight 1.
    pub fn to_energy(&self, distance: f64) -> f64 {
        distance / self.unit
    }

    /// A cost in units of squared values in [0, 1] at weight 1 as searches count it.
    pub fn to_distance(&self, energy: f64) -> u32 {
        (energy * self.unit).round().clamp(0.0, f64::from(u32::MAX / 4)) as u32
    }

    /// Bytes of a row of a patch, in whole lanes.
    #[inline]
    pub(in crate::patch) fn row(&self) -> usize {
        self.row
    }

    /// Weights of one row of a patch at a step of the modulation.
    #[inline]
    pub(in crate::patch) fn weights(&self, step: u8) -> &[i16] {
        &self.weights[usize::from(step.min(MODULATION))]
    }
}

/// The largest distance stays below this, so that sums of two never overflow.
const MAX_DISTANCE: f64 = (u32::MAX / 4) as f64;

/// The factor from weights to whole numbers.
fn scale(weights: impl Iterator<Item = f64>, side: usize) -> Option<f64> {
    let positive: Vec<f64> = weights.filter(|&w| w > 0.0).collect();
    let largest = positive.iter().copied().reduce(f64::max)?;
    let total: f64 = positive.iter().sum();
    let most =
        f64::from(MAX_WEIGHT).min(MAX_DISTANCE * largest / (total * (side * side) as f64 * 255.0 * 255.0)).floor();
    let error = |top: f64| {
        let s = top / largest;
        positive.iter().map(|w| ((w * s).round() / (w * s) - 1.0).abs()).fold(0.0, f64::max)
    };
    let candidates = (1..=most.max(1.0) as u32).map(f64::from).filter(|&top| top * 2.0 > most);
    candidates.min_by(|&a, &b| error(a).total_cmp(&error(b)).then(b.total_cmp(&a))).map(|top| top / largest)
}

fn row_weights(channels: &[Channel], side: usize, scale: f64, step: u8) -> Vec<i16> {
    let mut row = vec![0; (side * channels.len()).next_multiple_of(LANES)];
    for (i, w) in row[..side * channels.len()].iter_mut().enumerate() {
        let channel = &channels[i % channels.len()];
        let share = if channel.role == Role::Modulated { f64::from(step) / f64::from(MODULATION) } else { 1.0 };
        *w = (f64::from(channel.weight) * scale * share).round() as i16;
    }
    row
}

/// An image as interleaved bytes.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Stack {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Bytes of a pixel.
    pub channels: usize,
    /// `width * height * channels` bytes, and some more, so that rows may be read in whole lanes.
    data: Vec<u8>,
}

impl Stack {
    /// All zeros.
    pub fn zeros(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, data: vec![0; width * height * channels + MAX_SIDE * channels + LANES] }
    }

    /// From planes of equal size with values in [0, 1], one per channel; values outside are clamped.
    pub fn from_planes(planes: &[Plane]) -> Self {
        let (width, height) = planes.first().map_or((0, 0), |p| (p.width, p.height));
        let mut stack = Self::zeros(width, height, planes.len());
        stack.set_planes(0, planes);
        stack
    }

    /// Overwrites the channels from `first` on with `planes`, values in [0, 1].
    pub fn set_planes(&mut self, first: usize, planes: &[Plane]) {
        for (c, plane) in planes.iter().enumerate() {
            let bytes = self.data[first + c..].iter_mut().step_by(self.channels);
            bytes.zip(&plane.data).for_each(|(b, v)| *b = (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8);
        }
    }

    /// Adds the rows of an image below, at the left edge; it must not be wider, and have as many channels.
    pub(in crate::patch) fn append(&mut self, image: &Self) {
        let (used, stride) = (self.height * self.stride(), self.stride());
        self.data.truncate(used);
        self.data.reserve_exact(image.height * stride + MAX_SIDE * self.channels + LANES);
        for row in image.data[..image.height * image.stride()].chunks_exact(image.stride().max(1)) {
            self.data.extend_from_slice(row);
            self.data.resize(self.data.len() + stride - row.len(), 0);
        }
        self.height += image.height;
        self.data.resize(self.data.len() + MAX_SIDE * self.channels + LANES, 0);
    }

    /// The first `count` channels alone.
    pub(in crate::patch) fn first(&self, count: usize) -> Self {
        let mut first = Self::zeros(self.width, self.height, count);
        let pixels = first.bytes_mut().chunks_exact_mut(count).zip(self.data.chunks_exact(self.channels));
        pixels.for_each(|(to, from)| to.copy_from_slice(&from[..count]));
        first
    }

    /// The same with pairs of channels exchanged.
    pub(in crate::patch) fn exchanged(&self, pairs: &[(usize, usize)]) -> Self {
        let mut exchanged = self.clone();
        let channels = self.channels;
        for pixel in exchanged.bytes_mut().chunks_exact_mut(channels) {
            pairs.iter().for_each(|&(a, b)| pixel.swap(a, b));
        }
        exchanged
    }

    /// Channel `c` in [0, 1].
    pub fn plane(&self, c: usize) -> Plane {
        Plane::from_fn(self.width, self.height, |x, y| f32::from(self.pixel(y * self.width + x)[c]) / 255.0)
    }

    /// The bytes of pixel number `y * width + x`.
    #[inline]
    pub fn pixel(&self, index: usize) -> &[u8] {
        &self.data[index * self.channels..][..self.channels]
    }

    /// Every byte, with the spare ones at the end.
    #[inline]
    pub(in crate::patch) fn bytes(&self) -> &[u8] {
        &self.data
    }

    /// The bytes of the image alone, to write.
    pub(in crate::patch) fn bytes_mut(&mut self) -> &mut [u8] {
        let used = self.width * self.height * self.channels;
        &mut self.data[..used]
    }

    /// Bytes of a row.
    #[inline]
    pub(in crate::patch) fn stride(&self) -> usize {
        self.width * self.channels
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn channels(weights: &[f32], role: Role) -> Vec<Channel> {
        let mut all: Vec<Channel> = weights.iter().map(|&w| Channel::new("c", w, role)).collect();
        all[0].role = Role::Synthesised;
        all
    }

    #[test]
    fn weights_of_lazyfluids_are_exact_and_others_nearly() {
        let layout = Layout::new(2, channels(&[1.0, 1.0, 1.0, 3.0, 3.0, 0.2, 0.2, 0.2, 0.6], Role::Guide)).unwrap();
        assert_eq!(layout.weights(MODULATION)[..9], [40, 40, 40, 120, 120, 8, 8, 8, 24]);
        assert_eq!(layout.weights(0)[45..], [0; 64 - 45]);
        let odd = [1.0f32, 0.73, 0.31, 0.11];
        let layout = Layout::new(1, channels(&odd, Role::Guide)).unwrap();
        for (w, &whole) in odd.iter().zip(layout.weights(0).iter()) {
            let relative = f64::from(whole) * 65025.0 / layout.unit / f64::from(*w) - 1.0;
            assert!(relative.abs() < 0.03, "{w}: {relative}");
        }
        assert!((layout.to_energy(f64::from(layout.to_distance(0.5))) - 0.5).abs() < 1e-6);
    }

    #[test]
    fn modulation_scales_its_channels_only() {
        let mut all = channels(&[1.0, 1.0, 1.0], Role::Modulated);
        all[1].role = Role::Guide;
        let layout = Layout::new(2, all).unwrap();
        let full = layout.weights(MODULATION)[0];
        assert_eq!(layout.weights(0)[..3], [full, full, 0]);
        assert_eq!(layout.weights(MODULATION / 2)[..3], [full, full, full / 2]);
    }

    #[test]
    fn many_heavy_channels_do_not_overflow() {
        let layout = Layout::new(2, channels(&[1.0; 25], Role::Guide)).unwrap();
        let most = f64::from(layout.weights(0)[0]) * 25.0 * 25.0 * 65025.0;
        assert!(most <= MAX_DISTANCE && most * 2.0 > MAX_DISTANCE / 2.0);
    }

    #[test]
    fn impossible_layouts_are_refused_by_name() {
        let message = |radius, all| Layout::new(radius, all).unwrap_err().to_string();
        assert!(message(0, channels(&[1.0], Role::Guide)).contains("1 to 4"));
        assert!(message(2, channels(&[1.0; 65], Role::Guide)).contains("at most 64"));
        assert!(message(2, channels(&[0.0, 0.0], Role::Guide)).contains("all weights"));
        assert!(message(2, channels(&[1.0, f32::NAN], Role::Guide)).contains("NaN"));
        let mut late = channels(&[1.0, 1.0, 1.0], Role::Guide);
        late[2].role = Role::Synthesised;
        assert!(message(2, late).contains("must come first"));
    }

    #[test]
    fn bytes_come_back() {
        let planes = [0.0, 0.5].map(|o| Plane::from_fn(5, 3, |x, y| (x + y) as f32 / 14.0 + o));
        let stack = Stack::from_planes(&planes);
        let worst =
            (0..2).flat_map(|c| stack.plane(c).data.into_iter().zip(planes[c].data.clone()).collect::<Vec<_>>());
        assert!(worst.into_iter().all(|(a, b)| (a - b).abs() <= 0.5 / 255.0 + 1e-6));
    }
}
