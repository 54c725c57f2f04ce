//! Every method of the registry: frame count and size, background untouched, the same bytes on any number of threads,
//! cancel, and options named when they are wrong.

use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::{Observer, Silent};
use enliven::base::par;
use enliven::library::build::build;
use enliven::library::options;
use enliven::library::reader::Pack;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};
use enliven::scene::scene::{Scene, open};
use enliven::synth::method::{MethodEntry, Outcome};
use enliven::synth::methods::REGISTRY;
use enliven::synth::record::NodeRecord;
use enliven::synth::run::{PreparedScene, run};
use enliven::video::clip::Sink;

use crate::common;
use crate::keep::Keep;

/// A folder with a small library, a picture and a matte whose left third is still.
struct Stage {
    folder: tempfile::TempDir,
}

const SIZE: (usize, usize) = (150, 110);

fn picture() -> Rgb8 {
    let data = (0..SIZE.0 * SIZE.1 * 3).map(|i| 40 + (i * i / 7 % 170) as u8).collect();
    Rgb8 { width: SIZE.0, height: SIZE.1, data }
}

fn matte(x: usize) -> f32 {
    if x < 50 { 0.0 } else { (x as f32 - 49.0).min(20.0) / 20.0 }
}

impl Stage {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        let clips = common::write_clips(folder.path());
        build(&clips, &folder.path().join("small.pack"), &common::options(), &Silent).unwrap();
        write_png(&folder.path().join("p.png"), &picture()).unwrap();
        write_grey_png(&folder.path().join("m.png"), &Plane::from_fn(SIZE.0, SIZE.1, |x, _| matte(x))).unwrap();
        Self { folder }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn scene(&self, more: &str) -> Result<Scene> {
        let text = format!("picture = 'p.png'\nmatte = 'm.png'\nlibrary = ['small.pack']\n{more}");
        std::fs::write(self.path("scene.toml"), text).unwrap();
        Scene::new(open(&self.path("scene.toml"))?)
    }

    fn run(&self, more: &str, observer: &dyn Observer) -> Result<(Vec<Rgb8>, Outcome)> {
        let mut sink = Keep::default();
        let outcome = run(&self.scene(more)?, &mut sink, observer)?;
        Ok((sink.0, outcome))
    }

    /// Names of the library's clips.
    fn clips(&self) -> [String; 3] {
        let pack = Pack::open(&self.path("small.pack")).unwrap();
        std::array::from_fn(|i| pack.clips()[i].id.to_string())
    }

    fn error(&self, more: &str) -> Error {
        self.run(more, &Silent).unwrap_err()
    }
}

/// What methods need that do not get their motion from clips.
const MOVING: &str = "[motion]\ndirection = 90\n";

/// Names a method, and the clip that it cannot do without.
fn named(method: &MethodEntry) -> String {
    let exemplar = if method.name == "okabe2009" { "exemplar = 'a.y4m'\n" } else { "" };
    format!("method = '{}'\n{exemplar}", method.name)
}

#[test]
fn every_method_keeps_the_contract() {
    let stage = Stage::new();
    for method in REGISTRY {
        let settings = format!("{}{MOVING}[output]\nframes = 24\n", named(method));
        let once = |threads| par::with_threads(threads, || stage.run(&settings, &Silent)).unwrap().unwrap();
        let (frames, outcome) = once(1);
        assert_eq!(frames.len(), 24, "{}", method.name);
        let original = picture();
        for frame in &frames {
            assert_eq!((frame.width, frame.height), SIZE);
            for y in 0..SIZE.1 {
                let still = y * SIZE.0 * 3..(y * SIZE.0 + 50) * 3;
                assert_eq!(frame.data[still.clone()], original.data[still], "{}: background changed", method.name);
            }
        }
        assert!(frames.windows(2).all(|pair| pair[0] != pair[1]), "{}: frozen frames", method.name);
        let (again, other) = once(3);
        assert!(frames == again, "{}: frames depend on the number of threads", method.name);
        assert_eq!(outcome.record.assignment, other.record.assignment);
        assert_eq!(outcome.pictures, other.pictures);
    }
}

#[test]
fn a_part_of_the_frames_is_as_in_the_whole() {
    let stage = Stage::new();
    for method in REGISTRY {
        let settings = |range| format!("{}{MOVING}[output]\nframes = 24\n{range}", named(method));
        let whole = stage.run(&settings(""), &Silent).unwrap().0;
        let part = stage.run(&settings("frames_range = [7, 20]"), &Silent).unwrap().0;
        assert!(part == whole[7..20], "{}", method.name);
    }
    // An outline that moves has a past.
    let settings = |range| format!("[output]\nframes = 24\n{range}[database]\ntau = 0.8\n");
    let whole = stage.run(&settings(""), &Silent).unwrap().0;
    let part = stage.run(&settings("frames_range = [7, 20]\n"), &Silent).unwrap().0;
    assert!(part == whole[7..20]);
    for (range, part) in [("[5, 5]", "write 5..6"), ("[6, 5]", "write 5..6"), ("[0, 25]", "allowed: 0..24")] {
        let error = stage.error(&format!("[output]\nframes = 24\nframes_range = {range}"));
        assert!(error.kind() == Kind::Usage && error.to_string().contains(part), "{error}");
    }
}

#[test]
fn memory_bounds_the_run_and_not_its_frames() {
    let stage = Stage::new();
    let whole = stage.run("[output]\nframes = 12\n", &Silent).unwrap().0;
    let little = stage.run("[output]\nframes = 12\nmax_memory = 800_000_000\n", &Silent).unwrap().0;
    assert!(whole == little);
    let error = stage.error("[output]\nmax_memory = 100_000_000\n");
    assert_eq!(error.kind(), Kind::Limit);
    assert!(error.to_string().contains("100 MB are allowed") && error.to_string().contains("--max-memory"), "{error}");
}

#[test]
fn the_name_of_the_picture_does_not_matter() {
    let stage = Stage::new();
    let whole = stage.run("[output]\nframes = 8\n", &Silent).unwrap().0;
    std::fs::rename(stage.path("p.png"), stage.path("p2.png")).unwrap();
    let text = "picture = 'p2.png'\nmatte = 'm.png'\nlibrary = ['small.pack']\n[output]\nframes = 8\n";
    std::fs::write(stage.path("scene.toml"), text).unwrap();
    let mut sink = Keep::default();
    run(&Scene::new(open(&stage.path("scene.toml")).unwrap()).unwrap(), &mut sink, &Silent).unwrap();
    assert!(sink.0 == whole);
}

#[test]
fn the_loop_closes_as_smoothly_as_it_goes_on() {
    let stage = Stage::new();
    for method in REGISTRY {
        let settings = format!("{}{MOVING}[output]\nframes = 32\n", named(method));
        let (frames, _) = stage.run(&settings, &Silent).unwrap();
        let step = |a: &Rgb8, b: &Rgb8| {
            a.data.iter().zip(&b.data).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum::<f64>()
        };
        let steps: Vec<f64> = (0..32).map(|t| step(&frames[t], &frames[(t + 1) % 32])).collect();
        let typical = steps[..31].iter().sum::<f64>() / 31.0;
        assert!(steps[31] < 2.0 * typical, "{}: seam {} typical {typical}", method.name, steps[31]);
    }
}

#[test]
fn a_library_of_fire_is_not_carried_and_what_is_written_chooses_nothing_anew() {
    let stage = Stage::new();
    let clips = common::write_clips(stage.folder.path());
    let fire = options::Options { tag: "fire".into(), ..common::options() };
    build(&clips, &stage.path("fire.pack"), &fire, &Silent).unwrap();
    for (library, method) in [("small", "hybrid"), ("fire", "database")] {
        let file = format!("picture = 'p.png'\nlibrary = ['{library}.pack']\n");
        std::fs::write(stage.path("scene.toml"), file).unwrap();
        let scene = Scene::new(open(&stage.path("scene.toml")).unwrap()).unwrap();
        let written = PreparedScene::new(scene).unwrap().into_scene();
        assert_eq!(written.settings().method.as_deref(), Some(method));
        let again = PreparedScene::new(written.clone()).unwrap().into_scene();
        assert_eq!(again.settings(), written.settings());
    }
}

#[test]
fn another_frame_rate_keeps_the_speed() {
    let stage = Stage::new();
    // The same second of footage at 25 and 50 frames a second: every other frame is the same.
    let (slow, _) = stage.run("method = \"database\"\n[output]\nframes = 24\nfps = 25\n", &Silent).unwrap();
    let (fast, _) = stage.run("method = \"database\"\n[output]\nframes = 48\nfps = 50\n", &Silent).unwrap();
    assert!(slow.iter().zip(fast.iter().step_by(2)).all(|(a, b)| a == b));
    assert!(fast.windows(2).all(|pair| pair[0] != pair[1]));
}

#[test]
fn the_record_tells_what_is_needed_to_repeat_and_to_judge_the_run() {
    let stage = Stage::new();
    let (_, outcome) = stage.run("[output]\nframes = 8\n[database]\nshutter = 2\n", &Silent).unwrap();
    let record = outcome.record;
    assert_eq!(record.output_size, SIZE);
    assert!(record.stages.iter().any(|s| s.name == "frames") && record.seconds > 0.0);
    let assignment = record.assignment.as_ref().unwrap();
    assert_eq!(assignment.clips.iter().map(|c| c.nodes).sum::<usize>(), assignment.nodes.len());
    assert!((assignment.clips.iter().map(|c| c.share).sum::<f64>() - 1.0).abs() < 1e-9);
    assert_eq!(record.scene.options["database"].len(), (REGISTRY[0].options)().len());
    let json = serde_json::to_string(&record).unwrap();
    assert_eq!(serde_json::from_str::<enliven::synth::record::RunRecord>(&json).unwrap(), record);
    assert!(outcome.pictures.iter().any(|(name, picture)| *name == "assignment" && picture.width > SIZE.0));
}

/// Says stop after some frames.
#[derive(Default)]
struct Impatient(AtomicUsize);

impl Observer for Impatient {
    fn advance(&self, stage: &str, steps: u64) {
        if stage == "frames" {
            self.0.fetch_add(steps as usize, Ordering::Relaxed);
        }
    }

    fn cancelled(&self) -> bool {
        self.0.load(Ordering::Relaxed) >= 5
    }
}

#[test]
fn a_cancel_stops_the_run() {
    let stage = Stage::new();
    for method in REGISTRY {
        let settings = format!("{}{MOVING}[output]\nframes = 500\n", named(method));
        let error = stage.run(&settings, &Impatient::default()).unwrap_err();
        assert_eq!(error.kind(), Kind::Interrupted, "{}", method.name);
    }
}

#[test]
fn mistakes_are_named() {
    let stage = Stage::new();
    let contains = |more: &str, words: &str| {
        let error = stage.error(more).to_string();
        assert!(error.contains(words), "{error:?} should contain {words:?}");
    };
    contains("method = 'databse'", "no method \"databse\"");
    contains("[databse]\nshutter = 1", "did you mean \"database\"?");
    contains("[otput]\nframes = 1", "did you mean \"output\"?");
    contains("[database]\nshuter = 1", "did you mean \"shutter\"?");
    contains("[database]\ntau = 1", "database.tau: 1 is out of range");
    contains("[database]\ntau = -0.5", "database.tau: -0.5 is out of range (allowed: 0 to 0.98, or -1");
    contains("[database]\nshutter = -1", "database.shutter: -1 is out of range");
    contains("method = 'advect'", "no motion is asked for anywhere on the fluid");
    contains("method = 'advect'", "draw strokes along the flow (--strokes), or give --direction");
    contains("[advect]\nlife = 2", "advect.life: 2 is out of range");
    contains("[hybrid]\nshutter = 1", "hybrid.shutter: no such key");
    contains("[hybrid]\nsigma = -1", "hybrid.sigma: -1 is out of range");
    contains("[hybrid]\ntau = -0.5", "hybrid.tau: -0.5 is out of range");
    contains("use = ['lava']", "no clip of the library is tagged lava (allowed: test)");
    let [a, b, c] = stage.clips();
    let mut misspelt = a.clone();
    misspelt.replace_range(3..4, if a[3..].starts_with('0') { "1" } else { "0" });
    contains(&format!("without = ['{misspelt}']"), &format!("no clip of the library is called \"{misspelt}\""));
    contains(&format!("without = ['{misspelt}']"), &format!("did you mean \"{a}\"?"));
    contains("without = ['my clip']", "`enliven-db inspect` lists its clips");
    contains(&format!("without = ['{a}', '{b}', '{c}']"), "without: leaves no piece of the library to use");
    std::fs::write(stage.path("text.pack"), "not a pack").unwrap();
    let scene = |library: &[&Path], method: &str| {
        let mut file = open(&stage.path("p.png")).unwrap();
        file.method = Some(method.to_owned());
        file.library = library.iter().map(|p| p.to_path_buf()).collect();
        run(&Scene::new(file).unwrap(), &mut Keep::default(), &Silent).unwrap_err().to_string()
    };
    assert!(scene(&[], "database").contains("the database method needs a library"));
    assert!(scene(&[], "hybrid").contains("the hybrid method needs a library"));
    assert!(scene(&[&stage.path("text.pack")], "database").contains("text.pack"));
}

/// Keeps fluid and opacity.
#[derive(Default)]
struct KeepAlpha(Vec<(Rgb8, Vec<u8>)>);

impl Sink for KeepAlpha {
    fn push(&mut self, _: &Rgb8) -> Result<()> {
        panic!("a frame without opacity");
    }

    fn push_with_alpha(&mut self, frame: &Rgb8, alpha: &[u8]) -> Result<()> {
        self.0.push((frame.clone(), alpha.to_vec()));
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

#[test]
fn the_outline_moves_and_what_it_never_reaches_keeps_its_bytes() {
    let stage = Stage::new();
    let settings = |alpha| format!("[output]\nframes = 20\nalpha = {alpha}\n[database]\ntau = 0.8\n");
    let (frames, outcome) = stage.run(&settings(false), &Silent).unwrap();
    assert!(frames == par::with_threads(3, || stage.run(&settings(false), &Silent)).unwrap().unwrap().0);
    assert!(outcome.pictures.iter().any(|(name, made)| *name == "background" && (made.width, made.height) == SIZE));

    let mut alone = KeepAlpha::default();
    run(&stage.scene(&settings(true)).unwrap(), &mut alone, &Silent).unwrap();
    let (original, mut seen, mut free) = (picture(), 0, 0);
    for (t, (frame, (fluid, alpha))) in frames.iter().zip(&alone.0).enumerate() {
        assert_ne!(alpha, &alone.0[(t + 1) % 20].1, "the outline stands still in frame {t}");
        for (i, &a) in alpha.iter().enumerate() {
            let pixel = 3 * i..3 * i + 3;
            if a == 0 && matte(i % SIZE.0) == 0.0 {
                free += 1;
                assert_eq!(frame.data[pixel.clone()], original.data[pixel], "{i} in frame {t}");
            } else if a == 255 {
                seen += 1;
                let mut pairs = frame.data[pixel.clone()].iter().zip(&fluid.data[pixel]);
                assert!(pairs.all(|(a, b)| a.abs_diff(*b) <= 1), "{i} in frame {t}");
            }
        }
    }
    assert!(seen > 10_000 && free > 10_000, "{seen} {free}");
}

#[test]
fn an_outline_strays_as_far_at_any_frame_rate() {
    let stage = Stage::new();
    let strays = |frames: usize, fps: usize| {
        let settings = format!("[output]\nframes = {frames}\nfps = {fps}\nalpha = true\n");
        let scene = stage.scene(&format!("{settings}[database]\ntau = 0.85\nflicker = 0\n")).unwrap();
        let mut alone = KeepAlpha::default();
        run(&scene, &mut alone, &Silent).unwrap();
        let apart = |i: usize, a: u8| (f32::from(a) - 255.0 * matte(i % SIZE.0)).abs();
        let sum: f32 = alone.0.iter().flat_map(|f| f.1.iter().enumerate()).map(|(i, &a)| apart(i, a)).sum();
        sum / (frames * SIZE.0 * SIZE.1) as f32
    };
    let (slow, fast) = (strays(24, 25), strays(48, 50));
    assert!(slow > 1.0 && (fast / slow - 1.0).abs() < 0.25, "{slow} at 25 frames a second, {fast} at 50");
}

#[test]
fn a_background_that_shows_the_same_is_refused() {
    let stage = Stage::new();
    write_png(&stage.path("same.png"), &picture()).unwrap();
    let error = stage.error("background = 'same.png'\n[output]\nframes = 3\n[database]\ntau = 0.8\n");
    assert_eq!(error.kind(), Kind::Unusable);
    assert!(error.to_string().contains("shows the same as the picture"), "{error}");
}

#[test]
fn clips_of_several_fluids_or_none_are_told_of() {
    let stage = Stage::new();
    let clips = common::write_clips(stage.folder.path());
    let options = options::Options { tag: "other".into(), ..common::options() };
    build(&clips[..1], &stage.path("other.pack"), &options, &Silent).unwrap();
    let notes = |more: &str| {
        let text = format!("picture = 'p.png'\nmatte = 'm.png'\nlibrary = ['small.pack', 'other.pack']\n{more}");
        std::fs::write(stage.path("two.toml"), text + "[output]\nframes = 2\n").unwrap();
        let scene = Scene::new(open(&stage.path("two.toml")).unwrap()).unwrap();
        run(&scene, &mut Keep::default(), &Silent).unwrap().record.notes.join("; ")
    };
    assert!(notes("").contains("clips tagged other and test are used side by side"), "{}", notes(""));
    let said = notes("use = ['other']\n");
    assert!(said.contains("small.pack: none of its clips may be used"), "{said}");
    assert!(said.contains("all the motion comes from 1 clip:") && !said.contains("side by side"), "{said}");
}

#[test]
fn fluid_alone_has_its_matte_as_opacity_when_the_outline_stays() {
    let stage = Stage::new();
    write_png(&stage.path("b.png"), &Rgb8::black(SIZE.0, SIZE.1)).unwrap();
    let mut alone = KeepAlpha::default();
    run(&stage.scene("background = 'b.png'\n[output]\nframes = 3\nalpha = true\n").unwrap(), &mut alone, &Silent)
        .unwrap();
    let expected: Vec<u8> = (0..SIZE.0 * SIZE.1).map(|i| (matte(i % SIZE.0) * 255.0 + 0.5) as u8).collect();
    for (_, alpha) in &alone.0 {
        assert!(alpha.iter().zip(&expected).all(|(a, e)| a.abs_diff(*e) <= 1));
    }
}

#[test]
fn clips_are_left_out_by_name() {
    let stage = Stage::new();
    let used = |more: &str| {
        let (_, outcome) = stage.run(&format!("{more}\n[output]\nframes = 4\n"), &Silent).unwrap();
        let clips = outcome.record.assignment.unwrap().clips;
        clips.into_iter().map(|c| c.clip).collect::<Vec<_>>()
    };
    let favourite = used("")[0].clone();
    assert!(!used(&format!("without = ['{favourite}']")).contains(&favourite));
    let others: Vec<String> = stage.clips().into_iter().filter(|c| *c != favourite).collect();
    assert_eq!(used(&format!("use = ['test']\nwithout = {others:?}")), [favourite]);
}

#[test]
fn two_libraries_and_a_direction_serve_too() {
    let stage = Stage::new();
    std::fs::copy(stage.path("small.pack"), stage.path("other.pack")).unwrap();
    let mut file = open(&stage.path("scene.toml")).unwrap_or_else(|_| stage.scene("").unwrap().settings().clone());
    file.library.push(stage.path("other.pack"));
    file.motion.direction = Some(90.0);
    file.output.frames = Some(6);
    let mut sink = Keep::default();
    let outcome = run(&Scene::new(file).unwrap(), &mut sink, &Silent).unwrap();
    assert_eq!(sink.0.len(), 6);
    assert!(outcome.record.assignment.is_some());
}

/// The stage's picture with strokes down the fluid, `speed` picture pixels a frame fast.
fn with_strokes(stage: &Stage, speed: f32) -> String {
    let text = format!("{{\"strokes\": [{{\"points\": [[100, 10], [100, 100]], \"speed\": {speed}}}]}}");
    std::fs::write(stage.path("s.json"), text).unwrap();
    "[motion]\nstrokes = 's.json'\n[output]\nframes = 8\n".to_owned()
}

#[test]
fn footage_is_played_as_fast_as_is_asked() {
    let stage = Stage::new();
    let (plain, _) = stage.run("[output]\nframes = 8\n", &Silent).unwrap();
    let mut activities = Vec::new();
    for (speed, wanted) in [(0.7, 0.5), (1.4, 1.0), (2.8, 2.0)] {
        let (frames, outcome) = stage.run(&with_strokes(&stage, speed), &Silent).unwrap();
        // At the footage's own speed and direction, what is asked may be what is chosen anyhow.
        assert!(frames.len() == 8 && (wanted == 1.0 || frames != plain), "asked {speed}");
        let assignment = outcome.record.assignment.unwrap();
        for node in &assignment.nodes {
            assert_eq!(node.asked.map(|(_, v)| v > 0.999), Some(true));
            assert!((node.asked_speed.unwrap() - speed).abs() < 1e-3);
        }
        let mean =
            |of: fn(&NodeRecord) -> f32| assignment.nodes.iter().map(of).sum::<f32>() / assignment.nodes.len() as f32;
        let rate = mean(|n| n.rate);
        assert!((rate / wanted - 1.0).abs() < 0.4, "asked {speed}: rate {rate}");
        activities.push(mean(|n| n.activity));
        let rates = assignment.clips.iter().map(|c| f64::from(c.rate) * c.nodes as f64).sum::<f64>();
        assert!((rates / assignment.nodes.len() as f64 - f64::from(rate)).abs() < 1e-4);
    }
    assert!(activities[1] > 1.5 * activities[0] && activities[2] > 1.5 * activities[1], "{activities:?}");
}

#[test]
fn a_run_repeats_from_the_maps_of_what_was_asked() {
    let stage = Stage::new();
    let (_, first) = stage.run(&with_strokes(&stage, 3.0), &Silent).unwrap();
    let picture = |name: &str| &first.pictures.iter().find(|p| p.0 == name).unwrap().1;
    write_png(&stage.path("o.png"), picture("asked-orientation")).unwrap();
    write_png(&stage.path("v.png"), picture("asked-speed")).unwrap();
    let white = first.record.max_speed.unwrap();
    let maps = format!("[motion]\norientation = 'o.png'\nspeed = 'v.png'\nmax_speed = {white}\n[output]\nframes = 8\n");
    let (_, second) = stage.run(&maps, &Silent).unwrap();
    let nodes = |outcome: Outcome| outcome.record.assignment.unwrap().nodes;
    for (a, b) in nodes(first).iter().zip(nodes(second)) {
        let ((u, v), (x, y)) = (a.asked.unwrap(), b.asked.unwrap());
        assert!((u * x + v * y).min(1.0).acos().to_degrees() < 1.0);
        assert!((a.asked_speed.unwrap() - b.asked_speed.unwrap()).abs() < white / 255.0);
        assert_eq!((&a.piece, a.rate), (&b.piece, b.rate));
    }
}
