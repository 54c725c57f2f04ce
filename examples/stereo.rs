//! The solvers on a known problem: Tsukuba's stereo pair with the energy of the Middlebury MRF comparison (Szeliski et al.
//! 2008). Their reference expansion ends at 371,297.
//!
//! `ENLIVEN_DATA=… cargo run --release --example stereo`
//!
//! A label is a disparity from 0 to 15. Data term: differences after Birchfield & Tomasi 1998, in whole grey levels,
//! summed over the channels; beyond the border the largest difference. Smoothness: 20 × min(|difference of labels|, 2),
//! doubled where the left picture's neighbouring pixels differ by less than 8 (root mean square of the channels).

use std::path::Path;
use std::time::Duration;

use enliven::assign::energy::Problem;
use enliven::assign::pair_costs::PairCosts;
use enliven::assign::solve::{Options, Solver, solve};
use enliven::base::error::Result;
use enliven::base::observe::Silent;
use enliven::base::options::Words;
use enliven::raster::image::Rgb8;
use enliven::raster::picture_io::read_picture;

const LABELS: usize = 16;
const LAMBDA: f32 = 20.0;
const MOST: usize = 2;
/// Sum over the channels of the squares below which neighbours count as one surface.
const SAME_SURFACE: i32 = 3 * 8 * 8;
/// Most that the channels together can differ.
const WORST: i32 = 3 * 255;

fn at(picture: &Rgb8, x: usize, y: usize, channel: usize) -> i32 {
    i32::from(picture.data[3 * (y * picture.width + x) + channel])
}

/// Value of a pixel, and the least and most of it and the points half-way to its left and right.
fn range(picture: &Rgb8, x: usize, y: usize, channel: usize) -> (i32, i32, i32) {
    let own = at(picture, x, y, channel);
    let half = |x: usize| (own + at(picture, x, y, channel)) / 2;
    let (left, right) = (half(x.saturating_sub(1)), half((x + 1).min(picture.width - 1)));
    (own, own.min(left).min(right), own.max(left).max(right))
}

fn difference(left: &Rgb8, right: &Rgb8, x: usize, y: usize, disparity: usize) -> i32 {
    let Some(there) = x.checked_sub(disparity) else { return WORST };
    let outside = |value: i32, (_, low, high): (i32, i32, i32)| (value - high).max(low - value).max(0);
    let channel = |c: usize| {
        let (a, b) = (range(left, x, y, c), range(right, there, y, c));
        outside(a.0, b).min(outside(b.0, a))
    };
    (0..3).map(channel).sum()
}

/// The edges of the grid, with one table of costs for edges across surfaces and one for those within.
fn pairs(left: &Rgb8) -> PairCosts {
    let (width, height) = (left.width, left.height);
    let cost = |i: usize| (i / LABELS).abs_diff(i % LABELS).min(MOST) as f32;
    let across: Vec<f32> = (0..LABELS * LABELS).map(cost).collect();
    let size = across.len();
    let mut out = PairCosts {
        costs: [across.clone(), across.iter().map(|c| 2.0 * c).collect()].concat(),
        ..PairCosts::default()
    };
    for (x, y) in (0..height).flat_map(|y| (0..width).map(move |x| (x, y))) {
        for (x2, y2) in [(x + 1, y), (x, y + 1)].into_iter().filter(|&(x2, y2)| x2 < width && y2 < height) {
            let squares: i32 = (0..3).map(|c| (at(left, x, y, c) - at(left, x2, y2, c)).pow(2)).sum();
            out.edges.push([(y * width + x) as u32, (y2 * width + x2) as u32]);
            out.tables.push(if squares < SAME_SURFACE { size..2 * size } else { 0..size });
        }
    }
    out
}

/// CPU time of this process.
fn cpu() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

fn main() -> Result<()> {
    let Some(root) = std::env::var_os("ENLIVEN_DATA") else {
        println!("set ENLIVEN_DATA to the folder that holds benchmarks/stereo");
        return Ok(());
    };
    let read = |name: &str| Ok(read_picture(&Path::new(&root).join("benchmarks/stereo").join(name))?.rgb);
    let (left, right) = (read("tsukuba-imL.png")?, read("tsukuba-imR.png")?);
    let nodes = left.width * left.height;
    let offsets: Vec<usize> = (0..=nodes).map(|n| n * LABELS).collect();
    let place = |i: usize| (i / LABELS % left.width, i / LABELS / left.width, i % LABELS);
    let cost = |(x, y, disparity)| difference(&left, &right, x, y, disparity) as f32;
    let data: Vec<f32> = (0..nodes * LABELS).map(|i| cost(place(i))).collect();
    let pairs = pairs(&left);
    let problem = Problem { offsets: &offsets, data: &data, pairs: &pairs, lambda: LAMBDA };
    println!("{} × {} pixels, {LABELS} labels", left.width, left.height);
    for &(name, solver) in Solver::ALL {
        let start = cpu();
        let found = solve(&problem, &[], &Options { solver, sweeps: 100 }, &Silent)?;
        println!(
            "{name}: energy {:.0} (data {:.0}), bound {:.1}, {:.2} s of CPU; after each sweep or round: {:.0?}",
            found.energy,
            problem.data_energy(&found.labels),
            found.bound,
            (cpu() - start).as_secs_f64(),
            found.history
        );
    }
    Ok(())
}
