//! Does the motion of the database method obey? `ENLIVEN_DATA=… cargo run --release --example control -- LIBRARY.pack`
//!
//! Pictures and a clip come from the folder that `ENLIVEN_DATA` names. Motion is measured on the frames by TV-L1 at 640
//! pixels, where something was asked. *Of the mean*: the angle between the measured motion, averaged over time, and the
//! asked one (the measure "direction error"). *Each frame*: the mean of the angles between all frames, weighted by the
//! length of the measured motion; the same figure of a real waterfall says what can be expected of such water.

use std::path::{Path, PathBuf};
use std::process::ExitCode;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Silent;
use enliven::base::par;
use enliven::cli::common;
use enliven::flow::field::Field;
use enliven::flow::tv_l1::{Params, TvL1};
use enliven::measure::footage::LONG_SIDE;
use enliven::measure::{self, Footage, Recorder, Subject};
use enliven::raster::image::Plane;
use enliven::raster::picture_io::write_png;
use enliven::raster::resample::resize;
use enliven::scene::file::{Motion, SceneFile};
use enliven::scene::scene::Scene;
use enliven::synth;
use enliven::synth::methods::database;
use enliven::video::conform::{ConformOptions, Conformed};

/// Frames that are made and measured.
const FRAMES: usize = 60;
/// Motion below this is none, pixels per frame: what stands still in a real clip.
const MOVES: f32 = 0.1;
/// Straight down.
const DOWN: (f32, f32) = (0.0, 1.0);

/// Where the data, the library and the files made on the way are.
struct Place {
    data: PathBuf,
    library: PathBuf,
    folder: tempfile::TempDir,
}

/// A picture and the strokes drawn on it.
struct Case {
    picture: &'static str,
    strokes: &'static [&'static [(f32, f32)]],
}

const FOREST: Case = Case {
    picture: "forest-waterfall",
    strokes: &[
        &[(620.0, 320.0), (620.0, 500.0)],
        &[(700.0, 540.0), (700.0, 700.0)],
        &[(1000.0, 540.0), (1000.0, 700.0)],
    ],
};
const PAINTED: Case = Case {
    picture: "painted-waterfall",
    strokes: &[&[(280.0, 200.0), (280.0, 370.0)], &[(120.0, 420.0), (120.0, 505.0)], &[(420.0, 425.0), (420.0, 505.0)]],
};
const RAPIDS: Case = Case {
    picture: "sunset-rapids",
    strokes: &[&[(900.0, 620.0), (100.0, 620.0)], &[(900.0, 800.0), (100.0, 800.0)], &[(900.0, 960.0), (100.0, 960.0)]],
};

/// What was measured where something was asked.
struct Measured {
    /// Angle between mean and asked motion, degrees.
    of_the_mean: f64,
    /// Mean angle over all frames, degrees.
    each_frame: f64,
    /// Mean motion, pixels per frame of the measured size.
    mean: (f64, f64),
    /// Mean length of the motion.
    speed: f64,
}

fn main() -> ExitCode {
    common::main(|| (), |()| run())
}

fn run() -> Result<()> {
    let missing = |what: &str| Error::new(Kind::Usage, what, "is missing").remedy("see the top of examples/control.rs");
    let data = std::env::var_os("ENLIVEN_DATA").map(PathBuf::from).ok_or_else(|| missing("ENLIVEN_DATA"))?;
    let library = std::env::args_os().nth(1).map(PathBuf::from).ok_or_else(|| missing("LIBRARY.pack"))?;
    let folder = tempfile::tempdir().map_err(|e| Error::new(Kind::Io, "temporary folder", e.to_string()))?;
    let place = Place { data, library, folder };
    print("a real waterfall against down", &real(&place.data.join("clips/water/relaxe_waterfall.mp4"))?);
    for case in [&FOREST, &PAINTED] {
        print(&format!("{}, strokes down", case.picture), &place.measured(case, &place.strokes(case, false)?)?);
        print(&format!("{}, nothing asked", case.picture), &place.measured(case, &Motion::default())?);
    }
    for (name, reversed) in [("left", false), ("right", true)] {
        let motion = place.strokes(&RAPIDS, reversed)?;
        print(&format!("{}, strokes to the {name}", RAPIDS.picture), &place.measured(&RAPIDS, &motion)?);
    }
    print(&format!("{}, nothing asked", RAPIDS.picture), &place.measured(&RAPIDS, &Motion::default())?);
    place.speeds(&FOREST)?;
    place.speeds(&RAPIDS)
}

fn print(name: &str, m: &Measured) {
    println!(
        "{name}: of the mean {:.1}°, each frame {:.1}°; mean motion ({:+.3}, {:+.3}), speed {:.3} px/frame",
        m.of_the_mean, m.each_frame, m.mean.0, m.mean.1, m.speed
    );
}

impl Place {
    fn file(&self, case: &Case, motion: &Motion) -> SceneFile {
        let picture = |what: &str| self.data.join("pictures").join(format!("{}{what}.png", case.picture));
        let mut file = SceneFile { picture: picture(""), matte: Some(picture(".matte")), ..SceneFile::default() };
        file.method = Some(database::ENTRY.name.to_owned());
        file.library = vec![self.library.clone()];
        file.motion = motion.clone();
        file.output.frames = Some(FRAMES);
        file
    }

    /// The case's strokes in a file.
    fn strokes(&self, case: &Case, reversed: bool) -> Result<Motion> {
        let points = |s: &[(f32, f32)]| if reversed { s.iter().rev().copied().collect() } else { s.to_vec() };
        let strokes: Vec<_> = case.strokes.iter().map(|s| serde_json::json!({ "points": points(s) })).collect();
        let path = self.folder.path().join(format!("{}{reversed}.json", case.picture));
        std::fs::write(&path, serde_json::json!({ "strokes": strokes }).to_string())
            .map_err(|e| Error::io(&path, "write", e))?;
        Ok(Motion { strokes: Some(path), ..Motion::default() })
    }

    /// Animates with `motion`, and measures where the case's strokes ask something, against them.
    fn measured(&self, case: &Case, motion: &Motion) -> Result<Measured> {
        let file = self.file(case, motion);
        let strokes = if motion.strokes.is_some() { motion.clone() } else { self.strokes(case, false)? };
        let still = Scene::new(SceneFile { motion: strokes, ..file.clone() })?.still(&Silent)?;
        let asked = still.asked.map(|a| a.direction).unwrap_or_default();
        let sure = asked.magnitude();
        let inside =
            still.working_matte.data.iter().zip(&sure.data).map(|(m, s)| m * if *s > 0.25 { 1.0 } else { 0.0 });
        let inside = Plane::from_vec(sure.width, sure.height, inside.collect());
        let mut recorder = Recorder::new(LONG_SIDE);
        synth::run::run(&Scene::new(file.clone())?, &mut recorder, &Silent)?;
        measure(&recorder.into_footage(file.output.fps, true, Some(&inside))?, &asked)
    }

    /// Runs with the speed map of a first run as it is and doubled.
    fn speeds(&self, case: &Case) -> Result<()> {
        let strokes = self.strokes(case, false)?;
        let first = synth::run::run(&Scene::new(self.file(case, &strokes))?, &mut Recorder::new(64), &Silent)?;
        let path = self.folder.path().join("speed.png");
        let map = first.pictures.iter().find(|p| p.0 == "speed").map(|p| &p.1);
        let (Some(map), Some(white)) = (map, first.record.max_speed) else { return Ok(()) };
        write_png(&path, map)?;
        let mut speeds = Vec::new();
        for factor in [1.0, 2.0] {
            let motion = Motion { speed: Some(path.clone()), max_speed: Some(factor * white), ..strokes.clone() };
            let measured = self.measured(case, &motion)?;
            print(&format!("{}, its own speed map × {factor}", case.picture), &measured);
            speeds.push(measured.speed);
        }
        println!("{}, speed map doubled: speed × {:.2}", case.picture, speeds[1] / speeds[0]);
        Ok(())
    }
}

/// A clip against straight down, where it moves.
fn real(path: &Path) -> Result<Measured> {
    let mut reader = Conformed::open(path, &ConformOptions::default())?;
    let mut frames = Vec::new();
    while let Some(frame) = reader.next_frame()?.filter(|_| frames.len() < FRAMES) {
        frames.push(frame);
    }
    let all = Footage::new(frames, 25.0, false, None)?;
    let (width, height) = (all.width(), all.height());
    let mut speed = Plane::zeros(width, height);
    let motion = flows(&all);
    for flow in &motion {
        speed.data.iter_mut().zip(&flow.magnitude().data).for_each(|(s, m)| *s += m / motion.len() as f32);
    }
    let inside = speed.map(|s| if s > MOVES { 1.0 } else { 0.0 });
    let moving = Footage::new(all.frames().to_vec(), 25.0, false, Some(&inside))?;
    let asked = Field { u: Plane::filled(width, height, DOWN.0), v: Plane::filled(width, height, DOWN.1) };
    measure(&moving, &asked)
}

/// Motion between all consecutive frames.
fn flows(footage: &Footage) -> Vec<Field> {
    let frames = footage.frames();
    par::map(frames.len() - 1, |t| {
        let mut flow = Field::default();
        let mut solver = TvL1::new(footage.width(), footage.height(), Params::library());
        solver.flow(&frames[t].luma(), &frames[t + 1].luma(), &mut flow);
        flow
    })
}

/// Measures footage against the asked motion, unit vectors at any size.
fn measure(footage: &Footage, asked: &Field) -> Result<Measured> {
    let sized = |plane: &Plane| resize(plane, footage.width(), footage.height());
    let asked = Field { u: sized(&asked.u), v: sized(&asked.v) };
    let (mut angles, mut lengths, mut sum, mut count) = (0.0, 0.0, (0.0, 0.0), 0.0);
    for flow in flows(footage) {
        for i in (0..footage.inside().len()).filter(|&i| footage.inside()[i]) {
            let (u, v) = (f64::from(flow.u.data[i]), f64::from(flow.v.data[i]));
            let (x, y) = (f64::from(asked.u.data[i]), f64::from(asked.v.data[i]));
            let length = u.hypot(v);
            angles += length * (u * y - v * x).abs().atan2(u * x + v * y).to_degrees();
            (lengths, count) = (lengths + length, count + 1.0);
            sum = (sum.0 + u, sum.1 + v);
        }
    }
    let subject = Subject { asked: Some(&asked), ..Subject::new(footage) };
    let error = measure::value("direction error", &subject);
    Ok(Measured {
        of_the_mean: error.unwrap_or(f64::NAN),
        each_frame: angles / lengths,
        mean: (sum.0 / count, sum.1 / count),
        speed: lengths / count,
    })
}
