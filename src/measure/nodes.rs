//! What the grid of pieces leaves in the frames.

use super::definition::{Better, Measure};
use super::footage::{Footage, spread};
use super::subject::{Node, Subject};
use crate::base::par;
use crate::raster::image::Plane;

/// Steps from frame to frame that seams are looked for in.
const STEPS: usize = 60;
/// Pixels from a border where its seam is over.
const OFF: usize = 4;
/// Mean below which a quotient by it means nothing: the variance, or the gradient, of a video that stands still.
const STILL: f64 = 1e-8;

/// Edges that show.
pub const SEAM_RATIO: Measure = Measure {
    name: "seam ratio",
    unit: "ratio",
    definition: "mean gradient of the difference of consecutive frames, across the lines where pieces hand over, over the same beside them",
    needs: "nodes, 2 frames",
    better: Better::One,
    compute: |subject| seam_ratio(subject),
};

/// Stripes of weak motion.
pub const MIDLINE_VARIANCE_RATIO: Measure = Measure {
    name: "midline variance ratio",
    unit: "ratio",
    definition: "variance over time on the middle lines of the pieces' overlaps, over that on the pieces' own middle lines",
    needs: "overlapping nodes, 2 frames",
    better: Better::One,
    compute: |subject| midline_variance_ratio(subject),
};

/// Monotony.
pub const USAGE_ENTROPY: Measure = Measure {
    name: "usage entropy",
    unit: "0 to 1",
    definition: "entropy of how often each source is used, over the largest possible",
    needs: "usage",
    better: Better::Higher,
    compute: |subject| {
        let usage = subject.usage?;
        let total: u64 = usage.counts.iter().sum();
        let largest = (total.min(usage.sources) as f64).ln();
        let shares = usage.counts.iter().filter(|&&c| c > 0).map(|&c| c as f64 / total as f64);
        (largest > 0.0).then(|| shares.map(|p| p * (1.0 / p).ln()).sum::<f64>() / largest)
    },
};

/// The pieces' activity at every pixel of a `width` × `height` image, pixels per frame: a mean of the nodes there,
/// weighted by a tent over each; zero where no node lies. `None` without nodes.
pub(super) fn activity(nodes: &[Node], (width, height): (usize, usize)) -> Option<Plane> {
    let (mut sum, mut weights) = (Plane::zeros(width, height), Plane::zeros(width, height));
    for node in nodes {
        let tent = |p: usize, low: f32| (1.0 - 2.0 * ((p as f32 + 0.5 - low) / node.side - 0.5).abs()).max(0.0);
        let range =
            |low: f32, size: usize| low.max(0.0) as usize..((low + node.side).ceil().max(0.0) as usize).min(size);
        for y in range(node.y, height) {
            for x in range(node.x, width) {
                let weight = tent(x, node.x) * tent(y, node.y);
                *sum.at_mut(x, y) += weight * node.activity;
                *weights.at_mut(x, y) += weight;
            }
        }
    }
    sum.data.iter_mut().zip(&weights.data).filter(|(_, w)| **w > 0.0).for_each(|(s, w)| *s /= w);
    (!nodes.is_empty()).then_some(sum)
}

/// Where two neighbouring pieces hand over, along x or y (which is called *across* here).
#[derive(Debug, Clone, Copy, PartialEq)]
struct Border {
    /// Whether across is x.
    vertical: bool,
    /// Position across: the middle of their overlap.
    line: f32,
    /// The two pieces' centres across.
    centres: (f32, f32),
    /// Positions along the border that belong to it.
    along: (f32, f32),
}

/// A border between every node and its nearest neighbour to the right and below, where they touch or overlap.
fn borders(nodes: &[Node]) -> Vec<Border> {
    let mut out = Vec::new();
    for a in nodes {
        for vertical in [true, false] {
            let place = |n: &Node| if vertical { (n.x, n.y) } else { (n.y, n.x) };
            let ((across, along), same) = (place(a), |b: f32, c: f32| (b - c).abs() < 0.01);
            let after = |b: &&Node| same(place(b).1, along) && place(b).0 > across + 0.01;
            let nearest = nodes.iter().filter(after).min_by(|b, c| place(b).0.total_cmp(&place(c).0));
            let Some(step) = nearest.map(|b| place(b).0 - across).filter(|step| *step <= a.side) else { continue };
            let (centre, middle) = (across + 0.5 * a.side, along + 0.5 * a.side);
            out.push(Border {
                vertical,
                line: centre + 0.5 * step,
                centres: (centre, centre + step),
                along: (middle - 0.5 * step, middle + 0.5 * step),
            });
        }
    }
    out
}

/// Lines across a border, each as the index of the pixel left of or above position 0 and the index step; outside the
/// frame nothing.
fn lines(border: &Border, footage: &Footage) -> impl Iterator<Item = Line> {
    let (width, height) = (footage.width(), footage.height());
    let (step, stride, count, length) =
        if border.vertical { (1, width, height, width) } else { (width, 1, width, height) };
    let pixel = |v: f32| v.round().max(0.0) as usize;
    let along = pixel(border.along.0)..pixel(border.along.1).min(count);
    along.map(move |a| Line { start: a * stride, step, length })
}

/// Pixels in a row or column.
struct Line {
    start: usize,
    step: usize,
    length: usize,
}

impl Line {
    /// Index of the pixel `at`, when it is in the frame and inside.
    fn pixel(&self, at: isize, inside: &[bool]) -> Option<usize> {
        let at = usize::try_from(at).ok().filter(|at| *at < self.length)?;
        Some(self.start + at * self.step).filter(|&i| inside[i])
    }
}

/// A mean being made.
#[derive(Debug, Clone, Copy, Default)]
struct Mean {
    sum: f64,
    count: usize,
}

impl Mean {
    fn add(&mut self, value: f32) {
        self.sum += f64::from(value);
        self.count += 1;
    }

    /// The quotient of two means, when both have values and the second is not nearly 0.
    fn over(self, other: Self) -> Option<f64> {
        let whole = other.sum / other.count as f64;
        (self.count > 0 && other.count > 0 && whole > STILL).then(|| self.sum / self.count as f64 / whole)
    }
}

fn seam_ratio(subject: &Subject) -> Option<f64> {
    let (mut across, mut beside) = (Mean::default(), Mean::default());
    for (_, (a, b)) in seams(subject) {
        across = Mean { sum: across.sum + a.sum, count: across.count + a.count };
        beside = Mean { sum: beside.sum + b.sum, count: beside.count + b.count };
    }
    across.over(beside)
}

/// Of steps that are looked at, the frame after each, and its gradients across the borders and beside them.
fn seams(subject: &Subject) -> Vec<(usize, (Mean, Mean))> {
    let footage = subject.footage;
    let borders = borders(subject.nodes);
    let steps = footage.steps();
    let chosen = spread(steps.len(), STEPS);
    let luma = footage.luma();
    par::map(chosen.len(), |i| {
        let (a, b) = steps[chosen[i]];
        let change: Vec<f32> = luma[b].data.iter().zip(&luma[a].data).map(|(b, a)| b - a).collect();
        (b, gradients(&change, &borders, footage))
    })
}

/// The frame into which seams show most.
pub(super) fn worst_frame(subject: &Subject) -> Option<usize> {
    if subject.nodes.is_empty() {
        return None;
    }
    let badness = |(frame, (across, beside)): (usize, (Mean, Mean))| {
        Some((frame, SEAM_RATIO.better.badness(across.over(beside)?)))
    };
    seams(subject).into_iter().filter_map(badness).max_by(|a, b| a.1.total_cmp(&b.1)).map(|worst| worst.0)
}

/// Gradients of `change` across the borders, and beside them up to the pieces' centres.
fn gradients(change: &[f32], borders: &[Border], footage: &Footage) -> (Mean, Mean) {
    let (mut across, mut beside) = (Mean::default(), Mean::default());
    let inside = footage.inside();
    for border in borders {
        let (middle, reach) = (border.line.round() as isize, (border.line - border.centres.0) as isize);
        for line in lines(border, footage) {
            let gradient = |at: isize| {
                let (a, b) = (line.pixel(at - 1, inside)?, line.pixel(at, inside)?);
                Some((change[b] - change[a]).abs())
            };
            gradient(middle).into_iter().for_each(|g| across.add(g));
            let off = (OFF as isize..=reach).flat_map(|d| [middle - d, middle + d]);
            off.filter_map(gradient).for_each(|g| beside.add(g));
        }
    }
    (across, beside)
}

fn midline_variance_ratio(subject: &Subject) -> Option<f64> {
    let footage = subject.footage;
    let variance = variance(footage)?;
    let (mut middle, mut centre) = (Mean::default(), Mean::default());
    for border in borders(subject.nodes) {
        for line in lines(&border, footage) {
            // Two pixels on either side of a line, so that a line between pixels and one on a pixel weigh alike.
            let add = |mean: &mut Mean, at: f32| {
                let at = at.round() as isize;
                (at - 1..=at).filter_map(|p| line.pixel(p, footage.inside())).for_each(|i| mean.add(variance[i]));
            };
            add(&mut middle, border.line);
            add(&mut centre, border.centres.0);
            add(&mut centre, border.centres.1);
        }
    }
    middle.over(centre)
}

/// Variance of every pixel's luma over time.
fn variance(footage: &Footage) -> Option<Vec<f32>> {
    let (luma, mean) = (footage.luma(), footage.mean());
    let mut out = vec![0.0; mean.data.len()];
    par::for_each_chunk(&mut out, mean.width, |y, row| {
        for frame in luma {
            let values = frame.row(y).iter().zip(mean.row(y));
            row.iter_mut().zip(values).for_each(|(sum, (l, m))| *sum += (l - m) * (l - m) / luma.len() as f32);
        }
    });
    (luma.len() >= 2).then_some(out)
}
