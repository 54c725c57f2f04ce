//! Figures of the database method's frames on four pictures of `$ENLIVEN_DATA/pictures`, inside the matte, with the
//! output at working size: how visible nodes and loops are, whether the motion has the strength of its pieces, and how
//! sharp the frames are.
//!
//!     ENLIVEN_DATA=... cargo run --release --example synthesis_figures LIBRARY [METHOD.KEY=VALUE]... [FOLDER]
//!
//! With a folder, contact sheets, full frames and differences of frames (five times as strong) are written to it.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use enliven::base::error::Result as EnlivenResult;
use enliven::base::observe::Silent;
use enliven::flow::field::Field;
use enliven::flow::tv_l1::{Params, TvL1};
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{picture_size, write_png};
use enliven::raster::pyramid::laplacian;
use enliven::report::contact_sheet::{contact_sheet, spread};
use enliven::scene::file::{SceneFile, set};
use enliven::scene::frame_map::FrameMap;
use enliven::scene::scene::Scene;
use enliven::synth::methods::database;
use enliven::synth::record::AssignmentRecord;
use enliven::synth::run::run;
use enliven::video::clip::Sink;

const PICTURES: [&str; 4] = ["forest-waterfall", "sunset-rapids", "painted-waterfall", "mill-stream"];
/// Distance of nodes.
const STRIDE: usize = 24;
/// Frames whose motion to the next one is measured: with 8 the mean is uncertain by a tenth.
const FLOWS: usize = 32;

#[derive(Default)]
struct Keep(Vec<Rgb8>);

impl Sink for Keep {
    fn push(&mut self, frame: &Rgb8) -> EnlivenResult<()> {
        self.0.push(frame.clone());
        Ok(())
    }

    fn finish(self: Box<Self>) -> EnlivenResult<()> {
        Ok(())
    }
}

/// A finished run.
struct Run {
    frames: Vec<Rgb8>,
    lumas: Vec<Plane>,
    picture: Plane,
    matte: Plane,
    assignment: AssignmentRecord,
}

fn main() -> Result<()> {
    let data = PathBuf::from(std::env::var_os("ENLIVEN_DATA").context("set ENLIVEN_DATA to the folder of test data")?);
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (library, rest) = arguments.split_first().context("name a library")?;
    let (options, folders): (Vec<_>, Vec<_>) = rest.iter().partition(|a| a.contains('='));
    println!("picture            seam  edges variance | loop  step  dip  fine | motion sharpness contrast flicker");
    for name in PICTURES {
        let result = animate(&data.join("pictures"), name, library, &options).with_context(|| name.to_owned())?;
        print(name, &result);
        if let Some(folder) = folders.first() {
            save(Path::new(folder), name, &result)?;
        }
    }
    Ok(())
}

fn animate(folder: &Path, name: &str, library: &str, options: &[&String]) -> Result<Run> {
    let mut file = SceneFile { picture: folder.join(format!("{name}.png")), ..SceneFile::default() };
    file.method = Some(database::ENTRY.name.to_owned());
    file.matte = Some(folder.join(format!("{name}.matte.png")));
    file.library = vec![library.into()];
    let map = FrameMap::new(picture_size(&file.picture)?, None, file.output.working_size)?;
    file.output.size = Some([map.working.0, map.working.1]);
    options.iter().try_for_each(|option| set(&mut file, option))?;
    let scene = Scene::new(file)?;
    let mut sink = Keep::default();
    let outcome = run(&scene, &mut sink, &Silent)?;
    let still = scene.still(&Silent)?;
    Ok(Run {
        lumas: sink.0.iter().map(Rgb8::luma).collect(),
        frames: sink.0,
        picture: still.working.luma(),
        matte: still.working_matte,
        assignment: outcome.record.assignment.context("no assignment")?,
    })
}

fn print(name: &str, run: &Run) {
    let (seam, edges) = (seam_ratio(run, STRIDE / 2), seam_ratio(run, 0));
    let (ratio, step) = loop_ratio(run);
    println!(
        "{name:18} {seam:.3} {edges:.3} {:.3}    | {ratio:.3} {step:.3} {:.3} {:.3} | {:.3}  {:.3}     {:.3}    {:.4}",
        midline_variance(run),
        contrast_dip(run, 1),
        contrast_dip(run, 0),
        motion(run),
        sharpness(run),
        contrast(run),
        flicker(run),
    );
}

/// Gradient of the temporal difference across the lines `offset` pixels into the nodes over the same elsewhere.
fn seam_ratio(run: &Run, offset: usize) -> f64 {
    let line = lines(run, offset);
    let (width, height) = (run.matte.width, run.matte.height);
    let mut sums = [[0.0f64; 2]; 2];
    for pair in run.lumas.windows(2).step_by(4) {
        let d = minus(&pair[1], &pair[0]);
        for (x, y) in pixels(width - 1, height - 1) {
            let m = f64::from(run.matte.at(x, y));
            for (on, step) in [(line.0(x + 1), (1, 0)), (line.1(y + 1), (0, 1))] {
                let gradient = f64::from(d.at(x + step.0, y + step.1) - d.at(x, y)).abs();
                sums[usize::from(on)][0] += m * gradient;
                sums[usize::from(on)][1] += m;
            }
        }
    }
    (sums[1][0] / sums[1][1]) / (sums[0][0] / sums[0][1])
}

/// Whether a column or row lies on the lines `offset` pixels into the nodes.
fn lines(run: &Run, offset: usize) -> (impl Fn(usize) -> bool, impl Fn(usize) -> bool) {
    let node = &run.assignment.nodes[0];
    let on = move |v: usize, node: usize| (v + 4 * STRIDE - node % STRIDE) % STRIDE == offset % STRIDE;
    let (nx, ny) = (node.x, node.y);
    (move |x| on(x, nx), move |y| on(y, ny))
}

/// Temporal variance where two nodes have equal weight over that in the middle of one.
fn midline_variance(run: &Run) -> f64 {
    let variance = temporal_variance(&run.lumas);
    let mean_on = |offset: usize| {
        let near: Vec<_> = [STRIDE - 1, 0, 1].map(|d| lines(run, offset + d)).into_iter().collect();
        let all = pixels(run.matte.width, run.matte.height);
        all.filter(|&(x, y)| near.iter().any(|l| l.0(x) || l.1(y))).fold((0.0, 0.0), |(sum, total), (x, y)| {
            let m = f64::from(run.matte.at(x, y));
            (sum + m * f64::from(variance.at(x, y)), total + m)
        })
    };
    let (midline, centre) = (mean_on(STRIDE / 2), mean_on(0));
    (midline.0 / midline.1) / (centre.0 / centre.1)
}

fn temporal_variance(lumas: &[Plane]) -> Plane {
    let mean = mean_of(lumas);
    let mut variance = Plane::zeros(mean.width, mean.height);
    for luma in lumas {
        let d = minus(luma, &mean);
        variance.data.iter_mut().zip(&d.data).for_each(|(v, d)| *v += d * d / lumas.len() as f32);
    }
    variance
}

/// Difference from the last frame to the first, and the greatest of all steps, over the median step.
fn loop_ratio(run: &Run) -> (f64, f64) {
    let count = run.lumas.len();
    let step = |t: usize| weighted(&run.matte, &minus(&run.lumas[(t + 1) % count], &run.lumas[t]).map(f32::abs));
    let steps: Vec<f64> = (0..count).map(step).collect();
    let median = median(&steps);
    (steps[count - 1] / median, steps.iter().copied().fold(0.0, f64::max) / median)
}

/// Least contrast of a band of the differences from the mean, over 5 frames, relative to the median over the loop.
fn contrast_dip(run: &Run, band: usize) -> f64 {
    let mean = mean_of(&run.lumas);
    let contrast = |luma: &Plane| {
        let bands = laplacian(&minus(luma, &mean), band + 1).0;
        let matte = enliven::raster::resample::resize(&run.matte, bands[band].width, bands[band].height);
        weighted(&matte, &bands[band].map(|v| v * v)).sqrt()
    };
    let contrasts: Vec<f64> = run.lumas.iter().map(contrast).collect();
    let count = contrasts.len();
    let window = |t: usize| (0..5).map(|k| contrasts[(t + k) % count]).sum::<f64>() / 5.0;
    (0..count).map(window).fold(f64::MAX, f64::min) / median(&contrasts)
}

/// Mean length of the motion measured on the frames over that of the pieces.
fn motion(run: &Run) -> f64 {
    let (width, height) = (run.matte.width, run.matte.height);
    let mut solver = TvL1::new(width, height, Params::library());
    let mut flow = Field::zeros(width, height);
    let shown = spread(run.lumas.len(), FLOWS).into_iter().map(|t| {
        solver.flow(&run.lumas[t], &run.lumas[(t + 1) % run.lumas.len()], &mut flow);
        weighted(&run.matte, &flow.magnitude())
    });
    let shown = shown.sum::<f64>() / FLOWS as f64;
    shown / weighted(&run.matte, &activity(run))
}

/// Mean length of the motion of the pieces, each over the square that is its own.
fn activity(run: &Run) -> Plane {
    let mut plane = Plane::zeros(run.matte.width, run.matte.height);
    for node in &run.assignment.nodes {
        let (left, top) = (node.x + STRIDE / 2, node.y + STRIDE / 2);
        for y in top..(top + STRIDE).min(plane.height) {
            for x in left..(left + STRIDE).min(plane.width) {
                *plane.at_mut(x, y) = node.activity;
            }
        }
    }
    plane
}

/// Energy of the finest band of the frames over that of the picture.
fn sharpness(run: &Run) -> f64 {
    let energy = |luma: &Plane| weighted(&run.matte, &laplacian(luma, 1).0[0].map(|v| v * v));
    let frames: Vec<f64> = run.lumas.iter().step_by(10).map(energy).collect();
    frames.iter().sum::<f64>() / frames.len() as f64 / energy(&run.picture)
}

/// Variance of the frames' luma over that of the picture.
fn contrast(run: &Run) -> f64 {
    let variance = |luma: &Plane| {
        let mean = weighted(&run.matte, luma) as f32;
        weighted(&run.matte, &luma.map(|l| (l - mean).powi(2)))
    };
    let frames: Vec<f64> = run.lumas.iter().step_by(10).map(variance).collect();
    frames.iter().sum::<f64>() / frames.len() as f64 / variance(&run.picture)
}

/// Standard deviation over time of the frames' mean luma.
fn flicker(run: &Run) -> f64 {
    let means: Vec<f64> = run.lumas.iter().map(|l| weighted(&run.matte, l)).collect();
    let mean = means.iter().sum::<f64>() / means.len() as f64;
    (means.iter().map(|m| (m - mean).powi(2)).sum::<f64>() / means.len() as f64).sqrt()
}

fn save(folder: &Path, name: &str, run: &Run) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    let file = |what: &str| folder.join(format!("{name}-{what}.png"));
    let chosen: Vec<Rgb8> = spread(run.frames.len(), 12).into_iter().map(|t| run.frames[t].clone()).collect();
    write_png(&file("sheet"), &contact_sheet(&chosen, 4, 1600))?;
    for t in [0, 6, run.frames.len() / 2] {
        write_png(&file(&format!("{t:03}")), &run.frames[t])?;
    }
    let change = |t: usize| {
        let grey = minus(&run.lumas[t + 1], &run.lumas[t]).map(|d| 0.5 + 5.0 * d);
        Rgb8 {
            width: grey.width,
            height: grey.height,
            data: grey.data.iter().flat_map(|v| [(v.clamp(0.0, 1.0) * 255.0) as u8; 3]).collect(),
        }
    };
    write_png(&file("change"), &change(run.frames.len() / 2))?;
    let deviation = temporal_variance(&run.lumas).map(|v| 5.0 * v.sqrt());
    let data = deviation.data.iter().flat_map(|v| [(v.clamp(0.0, 1.0) * 255.0) as u8; 3]).collect();
    Ok(write_png(&file("deviation"), &Rgb8 { width: deviation.width, height: deviation.height, data })?)
}

fn mean_of(planes: &[Plane]) -> Plane {
    let mut mean = Plane::zeros(planes[0].width, planes[0].height);
    for plane in planes {
        mean.data.iter_mut().zip(&plane.data).for_each(|(m, v)| *m += v / planes.len() as f32);
    }
    mean
}

fn minus(a: &Plane, b: &Plane) -> Plane {
    Plane::from_vec(a.width, a.height, a.data.iter().zip(&b.data).map(|(a, b)| a - b).collect())
}

fn weighted(matte: &Plane, values: &Plane) -> f64 {
    let product: f64 = matte.data.iter().zip(&values.data).map(|(m, v)| f64::from(m * v)).sum();
    product / matte.data.iter().map(|&m| f64::from(m)).sum::<f64>().max(1e-9)
}

fn median(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[sorted.len() / 2]
}

fn pixels(width: usize, height: usize) -> impl Iterator<Item = (usize, usize)> {
    (0..height).flat_map(move |y| (0..width).map(move |x| (x, y)))
}
