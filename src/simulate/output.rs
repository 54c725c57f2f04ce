//! A simulation written into a folder.

use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::Instant;

use serde::Serialize;

use crate::base::atomic_file::AtomicFolder;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{Observer, check, stage};
use crate::base::own_file::{self, Inputs};
use crate::base::par;
use crate::flow::io;
use crate::raster::image::Plane;
use crate::raster::picture_io::encode_deep_grey_png;
use crate::simulate::file::{Mode, SimFile, format};
use crate::simulate::fluid::{Fluid, Frame};
use crate::simulate::setup::Setup;
use crate::video::clip::Sink;
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// Frames alive at once: one being made, one being written, one between.
const WINDOW: usize = 3;
const STAGE: &str = "simulating";
const PREVIEW: &str = "preview.mp4";
const SUMMARY: &str = "summary.json";
const MASKS: &str = "masks";
/// Name of the simulation's file within the folder that is written.
pub const SIMULATION_FILE: &str = "sim.toml";

/// What a simulation came to; `summary.json`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    /// What was simulated.
    pub mode: Mode,
    /// Width and height, pixels.
    pub size: [usize; 2],
    /// Number of frames.
    pub frames: usize,
    /// Steps of the simulation, all together.
    pub steps: usize,
    /// Steps in a second of the clock, without writing.
    pub steps_per_second: f64,
    /// Greatest divergence after projection × side of a pixel / greatest speed; none for water, whose surface has one.
    pub max_divergence: Option<f32>,
    /// Mean rounds of the pressure solver a step; none for water.
    pub solver_rounds: Option<f32>,
    /// Greatest speed, pixels per frame.
    pub max_speed: f32,
    /// Density, or water, that was there at first and that emitters gave; density or depth × pixels.
    pub mass_given: f64,
    /// What left through open sides, less what came in.
    pub mass_left: f64,
    /// What faded.
    pub mass_faded: f64,
    /// What is there at the end.
    pub mass_at_end: f64,
    /// What is missing or too much at the end, as a share of what was given.
    pub mass_drift: f64,
    /// Depth in pixels at white in `height/`; none for gas.
    pub height_white: Option<f32>,
    /// Share of the pixels that were higher than that.
    pub height_clipped: Option<f64>,
}

/// Simulates, and writes the folder `output`: `flow/`, `alpha/`, for water `height/`, `preview.mp4`, `sim.toml`,
/// `masks/` where there are any, and `summary.json`. The folder appears when all of it is there, and replaces an earlier
/// simulation's. A simulation whose own file lies in the folder under that name is run in its place: file and masks stay as
/// they are.
///
/// # Errors
/// Those of [`Fluid::next_frame`]; a folder with other things in it, or with what the simulation is made from; a full disk;
/// an interruption.
pub fn simulate(setup: &Setup, output: &Path, observer: &dyn Observer) -> Result<Summary> {
    let folder = prepare(setup, output)?;
    let mut writer = Writer { setup, folder: &folder, preview: preview(setup, &folder)?, clipped: 0 };
    let mut fluid = Fluid::new(setup);
    let start = Instant::now();
    stage(observer, "run-in", setup.file.run_in as u64, || {
        fluid.run_in(|| {
            observer.advance("run-in", 1);
            check(observer)
        })
    })?;
    let state = Mutex::new((fluid, start.elapsed().as_secs_f64()));
    let frames = setup.file.frames;
    let make = |_| {
        check(observer)?;
        let mut state = state.lock().unwrap_or_else(PoisonError::into_inner);
        let start = Instant::now();
        let frame = state.0.next_frame();
        state.1 += start.elapsed().as_secs_f64();
        frame
    };
    stage(observer, STAGE, frames as u64, || {
        par::ordered_map(0..frames, WINDOW, make, |i, frame| {
            writer.write(i, &frame)?;
            observer.advance(STAGE, 1);
            Ok(())
        })
    })?;
    let (fluid, seconds) = state.into_inner().unwrap_or_else(PoisonError::into_inner);
    let summary = summary(setup, &fluid, seconds, writer.clipped);
    writer.preview.finish()?;
    let text = serde_json::to_string_pretty(&summary)
        .map_err(|e| Error::file(Kind::Io, output, format!("cannot write {SUMMARY}: {e}")).source(e))?;
    folder.write(SUMMARY, text.as_bytes())?;
    check(observer)?;
    folder.commit()?;
    Ok(summary)
}

/// The folder with the simulation's file and its masks in it.
fn prepare(setup: &Setup, output: &Path) -> Result<AtomicFolder> {
    let there = output.join(SIMULATION_FILE);
    let in_place = setup.path.as_ref().is_some_and(|path| Inputs::new([path.clone()]).holding(&there).is_some());
    refuse_stranger(output)?;
    let mut folder = AtomicFolder::create(output, is_ours)?;
    if in_place {
        folder.keep(SIMULATION_FILE);
        let masks = std::fs::read_dir(output.join(MASKS)).into_iter().flatten().flatten();
        masks.for_each(|mask| folder.keep(Path::new(MASKS).join(mask.file_name())));
        return Ok(folder);
    }
    let shapes = setup.file.emitters.iter().map(|e| &e.shape).chain(&setup.file.obstacles);
    let inputs = Inputs::new(shapes.filter_map(|shape| shape.mask.clone()).chain(setup.path.clone()));
    inputs.refuse(output, "simulation", "name another folder with -o")?;
    own_file::check(&there)?;
    let text = format(&with_masks(&setup.file, &folder)?)?;
    folder.write(SIMULATION_FILE, &own_file::marked(text.as_bytes()))?;
    Ok(folder)
}

/// Refuses to replace motion and opacity that no simulation wrote.
fn refuse_stranger(output: &Path) -> Result<()> {
    let Some(name) = ["flow", "alpha", "height", PREVIEW, SUMMARY].into_iter().find(|n| output.join(n).exists()) else {
        return Ok(());
    };
    let summary = std::fs::read(output.join(SUMMARY)).ok();
    let summary = summary.and_then(|bytes| serde_json::from_slice::<serde_json::Value>(&bytes).ok());
    if summary.is_some_and(|summary| summary.get("mass_drift").is_some()) {
        return Ok(());
    }
    Err(Error::file(
        Kind::Usage,
        output,
        format!("holds {name}, which enliven simulate did not write: no {SUMMARY} says so"),
    )
    .remedy("write to another folder"))
}

struct Writer<'s> {
    setup: &'s Setup,
    folder: &'s AtomicFolder,
    preview: Box<dyn Sink>,
    /// Pixels higher than white.
    clipped: usize,
}

impl Writer<'_> {
    fn write(&mut self, number: usize, frame: &Frame) -> Result<()> {
        let name = format!("flow/{number:05}.flo");
        self.folder.write(&name, &io::encode(&self.folder.path().join(&name), &frame.flow)?)?;
        self.grey("alpha", number, &frame.alpha)?;
        if let Some(height) = &frame.height {
            let white = white(self.setup);
            self.clipped += height.data.iter().filter(|&&h| h > white).count();
            self.grey("height", number, &height.map(|h| h / white))?;
        }
        self.preview.push(&frame.preview)
    }

    fn grey(&self, what: &str, number: usize, plane: &Plane) -> Result<()> {
        let name = format!("{what}/{number:05}.png");
        let bytes = encode_deep_grey_png(plane).map_err(|e| {
            Error::file(Kind::Io, &self.folder.path().join(&name), format!("cannot encode PNG: {e}")).source(e)
        })?;
        self.folder.write(&name, &bytes)
    }
}

/// Depth at white in the height pictures.
fn white(setup: &Setup) -> f32 {
    if setup.water.white > 0.0 { setup.water.white } else { 4.0 * setup.water.depth }
}

fn preview(setup: &Setup, folder: &AtomicFolder) -> Result<Box<dyn Sink>> {
    let [width, height] = setup.file.size;
    let rate = FrameRate::new(f64::from(setup.file.fps))?;
    sink::create(&folder.inside(PREVIEW), SinkOptions { width, height, rate, loops: false, alpha: false })
}

/// The file with its masks beside it, so that the folder can be simulated again wherever it is.
fn with_masks(file: &SimFile, folder: &AtomicFolder) -> Result<SimFile> {
    let mut file = file.clone();
    let emitters = file.emitters.iter_mut().map(|e| &mut e.shape).zip(1..).map(|(s, n)| (s, format!("emitter-{n}")));
    let obstacles = file.obstacles.iter_mut().zip(1..).map(|(s, n)| (s, format!("obstacle-{n}")));
    for (shape, name) in emitters.chain(obstacles) {
        let Some(path) = &mut shape.mask else { continue };
        let bytes = std::fs::read(&*path).map_err(|e| Error::io(path, "read", e))?;
        // Pictures are told by their content, whatever the name.
        let name = format!("{MASKS}/{name}.png");
        folder.write(&name, &bytes)?;
        *path = PathBuf::from(name);
    }
    Ok(file)
}

fn summary(setup: &Setup, fluid: &Fluid, seconds: f64, clipped: usize) -> Summary {
    let (tally, (budget, now)) = (fluid.tally, fluid.budget());
    let file = &setup.file;
    let missing = budget.given - budget.left - budget.faded - now;
    let gas = file.mode == Mode::Gas;
    let pixels = (file.size[0] * file.size[1] * file.frames) as f64;
    Summary {
        mode: file.mode,
        size: file.size,
        frames: file.frames,
        steps: tally.steps,
        steps_per_second: tally.steps as f64 / seconds,
        max_divergence: gas.then_some(tally.divergence),
        solver_rounds: gas.then_some(tally.rounds as f32 / tally.steps as f32),
        max_speed: tally.speed,
        mass_given: budget.given,
        mass_left: budget.left,
        mass_faded: budget.faded,
        mass_at_end: now,
        mass_drift: if budget.given > 0.0 { missing.abs() / budget.given } else { 0.0 },
        height_white: (!gas).then(|| white(setup)),
        height_clipped: (!gas).then_some(clipped as f64 / pixels),
    }
}

/// Whether a name in a folder is one that a simulation writes.
fn is_ours(name: &str) -> bool {
    let numbered = |folder: &str, extension: &str| {
        let number = name.strip_prefix(folder).and_then(|n| n.strip_suffix(extension));
        number.is_some_and(|n| n.len() == 5 && n.bytes().all(|b| b.is_ascii_digit()))
    };
    let mask = name.strip_prefix("masks/").and_then(|n| n.strip_suffix(".png"));
    ["flow/", "alpha/", "height/", "masks/", SIMULATION_FILE, SUMMARY, PREVIEW].contains(&name)
        || numbered("flow/", ".flo")
        || numbered("alpha/", ".png")
        || numbered("height/", ".png")
        || mask.is_some_and(|n| n.starts_with("emitter-") || n.starts_with("obstacle-"))
}
