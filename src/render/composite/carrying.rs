//! The still picture of a compositor taken apart into what stays and what is carried along.

use super::{COLOUR_STEPS, Compositor, Strip};
use crate::base::par;
use crate::library::variant::CELL;
use crate::raster::filter::gaussian;
use crate::raster::image::{self, Color, Difference, Plane};
use crate::raster::pyramid::{collapse, laplacian};
use crate::raster::resample::{Resizer, resize};
use crate::render::carry::{self, Carried, Carry, Moment, Texel};
use crate::render::extrapolate::fill;
use crate::render::layout::BANDS;
use crate::render::sway::Sway;

/// What of a carried picture stays in its place.
#[derive(Debug, Clone, Copy)]
pub enum Stays<'a> {
    /// Light and shade coarser than this: σ of a Gaussian, pixels of the working image.
    Coarser(f32),
    /// All but a share of the variance of each band, on cells, 0 to 1.
    But(&'a [Plane; BANDS]),
}

impl Compositor {
    /// Carries the still picture along a flow, all but what `stays`; `matte` tells where the fluid is, at working size.
    pub fn carrying(mut self, matte: &Plane, stays: &Stays, carry: &Carry) -> Self {
        let size = (self.picture.width, self.picture.height);
        let parts = Parts::of(&self.base((matte.width, matte.height)), matte, stays);
        let mut texels = vec![Texel::default(); size.0 * size.1];
        let resizer = &self.resizer;
        let strips = par::map(self.strips.len(), |i| self.strips[i].texels(resizer, &parts));
        for (strip, (steady, part)) in self.strips.iter_mut().zip(strips).filter(|(strip, _)| !strip.x.is_empty()) {
            strip.base = steady;
            for (y, part) in strip.y.clone().zip(part.chunks_exact(strip.x.len())) {
                texels[y * size.0..][strip.x.clone()].copy_from_slice(part);
            }
        }
        let steady = parts.steady.luma();
        self.carried = Some((Carried::new(texels, size, luma(&parts.detail), matte, carry), steady));
        self
    }

    /// Lets what is carried sway about its way; without anything carried nothing changes.
    pub fn swaying(mut self, sway: Sway) -> Self {
        if let Some((carried, _)) = &mut self.carried {
            carried.sway(sway);
        }
        self
    }

    /// Luma at working size of what the differences of frame `t` are added to, where a picture is carried; outside the
    /// fluid as if there were more of it.
    pub fn carried_luma(&self, t: usize) -> Option<Plane> {
        let (carried, steady) = self.carried.as_ref()?;
        let mut luma = carried.at(t).luma();
        luma.data.iter_mut().zip(&steady.data).for_each(|(l, s)| *l += s);
        Some(luma)
    }

    /// Colours without differences, at working size.
    fn base(&self, (width, height): (usize, usize)) -> Color {
        let size = (self.picture.width, self.picture.height);
        Color::from_planes(std::array::from_fn(|c| {
            let byte = |p: &[u8]| f32::from(p[c]) * (1.0 / 255.0);
            let mut plane = Plane::from_vec(size.0, size.1, self.picture.data.chunks_exact(3).map(byte).collect());
            for strip in self.strips.iter().filter(|strip| !strip.x.is_empty()) {
                for (y, row) in strip.y.clone().zip(strip.base[c].chunks_exact(strip.x.len())) {
                    let out = &mut plane.row_mut(y)[strip.x.clone()];
                    out.iter_mut().zip(row).for_each(|(o, b)| *o = f32::from(*b) * (1.0 / COLOUR_STEPS));
                }
            }
            resize(&plane, width, height)
        }))
    }
}

impl Strip {
    /// Colours without differences, with the detail that has been carried there.
    pub(super) fn carried(&self, moment: &Moment) -> [Vec<u16>; 3] {
        let detail = moment.window(self.x.clone(), self.y.clone(), &self.matte);
        std::array::from_fn(|c| {
            let sum = |(b, d): (&u16, &f32)| {
                let sum = f32::from(*b) + d * (COLOUR_STEPS / carry::STEPS);
                (sum.clamp(0.0, COLOUR_STEPS) + 0.5) as u16
            };
            self.base[c].iter().zip(&detail[c]).map(sum).collect()
        })
    }

    /// Colours taken apart: what is steady, and the detail that is carried, also that which is finer than a working pixel.
    fn texels(&self, resizer: &Resizer, parts: &Parts) -> ([Vec<u16>; 3], Vec<Texel>) {
        let mut texels = vec![Texel::default(); self.matte.len()];
        let steady = std::array::from_fn(|c| {
            let enlarged = |plane: &Plane| resizer.window(plane, self.x.clone(), self.y.clone()).data;
            let (steady, rest) = (enlarged(&parts.steady.planes[c]), enlarged(&parts.rest.planes[c]));
            for ((texel, base), rest) in texels.iter_mut().zip(&self.base[c]).zip(&rest) {
                let detail = f32::from(*base) * (1.0 / COLOUR_STEPS) - rest;
                texel[c] = (detail * carry::STEPS).round() as i16;
            }
            steady.iter().map(|s| (s.clamp(0.0, 1.0) * COLOUR_STEPS + 0.5) as u16).collect()
        });
        (steady, texels)
    }
}

/// A picture at working size, taken apart.
struct Parts {
    /// What stays in its place.
    steady: Color,
    /// What is carried.
    detail: Color<Difference>,
    /// The picture less what is carried.
    rest: Color,
}

impl Parts {
    fn of(base: &Color, matte: &Plane, stays: &Stays) -> Self {
        match stays {
            Stays::Coarser(sigma) => {
                let steady = Color::from_planes(base.planes.each_ref().map(|plane| coarse(plane, matte, *sigma)));
                Self { detail: difference(base, &steady), rest: steady.clone(), steady }
            }
            Stays::But(shares) => Self::by_bands(base, matte, shares),
        }
    }

    /// Parts that are added have the picture's variance once the carried one has left its place, where its forms are not
    /// those that stay any more.
    fn by_bands(base: &Color, matte: &Plane, shares: &[Plane; BANDS]) -> Self {
        // What is beside the fluid must not be carried in by coarse bands.
        let known = matte.map(|m| m * m);
        let fluid = fill(&base.planes.each_ref(), &known);
        let part = |carried: bool| {
            let planes = fluid.iter().map(|plane| {
                let (mut bands, rest) = laplacian(plane, BANDS);
                for (k, band) in bands.iter_mut().enumerate() {
                    let width = band.width;
                    for (i, value) in band.data.iter_mut().enumerate() {
                        let at = |v: usize| (v as f32 + 0.5) * (1 << k) as f32 / CELL as f32;
                        let share = shares[k].bilinear(at(i % width), at(i / width)).clamp(0.0, 1.0);
                        *value *= if carried { share } else { 1.0 - share }.sqrt();
                    }
                }
                collapse(&bands, (!carried).then_some(&rest))
            });
            <[Plane; 3]>::try_from(planes.collect::<Vec<_>>()).expect("three planes")
        };
        let detail = Color::from_planes(part(true));
        let rest: Color = Color::from_planes(std::array::from_fn(|c| less(&base.planes[c], &detail.planes[c])));
        let mut steady = Color::from_planes(part(false));
        // Outside the fluid the parts add up to the picture where they are.
        for (steady, rest) in steady.planes.iter_mut().zip(&rest.planes) {
            for ((s, r), m) in steady.data.iter_mut().zip(&rest.data).zip(&matte.data) {
                *s = r + m * (*s - r);
            }
        }
        Self { steady, detail, rest }
    }
}

fn difference(a: &Color, b: &Color) -> Color<Difference> {
    Color::from_planes(std::array::from_fn(|c| less(&a.planes[c], &b.planes[c])))
}

fn less(a: &Plane, b: &Plane) -> Plane {
    Plane::from_vec(a.width, a.height, a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect())
}

/// Luma of differences of colours, Rec. 709.
fn luma(detail: &Color<Difference>) -> Plane {
    let [r, g, b] = &detail.planes;
    let pixels = r.data.iter().zip(&g.data).zip(&b.data);
    Plane::from_vec(r.width, r.height, pixels.map(|((r, g), b)| image::luma([*r, *g, *b])).collect())
}

/// A Gaussian of width `sigma` within the matte; outside, of what lies near it.
fn coarse(plane: &Plane, matte: &Plane, sigma: f32) -> Plane {
    let weight = matte.map(|m| m.max(1e-3));
    let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
    let mut sum = gaussian(&Plane::from_vec(plane.width, plane.height, weighted), sigma);
    sum.data.iter_mut().zip(&gaussian(&weight, sigma).data).for_each(|(s, t)| *s /= t);
    sum
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{hash, unit};

    const SIZE: (usize, usize) = (96, 64);

    fn parts(matte: &Plane, share: f32) -> (Plane, Parts) {
        let noise = |x: usize, y: usize| 0.3 + 0.4 * unit(hash(5, &[x as u64 / 3, y as u64 / 3]));
        let plane = Plane::from_fn(SIZE.0, SIZE.1, noise);
        let base = Color::from_planes(std::array::from_fn(|_| plane.clone()));
        let shares = std::array::from_fn(|_| Plane::filled(SIZE.0 / CELL, SIZE.1 / CELL, share));
        (plane, Parts::of(&base, matte, &Stays::But(&shares)))
    }

    fn energy(plane: &Plane) -> f32 {
        collapse(&laplacian(plane, BANDS).0, None).data.iter().map(|v| v * v).sum()
    }

    #[test]
    fn what_stays_and_what_is_carried_share_the_variance() {
        let matte = Plane::filled(SIZE.0, SIZE.1, 1.0);
        for share in [0.0, 0.3, 1.0] {
            let (plane, parts) = parts(&matte, share);
            let (whole, carried) = (energy(&plane), energy(&parts.detail.planes[0]));
            let stays = energy(&parts.steady.planes[1]);
            assert!((carried / whole - share).abs() < 0.01 && (stays / whole + share - 1.0).abs() < 0.01, "{share}");
        }
    }

    #[test]
    fn outside_the_fluid_the_parts_are_the_picture() {
        let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, _| if x < 40 { 1.0 } else { 0.0 });
        let (plane, parts) = parts(&matte, 0.5);
        for (i, picture) in plane.data.iter().enumerate().filter(|(i, _)| i % SIZE.0 >= 40) {
            let sum = parts.steady.planes[2].data[i] + parts.detail.planes[2].data[i];
            assert!((sum - picture).abs() < 1e-5, "{i}: {sum} {picture}");
        }
    }
}
