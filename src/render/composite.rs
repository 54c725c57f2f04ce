//! The output frame: recovered image and differences inside the matte, the picture's own bytes outside.

use super::layout::BANDS;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Difference, Plane, Rgb8};
use crate::raster::pyramid::{collapse, laplacian};
use crate::raster::resample::{resize, resize_color};

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

/// Adds luma differences to a still picture.
pub struct Compositor {
    picture: Rgb8,
    rows: Vec<Span>,
}

/// The pixels of a row that lie in the matte.
struct Span {
    first: usize,
    pixels: Vec<Pixel>,
}

/// What a pixel needs.
#[derive(Clone, Copy)]
struct Pixel {
    /// Colour without differences.
    base: [f32; 3],
    /// Change of colour per luma.
    change: [f32; 3],
    /// One over the square of the room for negative and positive differences.
    below: f32,
    above: f32,
    inside: bool,
}

impl Compositor {
    /// `picture` and `matte` are at output size, `working` and `recovered` at working size. What the recovery changed
    /// is added to the picture at its own size, so that detail finer than a working pixel stays.
    pub fn new(picture: Rgb8, matte: &Plane, working: &Color, working_matte: &Plane, recovered: &Color) -> Self {
        let (width, height) = (picture.width, picture.height);
        let change: Vec<Plane> = (0..3)
            .map(|c| {
                let mut plane = recovered.planes[c].clone();
                plane.data.iter_mut().zip(&working.planes[c].data).for_each(|(r, w)| *r -= w);
                resize(&plane, width, height)
            })
            .collect();
        let limit = resize(&local_contrast(working, working_matte), width, height).map(|c| OUTLIER * c);
        let colour = resize_color(&colour_of_luma(working, working_matte), width, height);
        let rows = (0..height)
            .map(|y| {
                let row = matte.row(y);
                let first = row.iter().position(|&m| m > 0.0).unwrap_or(0);
                let end = row.iter().rposition(|&m| m > 0.0).map_or(first, |i| i + 1);
                let pixel = |x: usize| {
                    let (m, original) = (row[x], picture.pixel(x, y));
                    let base: [f32; 3] = std::array::from_fn(|c| {
                        (f32::from(original[c]) / 255.0 + m * change[c].at(x, y)).clamp(0.0, 1.0)
                    });
                    let luma = 0.2126 * base[0] + 0.7152 * base[1] + 0.0722 * base[2];
                    let change = std::array::from_fn(|c| m * colour.planes[c].at(x, y));
                    let room =
                        |room: f32| 1.0 / (room + HEADROOM).powi(2) + 1.0 / limit.at(x, y).max(CONTRAST_FLOOR).powi(2);
                    Pixel { base, change, below: room(luma), above: room(1.0 - luma), inside: m > 0.0 }
                };
                Span { first, pixels: (first..end).map(pixel).collect() }
            })
            .collect();
        Self { picture, rows }
    }

    /// One frame from the luma differences at working size. Pixels outside the matte keep their bytes.
    pub fn frame(&self, differences: &Plane) -> Rgb8 {
        let differences = resize(differences, self.picture.width, self.picture.height);
        let mut out = self.picture.clone();
        for (y, span) in self.rows.iter().enumerate() {
            let start = (y * out.width + span.first) * 3;
            let bytes = out.data[start..start + span.pixels.len() * 3].chunks_exact_mut(3);
            let row = &differences.row(y)[span.first..];
            for ((bytes, pixel), &d) in bytes.zip(&span.pixels).zip(row) {
                if pixel.inside {
                    // Compressed smoothly towards white and black, so that nothing is cut off flat.
                    let room = if d < 0.0 { pixel.below } else { pixel.above };
                    let d = d / (1.0 + room * d * d).sqrt();
                    for (byte, (base, change)) in bytes.iter_mut().zip(pixel.base.iter().zip(pixel.change)) {
                        *byte = ((base + change * d).clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
                    }
                }
            }
        }
        out
    }
}

/// Root mean square of what the bands of differences cover, around each pixel of the matte.
fn local_contrast(picture: &Color, matte: &Plane) -> Plane {
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
