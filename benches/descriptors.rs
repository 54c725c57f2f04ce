//! Speed and quality of dense SIFT, the vocabulary, word assignment and candidate search.
//!
//! `ENLIVEN_DATA=… cargo bench --bench descriptors [-- TABLE.bin]` uses the pictures there, at several sizes, and their
//! mirror images; without it a synthetic texture. Times are CPU seconds of one thread where the system tells them, else
//! the wall clock; the codebook on two threads is timed by the wall clock. With a file name the codebook's descriptors
//! are written there (128 bytes each), for comparison with other programs.

use std::path::Path;
use std::time::Instant;

use enliven::assign::candidates::{Options, Pieces, search};
use enliven::base::observe::Silent;
use enliven::base::{par, rng};
use enliven::descriptor::dense_sift::{DIMENSIONS, DescriptorGrid, describe};
use enliven::descriptor::vocabulary::{PIECE_WORDS, Vocabulary, WORDS, WordGrid};
use enliven::raster::filter;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::resample::resize;

/// Descriptors in the codebook, pieces in the library and nodes of the target, at most.
const CODEBOOK: usize = 1_000_000;
const PIECES: usize = 250_000;
const NODES: usize = 494;

/// CPU time of this thread so far in seconds (Linux), or the wall clock.
fn seconds(start: Instant) -> f64 {
    let stat = std::fs::read_to_string("/proc/thread-self/schedstat").ok();
    let nanoseconds = stat.and_then(|s| s.split_whitespace().next()?.parse::<f64>().ok());
    nanoseconds.map_or_else(|| start.elapsed().as_secs_f64(), |ns| ns * 1e-9)
}

/// Least time of several runs.
fn fastest<T>(runs: usize, mut work: impl FnMut() -> T) -> f64 {
    let once = |_| {
        let clock = Instant::now();
        let start = seconds(clock);
        std::hint::black_box(work());
        seconds(clock) - start
    };
    (0..runs).map(once).fold(f64::INFINITY, f64::min)
}

/// Luma of every picture with a long side of about 960 px, sizes multiples of 16.
fn pictures(folder: &Path) -> Vec<Plane> {
    let Ok(entries) = std::fs::read_dir(folder) else { return Vec::new() };
    let mut paths: Vec<_> = entries.flatten().map(|e| e.path()).collect();
    paths.sort();
    paths.retain(|p| !p.to_string_lossy().contains(".matte."));
    let open = |p: &std::path::PathBuf| -> Option<Plane> {
        let image = image::open(p).ok()?.to_rgb8();
        let (width, height) = (image.width() as usize, image.height() as usize);
        let luma = Rgb8 { width, height, data: image.into_raw() }.luma();
        Some(scaled(&luma, 960.0 / width.max(height) as f32))
    };
    paths.iter().filter_map(open).collect()
}

/// A cloudy texture with detail at several scales, for want of pictures.
fn synthetic() -> Vec<Plane> {
    let octave = |seed: u64, sigma: f32| {
        let white = Plane::from_fn(960, 640, |x, y| rng::unit(rng::hash(seed, &[x as u64, y as u64])) - 0.5);
        let cloud = filter::gaussian(&white, sigma);
        cloud.map(|v| v * sigma)
    };
    let sum = |seed: u64| {
        let mut plane = Plane::filled(960, 640, 0.5);
        for (i, sigma) in [1.0, 2.0, 4.0, 8.0].into_iter().enumerate() {
            plane.data.iter_mut().zip(&octave(4 * seed + i as u64, sigma).data).for_each(|(p, v)| *p += 0.3 * v);
        }
        plane
    };
    (0..6).map(sum).collect()
}

fn scaled(luma: &Plane, factor: f32) -> Plane {
    let to = |v: usize| ((v as f32 * factor) as usize / 16 * 16).max(16);
    resize(luma, to(luma.width), to(luma.height))
}

fn mirror(plane: &Plane) -> Plane {
    Plane::from_fn(plane.width, plane.height, |x, y| plane.at(plane.width - 1 - x, y))
}

/// At most [`CODEBOOK`] descriptors with contrast, spread evenly over all images.
fn table(grids: &[DescriptorGrid]) -> Vec<u8> {
    let textured = |g: &DescriptorGrid| -> Vec<[u8; DIMENSIONS]> {
        let all = g.data.as_chunks().0;
        all.iter().enumerate().filter(|(i, _)| !g.is_flat(*i)).map(|(_, d)| *d).collect()
    };
    let all: Vec<[u8; DIMENSIONS]> = grids.iter().flat_map(textured).collect();
    let n = all.len().min(CODEBOOK);
    (0..n).flat_map(|i| all[i * all.len() / n]).collect()
}

fn main() {
    let data = std::env::var_os("ENLIVEN_DATA");
    let mut images = data.map(|d| pictures(&Path::new(&d).join("pictures"))).unwrap_or_default();
    println!("images: {} {}", images.len(), if images.is_empty() { "(synthetic)" } else { "pictures" });
    if images.is_empty() {
        images = synthetic();
    }
    let levels: Vec<Plane> = images.iter().flat_map(|p| [1.0, 0.667, 0.5, 0.333].map(|f| scaled(p, f))).collect();
    let levels: Vec<Plane> = levels.iter().flat_map(|p| [p.clone(), mirror(p)]).collect();

    let time = fastest(5, || describe(&levels[0]));
    let first = describe(&levels[0]);
    println!("dense SIFT: {:.2} M descriptors/s, one thread", first.contrast.len() as f64 / time * 1e-6);

    let grids: Vec<DescriptorGrid> = levels.iter().map(describe).collect();
    let points: usize = grids.iter().map(|g| g.contrast.len()).sum();
    let table = table(&grids);
    println!("descriptors: {points} points, {} in the table", table.len() / DIMENSIONS);
    if let Some(path) = std::env::args().nth(1).filter(|a| !a.starts_with('-')) {
        std::fs::write(&path, &table).expect("the table can be written where asked");
    }
    codebook(&table);
    let vocabulary = Vocabulary::train(&table, WORDS, 1, &Silent).expect("there are descriptors");
    let time = fastest(3, || vocabulary.words(&grids[0]));
    println!("words: {:.2} M/s, one thread", grids[0].contrast.len() as f64 / time * 1e-6);
    let words: Vec<WordGrid> = grids.iter().map(|g| vocabulary.words(g)).collect();
    // The second size of the first picture is the target; its own levels stay out of the library.
    retrieval(&words[2], &words[8..]);
}

/// Squares of a word grid every `stride` points.
fn squares(grid: &WordGrid, stride: usize) -> Vec<[u8; PIECE_WORDS]> {
    let places = (0..grid.height).step_by(stride).flat_map(|j| (0..grid.width).step_by(stride).map(move |i| (i, j)));
    places.filter_map(|(i, j)| grid.piece(4 * i, 4 * j)).collect()
}

fn retrieval(target: &WordGrid, library: &[WordGrid]) {
    let all: Vec<[u8; PIECE_WORDS]> = library.iter().flat_map(|g| squares(g, 1)).collect();
    let n = all.len().min(PIECES);
    let words: Vec<[u8; PIECE_WORDS]> = (0..n).map(|i| all[i * all.len() / n]).collect();
    let nodes: Vec<[u8; PIECE_WORDS]> = squares(target, 6).into_iter().cycle().take(NODES).collect();
    let pieces = Pieces { words: &words, places: None };
    let run = || search(&nodes, pieces, Options::default(), None, &Silent).expect("there are pieces");
    let time = par::with_threads(1, || fastest(3, run)).expect("threads start");
    println!("candidates: {} nodes x {n} pieces in {:.0} ms, one thread", nodes.len(), time * 1e3);
    let places: Vec<u32> = (0..n as u32).map(|i| i / 16).collect();
    let pieces = Pieces { places: Some(&places), ..pieces };
    let spread = Options { per_place: 2, ..Options::default() };
    let run = || search(&nodes, pieces, spread, None, &Silent).expect("there are pieces");
    let time = par::with_threads(1, || fastest(3, run)).expect("threads start");
    println!("candidates, 2 per place: {:.0} ms", time * 1e3);
}

fn codebook(table: &[u8]) {
    let train = || Vocabulary::train(table, WORDS, 1, &Silent).expect("there are descriptors");
    let mut quality = 0.0;
    for threads in [1, 2] {
        let (wall, cpu, vocabulary) = par::with_threads(threads, || {
            let clock = Instant::now();
            let start = seconds(clock);
            let vocabulary = train();
            (clock.elapsed().as_secs_f64(), seconds(clock) - start, vocabulary)
        })
        .expect("threads start");
        quality = vocabulary.mean_squared_distance(table);
        println!("codebook, {threads} threads: {wall:.2} s wall, {cpu:.2} s CPU of the calling thread");
    }
    let clock = Instant::now();
    let start = seconds(clock);
    let bisecting = Vocabulary::train_by_bisecting(table, WORDS, 1, &Silent).expect("there are descriptors");
    let time = seconds(clock) - start;
    let reference = bisecting.mean_squared_distance(table);
    println!(
        "mean squared distance: {quality:.1}; bisecting everything, without refinement: {reference:.1} ({time:.2} s)"
    );
}
