//! The output frame: recovered image and differences inside the matte, the picture's own bytes outside.
//!
//! Frames are made strip by strip: what changes is interpolated from the working size for the rows of a strip only, and
//! what every frame needs of a pixel is kept in 16 bits a value, so that a picture of 24 megapixels fits in memory.

mod carrying;

pub use carrying::Stays;

use std::ops::Range;

use macro_rules_attribute::apply;

use super::carry::{Carried, Moment};
use super::drift::{Drift, Travel};
use super::layers::Layers;
use super::layout::BANDS;
use crate::base::instructions::kernel;
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Difference, Plane, Rgb8, luma};
use crate::raster::pyramid::{collapse, laplacian};
use crate::raster::resample::Resizer;

/// Window over which the picture's colours are compared with its luma, pixels of the working image.
const COLOUR_SIGMA: f32 = 12.0;
/// Variance of luma below which a place has no colour of its own to follow, and differences are neutral grey.
const COLOUR_FLOOR: f32 = 0.02 * 0.02;
/// Room left above white and below black before differences are compressed, in [0, 1].
const HEADROOM: f32 = 0.03;

/// Differences beyond this many times the local contrast of the picture are compressed: specks of the clip.
const OUTLIER: f32 = 3.0;
/// Window over which that contrast is measured, pixels of the working image.
const CONTRAST_SIGMA: f32 = 16.0;
/// Smallest such contrast, in [0, 1].
const CONTRAST_FLOOR: f32 = 0.01;

/// Rows of a strip.
const STRIP: usize = 32;
/// Steps of a colour, 256 within each of the 255 of 8 bits.
const COLOUR_STEPS: f32 = 255.0 * 256.0;
/// Steps per unit of a slope, a limit or a difference of mattes.
const STEPS: f32 = 8192.0;
/// How fast the matte's detail finer than a working pixel gives way where the outline has moved.
const LET_GO: f32 = 4.0;

/// Adds luma differences to a still picture.
pub struct Compositor {
    picture: Rgb8,
    resizer: Resizer,
    strips: Vec<Strip>,
    /// The matte at working size, where the outline moves.
    outline: Option<Plane>,
    /// Detail finer than a working pixel, where it travels.
    drift: Option<Drift>,
    /// The picture without its coarse light and shade, where that is carried along a flow, and the luma of these at
    /// working size.
    carried: Option<(Carried, Plane)>,
}

/// What travels in a frame besides the differences.
#[derive(Clone, Copy)]
struct Travelling<'a> {
    drift: Option<(&'a Drift, usize)>,
    carried: Option<&'a Moment<'a>>,
}

/// The part of some rows that may change, row by row without padding.
struct Strip {
    x: Range<usize>,
    y: Range<usize>,
    /// The matte, 0 to 255; 255 where the fluid lies before a background.
    matte: Vec<u8>,
    /// Colour without differences, channel by channel.
    base: [Vec<u16>; 3],
    /// Change of colour per luma.
    slope: [Vec<i16>; 3],
    /// Differences larger than this are compressed.
    limit: Vec<i16>,
    behind: Option<Behind>,
}

/// What a strip needs where the outline moves.
struct Behind {
    /// Packed colours of the background.
    colour: Vec<u8>,
    /// The matte less its enlarged working size.
    detail: Vec<i16>,
}

/// What a compositor is made from; planes at working size.
struct Still<'a> {
    /// The picture.
    working: &'a Color,
    /// Its matte.
    matte: &'a Plane,
    /// Its recovered average, where there is fluid.
    recovered: &'a Color,
    /// Change of colour per luma.
    slope: Color<Difference>,
    /// Largest differences.
    limit: Plane,
    /// Where anything may change.
    reach: &'a Plane,
}

impl Compositor {
    /// `picture` and `matte` are at output size, `working` and `recovered` at working size. What the recovery changed
    /// is added to the picture at its own size, so that detail finer than a working pixel stays.
    pub fn new(picture: Rgb8, matte: &Plane, working: &Color, working_matte: &Plane, recovered: &Color) -> Self {
        let (slope, limit) = (colour_of_luma(working, working_matte), local_contrast(working, working_matte));
        let still = Still { working, matte: working_matte, recovered, slope, limit, reach: working_matte };
        Self::build(picture, matte, &still, None)
    }

    /// The same for fluid whose outline moves before a background; `matte` at output size, `recovered` that of
    /// [`Layers::fluid`].
    pub fn layered(picture: Rgb8, matte: &Plane, working: &Color, layers: &Layers, recovered: &Color) -> Self {
        let slope = colour_of_luma(&layers.fluid, &layers.matte);
        let limit = local_contrast(&layers.fluid, &layers.matte);
        let still = Still { working, matte: &layers.matte, recovered, slope, limit, reach: &layers.reach };
        Self { outline: Some(layers.matte.clone()), ..Self::build(picture, matte, &still, Some(layers)) }
    }

    fn build(picture: Rgb8, matte: &Plane, still: &Still, layers: Option<&Layers>) -> Self {
        let resizer = Resizer::new((still.matte.width, still.matte.height), (picture.width, picture.height));
        let strips = par::map(picture.height.div_ceil(STRIP), |i| {
            let y = i * STRIP..((i + 1) * STRIP).min(picture.height);
            let x = match layers {
                None => extent(y.clone().map(|y| matte.row(y))),
                Some(_) => reach(still.reach, (picture.width, picture.height), y.clone()),
            };
            Strip::new(&picture, matte, still, layers, &resizer, x, y)
        });
        Self { picture, resizer, strips, outline: None, drift: None, carried: None }
    }

    /// Lets what is finer in the picture than in `working` travel with the flow, where the output is the larger.
    pub fn drifting(mut self, working: &Color, travel: &Travel) -> Self {
        let (size, small) = ((self.picture.width, self.picture.height), (working.width(), working.height()));
        if size.0 <= small.0 {
            return self;
        }
        let (resizer, picture, luma) = (&self.resizer, &self.picture, working.luma());
        let mut detail = vec![0i8; size.0 * size.1];
        let parts = par::map(self.strips.len(), |i| self.strips[i].detail(resizer, picture, &luma));
        for (strip, part) in self.strips.iter_mut().zip(&parts).filter(|(strip, _)| !strip.x.is_empty()) {
            strip.take(part);
            for (y, part) in strip.y.clone().zip(part.chunks_exact(strip.x.len())) {
                detail[y * size.0..][strip.x.clone()].copy_from_slice(part);
            }
        }
        self.drift = Some(Drift::new(detail, size, small, travel));
        self
    }

    /// Frame `t` from the luma differences at working size. Pixels outside the matte keep their bytes; `boundary`, at
    /// working size, takes the matte's place in a compositor with layers, and is not looked at otherwise.
    pub fn frame(&self, t: usize, differences: &Plane, boundary: &Plane) -> Rgb8 {
        let mut out = self.picture.clone();
        let shown = self.outline.as_ref().map(|matte| Shown::new(boundary, matte));
        let moment = self.carried.as_ref().map(|(carried, _)| carried.at(t));
        self.each_strip(&mut out.data, 3, |strip, rows| {
            let colours = strip.colours(&self.resizer, differences, self.travelling(t, &moment));
            match (&strip.behind, &shown) {
                (Some(behind), Some(shown)) => {
                    // What the fluid has left shows the background, which outside the matte has the picture's own bytes.
                    let cover = strip.cover(behind, &self.resizer, shown);
                    strip.write(rows, self.picture.width, |i| Some(over(behind, &colours, &cover, i)));
                }
                _ => strip.write(rows, self.picture.width, |i| {
                    (strip.matte[i] > 0).then(|| colours.each_ref().map(|c| c[i]))
                }),
            }
        });
        out
    }

    /// The fluid alone: its colours, black where nothing of it is seen, and how much of each pixel it covers, a byte each;
    /// only for a compositor with layers.
    pub fn fluid(&self, t: usize, differences: &Plane, boundary: &Plane) -> (Rgb8, Vec<u8>) {
        let opacity = self.opacity(boundary);
        let mut out = Rgb8::black(self.picture.width, self.picture.height);
        let moment = self.carried.as_ref().map(|(carried, _)| carried.at(t));
        self.each_strip(&mut out.data, 3, |strip, rows| {
            let colours = strip.colours(&self.resizer, differences, self.travelling(t, &moment));
            strip.write(rows, self.picture.width, |i| Some(colours.each_ref().map(|c| c[i])));
        });
        out.data.chunks_exact_mut(3).zip(&opacity).filter(|(_, a)| **a == 0).for_each(|(colour, _)| colour.fill(0));
        (out, opacity)
    }

    fn travelling<'a>(&'a self, t: usize, moment: &'a Option<Moment<'a>>) -> Travelling<'a> {
        Travelling { drift: self.drift.as_ref().map(|drift| (drift, t)), carried: moment.as_ref() }
    }

    fn opacity(&self, boundary: &Plane) -> Vec<u8> {
        let mut out = vec![0; self.picture.width * self.picture.height];
        let shown = self.outline.as_ref().map(|matte| Shown::new(boundary, matte));
        self.each_strip(&mut out, 1, |strip, rows| {
            if let (Some(behind), Some(shown)) = (&strip.behind, &shown) {
                let cover = strip.cover(behind, &self.resizer, shown);
                for (row, cover) in rows.chunks_exact_mut(self.picture.width).zip(cover.chunks_exact(strip.x.len())) {
                    row[strip.x.clone()].iter_mut().zip(cover).for_each(|(o, c)| *o = (c * 255.0 + 0.5) as u8);
                }
            }
        });
        out
    }

    /// Calls `f` for every strip in which something may change, with the rows of `data` that it lies in.
    fn each_strip(&self, data: &mut [u8], bytes: usize, f: impl Fn(&Strip, &mut [u8]) + Sync + Send) {
        par::for_each_chunk(data, STRIP * self.picture.width * bytes, |i, rows| {
            if !self.strips[i].x.is_empty() {
                f(&self.strips[i], rows);
            }
        });
    }
}

/// The outline of one frame at working size.
struct Shown<'a> {
    boundary: &'a Plane,
    /// 1 where the outline is still the matte's, 0 where it has moved away.
    still: Plane,
}

impl<'a> Shown<'a> {
    fn new(boundary: &'a Plane, matte: &Plane) -> Self {
        let still = |(b, m): (&f32, &f32)| 1.0 - (LET_GO * (b - m).abs()).min(1.0);
        let data = boundary.data.iter().zip(&matte.data).map(still).collect();
        Self { boundary, still: Plane::from_vec(matte.width, matte.height, data) }
    }
}

impl Strip {
    fn new(
        picture: &Rgb8,
        matte: &Plane,
        still: &Still,
        layers: Option<&Layers>,
        resizer: &Resizer,
        x: Range<usize>,
        y: Range<usize>,
    ) -> Self {
        let enlarged = |plane: &Plane| resizer.window(plane, x.clone(), y.clone());
        let places = || y.clone().flat_map(|y| x.clone().map(move |x| (x, y)));
        let m: Vec<f32> = match layers {
            None => places().map(|(x, y)| matte.at(x, y)).collect(),
            Some(layers) => {
                let tight = enlarged(&layers.tight);
                places().zip(&tight.data).map(|((x, y), t)| matte.at(x, y) * t.clamp(0.0, 1.0)).collect()
            }
        };
        let base = std::array::from_fn(|c| {
            let (recovered, working) = (enlarged(&still.recovered.planes[c]), enlarged(&still.working.planes[c]));
            let base = |(i, (x, y)): (usize, (usize, usize))| {
                let (p, r, w) = (f32::from(picture.pixel(x, y)[c]) / 255.0, recovered.data[i], working.data[i]);
                // Before a background the fluid's colour does not hold the picture's, which may show what is behind it.
                let colour = if layers.is_some() { r + m[i] * (p - w) } else { p + m[i] * (r - w) };
                (colour.clamp(0.0, 1.0) * COLOUR_STEPS + 0.5) as u16
            };
            places().enumerate().map(base).collect()
        });
        let slope = still.slope.planes.each_ref().map(|plane| {
            let whole = layers.is_some();
            let slope = |(s, m): (&f32, &f32)| ((if whole { *s } else { m * s }) * STEPS).round() as i16;
            enlarged(plane).data.iter().zip(&m).map(slope).collect()
        });
        let limit = enlarged(&still.limit);
        let limit = limit.data.iter().map(|c| ((OUTLIER * c).max(CONTRAST_FLOOR) * STEPS).round() as i16).collect();
        let behind = layers.map(|layers| Behind {
            colour: places().flat_map(|(x, y)| layers.background.pixel(x, y)).collect(),
            detail: m
                .iter()
                .zip(&enlarged(&layers.matte).data)
                .map(|(m, e)| ((m - e) * STEPS).round() as i16)
                .collect(),
        });
        let matte = m.iter().map(|m| if *m > 0.0 { (m * 255.0 + 0.5).max(1.0) as u8 } else { 0 }).collect();
        Self { x, y, matte, base, slope, limit, behind }
    }

    /// Colours of the fluid with its differences, channel by channel.
    fn colours(&self, resizer: &Resizer, differences: &Plane, travelling: Travelling) -> [Vec<f32>; 3] {
        let mut change = resizer.window(differences, self.x.clone(), self.y.clone()).data;
        let carried = travelling.carried.map(|moment| self.carried(moment));
        let base = carried.as_ref().unwrap_or(&self.base);
        compress(&mut change, base, &self.limit);
        let mut detail = match travelling.drift {
            Some((drift, t)) => drift.window(t, self.x.clone(), self.y.clone()),
            None => vec![0.0; change.len()],
        };
        // Detail may travel a little into a soft edge, not beyond it.
        detail.iter_mut().zip(&self.matte).for_each(|(d, m)| *d *= (f32::from(*m) * (2.0 / 255.0)).min(1.0));
        std::array::from_fn(|c| {
            let mut out = vec![0.0; change.len()];
            add(&base[c], &self.slope[c], &change, &detail, &mut out);
            out
        })
    }

    /// How much finer than a working pixel the picture's luma is, 255ths, times the matte.
    fn detail(&self, resizer: &Resizer, picture: &Rgb8, working: &Plane) -> Vec<i8> {
        let coarse = resizer.window(working, self.x.clone(), self.y.clone());
        let places = self.y.clone().flat_map(|y| self.x.clone().map(move |x| (x, y)));
        let fine = |(((x, y), coarse), m): (((usize, usize), &f32), &u8)| {
            let luma = luma(picture.pixel(x, y).map(f32::from));
            (f32::from(*m) * (1.0 / 255.0) * (luma - 255.0 * coarse)).round() as i8
        };
        places.zip(&coarse.data).zip(&self.matte).map(fine).collect()
    }

    /// Takes detail out of the colours, as far as they stay colours.
    fn take(&mut self, detail: &[i8]) {
        for base in &mut self.base {
            for (b, d) in base.iter_mut().zip(detail) {
                *b = (i32::from(*b) - 256 * i32::from(*d)).clamp(0, COLOUR_STEPS as i32) as u16;
            }
        }
    }

    /// How much of each pixel the fluid covers, 0 to 1; what 8 bits cannot show is 0.
    fn cover(&self, behind: &Behind, resizer: &Resizer, shown: &Shown) -> Vec<f32> {
        let window = |plane| resizer.window(plane, self.x.clone(), self.y.clone()).data;
        let (boundary, still) = (window(shown.boundary), window(&shown.still));
        let cover = |((b, s), d): ((&f32, &f32), &i16)| {
            let cover = b + s.clamp(0.0, 1.0) * f32::from(*d) * (1.0 / STEPS);
            if cover < 0.5 / 255.0 { 0.0 } else { cover.min(1.0) }
        };
        boundary.iter().zip(&still).zip(&behind.detail).map(cover).collect()
    }

    /// Writes the colours of pixels into rows of a picture of `width` pixels; those without one keep their bytes.
    fn write(&self, rows: &mut [u8], width: usize, colour: impl Fn(usize) -> Option<[f32; 3]>) {
        let span = self.x.len();
        for (j, row) in rows.chunks_exact_mut(3 * width).enumerate() {
            let bytes = row[3 * self.x.start..3 * self.x.end].chunks_exact_mut(3);
            for (i, bytes) in bytes.enumerate() {
                if let Some(colour) = colour(j * span + i) {
                    bytes.iter_mut().zip(colour).for_each(|(byte, v)| *byte = (v * 255.0 + 0.5) as u8);
                }
            }
        }
    }
}

/// Compresses differences smoothly towards white and black, so that nothing is cut off flat.
#[apply(kernel)]
fn compress(differences: &mut [f32], base: &[Vec<u16>; 3], limit: &[i16]) {
    let [r, g, b] = base;
    let colours = r.iter().zip(g).zip(b);
    for ((d, ((r, g), b)), limit) in differences.iter_mut().zip(colours).zip(limit) {
        let luma = luma([r, g, b].map(|c| f32::from(*c) * (1.0 / COLOUR_STEPS)));
        let room = if *d < 0.0 { luma } else { 1.0 - luma } + HEADROOM;
        let limit = f32::from(*limit) * (1.0 / STEPS);
        *d /= (1.0 + *d * *d * (1.0 / (room * room) + 1.0 / (limit * limit))).sqrt();
    }
}

/// `base + slope · change + detail`, within [0, 1].
#[apply(kernel)]
fn add(base: &[u16], slope: &[i16], change: &[f32], detail: &[f32], out: &mut [f32]) {
    for ((((o, base), slope), change), detail) in out.iter_mut().zip(base).zip(slope).zip(change).zip(detail) {
        let colour = f32::from(*base) * (1.0 / COLOUR_STEPS) + f32::from(*slope) * (1.0 / STEPS) * change + detail;
        *o = colour.clamp(0.0, 1.0);
    }
}

/// The fluid over its background, at pixel `i` of a strip.
fn over(behind: &Behind, colours: &[Vec<f32>; 3], cover: &[f32], i: usize) -> [f32; 3] {
    std::array::from_fn(|c| {
        let back = f32::from(behind.colour[3 * i + c]) * (1.0 / 255.0);
        back + cover[i] * (colours[c][i] - back)
    })
}

/// The columns within which any of the rows is above 0.
fn extent<'a>(rows: impl Iterator<Item = &'a [f32]>) -> Range<usize> {
    let ends = |row: &[f32]| Some((row.iter().position(|&v| v > 0.0)?, row.iter().rposition(|&v| v > 0.0)? + 1));
    let found = rows.filter_map(ends).reduce(|a, b| (a.0.min(b.0), a.1.max(b.1)));
    found.map_or(0..0, |(first, end)| first..end)
}

/// The columns of the output, of `size`, that interpolating `plane` can reach in its rows `y`.
fn reach(plane: &Plane, size: (usize, usize), y: Range<usize>) -> Range<usize> {
    let (across, down) = (plane.width as f64 / size.0 as f64, plane.height as f64 / size.1 as f64);
    let wide = |ratio: f64| 2.0 * ratio.max(1.0) + 1.0;
    let first = (y.start as f64 * down - wide(down)).max(0.0) as usize;
    let end = ((y.end as f64 * down + wide(down)) as usize + 1).min(plane.height);
    let x = extent((first..end).map(|y| plane.row(y)));
    if x.is_empty() {
        return 0..0;
    }
    let first = ((x.start as f64 - wide(across)) / across).max(0.0) as usize;
    first..(((x.end as f64 + wide(across)) / across).ceil() as usize).min(size.0)
}

/// Root mean square of what the bands of differences cover, around each pixel of the matte.
pub fn local_contrast(picture: &Color, matte: &Plane) -> Plane {
    let detail = collapse(&laplacian(&picture.luma(), BANDS).0, None);
    let weight = matte.map(|m| m.max(1e-3));
    let squares = detail.data.iter().zip(&weight.data).map(|(d, w)| d * d * w).collect();
    let mut squares = gaussian(&Plane::from_vec(detail.width, detail.height, squares), CONTRAST_SIGMA);
    let total = gaussian(&weight, CONTRAST_SIGMA);
    squares.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s = (*s / t).sqrt().max(CONTRAST_FLOOR));
    squares
}

/// How the colour of the picture changes with its luma around each pixel: the slope of each channel over luma in a
/// Gaussian window within the matte. Rec. 709 weights of the slopes sum to 1, so luma changes by what is asked. The
/// differences thus keep to the colours that the picture has (a clip's own chroma shows as blue and yellow specks).
pub fn colour_of_luma(picture: &Color, matte: &Plane) -> Color<Difference> {
    let luma = picture.luma();
    let weight = matte.map(|m| m.max(1e-3));
    let total = gaussian(&weight, COLOUR_SIGMA);
    let mean = |values: &mut dyn Iterator<Item = f32>| {
        let sum = values.zip(&weight.data).map(|(v, w)| v * w).collect();
        let mut sum = gaussian(&Plane::from_vec(luma.width, luma.height, sum), COLOUR_SIGMA);
        sum.data.iter_mut().zip(&total.data).for_each(|(s, t)| *s /= t);
        sum
    };
    let luma_mean = mean(&mut luma.data.iter().copied());
    let square_mean = mean(&mut luma.data.iter().map(|l| l * l));
    let slope = |plane: &Plane| {
        let plane_mean = mean(&mut plane.data.iter().copied());
        let product_mean = mean(&mut plane.data.iter().zip(&luma.data).map(|(p, l)| p * l));
        let at = |i: usize| {
            let covariance = product_mean.data[i] - plane_mean.data[i] * luma_mean.data[i];
            let variance = square_mean.data[i] - luma_mean.data[i] * luma_mean.data[i];
            ((covariance + COLOUR_FLOOR) / (variance.max(0.0) + COLOUR_FLOOR)).clamp(0.0, 2.5)
        };
        Plane::from_vec(luma.width, luma.height, (0..luma.data.len()).map(at).collect())
    };
    Color::from_planes(picture.planes.each_ref().map(slope))
}
