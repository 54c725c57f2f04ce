//! How far real clips are from themselves: the measures of motion for a clip's second half against its first (the
//! floor), and for defects of that half that should be far above it.
//!
//! `ENLIVEN_DATA=DIR cargo run --release --example measure_floor -- [CLIP…]` (default: three clips of water, one of fire
//! and one of smoke in `DIR/clips`).

use std::path::{Path, PathBuf};

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Silent;
use enliven::base::rng;
use enliven::measure::footage::LONG_SIDE;
use enliven::measure::read::reference;
use enliven::measure::{Footage, Subject, value};
use enliven::raster::image::Rgb8;

const CLIPS: [&str; 3] = ["water", "fire", "smoke"];
const FPS: f32 = 25.0;

fn main() {
    if let Err(error) = run() {
        eprintln!("{error}");
        std::process::exit(error.exit_code().into());
    }
}

/// The clips named, or the first few of each sort.
fn clips() -> Result<Vec<PathBuf>> {
    let named: Vec<PathBuf> = std::env::args().skip(1).map(PathBuf::from).collect();
    if !named.is_empty() {
        return Ok(named);
    }
    let Some(data) = std::env::var_os("ENLIVEN_DATA") else {
        return Err(Error::new(Kind::Usage, "ENLIVEN_DATA", "not set").remedy("set it to the folder of real data"));
    };
    let mut out = Vec::new();
    for sort in CLIPS {
        let folder = Path::new(&data).join("clips").join(sort);
        let entries = std::fs::read_dir(&folder).map_err(|e| Error::io(&folder, "list", e))?;
        let mut paths: Vec<PathBuf> = entries.filter_map(|e| Some(e.ok()?.path())).collect();
        paths.sort();
        out.extend(paths.into_iter().take(if sort == "water" { 3 } else { 1 }));
    }
    Ok(out)
}

fn run() -> Result<()> {
    println!(
        "{:28} {:>9} {:>9} {:>9} {:>9} {:>9} {:>9}",
        "dynamics distance", "floor", "frozen", "shuffled", "reversed", "half speed", "seed 2"
    );
    for path in clips()? {
        let frames = reference(&path, FPS, LONG_SIDE, &Silent)?;
        let (first, second) = frames.split_at(frames.len() / 2);
        let name = path.file_stem().unwrap_or_default().to_string_lossy();
        for measure in ["dynamics distance", "temporal spectrum distance"] {
            print_row(measure, &name, first, second)?;
        }
    }
    Ok(())
}

fn print_row(measure: &str, name: &str, first: &[Rgb8], second: &[Rgb8]) -> Result<()> {
    let real = Footage::new(first.to_vec(), FPS, false, None)?;
    let against = |frames: Vec<Rgb8>, seed: u64| -> Result<f64> {
        let footage = Footage::new(frames, FPS, false, None)?;
        let subject = Subject { reference: Some(&real), seed, ..Subject::new(&footage) };
        Ok(value(measure, &subject).unwrap_or(f64::NAN))
    };
    let mut shuffled: Vec<usize> = (0..second.len()).collect();
    shuffled.sort_by_key(|&t| rng::hash(1, &[t as u64]));
    let order = |places: Vec<usize>| places.into_iter().map(|t| second[t].clone()).collect::<Vec<_>>();
    let count = second.len();
    let versions = [
        (second.to_vec(), 1),
        (vec![second[0].clone(); count], 1),
        (order(shuffled), 1),
        (order((0..count).rev().collect()), 1),
        (order((0..count).map(|t| t / 2).collect()), 1),
        (second.to_vec(), 2),
    ];
    print!("{name:22} {:5}", &measure[..5]);
    for (frames, seed) in versions {
        print!(" {:9.4}", against(frames, seed)?);
    }
    println!();
    Ok(())
}
