//! Small clips to build libraries from.

use std::io::Write;
use std::path::{Path, PathBuf};

use enliven::base::rng;
use enliven::library::options::Options;

/// Width of the clips in pixels.
pub const WIDTH: usize = 96;
/// Height of the clips in pixels.
pub const HEIGHT: usize = 80;
/// Frames of the clips.
pub const FRAMES: usize = 42;

/// Options for such small clips.
pub fn options() -> Options {
    Options { tag: "test".into(), stride: 16, words: 12, ..Options::default() }
}

/// Smooth noise in 0..=255 at a place, by bilinear interpolation of hashes 4 pixels apart.
fn noise(seed: u64, x: f32, y: f32) -> f32 {
    let (x, y) = (x / 4.0, y / 4.0);
    let (x0, y0) = (x.floor(), y.floor());
    let at = |i: f32, j: f32| rng::unit(rng::hash(seed, &[i as i64 as u64, j as i64 as u64])) * 255.0;
    let (ax, ay) = (x - x0, y - y0);
    let top = at(x0, y0) * (1.0 - ax) + at(x0 + 1.0, y0) * ax;
    let bottom = at(x0, y0 + 1.0) * (1.0 - ax) + at(x0 + 1.0, y0 + 1.0) * ax;
    top * (1.0 - ay) + bottom * ay
}

/// A clip of a fall before a still wall, as Y4M: texture sinks a pixel and a half a frame right of the first fifth.
pub fn write_clip(path: &Path, seed: u64) {
    let mut bytes = format!("YUV4MPEG2 W{WIDTH} H{HEIGHT} F25:1 Ip A1:1 C420jpeg\n").into_bytes();
    for t in 0..FRAMES {
        bytes.extend(b"FRAME\n");
        for y in 0..HEIGHT {
            for x in 0..WIDTH {
                let (x, y, t) = (x as f32, y as f32, t as f32);
                let fluid = 0.7 * noise(seed, x, y - 1.5 * t) + 0.3 * noise(seed + 1, x + 0.5 * t, y - 2.5 * t);
                let value = if x < WIDTH as f32 / 5.0 { noise(seed + 2, x, y) } else { fluid };
                bytes.push(value as u8);
            }
        }
        bytes.extend(std::iter::repeat_n(128, WIDTH * HEIGHT / 2));
    }
    std::fs::File::create(path).unwrap().write_all(&bytes).unwrap();
}

/// Three clips in a folder.
pub fn write_clips(folder: &Path) -> Vec<PathBuf> {
    let paths: Vec<PathBuf> = ["a.y4m", "b.y4m", "c.y4m"].iter().map(|n| folder.join(n)).collect();
    paths.iter().enumerate().for_each(|(i, path)| write_clip(path, 10 * i as u64));
    paths
}
