//! How well the motion of a real clip is found in a library without that clip.
//!
//! For every clip: a scene as `enliven-db scenes` makes it, animated with the method's defaults through the functions that
//! `enliven animate` calls; then distances to the clip's own later frames. `floor` is another part of the clip against
//! them, `frozen` the picture held still, `wrong` a library of another fluid, `random` a random candidate at every node.
//! Without `--method` it is the database method's.
//! A score is (distance − floor) / (frozen − floor): 0 moves like the clip itself, 1 no better than a still. `shape` is
//! the dynamics distance with both sides brought to one deviation over time; `strength` that deviation over the clip's,
//! band by band of a Laplacian pyramid, fine to coarse.
//!
//!     ENLIVEN_DATA=… cargo run --release --example leave_one_out -- --water W.pack --fire F.pack --smoke S.pack
//!         [--only NAME,…] [--frames N] [--set METHOD.KEY=VALUE]… [--sweep METHOD.KEY=V1,V2,…]…
//!         [--method METHOD,…] [--unasked] [--held-out]
//!
//! With `--sweep` only scores are printed, a line for the settings as they are and one for each value (of the method
//! that `--method` names). With several methods they are compared, clip by clip: see [`comparison`].

mod comparison;

use std::path::{Path, PathBuf};
use std::time::Instant;

use anyhow::{Context, Result, bail};
use clap::Parser;
use enliven::base::observe::Silent;
use enliven::base::options::Table;
use enliven::flow::strokes::to_json;
use enliven::library::inputs::identify;
use enliven::library::reader::Pack;
use enliven::measure::{Footage, Recorder, Subject, value};
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};
use enliven::raster::pyramid::{laplacian, reduce};
use enliven::render::layout::BANDS;
use enliven::scene::clip_strokes::along_motion;
use enliven::scene::file::{SceneFile, set};
use enliven::scene::left_out::LeftOut;
use enliven::scene::scene::Scene;
use enliven::synth::method::{Outcome, Sources, Synthesizer};
use enliven::synth::methods::database;
use enliven::synth::pieces::options::Options;
use enliven::synth::pieces::piece_method::PieceMethod;
use enliven::synth::record::Timed;
use enliven::synth::run::run;

/// A clip: the fluid's library, and the file below `ENLIVEN_DATA`.
type Listed = (Fluid, &'static str);

/// The clips of the table. Defaults of methods were chosen on these.
const CLIPS: [Listed; 9] = [
    (Fluid::Water, "clips/water/relaxe_waterfall.mp4"),
    (Fluid::Water, "clips/water/nursmj_river.mp4"),
    (Fluid::Fire, "clips/fire/gato_fire.mp4"),
    (Fluid::Smoke, "clips/smoke/parth_smoke.mp4"),
    (Fluid::Water, "clips/water/eco_river.mp4"),
    (Fluid::Water, "clips/water/webar_waterfall.mp4"),
    (Fluid::Water, "clips/water/raventid_sea.mp4"),
    (Fluid::Fire, "clips/fire/pfc_flames.mp4"),
    (Fluid::Smoke, "clips/ink/daisy_ink.mp4"),
];

/// Clips that no default was chosen on.
const HELD_OUT: [Listed; 12] = [
    (Fluid::Water, "clips/water/meditator_river.mp4"),
    (Fluid::Fire, "clips/fire/implax_flames.mp4"),
    (Fluid::Smoke, "clips/smoke/brandi_smoke.mp4"),
    (Fluid::Water, "clips/water/mfr_waterfall.mp4"),
    (Fluid::Fire, "clips/fire/stgc_fire_pot0.avi"),
    (Fluid::Water, "clips/water/royce_ocean.mp4"),
    (Fluid::Smoke, "clips/clouds/carson_smoke.mp4"),
    (Fluid::Water, "clips/water/engpark_waves.mp4"),
    (Fluid::Fire, "clips/fire/szh_candle.mp4"),
    (Fluid::Water, "clips/water/gato_water.mp4"),
    (Fluid::Fire, "clips/fire/furg_house6.mp4"),
    (Fluid::Water, "clips/water/relaxe_rain.mp4"),
];

#[derive(Clone, Copy)]
enum Fluid {
    Water,
    Fire,
    Smoke,
}

#[derive(Parser)]
struct Arguments {
    /// Library of water
    #[arg(long)]
    water: PathBuf,
    /// Library of fire
    #[arg(long)]
    fire: PathBuf,
    /// Library of smoke
    #[arg(long)]
    smoke: PathBuf,
    /// Only these clips (part of a name)
    #[arg(long, value_delimiter = ',')]
    only: Vec<String>,
    /// Frames of the animations, and at most so many of the clip
    #[arg(long, default_value_t = 120)]
    frames: usize,
    /// An option of the method
    #[arg(long = "set")]
    set: Vec<String>,
    /// Values of an option to try one by one, METHOD.KEY=V1,V2
    #[arg(long)]
    sweep: Vec<String>,
    /// Leave nothing out: what the method could do with the right pieces
    #[arg(long)]
    with_itself: bool,
    /// Methods to compare, or the one to sweep
    #[arg(long, value_delimiter = ',')]
    method: Vec<String>,
    /// In a comparison, ask no motion of methods that can do without
    #[arg(long)]
    unasked: bool,
    /// The clips that no default was chosen on, in place of the others
    #[arg(long)]
    held_out: bool,
    /// Keep the frames of every animation as PNG in this folder
    #[arg(long)]
    keep: Option<PathBuf>,
}

impl Arguments {
    fn library(&self, fluid: Fluid) -> &Path {
        match fluid {
            Fluid::Water => &self.water,
            Fluid::Fire => &self.fire,
            Fluid::Smoke => &self.smoke,
        }
    }

    /// A library of another fluid.
    fn wrong(&self, fluid: Fluid) -> &Path {
        self.library(match fluid {
            Fluid::Water => Fluid::Fire,
            Fluid::Fire | Fluid::Smoke => Fluid::Water,
        })
    }
}

/// A clip, its scene, and what its animation should move like.
struct Known {
    name: String,
    fluid: Fluid,
    scene: SceneFile,
    /// Strokes that a person would draw along the clip's motion, for scenes that want some.
    strokes: PathBuf,
    matte: Plane,
    target: Footage,
    /// The clip's own deviation over time, per band.
    deviations: [f32; BANDS],
    floor: Distances,
    frozen: Distances,
}

/// Of motion, and of how fast things happen.
#[derive(Clone, Copy)]
struct Distances {
    dynamics: f64,
    spectrum: f64,
    shape: f64,
}

/// What came of an animation.
struct Animated {
    distances: Distances,
    /// Deviation over time, over the clip's, per band.
    strength: [f32; BANDS],
    largest_share: f64,
    clips: usize,
    seconds: f64,
}

fn keep_frames(footage: &Footage, folder: &Path) -> Result<()> {
    std::fs::create_dir_all(folder)?;
    for (t, frame) in footage.frames().iter().enumerate() {
        write_png(&folder.join(format!("{t:05}.png")), frame)?;
    }
    Ok(())
}

fn distances(footage: &Footage, target: &Footage) -> Distances {
    let subject = Subject { reference: Some(target), ..Subject::new(footage) };
    let of = |name| value(name, &subject).unwrap_or(f64::NAN);
    Distances {
        dynamics: of("dynamics distance"),
        spectrum: of("temporal spectrum distance"),
        shape: of("dynamics shape distance"),
    }
}

/// Deviation over time of each band inside the matte, from every fourth frame.
fn deviations(footage: &Footage, matte: &Plane) -> [f32; BANDS] {
    let frames = || footage.frames().iter().step_by(4).map(|frame| laplacian(&frame.luma(), BANDS).0);
    let mattes: Vec<Plane> = std::iter::successors(Some(matte.clone()), |m| Some(reduce(m))).take(BANDS).collect();
    let count = frames().count() as f32;
    std::array::from_fn(|b| {
        let (mut sum, mut squares) = (Plane::zeros(mattes[b].width, mattes[b].height), 0.0);
        for band in frames().map(|mut bands| bands.swap_remove(b)) {
            for ((s, v), inside) in sum.data.iter_mut().zip(&band.data).zip(&mattes[b].data) {
                *s += v / count;
                squares += inside * v * v / count;
            }
        }
        let still: f32 = sum.data.iter().zip(&mattes[b].data).map(|(m, inside)| inside * m * m).sum();
        ((squares - still).max(0.0) / mattes[b].data.iter().sum::<f32>()).sqrt()
    })
}

impl Known {
    fn open(arguments: &Arguments, fluid: Fluid, file: &str, folder: &Path) -> Result<Self> {
        let data = std::env::var_os("ENLIVEN_DATA").context("ENLIVEN_DATA names no folder")?;
        let path = Path::new(&data).join(file);
        let library = arguments.library(fluid);
        let pack = Pack::open(library)?;
        let id = identify(&path)?;
        let Some(clip) = pack.clips().iter().position(|c| c.id == id) else {
            bail!("{} is not in {}", path.display(), library.display());
        };
        let left = LeftOut::of(&pack, clip as u32, &Silent)?;
        let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let at = |what: &str| folder.join(format!("{name}.{what}.png"));
        write_png(&at("picture"), &left.picture)?;
        write_grey_png(&at("matte"), &left.matte)?;
        let mut scene = SceneFile {
            picture: at("picture"),
            matte: Some(at("matte")),
            library: vec![library.to_owned()],
            without: if arguments.with_itself { Vec::new() } else { vec![id.to_string()] },
            method: Some(
                arguments
                    .method
                    .first()
                    .filter(|_| arguments.method.len() == 1)
                    .map_or(database::ENTRY.name, |m| m)
                    .to_owned(),
            ),
            ..SceneFile::default()
        };
        let strokes = folder.join(format!("{name}.strokes.json"));
        std::fs::write(&strokes, to_json(&along_motion(&pack, clip as u32, &left.matte, false)?))?;
        scene.output.frames = Some(arguments.frames);
        arguments.set.iter().try_for_each(|text| set(&mut scene, text))?;
        let half = (left.reference.len() / 2).min(120);
        let mut reader = pack.frames(clip as u32)?;
        let mut part = |start: usize| {
            let frames = (start..start + half).map(|t| reader.at(t)).collect::<Result<Vec<Rgb8>, _>>()?;
            Footage::new(frames, 25.0, false, Some(&left.matte))
        };
        let (target, other) = (part(left.reference.start)?, part(left.reference.start + half)?);
        let still = Footage::new(vec![left.picture.clone(); half], 25.0, false, Some(&left.matte))?;
        let (floor, frozen) = (distances(&other, &target), distances(&still, &target));
        let deviations = deviations(&target, &left.matte);
        Ok(Self { name, fluid, scene, strokes, matte: left.matte, target, deviations, floor, frozen })
    }

    /// The animation of a scene, and what is known of it.
    fn animate(&self, scene: &SceneFile) -> Result<(Footage, Outcome)> {
        let mut recorder = Recorder::new(640);
        let outcome = run(&Scene::new(scene.clone())?, &mut recorder, &Silent)?;
        Ok((recorder.into_footage(scene.output.fps, true, Some(&self.matte))?, outcome))
    }

    fn run(&self, scene: &SceneFile, keep: Option<&Path>) -> Result<Animated> {
        let start = Instant::now();
        let (footage, outcome) = self.animate(scene)?;
        let seconds = start.elapsed().as_secs_f64();
        keep.map_or(Ok(()), |folder| keep_frames(&footage, folder))?;
        let clips = outcome.record.assignment.map(|a| a.clips).unwrap_or_default();
        let distances = distances(&footage, &self.target);
        Ok(Animated {
            distances,
            strength: self.strength(&footage),
            largest_share: clips.first().map_or(0.0, |c| c.share),
            clips: clips.len(),
            seconds,
        })
    }

    /// Deviation over time of an animation, over the clip's, per band.
    fn strength(&self, footage: &Footage) -> [f32; BANDS] {
        let made = deviations(footage, &self.matte);
        std::array::from_fn(|b| made[b] / self.deviations[b].max(1e-6))
    }

    /// The distances of a random candidate at every node.
    fn random(&self) -> Result<Distances> {
        let scene = Scene::new(self.scene.clone())?;
        let options: Table = scene.options("database");
        let method = PieceMethod::new("database", Options::from_table(&options)?, None).with_random_labels();
        let mut recorder = Recorder::new(640);
        method.synthesize(&scene, &Sources::open(&scene)?, &mut recorder, &Timed::new(&Silent))?;
        Ok(distances(&recorder.into_footage(self.scene.output.fps, true, Some(&self.matte))?, &self.target))
    }

    fn scores(&self, d: Distances) -> [f64; 2] {
        let score = |d: f64, floor: f64, frozen: f64| (d - floor) / (frozen - floor);
        [
            score(d.dynamics, self.floor.dynamics, self.frozen.dynamics),
            score(d.spectrum, self.floor.spectrum, self.frozen.spectrum),
        ]
    }
}

fn table(known: &[Known], arguments: &Arguments) -> Result<()> {
    println!("dynamics distance × 1000 | temporal spectrum distance, dB | dynamics shape distance");
    println!(
        "{:18} {:>6} {:>6} {:>6} {:>6} {:>6}  {:>6} | {:>6} {:>6} {:>6} {:>6} {:>6}  {:>6} | {:>5} {:>5} {:>5} {:>5} | {:>7} {:>5} {:>6} | strength",
        "clip",
        "ours",
        "floor",
        "frozen",
        "wrong",
        "random",
        "score",
        "ours",
        "floor",
        "frozen",
        "wrong",
        "random",
        "score",
        "shape",
        "floor",
        "wrong",
        "rand.",
        "largest",
        "clips",
        "s"
    );
    for clip in known {
        let keep = arguments.keep.as_ref().map(|k| k.join(&clip.name));
        let ours = clip.run(&clip.scene, keep.as_deref())?;
        let library = vec![arguments.wrong(clip.fluid).to_owned()];
        let wrong = clip.run(&SceneFile { library, without: Vec::new(), ..clip.scene.clone() }, None)?;
        let random = clip.random()?;
        let [dynamics, spectrum] = clip.scores(ours.distances);
        let milli = |d: Distances| 1000.0 * d.dynamics;
        println!(
            "{:18} {:6.1} {:6.1} {:6.1} {:6.1} {:6.1}  {dynamics:6.2} | {:6.2} {:6.2} {:6.2} {:6.2} {:6.2}  {spectrum:6.2} | {:5.2} {:5.2} {:5.2} {:5.2} | {:6.0}% {:5} {:6.1} | {:.2?}",
            clip.name,
            milli(ours.distances),
            milli(clip.floor),
            milli(clip.frozen),
            milli(wrong.distances),
            milli(random),
            ours.distances.spectrum,
            clip.floor.spectrum,
            clip.frozen.spectrum,
            wrong.distances.spectrum,
            random.spectrum,
            ours.distances.shape,
            clip.floor.shape,
            wrong.distances.shape,
            random.shape,
            100.0 * ours.largest_share,
            ours.clips,
            ours.seconds,
            ours.strength
        );
    }
    Ok(())
}

/// A line of scores of all clips, and their means.
fn line(known: &[Known], label: &str, text: Option<&str>) -> Result<()> {
    print!("{label:28}");
    let mut sums = [0.0; 2];
    for clip in known {
        let mut scene = clip.scene.clone();
        text.map_or(Ok(()), |text| set(&mut scene, text))?;
        let scores = clip.scores(clip.run(&scene, None)?.distances);
        sums.iter_mut().zip(scores).for_each(|(sum, s)| *sum += s / known.len() as f64);
        print!(" {:5.2}/{:<5.2}", scores[0], scores[1]);
    }
    println!("  mean {:.3} / {:.3}", sums[0], sums[1]);
    Ok(())
}

fn sweep(known: &[Known], arguments: &Arguments) -> Result<()> {
    println!("scores of dynamics / temporal spectrum");
    print!("{:28}", "");
    known.iter().for_each(|k| print!(" {:>11}", &k.name[..k.name.len().min(11)]));
    println!();
    line(known, "as it is", None)?;
    for sweep in &arguments.sweep {
        let (key, values) = sweep.split_once('=').context("--sweep METHOD.KEY=V1,V2")?;
        for value in values.split(',') {
            let text = format!("{key}={value}");
            line(known, &text, Some(&text))?;
        }
    }
    Ok(())
}

fn main() -> Result<()> {
    let arguments = Arguments::parse();
    let folder = tempfile::tempdir()?;
    let wanted =
        |file: &str| arguments.only.is_empty() || arguments.only.iter().any(|only| file.contains(only.as_str()));
    let clips: &[Listed] = if arguments.held_out { &HELD_OUT } else { &CLIPS };
    let known = clips
        .iter()
        .filter(|(_, file)| wanted(file))
        .map(|(fluid, file)| Known::open(&arguments, *fluid, file, folder.path()))
        .collect::<Result<Vec<_>>>()?;
    match (arguments.sweep.is_empty(), arguments.method.len()) {
        (false, _) => sweep(&known, &arguments),
        (true, 0 | 1) => table(&known, &arguments),
        (true, _) => comparison::compare(&known, &arguments),
    }
}
