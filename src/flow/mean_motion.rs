//! How a clip moves on the whole: the motion between its frames, averaged over time.

use super::field::Field;
use super::tv_l1::{Params, TvL1};
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::raster::image::Plane;

/// Most pairs of frames that are looked at, spread evenly over the clip.
const PAIRS: usize = 64;
/// Pairs that are looked at together.
const TOGETHER: usize = 8;

/// Motion averaged over time, pixels per frame.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct MeanMotion {
    /// Mean motion: 0 where it comes and goes.
    pub mean: Field,
    /// Mean length of the motion.
    pub activity: Plane,
}

impl MeanMotion {
    /// Of `count` frames, 2 at least, whose luma is `frame(t)`; tells `stage` of every pair.
    ///
    /// # Errors
    /// A cancel.
    pub fn of(
        count: usize,
        frame: impl Fn(usize) -> Plane + Sync + Send,
        stage: &str,
        observer: &dyn Observer,
    ) -> Result<Self> {
        let pairs = (count - 1).min(PAIRS);
        let first = frame(0);
        let mut sum =
            Self { mean: Field::zeros(first.width, first.height), activity: Plane::zeros(first.width, first.height) };
        for begin in (0..pairs).step_by(TOGETHER) {
            observe::check(observer)?;
            let flow = |k: usize| {
                let t = (begin + k) * (count - 1) / pairs;
                let (from, to, mut flow) = (frame(t), frame(t + 1), Field::default());
                TvL1::new(from.width, from.height, Params::library()).flow(&from, &to, &mut flow);
                flow
            };
            let flows = par::map(TOGETHER.min(pairs - begin), flow);
            flows.iter().for_each(|flow| sum.add(flow));
            observer.advance(stage, flows.len() as u64);
        }
        for plane in [&mut sum.mean.u, &mut sum.mean.v, &mut sum.activity] {
            plane.data.iter_mut().for_each(|v| *v /= pairs as f32);
        }
        Ok(sum)
    }

    /// How many pairs of so many frames are looked at.
    pub fn pairs(count: usize) -> usize {
        count.saturating_sub(1).min(PAIRS)
    }

    fn add(&mut self, flow: &Field) {
        let add = |sum: &mut Plane, plane: &Plane| sum.data.iter_mut().zip(&plane.data).for_each(|(s, v)| *s += v);
        add(&mut self.mean.u, &flow.u);
        add(&mut self.mean.v, &flow.v);
        add(&mut self.activity, &flow.magnitude());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;

    fn texture(x: f32, y: f32) -> f32 {
        let wave = |fx: f32, fy: f32, phase: f32| (fx * x + fy * y + phase).sin();
        0.5 + 0.1 * (wave(0.31, 0.11, 0.3) + wave(-0.13, 0.37, 1.1) + wave(0.21, -0.23, 2.0))
    }

    #[test]
    fn steady_motion_is_its_own_mean_and_to_and_fro_has_none() {
        let there = |t: usize| 1.5 * t as f32;
        let fro = |t: usize| 1.5 * (t % 2) as f32;
        for (place, wanted) in [(&there as &(dyn Fn(usize) -> f32 + Sync), 1.5), (&fro, 0.0)] {
            let frame =
                |t: usize| Plane::from_fn(96, 80, |x, y| texture(x as f32 - place(t), y as f32 - 0.5 * place(t)));
            let motion = MeanMotion::of(13, frame, "flow", &Silent).unwrap();
            let (u, v) = (motion.mean.u.at(48, 40), motion.mean.v.at(48, 40));
            assert!((u - wanted).abs() < 0.1 && (v - 0.5 * wanted).abs() < 0.1, "{u} {v}");
            assert!((motion.activity.at(48, 40) - 1.5 * 1.25f32.sqrt()).abs() < 0.1);
        }
    }
}
