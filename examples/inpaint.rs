//! How long making up what lies behind a fluid takes, and what it looks like.
//!
//! `cargo run --release --example inpaint -- PICTURE MATTE OUT.png [LONG_SIDE]`
//!
//! The picture is shrunk to the long side (640), what the matte covers is made up three times on two threads, and the least
//! CPU time and time of the clock are told.

use std::path::PathBuf;
use std::time::Instant;

use anyhow::{Context, Result, ensure};
use enliven::base::par;
use enliven::raster::image::Color;
use enliven::raster::picture_io::{read_matte, read_picture, write_png};
use enliven::raster::resample::resize;
use enliven::render::inpaint::inpaint;
use rustix::time::{ClockId, clock_gettime};

/// Alpha above which a pixel is covered.
const COVERED: f32 = 0.02;

fn main() -> Result<()> {
    let arguments: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    ensure!((3..=4).contains(&arguments.len()), "PICTURE MATTE OUT.png [LONG_SIDE]");
    let side: usize = arguments.get(3).map_or(Ok(640), |side| side.display().to_string().parse())?;
    let picture = read_picture(&arguments[0]).with_context(|| arguments[0].display().to_string())?.rgb.to_color();
    let matte = read_matte(&arguments[1]).with_context(|| arguments[1].display().to_string())?;
    let (width, height) = (matte.width, matte.height);
    let scale = side as f64 / width.max(height) as f64;
    let size = |v: usize| ((v as f64 * scale).round() as usize).max(1);
    let small = |plane: &enliven::raster::image::Plane| resize(plane, size(width), size(height));
    let picture = Color::from_planes(picture.planes.each_ref().map(small));
    let hole = small(&matte).map(|m| if m > COVERED { 1.0 } else { 0.0 });
    let share = hole.data.iter().sum::<f32>() / hole.data.len() as f32;
    let cpu = || {
        let time = clock_gettime(ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    };
    let (mut least, mut wall) = (f64::INFINITY, f64::INFINITY);
    for _ in 0..3 {
        let (before, start) = (cpu(), Instant::now());
        let made = par::with_threads(2, || inpaint(&picture, &hole))?;
        (least, wall) = (least.min(cpu() - before), wall.min(start.elapsed().as_secs_f64()));
        write_png(&arguments[2], &made.to_rgb8())?;
    }
    println!("{} x {}, {:.0} % made up: {least:.2} s of CPU, {wall:.2} s", size(width), size(height), 100.0 * share);
    Ok(())
}
