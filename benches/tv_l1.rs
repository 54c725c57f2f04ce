//! TV-L1 on a synthetic moving texture: a 640 × 360 pair at library settings, a 640 × 480 pair at quality settings.
//!
//!     cargo bench --bench tv_l1

use divan::Bencher;
use enliven::flow::field::Field;
use enliven::flow::tv_l1::{Params, TvL1};
use enliven::raster::image::Plane;

fn main() {
    divan::main();
}

fn texture(x: f32, y: f32) -> f32 {
    let wave = |fx: f32, fy: f32, phase: f32| (fx * x + fy * y + phase).sin();
    0.5 + 0.1 * (wave(0.31, 0.11, 0.3) + wave(-0.13, 0.37, 1.1) + wave(0.21, -0.23, 2.0) + wave(0.05, 0.08, 0.7))
}

fn pair(bencher: Bencher, width: usize, height: usize, params: Params) {
    let from = Plane::from_fn(width, height, |x, y| texture(x as f32, y as f32));
    let to = Plane::from_fn(width, height, |x, y| texture(x as f32 - 1.5, y as f32 + 0.75));
    let mut solver = TvL1::new(width, height, params);
    let mut flow = Field::default();
    bencher.bench_local(|| solver.flow(&from, &to, &mut flow));
}

#[divan::bench(sample_count = 10, sample_size = 1)]
fn library_640x360(bencher: Bencher) {
    pair(bencher, 640, 360, Params::library());
}

#[divan::bench(sample_count = 5, sample_size = 1)]
fn quality_640x480(bencher: Bencher) {
    pair(bencher, 640, 480, Params::quality());
}
