//! Builds a library of real clips and tells what it took: seconds by stage, pieces, bytes, peak memory.
//!
//! `ENLIVEN_DATA=DIR cargo run --release --example library_bench -- [--threads N] [--out FILE] [CLIP|FOLDER…]`
//! (default: `DIR/clips/water`).

use std::path::{Path, PathBuf};
use std::time::Instant;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Observer;
use enliven::base::par;
use enliven::library::build::build;
use enliven::library::options::Options;
use enliven::library::reader::Pack;
use enliven::library::verify::verify;

/// Prints what a person would want to know afterwards.
struct Printing;

impl Observer for Printing {
    fn end(&self, stage: &str, seconds: f64) {
        if seconds > 0.5 {
            println!("  {stage}: {seconds:.2} s");
        }
    }

    fn note(&self, message: &str) {
        println!("  {message}");
    }
}

/// Peak resident memory of this process in MB, where the system tells.
fn peak_memory() -> Option<f64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find(|l| l.starts_with("VmHWM:"))?;
    line.split_whitespace().nth(1)?.parse::<f64>().ok().map(|kb| kb / 1024.0)
}

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(error.exit_code().into());
    }
}

fn run() -> Result<()> {
    let (mut threads, mut out, mut clips) = (0, None, Vec::new());
    let mut arguments = std::env::args().skip(1);
    while let Some(argument) = arguments.next() {
        match argument.as_str() {
            "--threads" => threads = arguments.next().and_then(|n| n.parse().ok()).unwrap_or(0),
            "--out" => out = arguments.next().map(PathBuf::from),
            _ => clips.push(PathBuf::from(argument)),
        }
    }
    if clips.is_empty() {
        let Some(data) = std::env::var_os("ENLIVEN_DATA") else {
            return Err(Error::new(Kind::Usage, "ENLIVEN_DATA", "not set").remedy("set it to the folder of real data"));
        };
        clips.push(Path::new(&data).join("clips/water"));
    }
    par::init(threads)?;
    let folder = std::env::temp_dir().join(format!("enliven-library-bench-{}", std::process::id()));
    let path = out.clone().unwrap_or_else(|| folder.join("bench.pack"));
    if out.is_none() {
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
    }
    let start = Instant::now();
    let result = measure(&clips, &path);
    println!("total: {:.1} s on {} threads", start.elapsed().as_secs_f64(), par::threads());
    if out.is_none() {
        std::fs::remove_dir_all(&folder).map_err(|e| Error::io(&folder, "remove", e))?;
    }
    result
}

fn measure(clips: &[PathBuf], path: &Path) -> Result<()> {
    let options = Options { tag: "water".into(), ..Options::default() };
    let report = build(clips, path, &options, &Printing)?;
    for clip in &report.accepted {
        let name = clip.path.file_name().unwrap_or_default().to_string_lossy();
        let (w, h) = (clip.width, clip.height);
        println!("{name:28} {w}x{h} {:5} frames {:6} pieces {:6} still", clip.frames, clip.pieces, clip.still);
    }
    report.refused.iter().for_each(|r| println!("refused {}: {}", r.path.display(), r.reason));
    let [clips, features, writing] = report.seconds;
    println!("clips {clips:.1} s, features {features:.1} s, writing {writing:.1} s");
    println!("peak memory while building: {:.0} MB", peak_memory().unwrap_or(f64::NAN));
    let start = Instant::now();
    let pack = Pack::open(path)?;
    println!("opened in {:.2} ms", start.elapsed().as_secs_f64() * 1e3);
    let raw: f64 = pack.clips().iter().map(|c| f64::from(c.frames) * f64::from(c.width * c.height) * 3.0).sum();
    let mut rest = report.bytes as f64;
    for section in pack.sections() {
        println!("  section {:10} {:12} bytes", section.name(), section.length);
        if ["frames", "frameidx", "cells", "average"].contains(&section.name().as_str()) {
            rest -= section.length as f64;
        }
    }
    let frames = pack.sections().iter().find(|s| s.name() == "frames").map_or(0, |s| s.length) as f64;
    println!(
        "{} pieces, {} bytes, {:.0} bytes a piece beside frames, averages and grids",
        report.pieces,
        report.bytes,
        rest / report.pieces as f64
    );
    println!("frames compressed {:.2} times", raw / frames);
    let start = Instant::now();
    verify(&pack, &Printing)?;
    let seconds = start.elapsed().as_secs_f64();
    println!(
        "verified (every byte, every frame decoded on one thread) in {seconds:.1} s, {:.0} MB/s of pixels",
        raw / seconds / 1e6
    );
    Ok(())
}
