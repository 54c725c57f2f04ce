//! How fast patches are searched, where the time of a frame goes, and how near its energy is to the best.
//!
//! `cargo run --release --example patch_speed`
//!
//! First PatchMatch alone: 5 × 5 patches of six channels, one million pixels against one million, four sweeps. Then
//! LazyFluids' channels: frames of 1024 × 1024 pixels from an exemplar of 512 × 512, each from the one before: the time of
//! a frame on one thread and on two in turns, the rounds of each level, and the energy over that of ten times the rounds.
//! The exemplar is made up; with the environment variable ENLIVEN_DATA also `exemplars/fire.png` and
//! `exemplars/volcano-smoke.jpg` there.

use std::time::Instant;

use anyhow::{Context, Result, ensure};
use enliven::base::observe::Silent;
use enliven::base::par;
use enliven::base::rng::{hash, unit};
use enliven::patch::data::channels::{Channel, Layout, Role, Stack};
use enliven::patch::data::field::Nnf;
use enliven::patch::data::patches::Patches;
use enliven::patch::data::segments::{Thresholds, labels};
use enliven::patch::engine::{Engine, Frame, Image, Settings, Target};
use enliven::patch::patch_match::{Search, Sweep};
use enliven::raster::filter::gaussian;
use enliven::raster::image::Plane;
use enliven::raster::picture_io::read_picture;
use enliven::raster::resample::resize;
use enliven::synth::methods::lazyfluids::Options;
use enliven::synth::sequence::chain::Recipe;
use enliven::synth::sequence::patch_method::PatchMethod;
use rustix::time::{ClockId, clock_gettime};

/// Frames of a sequence; the first starts from nothing and does not count.
const FRAMES: usize = 3;
/// Exemplars that may be there.
const REAL: [&str; 2] = ["fire.png", "volcano-smoke.jpg"];

fn main() -> Result<()> {
    on(2, bare)?;
    lazyfluids("made up", &made_up(512, 1), true)?;
    if let Some(folder) = std::env::var_os("ENLIVEN_DATA") {
        for name in REAL {
            let path = std::path::Path::new(&folder).join("exemplars").join(name);
            let picture = read_picture(&path).with_context(|| path.display().to_string())?;
            let [red, green, blue] = picture.rgb.to_color().planes.each_ref().map(|p| resize(p, 512, 512));
            let alpha = red.map(|r| (r * 1.5).min(1.0));
            lazyfluids(name, &[red, green, blue, alpha], false)?;
        }
    }
    Ok(())
}

/// Runs `work` on so many threads.
fn on<T: Send>(threads: usize, work: impl FnOnce() -> T + Send) -> Result<T> {
    Ok(par::with_threads(threads, work)?)
}

/// CPU seconds of the process and seconds of the clock that `work` takes.
fn timed<T>(work: impl FnOnce() -> T) -> (T, f64, f64) {
    let cpu = || {
        let time = clock_gettime(ClockId::ProcessCPUTime);
        time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
    };
    let (start, before) = (Instant::now(), cpu());
    let result = work();
    (result, cpu() - before, start.elapsed().as_secs_f64())
}

fn noise(size: usize, seed: u64, sigma: f32) -> Plane {
    let plane = gaussian(&Plane::from_fn(size, size, |x, y| unit(hash(seed, &[x as u64, y as u64])) - 0.5), sigma);
    let deviation = (plane.data.iter().map(|v| v * v).sum::<f32>() / plane.data.len() as f32).sqrt();
    plane.map(|v| v / deviation)
}

/// Colour and alpha of something between smoke and fire.
fn made_up(size: usize, seed: u64) -> [Plane; 4] {
    let bands: Vec<Plane> =
        [40.0, 14.0, 5.0, 1.5].iter().zip(1..).map(|(&s, k)| noise(size, seed * 10 + k, s)).collect();
    let height = Plane::from_fn(size, size, |x, y| {
        let sum: f32 = bands.iter().zip([0.10, 0.08, 0.05, 0.03]).map(|(b, a)| b.at(x, y) * a).sum();
        0.6 + sum
    });
    let rim = Plane::from_fn(size, size, |x, y| {
        let r = (x as f32 / size as f32 - 0.5).hypot(y as f32 / size as f32 - 0.5);
        ((0.42 + 0.05 * bands[1].at(x, y) + 0.02 * bands[2].at(x, y) - r) * 14.0).clamp(0.0, 1.0)
    });
    let channel =
        |power: f32| Plane::from_fn(size, size, |x, y| height.at(x, y).clamp(0.0, 1.0).powf(power) * rim.at(x, y));
    [channel(0.7), channel(1.3), channel(2.5), rim]
}

/// Two sets of patches with six channels that have nothing to do with each other.
fn pair(side: usize) -> (Layout, Patches, Patches) {
    const CHANNELS: usize = 6;
    let channels = (0..CHANNELS).map(|_| Channel::new("any", 1.0, Role::Synthesised)).collect();
    let layout = Layout::new(2, channels).expect("six channels of side five fit");
    let patches = |offset: u64| {
        let planes: Vec<Plane> = (0..CHANNELS as u64)
            .map(|c| {
                let (a, b) = (noise(side, 100 * offset + c, 6.0), noise(side, 100 * offset + c + 50, 1.2));
                Plane::from_fn(side, side, |x, y| 0.5 + 0.12 * a.at(x, y) + 0.05 * b.at(x, y))
            })
            .collect();
        Patches::new(Stack::from_planes(&planes), labels((side, side), 2, None, Thresholds::default()))
    };
    (layout, patches(1), patches(2))
}

/// CPU and clock seconds of `sweeps` sweeps, and how many distances they take at most: two neighbours, and windows of half
/// side `reach` and ever half of that.
fn searched(side: usize, sweeps: usize, reach: usize) -> (f64, f64, f64) {
    let (layout, from, to) = pair(side);
    let search: Search = Search::plain(&layout, &from, &to);
    let mut nnf = Nnf::random(&from, &to, 1);
    search.evaluate(&mut nnf);
    let mut total = (0.0, 0.0);
    for number in 0..sweeps {
        let ((), cpu, wall) = timed(|| search.sweep(&mut nnf, Sweep { number, reach, seed: number as u64 }));
        total = (total.0 + cpu, total.1 + wall);
        if sweeps <= 4 {
            let energy = layout.to_energy(nnf.total() as f64) / from.count() as f64;
            println!("  sweep {number}: {cpu:.2} s of CPU, {wall:.2} s, energy a patch {energy:.4}");
        }
    }
    let windows = f64::from(usize::BITS - reach.leading_zeros());
    (total.0, total.1, sweeps as f64 * from.count() as f64 * (2.0 + windows))
}

fn bare() {
    println!("PatchMatch, 1024 x 1024 against 1024 x 1024, 5 x 5 x 6 channels, threads: {}", par::threads());
    let (cpu, wall, distances) = searched(1024, 4, 1024);
    let each = cpu / distances * 1e9;
    println!(
        "  four sweeps: {cpu:.2} s of CPU, {wall:.2} s; at most {distances:.1e} distances, {each:.1} ns of CPU each"
    );
    let (cpu, _, distances) = searched(48, 400, 32);
    let cached = cpu / distances * 1e9;
    println!(
        "  the same in images of 48 x 48, all in the cache: {cached:.1} ns; so {:.1} times the arithmetic",
        each / cached
    );
}

fn channels() -> Vec<Channel> {
    use Role::{Guide, Modulated, Synthesised};
    let (lambda, eta) = (0.2, 3.0);
    let all = [
        ("red", 1.0, Synthesised),
        ("green", 1.0, Synthesised),
        ("blue", 1.0, Synthesised),
        ("alpha", 3.0, Synthesised),
        ("blurred alpha", eta, Guide),
        ("red before", lambda, Modulated),
        ("green before", lambda, Modulated),
        ("blue before", lambda, Modulated),
        ("alpha before", 3.0 * lambda, Modulated),
    ];
    all.iter().map(|&(name, weight, role)| Channel::new(name, weight, role)).collect()
}

/// An image with LazyFluids' channels: colour and alpha now, and before.
fn image(now: &[Plane], alpha: &Plane, before: &[Plane]) -> Image {
    let blurred = gaussian(alpha, 1.5);
    let planes = now.iter().chain([&blurred]).chain(before).cloned().collect();
    Image { planes, blurred: Some(blurred) }
}

/// Where a pixel of the next frame was.
fn turned(x: usize, y: usize) -> (f32, f32) {
    let (sin, cos) = 0.01f32.sin_cos();
    let (x, y) = (x as f32 + 0.5 - 512.0, y as f32 + 0.5 - 512.0);
    (512.0 + cos * x + sin * y, 512.0 + cos * y - sin * x)
}

/// Everything turned a little round the middle.
fn carried(planes: &[Plane]) -> Vec<Plane> {
    let turn = |p: &Plane| {
        Plane::from_fn(p.width, p.height, |x, y| {
            let (x, y) = turned(x, y);
            p.bilinear(x, y)
        })
    };
    planes.iter().map(turn).collect()
}

/// A sequence; with `alone` every frame is made on one thread too.
fn lazyfluids(name: &str, exemplar: &[Plane; 4], alone: bool) -> Result<()> {
    let side = 1024;
    let alpha = &made_up(side, 9)[3];
    let Recipe { settings, keep, .. } = Options::default().recipe(false, 1);
    let engine = Engine::new(Layout::new(2, channels())?, settings.clone());
    let images = [image(&exemplar[..], &exemplar[3], &exemplar[..])];
    let source = on(2, || engine.source(&images))??;
    println!("\n{name}");
    let mut last: Option<(Target, Frame)> = None;
    let mut seconds = [0.0; 2];
    for number in 0..FRAMES {
        let target = next(side, alpha, last.as_ref().map(|(_, frame)| frame), keep);
        let (frame, cpu, wall) = on(2, || timed(|| engine.frame(&source, &target, &Silent)))?;
        let frame = frame?;
        print(&format!("frame {number}: {cpu:.2} s of CPU, {wall:.2} s"), &frame);
        if number > 0 {
            seconds[1] += wall;
        }
        if number > 0 && alone {
            let (one, cpu, wall) = on(1, || timed(|| engine.frame(&source, &target, &Silent)))?;
            println!("  on one thread: {cpu:.2} s of CPU, {wall:.2} s");
            ensure!(one?.planes == frame.planes, "one thread made another frame");
            seconds[0] += wall;
        }
        last = Some((target, frame));
    }
    println!("  steady state: {:.2} s a frame on two threads", seconds[1] / (FRAMES - 1) as f64);
    if alone {
        println!("  two threads are {:.2} times as fast as one", seconds[0] / seconds[1]);
    }
    let (target, frame) = last.context("no frame")?;
    longer(&engine, settings, &images, &target, &frame)
}

/// What the frame after `last` is made from.
fn next(side: usize, alpha: &Plane, last: Option<&Frame>, keep: f32) -> Target {
    let before = match last {
        None => (0..4).map(|c| noise(side, 7 + c, 1.0).map(|v| 0.5 + 0.1 * v)).collect(),
        Some(frame) => carried(&frame.planes),
    };
    let modulation = last.is_none().then(|| Plane::zeros(side, side));
    let previous = last.map(|frame| frame.nnf.carried(turned));
    let kept = last.map(|_| Plane::filled(side, side, keep));
    Target { modulation, kept, previous, ..Target::new(image(&before, alpha, &before)) }
}

/// The same frame with ten times the rounds, and how its energy compares.
fn longer(engine: &Engine, settings: Settings, images: &[Image], target: &Target, frame: &Frame) -> Result<()> {
    let (coarse, fine) = settings.iterations;
    let many = Settings { iterations: (10 * coarse, 10 * fine), tolerance: 0.0, ..settings };
    let engine = Engine::new(engine.layout().clone(), many);
    let (long, cpu, wall) = on(2, || {
        let source = engine.source(images)?;
        let (frame, cpu, wall) = timed(|| engine.frame(&source, target, &Silent));
        frame.map(|frame| (frame, cpu, wall))
    })??;
    println!("  with ten times the rounds: {cpu:.2} s of CPU, {wall:.2} s");
    println!("  energy over that with ten times the rounds: {:.3}", last_energy(frame) / last_energy(&long));
    Ok(())
}

fn last_energy(frame: &Frame) -> f64 {
    frame.levels.last().and_then(|level| level.energies.last()).copied().unwrap_or(f64::NAN)
}

fn print(title: &str, frame: &Frame) {
    println!("{title}");
    for level in &frame.levels {
        let each = |energy: Option<&f64>| energy.copied().unwrap_or(f64::NAN) / level.patches.1 as f64;
        println!(
            "    {:4} x {:4}, {:6} patches from {:6}: {:2} rounds, search {:.3} s, vote {:.3} s; energy a patch {:.4} to {:.4}",
            level.size.0,
            level.size.1,
            level.patches.1,
            level.patches.0,
            level.energies.len(),
            level.searching,
            level.voting,
            each(level.energies.first()),
            each(level.energies.last())
        );
    }
}
