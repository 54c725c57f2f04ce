//! Simulations as a person meets them: the fixtures, what is written, and how mistakes are named.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicUsize, Ordering};

use enliven::base::error::Kind;
use enliven::base::observe::{Observer, Silent};
use enliven::base::par;
use enliven::flow::io;
use enliven::raster::image::Plane;
use enliven::raster::picture_io::{read_grey, write_grey_png};
use enliven::simulate::file::parse;
use enliven::simulate::fluid::{Fluid, Frame};
use enliven::simulate::output::simulate;
use enliven::simulate::setup::Setup;

const SMOKE: &str = "size = [48, 40]\nframes = 4\n[sides]\ntop = 'open'\n[[emitter]]\ndisc = [24, 30, 6]\nrate = 0.3\n\
                     temperature = 1\nflicker = 0.5\nvelocity = [0, -2]\n[[obstacle]]\nmask = 'rock.png'\n";
const WATER: &str = "mode = 'water'\nsize = [40, 32]\nframes = 3\n[[emitter]]\nbox = [4, 4, 6, 6]\nrate = 1.5\n";

fn folder(text: &str) -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("sim.toml");
    fs::write(&path, text).unwrap();
    let rock = Plane::from_fn(48, 40, |x, y| f32::from((30..40).contains(&x) && (8..14).contains(&y)));
    write_grey_png(&folder.path().join("rock.png"), &rock).unwrap();
    (folder, path)
}

/// Every file below a folder with its bytes, but for the summary, which tells times.
fn files(folder: &Path) -> Vec<(PathBuf, Vec<u8>)> {
    let mut out = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            out.extend(files(&path));
        } else if !path.ends_with("summary.json") {
            out.push((path.strip_prefix(folder).unwrap().to_owned(), fs::read(&path).unwrap()));
        }
    }
    out.sort();
    out
}

#[test]
fn the_fixtures_are_sound() {
    let fixtures = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/simulate");
    for name in ["plume", "fireball", "river", "fire"] {
        Setup::open(&fixtures.join(name).with_extension("toml")).unwrap();
    }
}

#[test]
fn a_folder_holds_all_and_runs_again_with_the_same_bytes_on_any_number_of_threads() {
    let (folder, path) = folder(SMOKE);
    let run = |path: &Path, name: &str, threads: usize| {
        let out = folder.path().join(name);
        let setup = Setup::open(path).unwrap();
        let summary = par::with_threads(threads, || simulate(&setup, &out, &Silent)).unwrap().unwrap();
        (out, summary)
    };
    let (out, summary) = run(&path, "a", 1);
    for name in ["sim.toml", "summary.json", "preview.mp4", "masks/obstacle-1.png"] {
        assert!(out.join(name).is_file(), "{name}");
    }
    let flow = io::read(&out.join("flow/00003.flo")).unwrap();
    let alpha = read_grey(&out.join("alpha/00003.png")).unwrap();
    assert_eq!((flow.width(), flow.height(), alpha.width, alpha.height), (48, 40, 48, 40));
    assert!(flow.v.at(24, 28) < -1.0 && alpha.at(24, 28) > 0.5 && alpha.at(35, 10) == 0.0);
    assert!(summary.max_divergence.unwrap() <= 1e-4 && summary.mass_drift < 1e-5, "{summary:?}");
    // The copy stands for the file; an earlier simulation is replaced.
    let (again, _) = run(&out.join("sim.toml"), "b", 3);
    assert!(files(&out) == files(&again));
    run(&path, "b", 1);
    fs::write(again.join("alpha/mine.txt"), "").unwrap();
    let error = simulate(&Setup::open(&path).unwrap(), &again, &Silent).unwrap_err();
    assert!(error.to_string().contains("alpha/mine.txt"), "{error}");
}

#[test]
fn the_command_tells_what_it_did_and_refuses_with_a_code() {
    let (folder, path) = folder(WATER);
    let run = |file: &Path| {
        let mut command = assert_cmd::Command::cargo_bin("enliven").unwrap();
        command.args(["simulate", "--json", "-o"]).arg(folder.path().join("out")).arg(file).output().unwrap()
    };
    let done = run(&path);
    let summary: serde_json::Value = serde_json::from_slice(&done.stdout).unwrap();
    assert!(done.status.success() && summary["frames"] == 3 && summary["mode"] == "water", "{summary}");
    fs::write(&path, "frams = 3").unwrap();
    let refused = run(&path);
    assert_eq!(refused.status.code(), Some(2));
    assert!(String::from_utf8(refused.stderr).unwrap().contains("did you mean \"frames\"?"));
    assert_eq!(run(&folder.path().join("none.toml")).status.code(), Some(1));
}

#[test]
fn what_a_person_made_stays() {
    let (folder, path) = folder(SMOKE);
    let out = folder.path().join("out");
    let run = |file: &Path| simulate(&Setup::open(file).unwrap(), &out, &Silent).map_err(|e| e.to_string());
    // Run in its own place, again and again, a file stays the very same, and so do its masks.
    fs::create_dir_all(out.join("masks")).unwrap();
    let (mine, mask) = (out.join("sim.toml"), out.join("masks/obstacle-7.png"));
    fs::write(&mine, SMOKE.replace("rock.png", "masks/obstacle-7.png")).unwrap();
    fs::copy(folder.path().join("rock.png"), &mask).unwrap();
    let before = [&mine, &mask].map(|path| fs::read(path).unwrap());
    for file in [mine.clone(), folder.path().join("out/../out/sim.toml")] {
        run(&file).unwrap();
        assert!([&mine, &mask].map(|path| fs::read(path).unwrap()) == before);
        assert!(out.join("flow/00003.flo").is_file());
    }
    // Another simulation does not replace it, nor frames of a target from elsewhere.
    let error = run(&path).unwrap_err();
    assert!(error.contains("sim.toml: was not written by enliven"), "{error}");
    fs::remove_file(&mine).unwrap();
    run(&path).unwrap();
    run(&path).unwrap();
    fs::remove_file(out.join("summary.json")).unwrap();
    let error = run(&path).unwrap_err();
    assert!(error.contains("holds flow, which enliven simulate did not write"), "{error}");
    assert!(out.join("flow/00003.flo").is_file());
}

#[test]
fn water_has_heights() {
    let (folder, path) = folder(WATER);
    let out = folder.path().join("out");
    let summary = simulate(&Setup::open(&path).unwrap(), &out, &Silent).unwrap();
    let height = read_grey(&out.join("height/00002.png")).unwrap().map(|v| v * summary.height_white.unwrap());
    assert!((height.at(30, 25) - 10.0).abs() < 1e-2 && height.at(6, 6) > 11.0, "{}", height.at(6, 6));
    assert!(summary.max_divergence.is_none() && summary.mass_drift < 1e-6, "{summary:?}");
}

#[test]
fn an_interruption_leaves_nothing() {
    struct Stop(AtomicUsize);
    impl Observer for Stop {
        fn cancelled(&self) -> bool {
            self.0.fetch_add(1, Ordering::SeqCst) > 1
        }
    }
    let (folder, path) = folder(SMOKE);
    let before = files(folder.path());
    let error = simulate(&Setup::open(&path).unwrap(), &folder.path().join("out"), &Stop(0.into())).unwrap_err();
    assert_eq!(error.kind(), Kind::Interrupted);
    assert!(files(folder.path()) == before);
}

#[test]
fn mistakes_are_named() {
    let emitter = |text: &str| format!("size = [48, 40]\n[[emitter]]\n{text}\n");
    let disc = |text: &str| emitter(&format!("disc = [20, 20, 4]\n{text}"));
    for (text, said) in [
        ("frams = 3".to_owned(), &["frams: no such key", "did you mean \"frames\"?"][..]),
        ("[sides]\nlefft = 'open'".into(), &["sides.lefft", "did you mean \"left\"?"]),
        ("[gas]\nbuoyansy = 1".into(), &["gas.buoyansy", "did you mean \"buoyancy\"?"]),
        (disc("rates = 1"), &["emitter.rates", "did you mean \"rate\"?"]),
        ("[[obstacle]]\nrate = 1".into(), &["obstacle.rate"]),
        ("mode = 'steam'".into(), &["line 1", "steam"]),
        ("size = [-48, 40]".into(), &["line 1: size = -48 is below 0", "a whole number"]),
        ("size = [48, 40]".into(), &["emitter: there is none", "[[emitter]]"]),
        ("size = [48]".into(), &["line 1: size: "]),
        ("size = [4, 40]".into(), &["size: 4 × 40 pixels", "16 to 4096"]),
        ("size = [4096, 4096]".into(), &["size", "up to 4194304 pixels"]),
        ("frames = 100001".into(), &["frames: 100001 is out of range"]),
        ("seed = -1".into(), &["line 1", "whole number"]),
        ("run_in = 100001".into(), &["run_in: 100001 is out of range", "0 to 100000"]),
        ("run_in = -5".into(), &["line 1"]),
        ("vorticity = nan".into(), &["vorticity: NaN"]),
        ("[gas]\nbuoyancy = nan".into(), &["gas.buoyancy", "out of range"]),
        ("[gas]\nturbulence = 3".into(), &["gas.turbulence", "out of range"]),
        ("[gas]\neddies = 0".into(), &["gas.eddies", "out of range"]),
        ("[gas]\nopacity = inf".into(), &["gas.opacity", "out of range"]),
        ("mode = 'water'\n[water]\ngravity = nan".into(), &["water.gravity", "out of range"]),
        (disc("rate = nan"), &["emitter 1: rate: NaN"]),
        (disc("velocity = [nan, 0]"), &["emitter 1: velocity: NaN"]),
        (disc("soft = -1"), &["emitter 1: soft: -1"]),
        (disc("soft = nan"), &["emitter 1: soft: NaN"]),
        (emitter("mask = 'rock.png'\nsoft = 3"), &["emitter 1: soft", "blur the mask"]),
        (emitter("disc = [1e30, 20, 4]"), &["emitter 1: lies outside the picture"]),
        ("[[obstacle]]\ndisc = [9, 9, inf]".into(), &["obstacle 1: disc"]),
        ("frames = 0".into(), &["frames: 0 is out of range", "1 to 100000"]),
        ("steps = 100".into(), &["steps: 100", "1 to 64"]),
        ("fps = 0".into(), &["fps: 0", "1 to 240"]),
        ("drag = nan".into(), &["drag: NaN"]),
        ("wind = [nan, 0.0]".into(), &["wind: NaN"]),
        ("wind = [40, 0]\nsteps = 2".into(), &["wind: 40 pixels per frame are too fast for 2 steps", "more steps"]),
        (disc("velocity = [0, -17]"), &["emitter 1: velocity: -17", "up to 16 pixels a step"]),
        (disc("rate = -1"), &["emitter 1: rate: -1"]),
        (disc("flicker = 2"), &["emitter 1: flicker: 2"]),
        (disc("temperature = inf"), &["emitter 1: temperature: inf"]),
        (disc("from = 9\nuntil = 9"), &["emitter 1", "no time"]),
        (emitter("disc = [90, 20, 4]"), &["emitter 1: lies outside the picture", "48 × 40"]),
        (emitter("disc = [20, 20, 0]"), &["emitter 1: disc", "a radius above 0"]),
        (emitter("disc = [nan, 20, 4]"), &["emitter 1: disc"]),
        (emitter("box = [2, 2, -5, 4]"), &["emitter 1: box"]),
        (emitter("rate = 1"), &["emitter 1: has no shape"]),
        (disc("box = [2, 2, 5, 4]"), &["more than one shape"]),
        (emitter("mask = 'none.png'"), &["none.png", "no such file"]),
        ("size = [50, 40]\n[[obstacle]]\nmask = 'rock.png'".into(), &["rock.png: is 48 × 40 pixels", "50 × 40"]),
        (disc("rate = 1\n[[obstacle]]\nbox = [10, 10, 20, 20]"), &["emitter 1: lies inside obstacles"]),
        ("[[obstacle]]\nbox = [-9, -9, 999, 999]".into(), &["no room is left"]),
        ("mode = 'water'\n[gas]\ncooling = 0.1".into(), &["gas: a table [gas] in a simulation of water"]),
        ("[water]\ndepth = 3".into(), &["water: a table [water] in a simulation of gas"]),
        (format!("mode = 'water'\n{}", disc("temperature = 1")), &["emitter 1: temperature"]),
        ("mode = 'water'\n[water]\ndepth = -1".into(), &["water.depth", "out of range"]),
    ] {
        let (folder, path) = folder(&text);
        let error = Setup::open(&path).unwrap_err().to_string();
        assert!(said.iter().all(|part| error.contains(part)), "{text}\n{error}");
        assert!(error.contains("sim.toml") || error.contains(".png"), "{error}");
        drop(folder);
    }
}

/// Frames of a simulation, from its text.
fn frames(text: &str, count: usize) -> Vec<Frame> {
    let setup = Setup::new(parse(text, Path::new("sim.toml")).unwrap(), Path::new("")).unwrap();
    let mut fluid = Fluid::new(&setup);
    fluid.run_in(|| Ok(())).unwrap();
    let frames = (0..count).map(|_| fluid.next_frame().unwrap()).collect();
    assert!(fluid.tally.divergence <= 1e-4, "{:?}", fluid.tally);
    frames
}

const PLUME: &str = "[sides]\ntop = 'open'\n[[emitter]]\ndisc = [32, 70, 8]\nsoft = 6\nrate = 0.2\ntemperature = 1\n";

#[test]
fn a_run_in_is_the_beginning_that_is_left_out() {
    let whole = frames(&format!("size = [64, 80]\n{PLUME}"), 12);
    let part = frames(&format!("size = [64, 80]\nrun_in = 9\n{PLUME}"), 3);
    assert!(part[..] == whole[9..]);
    assert!(whole[0].alpha.at(32, 70) > 0.1 && whole[0].alpha.at(32, 30) == 0.0);
}

#[test]
fn turbulence_ends_symmetry_and_only_where_there_is_smoke() {
    let skew = |frame: &Frame| {
        let alpha = &frame.alpha;
        let pair = |i: usize| (alpha.data[i] - alpha.at(63 - i % 64, i / 64)).abs();
        (0..alpha.data.len()).map(pair).fold(0.0, f32::max)
    };
    let last = |gas: &str| frames(&format!("size = [64, 80]\n[gas]\nopacity = 2\n{gas}\n{PLUME}"), 30).pop().unwrap();
    let (calm, stirred) = (last(""), last("turbulence = 0.3"));
    assert!(skew(&calm) < 1e-3 && skew(&stirred) > 0.2, "{} {}", skew(&calm), skew(&stirred));
    let later = "[[emitter]]\ndisc = [32, 40, 3]\nrate = 1\nfrom = 50\nuntil = 60\n";
    let clear = frames(&format!("size = [64, 80]\n[gas]\nturbulence = 1\n{later}"), 5).pop().unwrap();
    assert!(clear.flow.magnitude().data.iter().all(|&speed| speed == 0.0));
}

#[test]
fn what_becomes_too_fast_is_refused_by_frame() {
    let text = "size = [32, 64]\nframes = 60\n[gas]\nbuoyancy = 2\n[[emitter]]\ndisc = [16, 50, 8]\ntemperature = 50\n";
    let setup = Setup::new(parse(text, Path::new("sim.toml")).unwrap(), Path::new("")).unwrap();
    let folder = tempfile::tempdir().unwrap();
    let error = simulate(&setup, &folder.path().join("out"), &Silent).unwrap_err().to_string();
    assert!(error.contains("at frame ") && error.contains("more steps a frame"), "{error}");
    assert_eq!(fs::read_dir(folder.path()).unwrap().count(), 0);
}
