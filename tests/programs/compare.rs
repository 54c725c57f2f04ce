//! `enliven compare` as a person meets it: what is made, what is kept, what is told.

use std::fs::{self, File};
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use enliven::base::rng;
use enliven::raster::filter::gaussian;
use enliven::raster::image::{Color, Plane};
use enliven::raster::picture_io::{read_picture, write_grey_png, write_png};
use enliven::report::comparison::{Comparison, Row};
use tempfile::TempDir;

const SIZE: (usize, usize) = (112, 80);

/// A folder with two scenes of one picture.
fn studio() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let noise = |c: u64| {
        let noise = Plane::from_fn(SIZE.0, SIZE.1, |x, y| rng::unit(rng::hash(c, &[x as u64, y as u64])) - 0.5);
        gaussian(&noise, 1.5).map(|v| (0.5 + 1.6 * v).clamp(0.0, 1.0))
    };
    let picture = Color::from_planes([noise(0), noise(1), noise(2)]).to_rgb8();
    write_png(&folder.path().join("picture.png"), &picture).unwrap();
    let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, _| ((x as f32 - 40.0) / 4.0).clamp(0.0, 1.0));
    write_grey_png(&folder.path().join("matte.png"), &matte).unwrap();
    for (name, direction) in [("down", 90), ("right", 0)] {
        let text = format!(
            "picture = 'picture.png'\nmatte = 'matte.png'\n[motion]\ndirection = {direction}\n[output]\nframes = 10\n"
        );
        fs::write(folder.path().join(format!("{name}.toml")), text).unwrap();
    }
    folder
}

fn run(folder: &Path, line: &str) -> Output {
    let mut command = Command::cargo_bin("enliven").unwrap();
    command.current_dir(folder).env("PATH", "").arg("compare").args(line.split_whitespace()).output().unwrap()
}

fn said(output: &Output) -> String {
    String::from_utf8(output.stderr.clone()).unwrap()
}

fn succeed(folder: &Path, line: &str) -> String {
    let output = run(folder, line);
    assert!(output.status.success(), "{line}: {}", said(&output));
    said(&output)
}

fn results(folder: &Path) -> Comparison {
    serde_json::from_str(&fs::read_to_string(folder.join("results.json")).unwrap()).unwrap()
}

fn names(rows: &[Row]) -> Vec<&str> {
    rows.iter().map(|row| row.name.as_str()).collect()
}

/// The worst frames of a row of the first scene.
fn scene_worst(found: &Comparison, name: &str) -> Vec<(String, usize)> {
    let row = found.scenes[0].rows.iter().find(|row| row.name == name).unwrap();
    assert!(row.worst.values().all(|frame| *frame < found.scenes[0].frames), "{:?}", row.worst);
    row.worst.clone().into_iter().collect()
}

#[test]
fn all_methods_stand_beside_each_other_and_what_fails_is_told() {
    let folder = studio();
    succeed(folder.path(), "down.toml right.toml --methods kwatra,database -o out");
    let out = folder.path().join("out");
    let found = results(&out);
    assert_eq!(found.scenes.iter().map(|scene| scene.name.as_str()).collect::<Vec<_>>(), ["down", "right"]);
    for scene in &found.scenes {
        assert_eq!(names(&scene.rows), ["frozen", "advect", "kwatra", "database"]);
        for row in &scene.rows[..3] {
            let video = out.join(row.video.as_ref().unwrap());
            assert!(video.exists() && row.failed.is_none() && row.values.contains_key("warp error"), "{row:?}");
            assert!(row.series.iter().any(|series| series.measure == "sharpness retention"));
            let slice = read_picture(&video.with_extension("slice.png")).unwrap().rgb;
            let turned = if scene.name == "down" { SIZE.1 } else { SIZE.0 };
            assert_eq!((slice.width, slice.height), (2 * 10, turned), "a loop twice, along the motion");
        }
        let failed = scene.rows[3].failed.as_ref().unwrap();
        assert!(failed.contains("library") && scene.rows[3].video.is_none(), "{failed}");
        assert!(scene.rows[0].values["warp error"] < scene.rows[1].values["warp error"]);
        let pictures: Vec<&str> = scene.pictures.iter().map(|(file, _)| file.rsplit('/').next().unwrap()).collect();
        assert_eq!(pictures, ["picture.png", "matte.png", "motion.png"]);
        assert!(scene.pictures.iter().all(|(file, caption)| out.join(file).exists() && !caption.is_empty()));
        assert!(out.join(scene.rows[2].motion.as_ref().unwrap()).exists());
    }
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("Not made") && page.contains("src=\"right/kwatra.mp4\"") && page.contains(&found.command));
    let table = fs::read_to_string(out.join("results.csv")).unwrap();
    assert_eq!(table.lines().count(), 9);
    // Both scenes together: what failed is counted, and the reference has no place among the methods.
    let all: serde_json::Value = serde_json::from_str(&fs::read_to_string(out.join("results.json")).unwrap()).unwrap();
    let row = |i: usize| &all["overall"][i];
    assert_eq!((&row(1)["name"], &row(1)["reference"]), (&"advect".into(), &true.into()));
    assert_eq!((row(2)["made"].as_u64(), row(3)["failed"].as_u64()), (Some(2), Some(2)));
    assert_eq!(row(2)["measures"]["warp error"]["scenes"], 2);
    let summary = fs::read_to_string(out.join("summary.csv")).unwrap();
    assert!(summary.contains("kwatra,method,2,0,warp error,2,"), "{summary}");
    assert!(page.contains("All scenes together") && page.contains("2 failed"));
    let plot = fs::read_to_string(out.join("down/plots/over-time-warp-error.svg")).unwrap();
    assert!(plot.starts_with("<svg xmlns=") && plot.contains("kwatra") && !plot.contains("var("), "{plot}");
    assert!(scene_worst(&found, "kwatra").iter().any(|(measure, _)| measure == "largest step ratio"));
    assert!(table.lines().nth(3).unwrap().starts_with("down,kwatra,method,,"), "{table}");
}

#[test]
fn finished_rows_are_kept_and_what_changed_is_named() {
    let folder = studio();
    let line = "down.toml --methods kwatra,advect -o out";
    succeed(folder.path(), line);
    let first = fs::read(folder.path().join("out/down/kwatra.mp4")).unwrap();
    let again = succeed(folder.path(), line);
    assert_eq!(again.matches("kept, nothing has changed").count(), 3, "{again}");
    let other = succeed(folder.path(), &format!("{line} --set kwatra.lambda=0.9"));
    assert!(other.contains("down, kwatra: made again, changed: kwatra.lambda"), "{other}");
    assert_eq!(other.matches("kept, nothing has changed").count(), 2, "{other}");
    succeed(folder.path(), line);
    assert!(fs::read(folder.path().join("out/down/kwatra.mp4")).unwrap() == first);
    // A lost video, and another picture under the same name.
    fs::remove_file(folder.path().join("out/down/advect.mp4")).unwrap();
    let lost = succeed(folder.path(), line);
    assert!(lost.contains("down, advect: made again, its video is gone"), "{lost}");
    write_grey_png(&folder.path().join("matte.png"), &Plane::filled(SIZE.0, SIZE.1, 1.0)).unwrap();
    let changed = succeed(folder.path(), line);
    assert_eq!(changed.matches("made again, changed: matte.png").count(), 3, "{changed}");
}

#[test]
fn the_command_on_the_page_repeats_it() {
    let folder = studio();
    succeed(
        folder.path(),
        "down.toml --methods kwatra --sweep kwatra.lambda=1,2 --sweep kwatra.patch=5,7 --frames 8 -o out",
    );
    let out = folder.path().join("out");
    let found = results(&out);
    let swept =
        ["kwatra lambda=1 patch=5", "kwatra lambda=1 patch=7", "kwatra lambda=2 patch=5", "kwatra lambda=2 patch=7"];
    assert_eq!(names(&found.scenes[0].rows)[2..], swept);
    assert_eq!(found.scenes[0].frames, 8);
    let map = fs::read_to_string(out.join("down/plots/sweep-kwatra-warp-error.svg")).unwrap();
    assert_eq!(map.matches("class=\"field\"").count(), 4, "{map}");
    let line = found.command.strip_prefix("enliven compare ").unwrap();
    let again = succeed(&out, line);
    assert_eq!(again.matches("kept, nothing has changed").count(), 6, "{again}");
    assert_eq!(results(&out), found);
}

#[test]
fn a_designed_target_is_compared_by_the_methods_that_take_one() {
    let folder = studio();
    let simulation = "size = [48, 40]\nframes = 9\nrun_in = 6\n[sides]\ntop = 'open'\n[[emitter]]\n\
                      disc = [24, 30, 9]\nrate = 0.5\ntemperature = 1\nvelocity = [0, -1]\n";
    fs::write(folder.path().join("sim.toml"), simulation).unwrap();
    let mut command = Command::cargo_bin("enliven").unwrap();
    command.current_dir(folder.path()).args(["simulate", "sim.toml", "-o", "sim"]).assert().success();
    succeed(folder.path(), "sim --exemplar picture.png -o out");
    let rows = results(&folder.path().join("out")).scenes.remove(0).rows;
    assert_eq!(names(&rows), ["lazyfluids", "kwatra"]);
    assert!(rows.iter().all(|row| row.failed.is_none() && row.values.contains_key("direction error")), "{rows:?}");
    for name in ["alpha", "motion", "exemplar"] {
        assert!(folder.path().join(format!("out/sim/pictures/{name}.png")).exists(), "{name}");
    }
}

#[test]
fn a_scene_is_shown_where_no_method_can_be_run() {
    let folder = studio();
    let nothing = |line: &str| {
        let output = run(folder.path(), line);
        assert!(
            output.status.code() == Some(1) && said(&output).contains("no method could be run"),
            "{}",
            said(&output)
        );
        said(&output)
    };
    nothing("down.toml --methods database -o out");
    let scene = results(&folder.path().join("out")).scenes.remove(0);
    assert!(scene.rows[2].failed.is_some() && scene.pictures.len() == 3, "{:?}", scene.pictures);
    // A picture that turns out to be damaged is told, and the comparison goes on.
    let mut damaged = fs::read(folder.path().join("matte.png")).unwrap();
    damaged.truncate(damaged.len() / 2);
    fs::write(folder.path().join("matte.png"), damaged).unwrap();
    let told = nothing("down.toml --methods advect -o damaged");
    let scene = results(&folder.path().join("damaged")).scenes.remove(0);
    assert!(told.contains("down: ") && told.contains("matte.png"), "{told}");
    assert!(scene.pictures.is_empty() && scene.rows.iter().all(|row| row.failed.is_some()), "{scene:?}");
}

#[cfg(unix)]
mod interrupted {
    use std::io::{BufRead, BufReader};
    use std::process::Stdio;

    use super::*;

    /// Runs a comparison, and stops it as Ctrl-C does as soon as it says `at`.
    fn stopped(folder: &Path, line: &str, at: &str) -> (Option<i32>, String) {
        let mut child = std::process::Command::new(assert_cmd::cargo::cargo_bin("enliven"));
        let child = child.current_dir(folder).env("PATH", "").arg("compare").args(line.split_whitespace());
        let mut child = child.stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap();
        let mut said = String::new();
        for line in BufReader::new(child.stderr.take().unwrap()).lines() {
            let line = line.unwrap();
            if line.contains(at) {
                let kill = format!("kill -INT {}", child.id());
                assert!(std::process::Command::new("/bin/sh").args(["-c", &kill]).status().unwrap().success());
            }
            said += &(line + "\n");
        }
        (child.wait().unwrap().code(), said)
    }

    #[test]
    fn what_is_finished_stays_and_the_next_run_goes_on() {
        let folder = studio();
        let line = "down.toml --methods kwatra,lazyfluids,advect --frames 60 -o out";
        let (code, said) = stopped(folder.path(), line, "[3/4");
        assert_eq!(code, Some(130), "{said}");
        assert!(said.contains("2 of 4 videos are finished"), "{said}");
        assert!(said.ends_with("interrupted: nothing was left half-written; run the same command again to go on\n"));
        let out = folder.path().join("out");
        let rows = results(&out).scenes.remove(0).rows;
        assert_eq!(names(&rows), ["frozen", "kwatra", "lazyfluids", "advect"]);
        assert_eq!(rows.iter().map(Row::is_to_make).collect::<Vec<_>>(), [false, false, true, true]);
        let page = fs::read_to_string(out.join("index.html")).unwrap();
        assert!(page.contains("2 videos still to be made") && page.trim_end().ends_with("</html>"));
        assert!(!out.join("down/lazyfluids.mp4").exists());

        let again = succeed(folder.path(), line);
        assert_eq!(again.matches("kept, nothing has changed").count(), 2, "{again}");
        assert!(again.contains("[3/4] down, lazyfluids:") && again.contains("down, advect:"), "{again}");
        assert_eq!(results(&out).to_make(), 0);
        assert!(!fs::read_to_string(out.join("index.html")).unwrap().contains("to be made"));
    }
}

#[test]
fn mistakes_are_named_before_any_work() {
    let folder = studio();
    let refuse = |line: &str, parts: &[&str]| {
        let output = run(folder.path(), line);
        let said = said(&output);
        assert_eq!(output.status.code(), Some(2), "{line}: {said}");
        parts.iter().for_each(|part| assert!(said.contains(part), "{line}: {part:?} is not in {said}"));
        assert!(!folder.path().join("out").exists());
    };
    refuse("down.toml --methods fluids -o out", &["no method \"fluids\"", "lazyfluids"]);
    refuse("down.toml --methods advect,advect -o out", &["advect is named twice"]);
    refuse("down.toml --sweep kwatra=3 -o out", &["METHOD.KEY=V1,V2"]);
    refuse("down.toml --sweep kwatra.lamda=3 -o out", &["kwatra.lamda", "did you mean \"lambda\"?"]);
    refuse("down.toml --methods advect --sweep kwatra.lambda=3 -o out", &["kwatra is not compared"]);
    refuse("down.toml --sweep kwatra.lambda=0.1,0.2,0.1 -o out", &["names 0.1 twice"]);
    refuse("down.toml --sweep kwatra.lambda=0.1 --sweep kwatra.lambda=0.2 -o out", &["kwatra.lambda is swept twice"]);
    refuse("down.toml --set kwatra.patch=4 -o out", &["kwatra.patch: 4 is out of range"]);
    // What is not ours is not written over.
    fs::create_dir(folder.path().join("site")).unwrap();
    fs::write(folder.path().join("site/index.html"), "mine").unwrap();
    refuse("down.toml --methods advect -o site", &["site: its index.html is not of a comparison", "-o"]);
    assert_eq!(fs::read(folder.path().join("site/index.html")).unwrap(), b"mine");
    fs::create_dir(folder.path().join("busy")).unwrap();
    let lock = File::create(folder.path().join("busy/.lock")).unwrap();
    lock.lock().unwrap();
    let output = run(folder.path(), "down.toml --methods advect -o busy");
    assert_eq!(output.status.code(), Some(2));
    assert!(said(&output).contains("another comparison is at work here"), "{}", said(&output));
    drop(lock);
    // A folder that cannot be made, and one within it.
    let output = run(folder.path(), "down.toml --methods advect -o picture.png");
    assert_eq!((output.status.code(), said(&output).lines().count()), (Some(1), 1), "{}", said(&output));
    assert!(said(&output).contains("picture.png: cannot make the folder"), "{}", said(&output));
    fs::write(folder.path().join("busy/down"), "in the way").unwrap();
    let output = run(folder.path(), "down.toml --methods advect -o busy --quiet");
    assert_eq!((output.status.code(), said(&output).lines().count()), (Some(1), 1), "{}", said(&output));
    assert!(said(&output).contains("cannot make the folder"), "{}", said(&output));
}
