//! The still picture of a compositor taken apart into what stays and what is carried along.

use super::{COLOUR_STEPS, Compositor, Strip};
use crate::base::par;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Plane};
use crate::raster::resample::{Resizer, resize};
use crate::render::carry::{self, Carried, Carry, Moment, Texel};

impl Compositor {
    /// Carries the still picture along a flow, all but its coarse light and shade; `matte` tells where the fluid is, at
    /// working size.
    pub fn carrying(mut self, matte: &Plane, carry: &Carry) -> Self {
        let size = (self.picture.width, self.picture.height);
        let working = (matte.width, matte.height);
        let base = self.base(working);
        let steady = Color::from_planes(base.planes.each_ref().map(|plane| coarse(plane, matte, carry.steady)));
        let mut texels = vec![Texel::default(); size.0 * size.1];
        let resizer = &self.resizer;
        let parts = par::map(self.strips.len(), |i| self.strips[i].texels(resizer, &steady));
        for (strip, (coarse, part)) in self.strips.iter_mut().zip(parts).filter(|(strip, _)| !strip.x.is_empty()) {
            strip.base = coarse;
            for (y, part) in strip.y.clone().zip(part.chunks_exact(strip.x.len())) {
                texels[y * size.0..][strip.x.clone()].copy_from_slice(part);
            }
        }
        let (mut detail, steady) = (base.luma(), steady.luma());
        detail.data.iter_mut().zip(&steady.data).for_each(|(d, s)| *d -= s);
        self.carried = Some((Carried::new(texels, size, detail, matte, carry), steady));
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

    /// Colours taken apart: what is coarse, of which `steady` has the working size, and the rest.
    fn texels(&self, resizer: &Resizer, steady: &Color) -> ([Vec<u16>; 3], Vec<Texel>) {
        let mut texels = vec![Texel::default(); self.matte.len()];
        let coarse = std::array::from_fn(|c| {
            let steady = resizer.window(&steady.planes[c], self.x.clone(), self.y.clone());
            let coarse: Vec<u16> =
                steady.data.iter().map(|s| (s.clamp(0.0, 1.0) * COLOUR_STEPS + 0.5) as u16).collect();
            for ((texel, base), coarse) in texels.iter_mut().zip(&self.base[c]).zip(&coarse) {
                texel[c] = ((f32::from(*base) - f32::from(*coarse)) * (carry::STEPS / COLOUR_STEPS)).round() as i16;
            }
            coarse
        });
        (coarse, texels)
    }
}

/// A Gaussian of width `sigma` within the matte; outside, of what lies near it.
fn coarse(plane: &Plane, matte: &Plane, sigma: f32) -> Plane {
    let weight = matte.map(|m| m.max(1e-3));
    let weighted = plane.data.iter().zip(&weight.data).map(|(p, w)| p * w).collect();
    let mut sum = gaussian(&Plane::from_vec(plane.width, plane.height, weighted), sigma);
    sum.data.iter_mut().zip(&gaussian(&weight, sigma).data).for_each(|(s, t)| *s /= t);
    sum
}
