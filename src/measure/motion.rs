//! Motion measured on the video itself.

use super::definition::{Better, Measure};
use super::footage::{Footage, Pair, spread};
use super::nodes::activity;
use super::subject::Subject;
use crate::base::par;
use crate::flow::field::Field;
use crate::flow::tv_l1::{Params, TvL1};
use crate::raster::image::Plane;
use crate::raster::resample::{resize, shrunk};

/// Long side of the frames that motion is estimated on, pixels.
const FLOW_SIDE: usize = 320;
/// Pairs of consecutive frames that motion is estimated between, evenly spread.
const PAIRS: usize = 32;
/// Speed below which a direction means nothing, pixels per frame.
const STILL: f32 = 1e-3;

/// What the motion does not explain.
pub const WARP_ERROR: Measure = Measure {
    name: "warp error",
    unit: "luma, 0 to 1",
    definition: "root mean square difference of a frame and the one before carried along the flow, occluded pixels out",
    needs: "2 frames",
    better: Better::Lower,
    compute: |subject| warp_error(subject.footage),
};

/// Where it moves, against where it was told to.
pub const DIRECTION_ERROR: Measure = Measure {
    name: "direction error",
    unit: "degrees",
    definition: "mean angle between the measured motion (mean over time) and the motion asked for, weighted by the asked speed",
    needs: "an asked direction",
    better: Better::Lower,
    compute: |subject| direction_error(subject),
};

/// How fast it moves, against what was asked.
pub const SPEED_CORRELATION: Measure = Measure {
    name: "speed correlation",
    unit: "-1 to 1",
    definition: "correlation over the matte of the speed of the measured motion (mean over time) with the speed asked for",
    needs: "asked speeds that differ",
    better: Better::Higher,
    compute: |subject| speed_correlation(subject),
};

/// How much of the pieces' motion can be seen.
pub const MOTION_SHARE: Measure = Measure {
    name: "motion share",
    unit: "ratio",
    definition: "mean length of the measured motion over the mean length of the motion in the assigned pieces",
    needs: "nodes",
    better: Better::One,
    compute: |subject| motion_share(subject),
};

/// Size of the frames that motion is estimated on.
fn flow_size(footage: &Footage) -> (usize, usize) {
    shrunk((footage.width(), footage.height()), FLOW_SIDE)
}

/// A frame's luma at the size that motion is estimated on.
fn small(footage: &Footage, t: usize) -> Plane {
    let (width, height) = flow_size(footage);
    resize(&footage.luma()[t], width, height)
}

/// The motion of at most [`PAIRS`] pairs of consecutive frames, estimated once.
fn pairs(footage: &Footage) -> &[Pair] {
    footage.pairs.get_or_init(|| estimated(footage))
}

fn estimated(footage: &Footage) -> Vec<Pair> {
    let steps = footage.steps();
    let chosen = spread(steps.len(), PAIRS);
    let (width, height) = flow_size(footage);
    let inside = small_inside(footage);
    par::map(chosen.len(), |i| {
        let frames = steps[chosen[i]];
        let (from, to) = (small(footage, frames.0), small(footage, frames.1));
        let mut solver = TvL1::new(width, height, Params::library());
        let (mut forward, mut backward) = (Field::default(), Field::default());
        if from == to {
            (forward, backward) = (Field::zeros(width, height), Field::zeros(width, height));
        } else {
            solver.flow(&from, &to, &mut forward);
            solver.flow(&to, &from, &mut backward);
        }
        let unexplained = unexplained([&from, &to], [&forward, &backward], &inside);
        Pair { frames, forward, unexplained }
    })
}

/// Per pixel of the small frames, whether it counts.
fn small_inside(footage: &Footage) -> Vec<bool> {
    let (width, height) = flow_size(footage);
    let inside = footage.inside().iter().map(|&i| if i { 1.0 } else { 0.0 }).collect();
    let inside = Plane::from_vec(footage.width(), footage.height(), inside);
    resize(&inside, width, height).data.iter().map(|&m| m >= 0.5).collect()
}

/// Pixels of the footage per pixel of the small frames.
fn enlargement(footage: &Footage) -> f32 {
    footage.width() as f32 / flow_size(footage).0 as f32
}

/// The motion's mean over time, and the mean of its length, at the small size, in pixels of the footage per frame;
/// `None` when there is only one frame.
fn mean_motion(footage: &Footage) -> Option<(Field, Plane)> {
    let pairs = pairs(footage);
    let first = pairs.first()?;
    let (width, height) = (first.forward.width(), first.forward.height());
    let share = enlargement(footage) / pairs.len() as f32;
    let add = |sum: &mut Plane, part: &Plane| sum.data.iter_mut().zip(&part.data).for_each(|(s, p)| *s += share * p);
    let (mut mean, mut speed) = (Field::zeros(width, height), Plane::zeros(width, height));
    for pair in pairs {
        add(&mut mean.u, &pair.forward.u);
        add(&mut mean.v, &pair.forward.v);
        add(&mut speed, &pair.forward.magnitude());
    }
    Some((mean, speed))
}

fn warp_error(footage: &Footage) -> Option<f64> {
    let of_pairs = pairs(footage).iter().map(|pair| pair.unexplained);
    let (sum, count) = of_pairs.fold((0.0, 0), |(sum, count), s| (sum + s.0, count + s.1));
    (count > 0).then(|| (sum / count as f64).sqrt())
}

/// The first frame of each pair, and the pair's own warp error (0 where nothing is seen in both).
pub(super) fn warp_errors(footage: &Footage) -> (Vec<usize>, Vec<f64>) {
    let of = |(sum, count): (f64, usize)| (sum / count.max(1) as f64).sqrt();
    pairs(footage).iter().map(|pair| (pair.frames.0, of(pair.unexplained))).unzip()
}

/// Sum of squared differences between the second frame and the first carried along the motion, and how many pixels
/// were seen in both (forward and backward motion agree; Sundaram, Brox & Keutzer 2010, Eq. 5).
fn unexplained([before, after]: [&Plane; 2], [forward, backward]: [&Field; 2], inside: &[bool]) -> (f64, usize) {
    let (mut sum, mut count) = (0.0, 0);
    for (i, _) in inside.iter().enumerate().filter(|(_, inside)| **inside) {
        let (bu, bv) = (backward.u.data[i], backward.v.data[i]);
        let (x, y) = ((i % after.width) as f32 + 0.5 + bu, (i / after.width) as f32 + 0.5 + bv);
        let (fu, fv) = (forward.u.bilinear(x, y), forward.v.bilinear(x, y));
        let apart = (fu + bu).powi(2) + (fv + bv).powi(2);
        let leaves = x < 0.0 || y < 0.0 || x > after.width as f32 || y > after.height as f32;
        if leaves || apart > 0.01 * (fu * fu + fv * fv + bu * bu + bv * bv) + 0.5 {
            continue;
        }
        sum += f64::from(after.data[i] - before.bilinear(x, y)).powi(2);
        count += 1;
    }
    (sum, count)
}

/// Measured and asked motion of every pixel inside at the small size, both in pixels of the footage per frame.
fn measured_and_asked(subject: &Subject) -> Option<Vec<[(f32, f32); 2]>> {
    let asked = subject.asked?;
    let (mean, _) = mean_motion(subject.footage)?;
    let small = |plane: &Plane| resize(plane, mean.width(), mean.height());
    let (u, v) = (small(&asked.u), small(&asked.v));
    let inside = small_inside(subject.footage);
    let at = |i: usize| [(mean.u.data[i], mean.v.data[i]), (u.data[i], v.data[i])];
    Some((0..inside.len()).filter(|&i| inside[i]).map(at).collect())
}

fn length((u, v): (f32, f32)) -> f32 {
    u.hypot(v)
}

fn direction_error(subject: &Subject) -> Option<f64> {
    let (mut sum, mut weight) = (0.0, 0.0);
    for [measured, asked] in measured_and_asked(subject)? {
        let speed = f64::from(length(asked));
        // What stands still goes in no direction: as wrong as right.
        let angle = if length(measured) < STILL {
            90.0
        } else {
            let cross = measured.0 * asked.1 - measured.1 * asked.0;
            let dot = measured.0 * asked.0 + measured.1 * asked.1;
            f64::from(cross.abs().atan2(dot)).to_degrees()
        };
        sum += speed * angle;
        weight += speed;
    }
    (weight > 0.0).then(|| sum / weight)
}

fn speed_correlation(subject: &Subject) -> Option<f64> {
    let asked = subject.asked_speed.cloned().or_else(|| subject.asked.map(Field::magnitude))?;
    let (mean, _) = mean_motion(subject.footage)?;
    let asked = resize(&asked, mean.width(), mean.height());
    let (speed, inside) = (mean.magnitude(), small_inside(subject.footage));
    let counts = |i: &usize| inside[*i] && asked.data[*i] >= STILL;
    let pair = |i: usize| (f64::from(speed.data[i]), f64::from(asked.data[i]));
    correlation(&(0..inside.len()).filter(counts).map(pair).collect::<Vec<_>>())
}

/// Pearson's correlation; `None` when either side hardly varies (by less than a hundredth of its mean).
fn correlation(pairs: &[(f64, f64)]) -> Option<f64> {
    let n = pairs.len() as f64;
    let (mx, my) = (pairs.iter().map(|p| p.0).sum::<f64>() / n, pairs.iter().map(|p| p.1).sum::<f64>() / n);
    let moment = |f: &dyn Fn(f64, f64) -> f64| pairs.iter().map(|p| f(p.0 - mx, p.1 - my)).sum::<f64>() / n;
    let (xx, yy, xy) = (moment(&|x, _| x * x), moment(&|_, y| y * y), moment(&|x, y| x * y));
    let varies = xx.sqrt() > 0.01 * mx && yy.sqrt() > 0.01 * my;
    varies.then(|| xy / (xx * yy).sqrt())
}

fn motion_share(subject: &Subject) -> Option<f64> {
    let footage = subject.footage;
    let (_, speed) = mean_motion(footage)?;
    let pieces = activity(subject.nodes, (footage.width(), footage.height()))?;
    let pieces = resize(&pieces, speed.width, speed.height);
    let inside = small_inside(footage);
    let counts = |i: &usize| inside[*i] && pieces.data[*i] > STILL;
    let (mut measured, mut assigned) = (0.0, 0.0);
    for i in (0..inside.len()).filter(counts) {
        measured += f64::from(speed.data[i]);
        assigned += f64::from(pieces.data[i]);
    }
    (assigned > 0.0).then(|| measured / assigned)
}
