//! Methods beside each other on the same clips.
//!
//! All get the same picture, matte and strokes, and those with a library the same library without the clip. The strokes
//! are what a person would draw who has seen the clip: one stroke on each large part of the matte, along the mean motion
//! there, without a speed. With `--unasked` only `advect`, which can do nothing without, gets them.

use std::fmt::Write as _;
use std::path::Path;
use std::time::Instant;

use anyhow::Result;
use enliven::library::reader::Pack;
use enliven::library::variant::CELL;
use enliven::measure::{Footage, Subject, value};
use enliven::raster::components::Components;
use enliven::raster::image::Plane;
use enliven::render::layout::BANDS;
use enliven::scene::file::SceneFile;

use super::{Arguments, Distances, Known, distances, keep_frames};

/// Parts of the matte below this share of it get no stroke.
const LARGE: f32 = 0.1;
/// Length of a stroke, pixels.
const LENGTH: f32 = 40.0;

/// Writes a stroke for every large part of the matte, through the pixel nearest to its middle.
pub fn draw_strokes(pack: &Pack, clip: u32, matte: &Plane, path: &Path) -> Result<()> {
    let grid = pack.grid(clip, 0)?;
    let parts = Components::above(matte, 0.5);
    let fluid: usize = parts.sizes.iter().sum();
    let mut strokes = String::new();
    for part in (1..=parts.sizes.len()).filter(|part| parts.sizes[part - 1] as f32 > LARGE * fluid as f32) {
        let pixels: Vec<(usize, usize)> = (0..matte.data.len())
            .filter(|&i| parts.labels[i] as usize == part)
            .map(|i| (i % matte.width, i / matte.width))
            .collect();
        let mean =
            |of: &dyn Fn(usize, usize) -> f32| pixels.iter().map(|&(x, y)| of(x, y)).sum::<f32>() / pixels.len() as f32;
        let motion = |k: usize| {
            move |x: usize, y: usize| {
                let cell = (y / CELL).min(grid.height - 1) * grid.width + (x / CELL).min(grid.width - 1);
                grid.cells[cell].mean[k].to_f32()
            }
        };
        let (u, v) = (mean(&motion(0)), mean(&motion(1)));
        let (middle_x, middle_y) = (mean(&|x, _| x as f32), mean(&|_, y| y as f32));
        let far = |&(x, y): &(usize, usize)| (x as f32 - middle_x).hypot(y as f32 - middle_y);
        let Some(&(x, y)) = pixels.iter().min_by(|a, b| far(a).total_cmp(&far(b))) else { continue };
        let scale = 0.5 * LENGTH / u.hypot(v).max(1e-6);
        let end = |sign: f32| {
            let place = |c: usize, d: f32, size: usize| (c as f32 + sign * scale * d).clamp(0.0, size as f32 - 1.0);
            format!("[{:.1}, {:.1}]", place(x, u, matte.width), place(y, v, matte.height))
        };
        let comma = if strokes.is_empty() { "" } else { ", " };
        write!(strokes, "{comma}{{\"points\": [{}, {}]}}", end(-1.0), end(1.0))?;
    }
    Ok(std::fs::write(path, format!("{{\"strokes\": [{strokes}]}}"))?)
}

/// Prints a line per clip and method.
pub fn compare(known: &[Known], arguments: &Arguments) -> Result<()> {
    println!("{}", Row::head());
    let mut winners = Vec::new();
    for clip in known {
        println!("{:17} {:9} {:7.1}", clip.name, "floor", 1000.0 * clip.floor.dynamics);
        println!("{:17} {:9} {:7.1}", "", "frozen", 1000.0 * clip.frozen.dynamics);
        println!("{}", real(clip));
        let mut best: Option<(f64, &str)> = None;
        for method in &arguments.method {
            let row = row(clip, method, arguments)?;
            println!("{row}");
            if best.is_none_or(|(least, _)| row.distances.dynamics < least) {
                best = Some((row.distances.dynamics, method));
            }
        }
        winners.extend(best.map(|b| b.1));
    }
    for method in &arguments.method {
        let wins = winners.iter().filter(|w| *w == method).count();
        println!("{method} has the least dynamics distance on {wins} of {} clips", known.len());
    }
    Ok(())
}

/// A method on a clip.
struct Row {
    method: String,
    distances: Distances,
    /// Of dynamics and temporal spectrum: 0 as near as the clip itself, 1 no nearer than the still.
    scores: [f64; 2],
    /// Sharpness, colour, loop, flicker and warp error, see [`MEASURES`].
    values: [f64; 5],
    /// Deviation over time, over the clip's, per band.
    strength: [f32; BANDS],
    seconds: f64,
}

/// The clip itself, by the measures beside the distances.
fn real(clip: &Known) -> Row {
    let (method, distances) = ("real".to_owned(), clip.floor);
    Row {
        method,
        distances,
        scores: clip.scores(distances),
        values: values(&clip.target, &clip.target),
        strength: [1.0; BANDS],
        seconds: 0.0,
    }
}

/// Measures beside the distances, and factors they are printed with.
const MEASURES: [(&str, f64); 5] = [
    ("sharpness retention", 1.0),
    ("colour distance", 1.0),
    ("loop ratio", 1.0),
    ("flicker", 1000.0),
    ("warp error", 1000.0),
];

fn row(clip: &Known, method: &str, arguments: &Arguments) -> Result<Row> {
    let mut scene = SceneFile { method: Some(method.to_owned()), ..clip.scene.clone() };
    if !arguments.unasked || method == "advect" {
        scene.motion.strokes = Some(clip.strokes.clone());
    }
    let start = Instant::now();
    let (footage, _) = clip.animate(&scene)?;
    let seconds = start.elapsed().as_secs_f64();
    if let Some(folder) = &arguments.keep {
        keep_frames(&footage, &folder.join(&clip.name).join(method))?;
    }
    let distances = distances(&footage, &clip.target);
    Ok(Row {
        method: method.to_owned(),
        distances,
        scores: clip.scores(distances),
        values: values(&footage, &clip.target),
        strength: clip.strength(&footage),
        seconds,
    })
}

fn values(footage: &Footage, target: &Footage) -> [f64; 5] {
    let subject = Subject { reference: Some(target), ..Subject::new(footage) };
    MEASURES.map(|(name, factor)| factor * value(name, &subject).unwrap_or(f64::NAN))
}

impl Row {
    fn head() -> String {
        format!(
            "{:17} {:9} {:>7} {:>6} {:>6} {:>8} {:>6} {:>6} {:>6} {:>6} {:>7} {:>6} {:>5}  strength",
            "clip",
            "method",
            "dyn ×1k",
            "score",
            "shape",
            "spec, dB",
            "score",
            "sharp",
            "colour",
            "loop",
            "flick×k",
            "warp×k",
            "s"
        )
    }
}

impl std::fmt::Display for Row {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { method, distances: Distances { dynamics, spectrum, shape }, scores, values, strength, seconds } =
            self;
        let [sharp, colour, closing, flicker, warp] = values;
        write!(
            f,
            "{:17} {method:9} {:7.1} {:6.2} {shape:6.2} {spectrum:8.2} {:6.2} {sharp:6.2} {colour:6.2} {closing:6.2} \
             {flicker:7.2} {warp:6.1} {seconds:5.0}  {strength:.2?}",
            "",
            1000.0 * dynamics,
            scores[0],
            scores[1]
        )
    }
}
