//! Methods beside each other on the same clips.
//!
//! All get the same picture, matte and strokes, and those with a library the same library without the clip. The strokes
//! are what a person would draw who has seen the clip (`scene::clip_strokes`). With `--unasked` only `advect`, which can do nothing without, gets them.

use std::time::Instant;

use anyhow::Result;
use enliven::measure::{Footage, Subject, value};
use enliven::render::layout::BANDS;
use enliven::scene::file::SceneFile;

use super::{Arguments, Distances, Known, distances, keep_frames};

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
