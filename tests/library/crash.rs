//! A build killed anywhere leaves nothing, or the whole pack, under the final name, and the next run resumes it.
//!
//! The test starts itself as a child process that builds a library and reports when it reaches a given point; the
//! parent then kills it with SIGKILL, either while it holds still there, or a little later while it runs on.

use std::fs;
use std::io::{BufRead, BufReader, Write};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::time::Duration;

use enliven::base::observe::{Observer, Silent};
use enliven::library::build::{BuildReport, build};
use enliven::library::reader::Pack;
use enliven::library::verify::verify;

use crate::common;

/// The variable that makes [`child`] a child: folder, stage, step and manner, one a line.
const CHILD: &str = "ENLIVEN_TEST_CRASH_CHILD";
/// What the child prints when it reaches its point.
const REACHED: &str = "reached the point";

/// A point of a build: `step` 0 is the beginning of the stage, `END` its end, others count its steps.
#[derive(Debug, Clone, Copy)]
struct Point {
    stage: &'static str,
    step: u64,
    /// Kill so much later, while the child runs on; without it, the child holds still.
    later: Option<Duration>,
}

const END: u64 = u64::MAX;

/// Reports and, if asked, holds still at its point.
struct Reporting {
    stage: String,
    step: u64,
    hold: bool,
    steps: Mutex<u64>,
}

impl Reporting {
    fn reached(&self) {
        println!("{REACHED}");
        std::io::stdout().flush().unwrap();
        if self.hold {
            // Killed long before this ends.
            std::thread::sleep(Duration::from_secs(600));
        }
    }
}

impl Observer for Reporting {
    fn begin(&self, stage: &str, _: u64) {
        if stage == self.stage && self.step == 0 {
            self.reached();
        }
    }

    fn advance(&self, stage: &str, steps: u64) {
        if stage == self.stage {
            let mut done = self.steps.lock().unwrap();
            let before = *done;
            *done += steps;
            if (before + 1..=before + steps).contains(&self.step) {
                self.reached();
            }
        }
    }

    fn end(&self, stage: &str, _: f64) {
        if stage == self.stage && self.step == END {
            self.reached();
        }
    }
}

/// Not a test of its own: the process that is killed.
#[test]
fn child() {
    let Ok(order) = std::env::var(CHILD) else { return };
    let lines: Vec<&str> = order.lines().collect();
    let observer = Reporting {
        stage: lines[1].to_owned(),
        step: lines[2].parse().unwrap(),
        hold: lines[3] == "hold",
        steps: Mutex::new(0),
    };
    run(Path::new(lines[0]), &observer);
}

fn clips(folder: &Path) -> PathBuf {
    folder.with_file_name("clips")
}

fn run(folder: &Path, observer: &dyn Observer) -> BuildReport {
    build(&[clips(folder)], &folder.join("l.pack"), &common::options(), observer).unwrap()
}

/// Runs a build in `folder` and kills it at a point; true when it was killed before it ended by itself.
fn kill_at(folder: &Path, point: Point) -> bool {
    let manner = if point.later.is_some() { "run" } else { "hold" };
    let order = format!("{}\n{}\n{}\n{manner}", folder.display(), point.stage, point.step);
    let mut child = Command::new(std::env::current_exe().unwrap())
        .args(["crash::child", "--exact", "--nocapture", "--test-threads=1"])
        .env(CHILD, order)
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let output = BufReader::new(child.stdout.take().unwrap());
    let reached = output.lines().map_while(Result::ok).any(|line| line.ends_with(REACHED));
    assert!(reached, "the build never reached {point:?}");
    if let Some(later) = point.later {
        std::thread::sleep(later);
    }
    child.kill().unwrap();
    !child.wait().unwrap().success()
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

/// What must hold after a kill: nothing or all under the final name; the next run takes up what is finished, leaves
/// nothing but the pack and its names, and the same pack.
fn check(folder: &Path, point: Point, expected: &[u8]) {
    let path = folder.join("l.pack");
    if path.exists() {
        assert!(fs::read(&path).unwrap() == expected, "{point:?}: something else under the final name");
        verify(&Pack::open(&path).unwrap(), &Silent).unwrap();
    }
    let finished = match fs::read_dir(folder.join("l.pack.build")) {
        Ok(_) => names(&folder.join("l.pack.build")).iter().filter(|n| !n.starts_with('.') && *n != "lock").count(),
        Err(_) => 0,
    };
    let report = run(folder, &Silent);
    assert_eq!(report.accepted.iter().filter(|c| c.resumed).count(), finished, "{point:?}: clips resumed");
    assert!(fs::read(&path).unwrap() == expected, "{point:?}: the next run made another pack");
    assert_eq!(names(folder), ["l.pack", "l.pack.names.toml"], "{point:?}: leftovers");
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for name in names(from) {
        let (from, to) = (from.join(&name), to.join(&name));
        if from.is_dir() { copy_folder(&from, &to) } else { fs::copy(&from, &to).map(|_| ()).unwrap() }
    }
}

#[test]
fn a_build_killed_anywhere_leaves_nothing_or_all_and_is_resumed() {
    let root = tempfile::tempdir().unwrap();
    let fresh = |name: String| {
        let folder = root.path().join(name);
        fs::create_dir(&folder).unwrap();
        folder
    };
    fs::create_dir(root.path().join("clips")).unwrap();
    common::write_clips(&root.path().join("clips"));
    let undisturbed = fresh("undisturbed".into());
    let report = run(&undisturbed, &Silent);
    assert_eq!((report.accepted.len(), report.refused.len()), (3, 0), "{:?}", report.refused);
    let expected = fs::read(undisturbed.join("l.pack")).unwrap();

    // Reading and analysing, in each of the clips.
    let frames = common::FRAMES as u64;
    for (i, step) in [1, 7, 17, 40, frames, frames + 1, frames + 30, 2 * frames, 2 * frames + 9].into_iter().enumerate()
    {
        let point = Point { stage: "decode", step, later: None };
        let folder = fresh(format!("decode {i}"));
        kill_at(&folder, point);
        assert!(!folder.join("l.pack").exists());
        check(&folder, point, &expected);
    }
    let point = Point { stage: "clips", step: 2, later: None };
    let folder = fresh("between clips".into());
    kill_at(&folder, point);
    check(&folder, point, &expected);

    // The later phases start from finished segments.
    let base = fresh("base".into());
    kill_at(&base, Point { stage: "clips", step: END, later: None });
    let micros = |us: u64| Some(Duration::from_micros(us));
    let hold = |stage: &'static str, steps: &[u64]| -> Vec<Point> {
        steps.iter().map(|&step| Point { stage, step, later: None }).collect()
    };
    let later = |stage: &'static str, delays: &[u64]| -> Vec<Point> {
        delays.iter().map(|&us| Point { stage, step: 0, later: micros(us) }).collect()
    };
    let points = [
        hold("features", &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, END]),
        hold("write", &[0, END]),
        later("write", &[0, 100, 200, 400, 800, 1500, 3000, 6000, 12_000]),
        hold("sync", &[0, END]),
        later("sync", &[0, 50, 100, 200, 400, 800, 1500, 3000, 6000]),
        hold("rename", &[0, END]),
        later("rename", &[0, 50, 100, 200, 400, 800, 1500, 3000, 6000]),
    ];
    let mut killed = 0;
    for (i, point) in points.into_iter().flatten().enumerate() {
        let folder = fresh(format!("late {i}"));
        copy_folder(&base, &folder);
        killed += usize::from(kill_at(&folder, point));
        check(&folder, point, &expected);
    }
    println!("{killed} late builds were killed before they ended");
    assert!(killed > 20);
}
