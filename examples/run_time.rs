//! Seconds per stage of whole runs, and whether the bytes agree.
//!
//! `cargo run --release --example run_time -- LIBRARY.pack PICTURE…`
//!
//! Beside a picture `P.png` its matte is `P.matte.png`. Every picture is animated to an MP4 with the database
//! method's own settings: twice on one thread, twice on two, and once more on two under another name. A stage's figure is the
//! better of its two runs. The CPU time of the process tells how busy the machine was with others.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, ensure};
use enliven::base::observe::Silent;
use enliven::base::par;
use enliven::report::animate::animate;
use enliven::scene::file::SceneFile;
use enliven::synth::methods::database;
use enliven::synth::record::RunRecord;
use rustix::time::{ClockId, clock_gettime};

/// Stages whose ratio of one thread to two is told.
const HOT: [&str; 4] = ["candidates", "pair costs", "loops", "frames"];

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    let Some((library, pictures)) = arguments.split_first().filter(|(_, pictures)| !pictures.is_empty()) else {
        println!("give a library and pictures (see the top of this file)");
        return Ok(());
    };
    let folder = tempfile::tempdir()?;
    // Reads the library into the page cache.
    std::io::copy(&mut std::fs::File::open(library)?, &mut std::io::sink())?;
    for picture in pictures {
        measure(picture, library, folder.path()).with_context(|| picture.display().to_string())?;
    }
    Ok(())
}

/// One run: its record, its CPU seconds and the bytes of its video.
struct Run {
    record: RunRecord,
    cpu: f64,
    video: Vec<u8>,
}

fn run(picture: &Path, library: &Path, folder: &Path, threads: usize) -> Result<Run> {
    let matte = picture.with_extension("matte.png");
    let scene = SceneFile {
        picture: picture.to_owned(),
        matte: matte.exists().then_some(matte),
        library: vec![library.to_owned()],
        method: Some(database::ENTRY.name.to_owned()),
        ..SceneFile::default()
    };
    let output = folder.join("x.mp4");
    let start = cpu_seconds();
    let record = par::with_threads(threads, || animate(scene, &output, None, &Silent))??;
    Ok(Run { record, cpu: cpu_seconds() - start, video: std::fs::read(output)? })
}

fn cpu_seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}

fn measure(picture: &Path, library: &Path, folder: &Path) -> Result<()> {
    let twice = |threads| -> Result<[Run; 2]> {
        Ok([run(picture, library, folder, threads)?, run(picture, library, folder, threads)?])
    };
    let (one, two) = (twice(1)?, twice(2)?);
    let renamed = folder.join("renamed.png");
    std::fs::copy(picture, &renamed)?;
    let matte = picture.with_extension("matte.png");
    if matte.exists() {
        std::fs::copy(matte, renamed.with_extension("matte.png"))?;
    }
    let other = run(&renamed, library, folder, 2)?;
    let runs: Vec<&Run> = one.iter().chain(&two).chain([&other]).collect();
    ensure!(runs.iter().all(|run| run.video == runs[0].video), "the bytes differ");
    let RunRecord { working_size: w, output_size: o, .. } = two[0].record;
    println!("{}: {} × {} worked, {} × {} written", picture.display(), w.0, w.1, o.0, o.1);
    for stage in &two[0].record.stages {
        print(&stage.name, best(&one, |run| seconds(run, &stage.name)), best(&two, |run| seconds(run, &stage.name)));
    }
    let hot = |run: &Run| HOT.iter().map(|stage| seconds(run, stage)).sum();
    print("the four largest", best(&one, hot), best(&two, hot));
    print("all", best(&one, |run| run.record.seconds), best(&two, |run| run.record.seconds));
    print("CPU", best(&one, |run| run.cpu), best(&two, |run| run.cpu));
    println!("  five runs, the same {} bytes", runs[0].video.len());
    Ok(())
}

fn seconds(run: &Run, stage: &str) -> f64 {
    run.record.stages.iter().filter(|s| s.name == stage).map(|s| s.seconds).sum()
}

fn best(runs: &[Run; 2], of: impl Fn(&Run) -> f64) -> f64 {
    of(&runs[0]).min(of(&runs[1]))
}

fn print(name: &str, one: f64, two: f64) {
    println!("  {name:18} {one:6.2} s on one thread, {two:6.2} s on two: {:4.2} ×", one / two.max(1e-9));
}
