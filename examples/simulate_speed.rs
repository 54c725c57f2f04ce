//! How many steps a second the simulator makes, and how exact it is.
//!
//! `cargo run --release --example simulate_speed [-- THREADS [SIDE]]` (1 thread, 512 pixels)
//!
//! A plume with vorticity confinement and a round rock in a closed box. The first steps, with nothing much in the picture,
//! are not counted.

use std::path::Path;

use anyhow::{Context, Result};
use enliven::base::par;
use enliven::simulate::file::parse;
use enliven::simulate::fluid::Fluid;
use enliven::simulate::setup::Setup;
use rustix::time::{ClockId, clock_gettime};

/// Steps that are not counted, and steps that are.
const BEFORE: usize = 20;
const COUNTED: usize = 60;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1).map(|a| a.parse::<usize>());
    let threads = arguments.next().unwrap_or(Ok(1)).context("the number of threads")?;
    let side = arguments.next().unwrap_or(Ok(512)).context("the side in pixels")?;
    par::with_threads(threads, || run(side))?
}

fn run(side: usize) -> Result<()> {
    let (middle, low, radius) = (side / 2, side * 9 / 10, side / 20);
    let text = format!(
        "size = [{side}, {side}]\nvorticity = 0.15\n[gas]\nbuoyancy = 0.2\n[[emitter]]\ndisc = [{middle}, {low}, {radius}]\n\
         rate = 0.2\ntemperature = 1\nvelocity = [0, -2]\n[[obstacle]]\ndisc = [{middle}, {middle}, {radius}]\n"
    );
    let setup = Setup::new(parse(&text, Path::new("simulate_speed"))?, Path::new(""))?;
    let mut fluid = Fluid::new(&setup);
    (0..BEFORE).try_for_each(|_| fluid.next_frame().map(drop))?;
    let (start, cpu, rounds) = (std::time::Instant::now(), seconds(), fluid.tally.rounds);
    (0..COUNTED).try_for_each(|_| fluid.next_frame().map(drop))?;
    let (wall, cpu) = (start.elapsed().as_secs_f64(), seconds() - cpu);
    let count = COUNTED as f64;
    println!(
        "{side} x {side}, {} threads: {:.1} steps a second of the clock, {:.1} of CPU",
        par::threads(),
        count / wall,
        count / cpu
    );
    let (budget, now) = fluid.budget();
    println!(
        "solver rounds a step {:.1}, divergence up to {:.1e}, greatest speed {:.1} pixels per frame, mass drift {:.1e}",
        (fluid.tally.rounds - rounds) as f64 / count,
        fluid.tally.divergence,
        fluid.tally.speed,
        (budget.given - budget.left - now).abs() / budget.given
    );
    Ok(())
}

/// Seconds of CPU of the process.
fn seconds() -> f64 {
    let time = clock_gettime(ClockId::ProcessCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
