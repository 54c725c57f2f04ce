//! TV-L1's average end-point error and CPU time with both presets, on the Middlebury pairs in
//! `$ENLIVEN_DATA/benchmarks/flow`, and its time per 640 × 360 pair.
//!
//!     ENLIVEN_DATA=... cargo run --release --example flow_accuracy [FOLDER FOR PICTURES]

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use enliven::flow::draw;
use enliven::flow::field::Field;
use enliven::flow::io;
use enliven::flow::tv_l1::{Params, TvL1};
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::resample;

/// Timed runs of each case; the fastest counts.
const RUNS: usize = 5;

fn main() -> Result<()> {
    let data = PathBuf::from(std::env::var_os("ENLIVEN_DATA").context("set ENLIVEN_DATA to the folder of test data")?);
    let pictures = std::env::args_os().nth(1).map(PathBuf::from);
    for (preset, params) in [("quality", Params::quality()), ("library", Params::library())] {
        for name in ["RubberWhale", "Dimetrodon"] {
            let folder = data.join("benchmarks/flow").join(name);
            let (from, to) = (luma(&folder.join("frame10.png"))?, luma(&folder.join("frame11.png"))?);
            let truth = io::read(&folder.join("flow10.flo"))?;
            let (flow, seconds) = timed(params, &from, &to);
            let (width, height) = (from.width, from.height);
            println!("{preset} {name} {width} x {height}: error {:.4} px, {seconds:.3} s", error(&flow, &truth));
            if let Some(folder) = &pictures {
                save(&folder.join(format!("{preset}-{name}.png")), &draw::colour(&flow, 0.0))?;
                save(&folder.join(format!("truth-{name}.png")), &draw::colour(&truth, 0.0))?;
            }
            let small = |plane: &Plane| resample::resize(plane, 640, 360);
            let (_, seconds) = timed(params, &small(&from), &small(&to));
            println!("{preset} {name} resized to 640 x 360: {:.1} ms", 1000.0 * seconds);
        }
    }
    println!("inner iteration at 640 x 360: {:.2} ns per pixel", 1e9 * iteration_seconds());
    Ok(())
}

fn luma(path: &Path) -> Result<Plane> {
    let image = image::open(path).with_context(|| path.display().to_string())?.to_rgb8();
    Ok(Rgb8 { width: image.width() as usize, height: image.height() as usize, data: image.into_raw() }.luma())
}

fn save(path: &Path, image: &Rgb8) -> Result<()> {
    Ok(image::save_buffer(path, &image.data, image.width as u32, image.height as u32, image::ColorType::Rgb8)?)
}

/// CPU time of the calling thread, seconds.
fn cpu_seconds() -> f64 {
    let time = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn timed(params: Params, from: &Plane, to: &Plane) -> (Field, f64) {
    let mut solver = TvL1::new(from.width, from.height, params);
    let mut flow = Field::default();
    let mut run = || {
        let start = cpu_seconds();
        solver.flow(from, to, &mut flow);
        cpu_seconds() - start
    };
    let best = (0..RUNS).map(|_| run()).fold(f64::INFINITY, f64::min);
    (flow, best)
}

/// CPU seconds per pixel and inner iteration: one level, one warp, many iterations less few.
fn iteration_seconds() -> f64 {
    let wave = |x: usize, y: usize| ((x * 7 + y * 13) % 29) as f32 / 29.0;
    let (from, to) = (Plane::from_fn(640, 360, wave), Plane::from_fn(640, 360, |x, y| wave(x + 1, y)));
    let seconds = |iterations: usize| {
        let params = Params { iterations, warps: 1, min_side: usize::MAX, ..Params::library() };
        timed(params, &from, &to).1
    };
    (seconds(210) - seconds(10)) / (200 * 640 * 360) as f64
}

/// Average end-point error over the pixels whose true motion is known.
fn error(flow: &Field, truth: &Field) -> f64 {
    let vectors = |f: &Field| f.u.data.iter().copied().zip(f.v.data.iter().copied()).collect::<Vec<_>>();
    let pairs = vectors(flow).into_iter().zip(vectors(truth));
    let errors: Vec<f64> = pairs
        .filter(|(_, (u, v))| io::is_known(*u, *v))
        .map(|(a, b)| f64::from(a.0 - b.0).hypot(f64::from(a.1 - b.1)))
        .collect();
    errors.iter().sum::<f64>() / errors.len() as f64
}
