//! Both programs as a person meets them: what they print, what they leave behind, and how they refuse.
//!
//! ffmpeg is hidden from them throughout (an empty PATH), so that the results do not depend on the machine.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;
use std::sync::OnceLock;

use assert_cmd::Command;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::npy;
use enliven::raster::picture_io::{read_picture, write_grey_png, write_png};
use enliven::report::run::to_json;
use enliven::synth::record::RunRecord;
use serde_json::Value;
use tempfile::TempDir;

use crate::common;

const FAILED: i32 = 1;
const USAGE: i32 = 2;
/// Size of the picture that is animated.
const SIZE: (usize, usize) = (112, 80);

fn program(name: &str, folder: &Path) -> Command {
    let mut command = Command::cargo_bin(name).unwrap();
    command.current_dir(folder).env("PATH", "");
    command
}

fn run<S: AsRef<OsStr>>(name: &str, folder: &Path, arguments: &[S]) -> Output {
    program(name, folder).args(arguments).output().unwrap()
}

/// Arguments separated by blanks.
fn words(line: &str) -> Vec<&str> {
    line.split_whitespace().collect()
}

fn stderr(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn stdout(output: &Output) -> String {
    String::from_utf8(output.stdout.clone()).unwrap()
}

/// Runs a line of a program that must succeed.
fn succeed(folder: &Path, line: &str) -> Output {
    let all = words(line);
    let output = run(all[0], folder, &all[1..]);
    assert!(output.status.success(), "{line}: {}", stderr(&output));
    output
}

/// Everything in a folder and below, by name.
fn tree(folder: &Path) -> Vec<PathBuf> {
    let mut paths = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            paths.extend(tree(&path));
        }
        paths.push(path);
    }
    paths.sort();
    paths
}

/// Runs a line that must be refused with `code` and one line of error that holds all `parts`, leaving nothing behind.
fn refuse(folder: &Path, line: &str, code: i32, parts: &[&str]) {
    let before = tree(folder);
    let all = words(line);
    let output = run(all[0], folder, &all[1..]);
    let said = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{line}: {said}");
    assert!(!said.contains("panicked") && !said.contains("os error"), "{line}: {said}");
    let errors: Vec<&str> = said.lines().filter(|l| l.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{line}: {said}");
    for part in parts {
        assert!(errors[0].contains(part), "{line}: {part:?} is not in {said}");
    }
    assert_eq!(tree(folder), before, "{line}: something was left behind");
}

/// A library of two small clips, built once by the program itself.
fn library() -> &'static Path {
    static LIBRARY: OnceLock<PathBuf> = OnceLock::new();
    LIBRARY.get_or_init(|| {
        let folder = Path::new(env!("CARGO_TARGET_TMPDIR")).join("cli-library");
        fs::create_dir_all(&folder).unwrap();
        common::write_clip(&folder.join("a.y4m"), 1);
        common::write_clip(&folder.join("b.y4m"), 2);
        succeed(&folder, "enliven-db build a.y4m b.y4m -o l.pack --stride 16 --tag water");
        folder.join("l.pack")
    })
}

/// A folder with a picture, mattes and the library.
fn studio() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let (width, height) = SIZE;
    let picture = |width: usize, height: usize| {
        let pixel = |i: usize| {
            let (x, y) = (i % width, i / width);
            [(x * 7 + y * 13) as u8, (x * x + y) as u8, (x + y * y / 3) as u8]
        };
        Rgb8 { width, height, data: (0..width * height).flat_map(pixel).collect() }
    };
    let right = |x: usize, _| f32::from(u8::from(x > width / 4));
    write_png(&at("picture.png"), &picture(width, height)).unwrap();
    write_png(&at("small.png"), &picture(40, 80)).unwrap();
    write_png(&at("dot.png"), &picture(1, 1)).unwrap();
    write_grey_png(&at("matte.png"), &Plane::from_fn(width, height, right)).unwrap();
    write_grey_png(&at("black.png"), &Plane::filled(width, height, 0.0)).unwrap();
    write_grey_png(&at("other.png"), &Plane::filled(50, height, 1.0)).unwrap();
    fs::write(at("text.png"), "This is not a picture.\n").unwrap();
    fs::write(at("text.pack"), "This is not a library.\n").unwrap();
    fs::create_dir(at("empty")).unwrap();
    fs::copy(library(), at("l.pack")).unwrap();
    folder
}

/// A real MP4, from the fixtures.
fn fixture() -> Vec<u8> {
    fs::read(Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/clips/fire/flames.mp4")).unwrap()
}

#[test]
fn clips_that_are_none_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, bytes: &[u8]| fs::write(folder.path().join(name), bytes).unwrap();
    let whole = fixture();
    put("text.mp4", b"These are only words.\n");
    put("empty.mp4", b"");
    put("cut.mp4", &whole[..whole.len() / 3]);
    put("head.mp4", &whole[..100]);
    put("noframes.y4m", b"YUV4MPEG2 W96 H80 F25:1 Ip A1:1 C420jpeg\n");
    put("nothing.mp4", b"\0\0\0\x10ftypisom\0\0\0\0\0\0\0\x08moov");
    let mut hevc = whole;
    let entry = hevc.windows(4).position(|w| w == b"stsd").unwrap() + 16;
    assert_eq!(&hevc[entry..entry + 4], b"avc1");
    hevc[entry..entry + 4].copy_from_slice(b"hvc1");
    put("phone.mp4", &hevc);
    fs::create_dir(folder.path().join("none")).unwrap();
    put("none/notes.txt", b"no clip");
    let cases: &[(&str, &[&str])] = &[
        ("text.mp4", &["text.mp4: not a video", "allowed: MP4", "check that it is a video that plays"]),
        ("empty.mp4", &["empty.mp4: the file is empty"]),
        ("cut.mp4", &["cut.mp4: ", "the file ends before it", "export it again"]),
        ("head.mp4", &["head.mp4: "]),
        ("noframes.y4m", &["noframes.y4m: the clip has no frames"]),
        ("nothing.mp4", &["nothing.mp4: "]),
        ("phone.mp4", &["phone.mp4: ", "HEVC", "install ffmpeg", "H.264"]),
        ("none", &["none: there is no clip in this folder", "mp4"]),
        ("missing.mp4", &["missing.mp4: ", "there is no such file or folder"]),
    ];
    for (name, parts) in cases {
        refuse(folder.path(), &format!("enliven-db scan {name}"), FAILED, parts);
        refuse(folder.path(), &format!("enliven-db build {name} -o l.pack"), FAILED, parts);
    }
    let several = ["none of 2 can be used", "text.mp4: not a video", "scan"];
    refuse(folder.path(), "enliven-db build text.mp4 empty.mp4 -o l.pack", FAILED, &several);
}

#[test]
fn a_build_refuses_bad_options_and_places() {
    let folder = studio();
    common::write_clip(&folder.path().join("a.y4m"), 1);
    let cases: &[(&str, i32, &[&str])] = &[
        ("-o none/l.pack", FAILED, &["none/l.pack: the folder none does not exist", "make that folder"]),
        ("-o text.png/l.pack", FAILED, &["text.png is a file, not a folder"]),
        ("-o empty", USAGE, &["empty: is a folder", "NAME.pack"]),
        ("-o a.y4m", USAGE, &["a.y4m: exists and is not a library", "another name"]),
        ("-o new.pack --stride 10", USAGE, &["--stride", "multiples of 4 from 4 to 48"]),
        ("-o new.pack --working-size 1", USAGE, &["--working-size", "64 to 4096"]),
        ("-o new.pack --tag a,b", USAGE, &["--tag"]),
        ("-o new.pack --threads 100000", USAGE, &["--threads", "0 to 256"]),
        ("", USAGE, &["required"]),
    ];
    for (arguments, code, parts) in cases {
        refuse(folder.path(), &format!("enliven-db build a.y4m {arguments}"), *code, parts);
    }
}

#[test]
fn foreign_newer_damaged_and_missing_packs_are_refused() {
    let folder = studio();
    let whole = fs::read(library()).unwrap();
    let put = |name: &str, change: &dyn Fn(&mut Vec<u8>)| {
        let mut bytes = whole.clone();
        change(&mut bytes);
        fs::write(folder.path().join(name), bytes).unwrap();
    };
    // The major version is judged first: a later one may keep its checksums elsewhere.
    put("newer.pack", &|bytes| bytes[8] += 1);
    put("cut.pack", &|bytes| bytes.truncate(bytes.len() / 2));
    let cases: &[(&str, &[&str])] = &[
        ("text.pack", &["text.pack: not an Enliven pack", "enliven-db build"]),
        ("newer.pack", &["newer.pack: pack of version", "use a newer Enliven"]),
        ("cut.pack", &["cut.pack: "]),
        ("none.pack", &["none.pack: no such library", "enliven-db build"]),
        ("empty", &["empty: ", "folder"]),
    ];
    for (pack, parts) in cases {
        for command in ["verify", "inspect", "inspect --json", "gallery"] {
            refuse(folder.path(), &format!("enliven-db {command} {pack}"), FAILED, parts);
        }
        refuse(folder.path(), &format!("enliven animate picture.png --library {pack} -o x.mp4"), FAILED, parts);
    }
    put("flipped.pack", &|bytes| {
        let middle = bytes.len() / 2;
        bytes[middle] ^= 1;
    });
    refuse(folder.path(), "enliven-db verify flipped.pack", FAILED, &["flipped.pack: ", "damaged"]);
}

#[test]
fn animate_refuses_bad_pictures_and_mattes() {
    let folder = studio();
    let smaller = "at least 48 pixels each way";
    let cases: &[(&str, &[&str])] = &[
        ("small.png", &["small.png: too small: 40 × 80 pixels", smaller, "larger picture"]),
        ("dot.png", &["dot.png: too small: 1 × 1 pixels", smaller]),
        ("text.png", &["text.png: is not a picture", "PNG, JPEG", "convert it to PNG"]),
        ("none.png", &["none.png: there is no such file", "a picture, a scene file"]),
        ("empty", &["empty/scene.toml: there is no such file", "a folder with a scene.toml"]),
        ("picture.png --matte other.png", &["other.png: the matte is 50 × 80", "112 × 80", "make the matte"]),
        (
            "picture.png --matte black.png",
            &["black.png: is all black", "paint white (255, or 65535) where the fluid is"],
        ),
        ("picture.png --matte picture.png", &["picture.png: is in colour", "paint it in white on black"]),
        ("picture.png --matte text.png", &["text.png: is not a picture", "convert it to PNG"]),
        ("picture.png --matte none.png", &["none.png: ", "there is no such file"]),
        ("picture.png --background other.png", &["other.png: the background is 50 × 80"]),
        ("picture.png --use fire", &["no clip of the library is tagged fire", "water"]),
    ];
    for (arguments, parts) in cases {
        let line = format!("enliven animate {arguments} --library l.pack -o x.mp4");
        refuse(folder.path(), &line, FAILED, parts);
    }
}

#[test]
fn animate_refuses_bad_places() {
    let folder = studio();
    let output = |arguments: &str, code: i32, parts: &[&str]| {
        refuse(folder.path(), &format!("enliven animate picture.png {arguments}"), code, parts);
    };
    output(
        "--library l.pack -o none/x.mp4",
        FAILED,
        &["none/x.mp4: the folder none does not exist", "make that folder"],
    );
    output("--library l.pack -o text.png/x.mp4", FAILED, &["text.png is a file, not a folder"]);
    output("--library l.pack -o x.mp4 --report text.png", FAILED, &["text.png: cannot make the folder", "in the way"]);
    output("--library l.pack -o x.mkv", USAGE, &["x.mkv: cannot write .mkv", ".mp4, .gif, .webp, .apng"]);
    output(
        "--library l.pack -o x.mp4 --alpha --report r",
        USAGE,
        &["x.mp4: this format carries no opacity", "a folder of PNG frames; .webp; .apng; .gif", "leave out --alpha"],
    );
    output("--library l.pack -o picture.png", USAGE, &["picture.png: "]);
    output("--library l.pack -o l.pack", USAGE, &["l.pack: is read for this video", "another name"]);
    output("--library l.pack -o - --json", USAGE, &["--json: standard output carries the video", "leave out --json"]);
    output("-o x.mp4", USAGE, &["no motion is asked for", "--strokes", "--direction"]);
    output("--method hybrid -o x.mp4", USAGE, &["library", "enliven-db build CLIPS -o NAME.pack", "--library"]);
    output("--library l.pack", USAGE, &["required"]);
}

#[test]
fn animate_refuses_bad_values() {
    let folder = studio();
    let cases: &[(&str, &[&str])] = &[
        ("--frames 0", &["output.frames", "2 to 100000"]),
        ("--frames -3", &["--frames", "whole number"]),
        ("--frames many", &["--frames", "whole number"]),
        ("--fps 0", &["output.fps", "1 to 240"]),
        ("--direction 1000", &["motion.direction", "-360 to 360 degrees; 0 = right, 90 = down"]),
        ("--direction nan", &["motion.direction", "-360 to 360"]),
        ("--speed matte.png", &["motion.max_speed", "give --max-speed"]),
        ("--speed matte.png --max-speed 0", &["motion.max_speed", "above 0, at most 1000"]),
        ("--max-speed 3", &["motion.max_speed", "without a speed map"]),
        ("--max-speed fast", &["--max-speed", "write a number"]),
        ("--direction north", &["--direction", "write degrees: 0 is right, 90 down"]),
        ("--preview --fps 0.5", &["output.fps: 0.5 is out of range"]),
        ("--size 100x100", &["output.size", "another shape", "allowed: 100 × 71"]),
        ("--size big", &["--size", "1280x720"]),
        ("--working-size 3", &["output.working_size", "96 to 4096"]),
        ("--method databse", &["no method \"databse\"", "did you mean \"database\"?"]),
        ("--set shutter=3", &["--set", "METHOD.KEY=VALUE", "for example"]),
        ("--set database.shuter=3", &["database.shuter: no such key", "did you mean \"shutter\"?"]),
        ("--set database.tua=1", &["database.tua: no such key", "(allowed: tau, ", "did you mean \"tau\"?"]),
        ("--set databse.shutter=3", &["databse: no such key", "did you mean \"database\"?"]),
        ("--set database.shutter=3000", &["database.shutter: 3000 is out of range", "from 0 to 100"]),
        ("--set database.shutter=wide", &["database.shutter", "is not a number"]),
        ("--threads 100000", &["--threads", "0 to 256"]),
    ];
    for (arguments, parts) in cases {
        let line = format!("enliven animate picture.png --library l.pack -o x.mp4 {arguments}");
        refuse(folder.path(), &line, USAGE, parts);
    }
    let files: &[(&str, &[&str])] = &[
        ("--strokes none.json", &["none.json", "check the name"]),
        ("--strokes matte.png", &["matte.png", "has no transparency", "a brush that fades in"]),
        ("--orientation none.png", &["none.png"]),
    ];
    for (arguments, parts) in files {
        refuse(
            folder.path(),
            &format!("enliven animate picture.png --library l.pack -o x.mp4 {arguments}"),
            FAILED,
            parts,
        );
    }
}

#[test]
fn scene_files_are_refused_with_key_or_line() {
    let folder = studio();
    let cases: &[(&str, &[&str])] = &[
        (
            "picture = 'picture.png'\nlibary = ['l.pack']",
            &["scene.toml: libary: no such key", "did you mean \"library\"?"],
        ),
        (
            "picture = 'picture.png'\n[output]\nframe = 3",
            &["scene.toml: output.frame: no such key", "did you mean \"frames\"?"],
        ),
        (
            "picture = 'picture.png'\n[database]\nsigmo = 3",
            &["scene.toml: database.sigmo: no such key", "mean \"sigma\"?"],
        ),
        ("picture = 'picture.png'\n[database]\nsigma = -3", &["scene.toml: database.sigma: -3 is out of range"]),
        ("picture = 'picture.png'\n[databose]\nsigma = 3", &["scene.toml: databose: no such key", "\"database\"?"]),
        ("picture = 'picture.png'\n[database]\nsigma = [3]", &["scene.toml: ", "an option is a number"]),
        ("[motion]\ndirection = 90\n\npicture = picture.png", &["scene.toml: line 4: ", "quoted"]),
        ("picture = 'picture.png'\n[output]\nframes = 'x'", &["scene.toml: ", "a whole number", "output.frames"]),
        ("matte = 'matte.png'", &["picture: no picture given"]),
    ];
    for (text, parts) in cases {
        fs::write(folder.path().join("scene.toml"), text).unwrap();
        refuse(folder.path(), "enliven animate scene.toml --library l.pack -o x.mp4", USAGE, parts);
        refuse(folder.path(), "enliven animate . --library l.pack -o x.mp4", USAGE, parts);
    }
}

/// The value of a measure in what `enliven measure --json` printed.
fn measured<'a>(report: &'a Value, name: &str) -> &'a Value {
    let rows = report["measures"].as_array().unwrap();
    &rows.iter().find(|row| row["name"] == name).unwrap_or_else(|| panic!("no {name}"))["value"]
}

#[test]
fn a_video_is_measured_by_what_is_known_of_it() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    common::write_clip(&at("real.y4m"), 1);
    succeed(folder.path(), "enliven animate picture.png --matte matte.png --library l.pack --frames 40 -o x.mp4");
    let report = |line: &str| -> Value { serde_json::from_slice(&succeed(folder.path(), line).stdout).unwrap() };

    let before = tree(folder.path());
    let whole = report("enliven measure x.mp4 --reference real.y4m --json");
    assert_eq!(tree(folder.path()), before);
    assert_eq!((&whole["frames"], &whole["fps"], &whole["loops"]), (&40.into(), &25.0.into(), &true.into()));
    let rows = whole["measures"].as_array().unwrap();
    let missing: Vec<&str> =
        rows.iter().filter(|r| r["value"].is_null()).map(|r| r["name"].as_str().unwrap()).collect();
    assert_eq!(missing, ["direction error", "speed correlation"]);
    // The library holds no frame of the picture, but the motion is borrowed from this very clip.
    assert!(measured(&whole, "dynamics distance").as_f64().unwrap() < 0.2);
    assert!((0.3..3.0).contains(&measured(&whole, "loop ratio").as_f64().unwrap()));

    let table = stdout(&succeed(folder.path(), "enliven measure x.mp4"));
    assert!(table.starts_with("x.mp4: 40 frames of 112 × 80 at 25 per second"), "{table}");
    assert!(table.contains("n/a") && table.contains("[needs: reference]"), "{table}");

    fs::remove_file(at("x.summary.json")).unwrap();
    let scene_only = report("enliven measure x.mp4 --json");
    assert!(measured(&scene_only, "seam ratio").is_null() && !measured(&scene_only, "colour distance").is_null());
    fs::remove_file(at("x.scene.toml")).unwrap();
    let bare = succeed(folder.path(), "enliven measure x.mp4 --json");
    assert!(stderr(&bare).contains("no scene is known: all of the video is measured"));
    let bare: Value = serde_json::from_slice(&bare.stdout).unwrap();
    assert!(measured(&bare, "colour distance").is_null() && !measured(&bare, "warp error").is_null());
    assert_eq!(bare["loops"], false);
    fs::write(at("down.toml"), "picture = 'picture.png'\n[motion]\ndirection = 90\n").unwrap();
    let asked = report("enliven measure x.mp4 --scene down.toml --json");
    assert!((0.0..180.0).contains(&measured(&asked, "direction error").as_f64().unwrap()));
}

#[test]
fn frames_left_out_and_opacity_are_measured_as_they_are_seen() {
    let folder = studio();
    let measure = |line: &str| {
        let output = succeed(folder.path(), line);
        (stderr(&output), serde_json::from_slice::<Value>(&output.stdout).unwrap())
    };
    let run = "enliven animate picture.png --matte matte.png --library l.pack --quiet";
    succeed(folder.path(), &format!("{run} --frames 48 --fps 100 -o fast.gif"));
    let (_, fast) = measure("enliven measure fast.gif --json");
    assert_eq!(fast["frames"], 24);
    assert!((fast["fps"].as_f64().unwrap() - 50.0).abs() < 0.5, "{}", fast["fps"]);
    succeed(folder.path(), &format!("{run} --frames 40 --fps 30 -o even.gif"));
    assert_eq!(measure("enliven measure even.gif --json").1["fps"], 30.0);

    succeed(folder.path(), &format!("{run} --frames 9 --alpha -o alone"));
    succeed(folder.path(), &format!("{run} --frames 9 -o whole"));
    let ((said, alone), (quiet, whole)) =
        (measure("enliven measure alone --json"), measure("enliven measure whole --json"));
    assert!(said.contains("alone: has opacity; it is measured over the scene's picture") && !quiet.contains("opacity"));
    // The outline stays, so fluid over its picture is the whole frame.
    let [a, b] = [&alone, &whole].map(|report| measured(report, "sharpness retention").as_f64().unwrap());
    assert!((a / b - 1.0).abs() < 0.05, "{a} {b}");
}

#[test]
fn measure_refuses_what_it_cannot_measure() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    let frames = |name: &str, count: usize| {
        fs::create_dir(at(name)).unwrap();
        for t in 0..count {
            let pixel = |i: usize| (i * 7 + t * 31) as u8;
            let frame = Rgb8 { width: 112, height: 80, data: (0..112 * 80 * 3).map(pixel).collect() };
            write_png(&at(name).join(format!("{t:05}.png")), &frame).unwrap();
        }
    };
    frames("few", 3);
    frames("enough", 10);
    fs::write(at("half.toml"), "picture = 'picture.png'\n[output]\nsize = [56, 40]\n").unwrap();
    frames("recorded", 10);
    fs::write(at("recorded.summary.json"), "{}").unwrap();
    let frame = [b"FRAME\n".as_slice(), &[128; 16 * 16 * 3 / 2]].concat();
    let long = [b"YUV4MPEG2 W16 H16 F25:1 Ip A1:1 C420jpeg\n".as_slice(), &frame.repeat(3001)].concat();
    fs::write(at("long.y4m"), long).unwrap();
    let cases: &[(&str, i32, &[&str])] = &[
        ("none.mp4", FAILED, &["none.mp4: cannot open", "there is no such file", "check the name"]),
        ("l.pack", FAILED, &["l.pack: not a video file of any known kind"]),
        ("empty", FAILED, &["empty: no PNG or JPEG pictures"]),
        ("few", FAILED, &["few: it has 3 frames, too few to measure", "at least 8", "longer video"]),
        ("long.y4m", FAILED, &["long.y4m: it has more than 3000 frames", "cut a part"]),
        ("enough --scene half.toml", FAILED, &["enough: its frames are 112 × 80 pixels, the scene's 56 × 40"]),
        ("enough --scene none.toml", FAILED, &["none.toml: there is no such file"]),
        ("enough --reference none.mp4", FAILED, &["none.mp4: ", "there is no such file"]),
        ("enough --reference text.png", FAILED, &["text.png: not a video"]),
        ("enough --reference few", FAILED, &["few: it has 3 frames at 25 a second, too few", "at least 32"]),
        ("enough --reference-size 3", USAGE, &["--reference-size: 3 is out of range", "16 to 4096"]),
        ("recorded", FAILED, &["recorded.summary.json: cannot be read as the summary of a run", "move this file"]),
    ];
    for (arguments, code, parts) in cases {
        refuse(folder.path(), &format!("enliven measure {arguments}"), *code, parts);
    }
    common::write_clip(&at("real.y4m"), 1);
    let black = "enough --reference real.y4m --reference-matte black.png";
    refuse(folder.path(), &format!("enliven measure {black}"), FAILED, &["black.png: is all black"]);
}

#[test]
fn a_library_is_built_shown_and_checked() {
    let folder = tempfile::tempdir().unwrap();
    common::write_clip(&folder.path().join("a.y4m"), 3);
    let scanned: Value =
        serde_json::from_slice(&succeed(folder.path(), "enliven-db scan a.y4m --json").stdout).unwrap();
    assert_eq!((&scanned[0]["accepted"], &scanned[0]["frames"]), (&Value::Bool(true), &Value::from(common::FRAMES)));

    let mut packs = Vec::new();
    for threads in [1, 2] {
        let line =
            format!("enliven-db build a.y4m -o {threads}.pack --stride 16 --tag fall --threads {threads} --json");
        let output = succeed(folder.path(), &line);
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        assert!(report["pieces"].as_u64().unwrap() > 0 && report["accepted"].as_array().unwrap().len() == 1);
        // Without a terminal nothing moves: the estimate, and only stages that take long.
        let (said, short) = (stderr(&output), |l: &str| l.starts_with("1 clip: about ") || l.ends_with(" s"));
        assert!(said.lines().all(short) && !said.contains('\r') && !said.contains('\x1b'), "{said}");
        packs.push(fs::read(folder.path().join(format!("{threads}.pack"))).unwrap());
    }
    assert!(packs[0] == packs[1], "the pack depends on the number of threads");
    assert_eq!(tree(folder.path()).len(), 5);
    let quiet = succeed(folder.path(), "enliven-db build a.y4m -o 1.pack --stride 16 --tag fall --quiet");
    assert_eq!(stderr(&quiet), "");
    assert!(stdout(&quiet).contains("1.pack: 1 clip, "));

    let shown: Value =
        serde_json::from_slice(&succeed(folder.path(), "enliven-db inspect 1.pack --json").stdout).unwrap();
    assert_eq!((&shown["clips"][0]["tag"], &shown["stride"]), (&Value::from("fall"), &Value::from(16)));
    assert!(stdout(&succeed(folder.path(), "enliven-db inspect 1.pack")).contains("fall"));
    let sound: Value =
        serde_json::from_slice(&succeed(folder.path(), "enliven-db verify 1.pack --json").stdout).unwrap();
    assert_eq!((&sound["sound"], &sound["pieces"]), (&Value::Bool(true), &shown["pieces"]));

    let output = succeed(folder.path(), "enliven-db gallery 1.pack");
    assert_eq!(stdout(&output).trim(), "1.gallery/index.html");
    let page = fs::read_to_string(folder.path().join("1.gallery/index.html")).unwrap();
    let sources: Vec<&str> = page.split("src=\"").skip(1).map(|s| s.split('"').next().unwrap()).collect();
    assert_eq!(sources.len(), 3);
    assert!(
        sources.iter().all(|s| folder.path().join("1.gallery").join(s).metadata().unwrap().len() > 100),
        "{sources:?}"
    );
}

#[test]
fn frames_of_a_folder_are_a_clip() {
    let folder = tempfile::tempdir().unwrap();
    fs::create_dir(folder.path().join("frames")).unwrap();
    common::write_clip(&folder.path().join("a.y4m"), 3);
    let clip = fs::read(folder.path().join("a.y4m")).unwrap();
    let header = clip.iter().position(|&b| b == b'\n').unwrap() + 1;
    let pixels = common::WIDTH * common::HEIGHT;
    for (t, frame) in clip[header..].chunks(6 + pixels * 3 / 2).enumerate() {
        let data = frame[6..6 + pixels].iter().map(|&v| f32::from(v) / 255.0).collect();
        let plane = Plane::from_vec(common::WIDTH, common::HEIGHT, data);
        write_grey_png(&folder.path().join(format!("frames/{t:04}.png")), &plane).unwrap();
    }
    succeed(folder.path(), "enliven-db build frames -o f.pack --stride 16");
    succeed(folder.path(), "enliven-db verify f.pack");
}

#[test]
fn videos_are_written_with_their_scene_and_summary() {
    let folder = studio();
    let common = "enliven animate picture.png --matte matte.png --library l.pack --frames 5";
    let cases = [
        ("a.mp4", "a", &b"ftyp"[..], 4),
        ("take.2.gif", "take.2", b"GIF89a", 0),
        ("b.y4m", "b", b"YUV4MPEG2", 0),
        ("c.webp", "c", b"WEBPVP8X", 8),
        ("d.apng", "d", b"\x89PNG", 0),
        ("frames", "frames", b"", 0),
        ("frames.2/", "frames.2", b"", 0),
    ];
    for (name, stem, magic, at) in cases {
        let before = tree(folder.path()).len();
        let output = succeed(folder.path(), &format!("{common} -o {name}"));
        assert!(stderr(&output).contains("5 frames of 112 × 80"), "{}", stderr(&output));
        let path = folder.path().join(name);
        let mut new = 3;
        if path.is_dir() {
            assert_eq!(tree(&path).len(), 5);
            new += 5;
        } else {
            assert!(fs::read(&path).unwrap()[at..].starts_with(magic), "{name}");
        }
        assert_eq!(tree(folder.path()).len(), before + new, "{name}");
        let summary = fs::read(folder.path().join(format!("{stem}.summary.json"))).unwrap();
        let summary: Value = serde_json::from_slice(&summary).unwrap();
        assert_eq!(summary["scene"]["output"]["frames"], 5);
        let scene = fs::read_to_string(folder.path().join(format!("{stem}.scene.toml"))).unwrap();
        assert!(scene.contains("picture = \"picture.png\""), "{scene}");
    }
    let output = succeed(folder.path(), &format!("{common} -o e.mp4 --report report --json --quiet"));
    let printed: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(printed["output_size"], serde_json::json!([112, 80]));
    assert_eq!(stderr(&output), "");
    for name in ["contact-sheet.png", "assignment.png", "orientation.png", "speed.png"] {
        assert!(folder.path().join("report").join(name).is_file(), "{name}");
    }
    the_page_tells_what_the_summary_holds(&folder.path().join("report"));
    // What was written is a wish that can be fed back; the scene that ran keeps it.
    let white = printed["max_speed"].as_f64().unwrap();
    let back = format!("--orientation report/orientation.png --speed report/speed.png --max-speed {white}");
    succeed(folder.path(), &format!("{common} {back} -o d.gif --report again"));
    assert!(folder.path().join("again/asked-orientation.png").is_file());
    assert!(fs::read_to_string(folder.path().join("d.scene.toml")).unwrap().contains("report/orientation.png"));
    let refused = format!("enliven animate picture.png --library l.pack {back} -o report/speed.png");
    refuse(folder.path(), &refused, USAGE, &["report/speed.png: is read for this video"]);
    let repainted = fs::read(folder.path().join("report/speed.png")).unwrap();
    let refused = format!("enliven animate picture.png --library l.pack {back} -o f.gif --report report");
    refuse(folder.path(), &refused, USAGE, &["is read for this video", "--report"]);
    assert_eq!(fs::read(folder.path().join("report/speed.png")).unwrap(), repainted);
    // A direction named on the command line lies over the scene's map.
    succeed(folder.path(), "enliven animate d.scene.toml --direction 90 --frames 4 -o e.gif");
    let scene = fs::read_to_string(folder.path().join("e.scene.toml")).unwrap();
    assert!(scene.contains("direction = 90") && !scene.contains("orientation"), "{scene}");
}

#[test]
fn a_run_is_handed_to_python_as_arrays() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    let line = "enliven animate picture.png --matte matte.png --library l.pack --direction 90 --frames 5 --quiet";
    let output = succeed(folder.path(), &format!("{line} -o x.npy --arrays arrays --json"));
    let summary: Value = serde_json::from_slice(&output.stdout).unwrap();
    let [width, height] = [0, 1].map(|i| summary["working_size"][i].as_u64().unwrap() as usize);
    let shape = |name: &str| npy::Frames::open(&at(name)).unwrap().shape();
    assert_eq!(shape("x.npy"), [5, 80, 112, 3]);
    assert_eq!(fs::read(at("x.npy")).unwrap(), fs::read(at("arrays/frames.npy")).unwrap());
    assert_eq!(shape("arrays/motion.npy"), [1, height, width, 2]);
    assert_eq!(shape("arrays/asked-direction.npy"), [1, height, width, 2]);
    assert_eq!(shape("arrays/asked-speed.npy"), [1, height, width, 1]);
    assert_eq!(tree(&at("arrays")).len(), 6);
    // What is in a folder stays.
    let earlier = tree(&at("arrays"));
    succeed(folder.path(), &format!("{line} -o x.npy --arrays arrays"));
    assert_eq!(tree(&at("arrays")), earlier, "a command can be repeated");
    fs::write(at("arrays/notes.npy"), "mine").unwrap();
    let refused = format!("{line} -o y.npy --arrays arrays");
    refuse(folder.path(), &refused, FAILED, &["arrays: holds notes.npy", "a new or empty folder"]);
    assert!(!at("y.npy").exists());
    for both in ["-o q.npy --arrays q.npy", "-o q --arrays ./q/", "-o x.npy --report r --arrays r"] {
        refuse(folder.path(), &format!("{line} {both}"), USAGE, &["a folder for the arrays alone"]);
    }
}

#[test]
fn nothing_that_a_person_made_is_written_over() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    let animate = |line: &str| stderr(&succeed(folder.path(), &format!("enliven animate {line}")));
    let wrong = |line: &str, parts: &[&str]| refuse(folder.path(), &format!("enliven animate {line}"), USAGE, parts);
    let mine =
        "# by hand\npicture = 'picture.png'\nmethod = 'advect'\n[motion]\ndirection = 90\n[output]\nframes = 8\n";
    let person = [("x.scene.toml", mine), ("x.summary.json", "{}"), ("x.preview.png", "a picture")];
    person.iter().for_each(|(name, text)| fs::write(at(name), text).unwrap());
    let unchanged = || person.iter().for_each(|(name, text)| assert_eq!(fs::read_to_string(at(name)).unwrap(), *text));

    // A person's files stay, whether they are read or not; a run writes beside them and replaces what it knows as its own.
    for line in ["x.scene.toml", "./x.scene.toml --preview", "picture.png --direction 90 --method advect --frames 8"] {
        let said = animate(&format!("{line} -o x.gif"));
        assert!(said.contains("x.scene.toml: stays as it is; this run writes x.run.scene.toml"), "{said}");
        unchanged();
    }
    assert!(at("x.run.preview.png").exists() && !at("x.run2.scene.toml").exists());
    let measured: Value =
        serde_json::from_slice(&succeed(folder.path(), "enliven measure x.gif --json").stdout).unwrap();
    assert_eq!(measured["loops"], true);

    // What it wrote itself is an input when it is run, and a person's file when it was changed.
    let run = fs::read(at("x.run.scene.toml")).unwrap();
    animate("x.run.scene.toml -o x.gif");
    assert!(fs::read(at("x.run.scene.toml")).unwrap() == run && at("x.run2.scene.toml").exists());
    let edited = fs::read_to_string(at("x.run2.scene.toml")).unwrap() + "# mine now\n";
    fs::write(at("x.run2.scene.toml"), &edited).unwrap();
    animate("x.run.scene.toml -o x.gif");
    assert!(at("x.run3.scene.toml").exists() && fs::read_to_string(at("x.run2.scene.toml")).unwrap() == edited);

    // Videos and frames without a record, and frames that are read.
    let advect = "--direction 90 --method advect --frames 8";
    fs::write(at("filmed.mp4"), "a film").unwrap();
    wrong(
        &format!("picture.png {advect} -o filmed.mp4"),
        &["filmed.mp4: is there already, and no filmed.summary.json"],
    );
    animate(&format!("picture.png {advect} -o frames"));
    animate(&format!("picture.png {advect} -o frames"));
    wrong(&format!("frames/00001.png {advect} -o frames"), &["frames/00001.png: is read for this", "-o"]);
    fs::remove_file(at("frames.summary.json")).unwrap();
    wrong(&format!("picture.png {advect} -o frames"), &["frames: is there already"]);

    // A page of somebody else's where the report would go, and a picture that was painted over.
    fs::create_dir(at("site")).unwrap();
    fs::write(at("site/index.html"), "mine").unwrap();
    wrong(&format!("picture.png {advect} -o y.gif --report site"), &["site/index.html: was not written by enliven"]);
    animate(&format!("picture.png {advect} -o y.gif --report page"));
    animate(&format!("picture.png {advect} -o y.gif --report page"));
    write_png(&at("page/motion.png"), &read_picture(&at("picture.png")).unwrap().rgb).unwrap();
    wrong(
        &format!("picture.png {advect} -o y.gif --report page"),
        &["page/motion.png", "changed since", "move it away"],
    );
}

#[cfg(unix)]
#[test]
fn links_to_what_is_read_are_not_written_over() {
    let folder = studio();
    let at = |name: &str| folder.path().join(name);
    std::os::unix::fs::symlink("picture.png", at("link.png")).unwrap();
    fs::hard_link(at("picture.png"), at("twin.png")).unwrap();
    for name in ["link.png", "twin.png", "./picture.png"] {
        let line = format!("enliven animate picture.png --direction 90 --method advect -o {name}");
        refuse(folder.path(), &line, USAGE, &["picture.png: is read for this video and would be written over"]);
    }
}

#[test]
fn the_names_of_clips_that_a_person_changed_stay_and_galleries_replace_only_galleries() {
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    common::write_clip(&at("a.y4m"), 10);
    let build = || stderr(&succeed(folder.path(), "enliven-db build a.y4m -o l.pack --stride 16"));
    build();
    assert!(!build().contains("names.toml"));
    let names = fs::read_to_string(at("l.pack.names.toml")).unwrap().replace("a.y4m", "the fall");
    fs::write(at("l.pack.names.toml"), &names).unwrap();
    assert!(build().contains("l.pack.names.toml: was not written by enliven, or was changed since"));
    assert_eq!(fs::read_to_string(at("l.pack.names.toml")).unwrap(), names);
    for _ in 0..2 {
        succeed(folder.path(), "enliven-db gallery l.pack");
    }
    fs::write(at("l.gallery/index.html"), "mine").unwrap();
    refuse(folder.path(), "enliven-db gallery l.pack", USAGE, &["l.gallery/index.html", "is not written over"]);
}

#[test]
fn a_demo_goes_into_a_folder_of_its_own() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("falls.mp4"), "a film").unwrap();
    refuse(folder.path(), "enliven demo -o .", USAGE, &["holds other things than an earlier demo"]);
    assert_eq!(tree(folder.path()).len(), 1);
}

fn the_page_tells_what_the_summary_holds(report: &Path) {
    let page = fs::read_to_string(report.join("index.html")).unwrap();
    let sources: Vec<&str> = page.split("src=\"").skip(1).map(|s| s.split('"').next().unwrap()).collect();
    assert!(sources.starts_with(&["../e.mp4", "contact-sheet.png", "assignment.png"]), "{sources:?}");
    assert!(sources.iter().all(|name| report.join(name).is_file()), "{sources:?}");
    let summary = fs::read_to_string(report.join("summary.json")).unwrap();
    let record: RunRecord = serde_json::from_str(&summary).unwrap();
    assert!(summary.ends_with(&to_json(&record).unwrap()[2..]), "all but the mark");
    for clip in &record.assignment.as_ref().unwrap().clips {
        assert!(page.contains(&clip.clip) && page.contains(&format!("{:.1} %", 100.0 * clip.share)), "{page}");
    }
}

#[test]
fn what_was_told_is_written_down() {
    let folder = studio();
    succeed(folder.path(), "enliven animate picture.png --library l.pack --frames 2 -o f.gif --report all --quiet");
    for name in ["all/index.html", "all/summary.json", "f.summary.json"] {
        assert!(fs::read_to_string(folder.path().join(name)).unwrap().contains("no matte given"), "{name}");
    }
}

#[test]
fn a_written_scene_repeats_the_run_on_any_number_of_threads() {
    let folder = studio();
    let flags = "--matte matte.png --library l.pack --frames 6 --fps 12.5 --direction 90 --seed 7 --size 56x40 \
                 --set database.candidates=20 --threads 1";
    succeed(folder.path(), &format!("enliven animate picture.png {flags} -o first.gif"));
    fs::create_dir(folder.path().join("deep")).unwrap();
    succeed(folder.path(), "enliven animate first.scene.toml -o deep/second.gif --threads 2");
    succeed(folder.path(), "enliven animate deep/second.scene.toml -o third.gif --threads 2");
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    assert!(read("first.gif") == read("deep/second.gif") && read("first.gif") == read("third.gif"));
    assert_eq!(read("first.scene.toml"), read("third.scene.toml"));

    // Flags go before the scene file; what they do not name stays.
    succeed(folder.path(), "enliven animate first.scene.toml --frames 4 -o fourth");
    assert_eq!(tree(&folder.path().join("fourth")).len(), 4);
    assert!(fs::read_to_string(folder.path().join("fourth.scene.toml")).unwrap().contains("candidates = 20"));
}

#[test]
fn a_dash_is_a_video_on_standard_output_and_nothing_else() {
    let folder = studio();
    let before = tree(folder.path());
    let output = succeed(folder.path(), "enliven animate picture.png --library l.pack --frames 3 -o -");
    let header = output.stdout.iter().position(|&b| b == b'\n').unwrap() + 1;
    assert!(output.stdout.starts_with(b"YUV4MPEG2 W112 H80 F25:1"));
    assert_eq!((output.stdout.len() - header) % 3, 0);
    assert!(output.stdout[header..].starts_with(b"FRAME"));
    assert!(stderr(&output).contains("no matte given: all of the picture moves"));
    assert_eq!(tree(folder.path()), before);
}

#[test]
fn help_and_methods_are_complete() {
    let folder = tempfile::tempdir().unwrap();
    assert!(stdout(&succeed(folder.path(), "enliven --help")).contains("animate"));
    assert!(stdout(&succeed(folder.path(), "enliven-db --help")).contains("gallery"));
    let methods: Value = serde_json::from_slice(&succeed(folder.path(), "enliven methods --json").stdout).unwrap();
    let options = methods[0]["options"].as_array().unwrap();
    let text = stdout(&succeed(folder.path(), "enliven methods"));
    for option in options {
        assert!(text.contains(&format!("--set database.{}=", option["name"].as_str().unwrap())));
    }
    for name in ["enliven", "enliven-db"] {
        let output = run::<&str>(name, folder.path(), &[]);
        assert_eq!(output.status.code(), Some(USAGE));
        assert!(stderr(&output).contains("Usage"), "{}", stderr(&output));
    }
}

#[test]
fn frames_can_be_made_in_parts() {
    let folder = studio();
    let run = |rest: &str| {
        succeed(folder.path(), &format!("enliven animate picture.png --library l.pack --frames 12 --quiet {rest}"));
    };
    run("-o whole");
    run("-o parts --frames-range 5..12");
    let numbers = |name: &str| fs::read_dir(folder.path().join(name)).unwrap().count();
    assert_eq!((numbers("whole"), numbers("parts")), (12, 7));
    let one = "enliven animate picture.png --library l.pack --frames 12 -o one --frames-range 5..6";
    assert!(stderr(&succeed(folder.path(), one)).contains("one: 1 frame of "));
    run("-o parts --frames-range 0..6");
    assert_eq!(numbers("parts"), 12);
    for i in 0..12 {
        let read = |name: &str| fs::read(folder.path().join(name).join(format!("{i:05}.png"))).unwrap();
        assert!(read("whole") == read("parts"), "frame {i}");
    }
    let line = "enliven animate picture.png --library l.pack --frames 12 -o x";
    for (range, part) in [("4", "write it like 0..40"), ("7..3", "7..3 holds no frame"), ("0..13", "0..12, or a part")]
    {
        refuse(folder.path(), &format!("{line} --frames-range {range}"), USAGE, &[part]);
    }
    for (memory, code, part) in [("1G2", USAGE, "like 800M or 2G"), ("1M", FAILED, "1 MB are allowed")] {
        refuse(folder.path(), &format!("{line} --max-memory {memory}"), code, &[part]);
    }
}

#[test]
fn a_preview_is_small_and_shows_its_first_frame() {
    let folder = studio();
    let line = "enliven animate picture.png --library l.pack --preview --json --quiet --size 56x40 -o x.mp4";
    let output = succeed(folder.path(), line);
    let record: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(record["scene"]["output"]["frames"], 50);
    assert_eq!(record["scene"]["hybrid"]["candidates"], 25);
    assert_eq!(record["output_size"], serde_json::json!([56, 40]));
    assert_eq!(read_picture(&folder.path().join("x.preview.png")).unwrap().rgb.width, 56);
    assert!(folder.path().join("x.mp4").exists());
}

#[test]
fn a_preview_of_a_panorama_or_into_a_folder_works_too() {
    let folder = studio();
    let pixel = |i: usize| (i % 251) as u8;
    let wide = Rgb8 { width: 640, height: 64, data: (0..640 * 64 * 3).map(pixel).collect() };
    write_png(&folder.path().join("wide.png"), &wide).unwrap();
    let line = "enliven animate wide.png --library l.pack --preview --frames 4 --quiet -o frames.2/";
    for _ in 0..2 {
        succeed(folder.path(), line);
        let mut beside: Vec<String> =
            fs::read_dir(folder.path()).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
        beside.retain(|name| name.starts_with("frames"));
        beside.sort();
        assert_eq!(beside, ["frames.2", "frames.2.preview.png", "frames.2.scene.toml", "frames.2.summary.json"]);
    }
}

#[test]
fn a_folder_of_frames_does_not_stand_in_the_way_of_a_gif() {
    let folder = studio();
    fs::create_dir(folder.path().join("x.frames")).unwrap();
    succeed(folder.path(), "enliven animate picture.png --library l.pack --frames 3 --quiet -o x.gif");
    assert!(folder.path().join("x.gif").is_file());
}

#[test]
fn clips_go_by_the_names_of_their_files() {
    let folder = studio();
    let names = folder.path().join("l.pack.names.toml");
    let line = "enliven animate picture.png --library l.pack --frames 3 -o x.gif";
    let bare = stderr(&succeed(folder.path(), line));
    assert!(bare.contains("all the motion comes from 2 clips"), "{bare}");
    fs::copy(library().with_file_name("l.pack.names.toml"), &names).unwrap();
    assert!(stdout(&succeed(folder.path(), "enliven-db inspect l.pack")).contains("b.y4m"));
    let shown: Value =
        serde_json::from_slice(&succeed(folder.path(), "enliven-db inspect l.pack --json").stdout).unwrap();
    let mut files: Vec<&str> = (0..2).map(|i| shown["clips"][i]["name"].as_str().unwrap()).collect();
    files.sort_unstable();
    assert_eq!(files, ["a.y4m", "b.y4m"]);
    succeed(folder.path(), "enliven-db gallery l.pack");
    assert!(fs::read_to_string(folder.path().join("l.gallery/index.html")).unwrap().contains("a.y4m"));

    // One is left out by its name; what is written down names it by hash, and repeats the run without any names.
    succeed(folder.path(), &format!("{line} --without a --report r"));
    let page = fs::read_to_string(folder.path().join("r/index.html")).unwrap();
    assert!(page.contains("b.y4m") && !page.contains("a.y4m"), "{page}");
    let first = fs::read(folder.path().join("x.gif")).unwrap();
    fs::remove_file(&names).unwrap();
    succeed(folder.path(), "enliven animate x.scene.toml -o y.gif");
    assert!(first == fs::read(folder.path().join("y.gif")).unwrap());
    refuse(folder.path(), &format!("{line} --without a"), USAGE, &["no clip of the library is called \"a\""]);

    fs::write(&names, "nonsense").unwrap();
    for line in [line, "enliven-db inspect l.pack", "enliven-db gallery l.pack"] {
        assert!(stderr(&succeed(folder.path(), line)).contains("l.pack.names.toml: holds no names of clips"), "{line}");
    }
}

/// A simulation of nine frames in the folder `sim`.
fn simulated(folder: &Path) {
    let text = "size = [48, 40]\nframes = 9\nrun_in = 6\nfps = 12.5\n[sides]\ntop = 'open'\n[[emitter]]\n\
                disc = [24, 30, 9]\nrate = 0.5\ntemperature = 1\nvelocity = [0, -1]\n";
    fs::write(folder.join("sim.toml"), text).unwrap();
    succeed(folder, "enliven simulate sim.toml -o sim");
}

#[test]
fn a_simulation_is_animated_again_and_measured() {
    let folder = studio();
    simulated(folder.path());
    let line = "enliven animate sim --exemplar picture.png --method lazyfluids --json";
    let output = succeed(folder.path(), &format!("{line} -o a.y4m --report r"));
    let record: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&record["scene"]["output"]["frames"], &record["scene"]["output"]["fps"]), (&9.into(), &12.5.into()));
    assert_eq!(record["output_size"], serde_json::json!([48, 40]));
    assert!(fs::read_to_string(folder.path().join("r/index.html")).unwrap().contains("sim"));
    let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
    let written = fs::read_to_string(folder.path().join("a.scene.toml")).unwrap();
    assert!(written.contains("flow = \"sim/flow\"") && !written.contains("picture ="), "{written}");
    succeed(folder.path(), "enliven animate a.scene.toml -o b.y4m");
    assert!(read("a.y4m") == read("b.y4m"));
    let measured = succeed(folder.path(), "enliven measure a.y4m --json");
    assert!(stdout(&measured).contains("48"), "{}", stdout(&measured));
    succeed(folder.path(), &format!("{line} --preview -o p.y4m"));
    succeed(folder.path(), &format!("{line} --frames 2 --background sim/alpha/00003.png -o c.y4m"));
}

#[test]
fn fields_usage_and_channels_can_be_looked_at() {
    let folder = studio();
    simulated(folder.path());
    let line = "enliven animate sim --exemplar picture.png --method lazyfluids --frames 3 -o a.y4m";
    let output = succeed(folder.path(), &format!("{line} --debug d/e"));
    let names = ["level-0-field.png", "level-0-usage.png", "level-0-channel-blurred-alpha.png"];
    for (frame, name) in (0..3).flat_map(|frame| names.map(|name| (frame, name))) {
        let picture = folder.path().join(format!("d/e/frame-{frame:05}/{name}"));
        assert!(read_picture(&picture).is_ok(), "{}", picture.display());
    }
    assert!(stderr(&output).contains("pictures of fields, usage and channels"), "{}", stderr(&output));
    // The picture is opaque: the smoke is as soft as it was designed.
    assert!(stderr(&output).contains("the edges are the target's own"), "{}", stderr(&output));
    let plain = fs::read(folder.path().join("a.y4m")).unwrap();
    succeed(folder.path(), line);
    assert!(fs::read(folder.path().join("a.y4m")).unwrap() == plain);
    let line =
        "enliven animate picture.png --matte matte.png --direction 90 --method advect --frames 8 -o b.y4m --debug f";
    assert!(stderr(&succeed(folder.path(), line)).contains("f: no pictures"));
    let again = "enliven animate sim --exemplar picture.png -o c.y4m --debug d/e";
    refuse(folder.path(), again, USAGE, &["d/e", "holds frames of an earlier run"]);
    fs::write(folder.path().join("file"), "").unwrap();
    refuse(folder.path(), &line.replace("--debug f", "--debug file/g"), FAILED, &["file/g", "cannot make the folder"]);
}

#[test]
fn mistakes_with_targets_are_named() {
    let folder = studio();
    simulated(folder.path());
    let wrong = |line: &str, parts: &[&str]| refuse(folder.path(), &format!("enliven animate {line}"), USAGE, parts);
    wrong("sim --method database -o x.mp4", &["method: database", "takes no designed [target]", "lazyfluids"]);
    wrong("sim -o x.mp4", &["exemplar", "--exemplar"]);
    wrong("sim.toml -o x.mp4", &["sim.toml", "is a simulation", "run enliven simulate"]);
    fs::create_dir_all(folder.path().join("half/flow")).unwrap();
    wrong("half -o x.mp4", &["half/flow", "has no folder alpha beside it"]);
    wrong("sim --exemplar picture.png --exemplar-alpha luminence -o x.mp4", &["luminence", "\"luminance\""]);
    let lazy = "--exemplar picture.png --method lazyfluids -o x.mp4";
    wrong(&format!("sim {lazy} --frames 10"), &["output.frames: 10 are more", "2 to 9"]);
    wrong(&format!("sim {lazy} --matte matte.png"), &["matte", "whose alpha"]);
    wrong(&format!("sim {lazy} --direction 90"), &["motion", "whose flow"]);
    wrong(&format!("sim {lazy} --frames 2").replace("x.mp4", "sim/alpha/"), &["sim/alpha", "would be written over"]);
    let scene = |text: &str| fs::write(folder.path().join("s.toml"), text).unwrap();
    scene("picture = 'picture.png'\n[target]\nflow = 'sim/flow'\nalpha = 'sim/alpha'");
    wrong(&format!("s.toml {lazy}"), &["picture", "not both", "as background", "as exemplar"]);
    scene("[target]\nflow = 'sim/flow'\nalfa = 'sim/alpha'");
    wrong(&format!("s.toml {lazy}"), &["target.alfa", "did you mean \"alpha\"?"]);
    scene("[target]\nflow = 'sim/flow'\nalpha = 'empty'");
    wrong(&format!("s.toml {lazy}"), &["empty", "no frames"]);
    scene("[target]\nalpha = 'sim/alpha'");
    wrong(&format!("s.toml {lazy}"), &["sim/alpha", "the target has no flow: ", "as flow in [target]"]);
    let twice = "--exemplar picture.png --exemplar matte.png";
    let thrice = "--exemplar-alpha luminance --exemplar-alpha darkness --exemplar-alpha luminance";
    wrong(&format!("sim {twice} {thrice} -o x.mp4"), &["--exemplar-alpha", "is given 3 times for 2 exemplars"]);
    scene("background = 'picture.png'\n[target]\nflow = 'sim/flow'\nalpha = 'sim/alpha'");
    let line = format!("enliven animate s.toml {lazy}");
    refuse(folder.path(), &line, FAILED, &["the background is 112 × 80 pixels, the target 48 × 40"]);
    fs::remove_file(folder.path().join("sim/alpha/00001.png")).unwrap();
    wrong(&format!("sim {lazy}"), &["sim/alpha", "frame 1 is missing", "0 to 8"]);
}

#[cfg(unix)]
mod interrupted {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};

    use super::*;

    fn interrupt(process: u32) {
        let kill = format!("kill -INT {process}");
        assert!(Command::new("/bin/sh").args(["-c", &kill]).status().unwrap().success());
    }

    #[test]
    fn a_build_stopped_by_ctrl_c_is_resumed() {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("clips")).unwrap();
        for i in 0..10 {
            common::write_clip(&folder.path().join(format!("clips/{i}.y4m")), 10 * i);
        }
        let mut child = Command::new(assert_cmd::cargo::cargo_bin("enliven-db"))
            .current_dir(folder.path())
            .args(["build", "clips", "-o", "l.pack", "--stride", "16"])
            .stdout(Stdio::null())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let work = folder.path().join("l.pack.build");
        let finished = || {
            let segment = |e: &std::io::Result<fs::DirEntry>| {
                e.as_ref().is_ok_and(|e| e.path().extension().is_some_and(|x| x == "segment"))
            };
            fs::read_dir(&work).map_or(0, |entries| entries.filter(segment).count())
        };
        let start = Instant::now();
        while finished() == 0 && start.elapsed() < Duration::from_secs(30) {
            std::thread::sleep(Duration::from_millis(2));
        }
        interrupt(child.id());
        let status = child.wait().unwrap();
        let mut said = String::new();
        std::io::Read::read_to_string(&mut child.stderr.take().unwrap(), &mut said).unwrap();
        assert_eq!(status.code(), Some(130), "{said}");
        assert!(said.contains("interrupted") && said.contains("run the same command again"), "{said}");
        assert!(!folder.path().join("l.pack").exists());
        let temporary = |p: &PathBuf| p.extension().is_some_and(|e| e == "part");
        assert!(!tree(folder.path()).iter().any(temporary));

        let output = succeed(folder.path(), "enliven-db build clips -o l.pack --stride 16 --json");
        let report: Value = serde_json::from_slice(&output.stdout).unwrap();
        let resumed = report["accepted"].as_array().unwrap().iter().filter(|c| c["resumed"] == true).count();
        assert!((1..10).contains(&resumed), "{resumed} clips resumed");
        succeed(folder.path(), "enliven-db build clips -o fresh.pack --stride 16");
        let read = |name: &str| fs::read(folder.path().join(name)).unwrap();
        assert!(read("l.pack") == read("fresh.pack"));
        assert!(!work.exists());
    }

    #[test]
    fn a_video_stopped_by_ctrl_c_leaves_nothing() {
        let folder = studio();
        for name in ["x.mp4", "x.gif", "x.webp", "x.apng", "x.y4m", "x"] {
            let before = tree(folder.path());
            let child = Command::new(assert_cmd::cargo::cargo_bin("enliven"))
                .current_dir(folder.path())
                .args(["animate", "picture.png", "--library", "l.pack", "--frames", "90000", "--quiet", "-o", name])
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            let start = Instant::now();
            while tree(folder.path()) == before && start.elapsed() < Duration::from_secs(30) {
                std::thread::sleep(Duration::from_millis(2));
            }
            std::thread::sleep(Duration::from_millis(100));
            interrupt(child.id());
            let output = child.wait_with_output().unwrap();
            assert_eq!(output.status.code(), Some(130), "{name}");
            assert_eq!(stderr(&output), "interrupted: nothing was left half-written\n", "{name}");
            assert_eq!(tree(folder.path()), before, "{name}");
        }
    }

    #[test]
    fn a_reader_that_goes_away_is_no_failure() {
        for line in ["enliven-db inspect l.pack --json", "enliven methods"] {
            let folder = studio();
            let all = words(line);
            let mut child = Command::new(assert_cmd::cargo::cargo_bin(all[0]))
                .current_dir(folder.path())
                .args(&all[1..])
                .stdout(Stdio::piped())
                .stderr(Stdio::piped())
                .spawn()
                .unwrap();
            drop(child.stdout.take());
            let output = child.wait_with_output().unwrap();
            assert!(!stderr(&output).contains("panicked"), "{line}: {}", stderr(&output));
        }
    }
}
