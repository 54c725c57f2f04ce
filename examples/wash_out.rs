//! Gradual wash-out (LazyFluids, Jamriška et al. 2015, Figure 2): what each rule for the nearest-neighbour field makes of an
//! exemplar over a long sequence, by the chain of frames and the options of the method itself.
//!
//!     ENLIVEN_DATA=... cargo run --release --example wash_out -- FOLDER [frames=180] [rules=plain,uniform] [only=fire]
//!         [lazyfluids.KEY=VALUE]...
//!
//! Exemplars are `volcano-smoke.jpg` and `fire.png` of `$ENLIVEN_DATA/exemplars` and a made-up texture that is sharp in
//! some places and blurred in others, all 256 × 256; the target is a closed box of 256 × 256 pixels in which simulated gas is
//! stirred, so that nothing leaves and nothing comes in. The control is a repetitive exemplar under pure rotation, where
//! the plain rule must stay sharp. Nothing is quoted alone: sharpness counts only where the motion is as asked and every
//! pixel comes from the exemplar.
//!
//! In FOLDER: `sharpness.svg` a target, and for every exemplar the frames of all rules side by side.

use std::path::{Path, PathBuf};

use anyhow::{Context, Result};
use enliven::base::observe::Silent;
use enliven::base::options::{Table, Value, Words};
use enliven::base::par;
use enliven::base::rng::{hash, unit};
use enliven::flow::field::Field;
use enliven::flow::io;
use enliven::flow::tv_l1::{Params, TvL1};
use enliven::patch::data::field::Nnf;
use enliven::patch::data::patches::{Patches, Place};
use enliven::patch::data::segments::NO_PATCH;
use enliven::patch::rules::Rule;
use enliven::raster::filter::gaussian;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{read_picture, write_grey_png, write_png};
use enliven::raster::premultiplied::Premultiplied;
use enliven::raster::resample::resize_rgb8;
use enliven::report::contact_sheet::contact_sheet;
use enliven::report::plot::{Key, Lines, lines};
use enliven::scene::file::{SceneFile, TargetFile};
use enliven::scene::scene::Scene;
use enliven::scene::target::Target;
use enliven::simulate::output::simulate;
use enliven::simulate::setup::Setup;
use enliven::synth::exemplar::exemplar::Exemplar;
use enliven::synth::methods::lazyfluids::Options;
use enliven::synth::sequence::chain::{Chain, State};
use enliven::synth::sequence::patch_method::PatchMethod;

/// Side of exemplars and targets, pixels.
const SIDE: usize = 256;
/// Pixels off the border that are not looked at: patches there are few.
const BORDER: usize = 8;
/// Frames that the sharpness is printed at, as shares of the sequence.
const SHOWN: [f64; 4] = [0.25, 0.5, 0.75, 1.0];
/// Frames between those whose motion is measured.
const STEP: usize = 9;
/// Frames that warp error and usage are means of begin here, as a share: what is washed out already is easy to carry.
const SETTLED: f64 = 0.5;

/// Gas that three draughts stir in a box.
const STIRRED: &str = r#"
mode = "gas"
size = [256, 256]
frames = 180
drag = 0.02
[sides]
left = "closed"
right = "closed"
top = "closed"
bottom = "closed"
[[emitter]]
disc = [70.0, 80.0, 22.0]
velocity = [2.0, 1.0]
[[emitter]]
disc = [186.0, 96.0, 22.0]
velocity = [-1.0, 2.0]
[[emitter]]
disc = [120.0, 190.0, 22.0]
velocity = [-2.0, -1.4]
"#;

fn main() -> Result<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (settings, folders): (Vec<_>, Vec<_>) = arguments.iter().partition(|a| a.contains('='));
    let folder = PathBuf::from(folders.first().context("name a folder to write to")?);
    let setting = |key: &str| settings.iter().find_map(|s| s.strip_prefix(key)?.strip_prefix('='));
    let frames: usize = setting("frames").map_or(Ok(180), str::parse).context("frames")?;
    let wanted = |list: Option<&str>, name: &str| list.is_none_or(|list| list.split(',').any(|n| n == name));
    let rules: Vec<&str> = Rule::ALL.iter().map(|rule| rule.0).filter(|name| wanted(setting("rules"), name)).collect();
    let given = settings.iter().filter_map(|s| s.strip_prefix("lazyfluids.")?.split_once('='));
    let given: Table = given.map(|(key, value)| (key.to_owned(), Value::parse(value))).collect();
    let data = PathBuf::from(std::env::var_os("ENLIVEN_DATA").context("set ENLIVEN_DATA to the folder of test data")?);
    std::fs::create_dir_all(&folder)?;
    let stirred = stirred(&folder.join("stirred"))?;
    let turning = turning(&folder.join("turning"), frames)?;
    let photo = |name: &str| cropped(&data.join("exemplars").join(name));
    let cases = [
        ("smoke", photo("volcano-smoke.jpg")?, &stirred),
        ("fire", photo("fire.png")?, &stirred),
        ("patches", partly_blurred(), &stirred),
        ("control", repetitive(), &turning),
    ];
    for (name, picture, target) in cases.iter().filter(|(name, ..)| wanted(setting("only"), name)) {
        if *name == "control" && !rules.contains(&"plain") {
            continue;
        }
        let exemplar = folder.join(format!("{name}.png"));
        write_png(&exemplar, picture)?;
        let rules: Vec<&str> = rules.iter().filter(|rule| *name != "control" || **rule == "plain").copied().collect();
        case(name, &exemplar, target, &rules, frames, &given, &folder)?;
    }
    Ok(())
}

/// All rules on one exemplar.
fn case(
    name: &str,
    exemplar: &Path,
    target: &TargetFile,
    rules: &[&str],
    frames: usize,
    given: &Table,
    folder: &Path,
) -> Result<()> {
    println!("\n{name}, {frames} frames");
    println!(
        "rule           sharpness at {SHOWN:?}  | entropy  uses     | warp error  direction | not of the exemplar"
    );
    let mut runs = Vec::new();
    for rule in rules {
        let run = run(exemplar, target, rule, frames, given)?;
        print(rule, &run, runs.first().map(|(_, plain)| plain));
        runs.push((*rule, run));
    }
    let key =
        |(rule, colour): (&str, &str)| Key { name: rule.to_owned(), style: format!("stroke:{colour}"), class: "" };
    let colours = ["#888", "#b60", "#06b", "#0a6", "#c03"];
    let curves: Vec<(Key, &[f64])> =
        runs.iter().zip(colours).map(|((rule, r), colour)| (key((*rule, colour)), &r.sharpness[..])).collect();
    let title = "sharpness over the exemplar's";
    let plot = lines(&Lines { title, along: "frame", start: 0.0, step: 1.0, lines: &curves });
    std::fs::write(folder.join(format!("{name}-sharpness.svg")), plot.file())?;
    for (k, share) in SHOWN.iter().enumerate() {
        let row: Vec<Rgb8> = runs.iter().map(|(_, r)| r.shown[k].clone()).collect();
        let file = format!("{name}-{:03}.png", at(*share, frames) + 1);
        write_png(&folder.join(file), &contact_sheet(&row, row.len(), 8 + row.len() * (SIDE + 8)))?;
    }
    Ok(())
}

/// The frame at a share of a sequence.
fn at(share: f64, frames: usize) -> usize {
    ((share * frames as f64) as usize).clamp(1, frames) - 1
}

/// What is measured of a sequence.
#[derive(Default)]
struct Run {
    /// Energy of fine detail over the exemplar's, every frame.
    sharpness: Vec<f64>,
    /// Frames at [`SHOWN`].
    shown: Vec<Rgb8>,
    /// Entropy of the usage over its greatest value, and the most uses of a patch.
    entropy: f64,
    uses: (u32, u32),
    /// Root mean square of what the motion does not explain.
    warp: f64,
    /// Mean angle between measured and asked motion, weighted by speed, degrees.
    direction: f64,
    /// Greatest share of pixels that are no mean of the exemplar's pixels that their patches name.
    foreign: f64,
}

fn run(exemplar: &Path, target: &TargetFile, rule: &str, frames: usize, given: &Table) -> Result<Run> {
    let file = SceneFile { target: Some(target.clone()), exemplar: Some(exemplar.to_owned()), ..SceneFile::default() };
    let scene = Scene::new(file)?;
    let still = scene.still(&Silent)?;
    let target = Target::of(&scene, &still)?;
    let mut table: Table = given.clone();
    table.insert("nnf".to_owned(), Value::parse(rule));
    let options = Options::from_table(&table)?;
    let wanted = options.wanted(&still);
    let exemplar = Exemplar::of(&scene, &still, &target, &wanted, &Silent)?;
    let recipe = options.recipe(exemplar.own, scene.settings().output.seed);
    let chain = Chain::new(&recipe, &exemplar, &target, &Silent)?;
    let source = exemplar.at(0).into_owned();
    let whole = detail(&source, &inner(source.alpha()));
    let pixels = inner(&target.alpha(0)?);
    let (mut run, mut state) = (Run::default(), chain.first()?);
    let (mut before, mut settled, mut moved) = (state.shown(), 0usize, (0.0, 0.0));
    for t in 0..frames {
        if t > 0 {
            state = chain.next(&state, false)?;
        }
        let now = state.shown();
        run.sharpness.push(detail(&now, &pixels) / whole);
        if SHOWN.iter().any(|&s| at(s, frames) == t) {
            run.shown.push(now.on_black());
        }
        if t > 0 && t >= at(SETTLED, frames) {
            let flow = target.flow(t)?;
            settled += 1;
            run.warp += unexplained(&before, &now, &flow, &pixels);
            let source = chain.source_at(t as i64)?;
            let (entropy, uses) = usage(&state.field, source.finest());
            run.entropy += entropy;
            run.uses = if settled == 1 { uses } else { (run.uses.0.min(uses.0), run.uses.1.max(uses.1)) };
            run.foreign = run.foreign.max(foreign(&state, source.finest(), recipe.radius, &pixels));
            if t % STEP == 0 {
                let (angle, weight) = angles(&before, &now, &flow, &pixels);
                moved = (moved.0 + angle, moved.1 + weight);
            }
        }
        before = now;
    }
    let mean = |sum: f64| sum / settled.max(1) as f64;
    (run.warp, run.entropy, run.direction) = (mean(run.warp), mean(run.entropy), moved.0 / f64::max(moved.1, 1e-9));
    Ok(run)
}

fn print(rule: &str, run: &Run, plain: Option<&Run>) {
    let sharpness: Vec<String> =
        SHOWN.iter().map(|&s| format!("{:.2}", run.sharpness[at(s, run.sharpness.len())])).collect();
    let over = |a: f64, b: Option<f64>| b.map_or(String::new(), |b| format!(" ({:.2})", a / b));
    println!(
        "{rule:14} {}   | {:.3}  {:>3}..{:<4} | {:.4}{} {:.1}°{} | {:.4}",
        sharpness.join("  "),
        run.entropy,
        run.uses.0,
        run.uses.1,
        run.warp,
        over(run.warp, plain.map(|p| p.warp)),
        run.direction,
        over(run.direction, plain.map(|p| p.direction)),
        run.foreign
    );
}

/// Pixels away from the border, and from what is not opaque.
fn inner(alpha: &Plane) -> Vec<(usize, usize)> {
    let near = gaussian(alpha, BORDER as f32 / 2.0);
    let all = (BORDER..alpha.height - BORDER).flat_map(|y| (BORDER..alpha.width - BORDER).map(move |x| (x, y)));
    all.filter(|&(x, y)| near.at(x, y) > 0.98).collect()
}

/// Mean squared Laplacian of the luma.
fn detail(frame: &Premultiplied, pixels: &[(usize, usize)]) -> f64 {
    let luma = frame.on_black().luma();
    let around = |x: usize, y: usize| luma.at(x - 1, y) + luma.at(x + 1, y) + luma.at(x, y - 1) + luma.at(x, y + 1);
    let squared = |&(x, y): &(usize, usize)| f64::from(4.0 * luma.at(x, y) - around(x, y)).powi(2);
    pixels.iter().map(squared).sum::<f64>() / pixels.len() as f64
}

/// Root mean square difference of a frame and the one before carried along the motion.
fn unexplained(before: &Premultiplied, now: &Premultiplied, flow: &Field, pixels: &[(usize, usize)]) -> f64 {
    let (before, now) = (before.on_black().luma(), now.on_black().luma());
    let place = |x: usize, d: f32| x as f32 + 0.5 - d;
    let carried = |x: usize, y: usize| before.bilinear(place(x, flow.u.at(x, y)), place(y, flow.v.at(x, y)));
    let squared = |&(x, y): &(usize, usize)| f64::from(now.at(x, y) - carried(x, y)).powi(2);
    (pixels.iter().map(squared).sum::<f64>() / pixels.len() as f64).sqrt()
}

/// Sum of the angles between measured and asked motion, weighted by the asked speed, and of the weights.
fn angles(before: &Premultiplied, now: &Premultiplied, flow: &Field, pixels: &[(usize, usize)]) -> (f64, f64) {
    let (before, now) = (before.on_black().luma(), now.on_black().luma());
    let mut solver = TvL1::new(now.width, now.height, Params::library());
    let mut seen = Field::zeros(now.width, now.height);
    solver.flow(&before, &now, &mut seen);
    let angle = |&(x, y): &(usize, usize)| {
        let (a, b) = ((flow.u.at(x, y), flow.v.at(x, y)), (seen.u.at(x, y), seen.v.at(x, y)));
        let weight = f64::from(a.0.hypot(a.1));
        let angle = f64::from((a.0 * b.1 - a.1 * b.0).atan2(a.0 * b.0 + a.1 * b.1)).abs().to_degrees();
        (weight * angle, weight)
    };
    pixels.iter().map(angle).fold((0.0, 0.0), |s, a| (s.0 + a.0, s.1 + a.1))
}

/// Entropy of how often the exemplar's patches are used, over that of equal use, and the fewest and most uses.
fn usage(field: &Nnf, source: &Patches) -> (f64, (u32, u32)) {
    let all = field.usage(source);
    let uses = || all.iter().zip(source.labels()).filter(|(_, l)| **l != NO_PATCH).map(|(n, _)| *n);
    let total = uses().map(f64::from).sum::<f64>();
    let share = |n: u32| f64::from(n) / total;
    let entropy: f64 = uses().filter(|n| *n > 0).map(|n| -share(n) * share(n).ln()).sum();
    // As even as it can be: as many patches as there are, or as there are targets.
    let even = (source.count() as f64).min(total).ln();
    let range = uses().fold((u32::MAX, 0), |(least, most), n| (least.min(n), most.max(n)));
    (entropy / even, range)
}

/// Share of the pixels that are not between the least and the greatest of the exemplar's pixels that the patches over them
/// name, by more than two levels of 255.
fn foreign(state: &State, source: &Patches, radius: usize, pixels: &[(usize, usize)]) -> f64 {
    let (layer, stack) = (&state.layer, &source.stack);
    let (columns, rows) = layer.size();
    let over = |v: usize, size: usize| v.saturating_sub(radius)..(v + radius + 1).min(size);
    let named = |x: usize, y: usize, c: usize| {
        let mut range = (u8::MAX, u8::MIN);
        for (cx, cy) in over(y, rows).flat_map(|cy| over(x, columns).map(move |cx| (cx, cy))) {
            let place = state.field.cells[cy * columns + cx].place;
            if place != Place::NONE {
                let value = stack.pixel(place.index() + x + y * stack.width - cx - cy * stack.width)[c];
                range = (range.0.min(value), range.1.max(value));
            }
        }
        range
    };
    let strange = |&(x, y): &(usize, usize)| {
        (0..3).any(|c| {
            let (least, most) = named(x, y, c);
            let value = layer.planes[c].at(x, y) * 255.0;
            !(f32::from(least) - 2.0..=f32::from(most) + 2.0).contains(&value)
        })
    };
    let strange = par::map(pixels.len(), |i| strange(&pixels[i]));
    strange.iter().filter(|s| **s).count() as f64 / pixels.len() as f64
}

fn folders(folder: &Path) -> Result<TargetFile> {
    let (flow, alpha) = (folder.join("flow"), folder.join("alpha"));
    std::fs::create_dir_all(&alpha)?;
    Ok(TargetFile { flow, alpha, height: None })
}

/// The stirred box, opaque all over.
fn stirred(folder: &Path) -> Result<TargetFile> {
    let setup = Setup::new(enliven::simulate::file::parse(STIRRED, Path::new("stirred"))?, Path::new(""))?;
    let made = folder.with_extension("simulation");
    let summary = simulate(&setup, &made, &Silent)?;
    println!("target: at most {:.1} pixels a frame, divergence {:?}", summary.max_speed, summary.max_divergence);
    let target = TargetFile { flow: made.join("flow"), ..folders(folder)? };
    let opaque = Plane::filled(SIDE, SIDE, 1.0);
    (0..summary.frames).try_for_each(|t| masked(&target, t, &opaque))?;
    Ok(target)
}

/// Pure rotation of a disc, 1.5 pixels a frame at its rim.
fn turning(folder: &Path, frames: usize) -> Result<TargetFile> {
    let target = folders(folder)?;
    std::fs::create_dir_all(&target.flow)?;
    let middle = SIDE as f32 / 2.0;
    let part = |f: fn(f32, f32) -> f32| {
        Plane::from_fn(SIDE, SIDE, |x, y| 1.5 / middle * f(x as f32 + 0.5 - middle, y as f32 + 0.5 - middle))
    };
    let field = Field { u: part(|_, y| -y), v: part(|x, _| x) };
    let disc = Plane::from_fn(SIDE, SIDE, |x, y| {
        let r = (x as f32 + 0.5 - middle).hypot(y as f32 + 0.5 - middle);
        (middle - BORDER as f32 - r).clamp(0.0, 1.0)
    });
    for t in 0..frames {
        io::write(&target.flow.join(format!("{t:05}.flo")), &field)?;
        masked(&target, t, &disc)?;
    }
    Ok(target)
}

fn masked(target: &TargetFile, t: usize, alpha: &Plane) -> Result<()> {
    Ok(write_grey_png(&target.alpha.join(format!("{t:05}.png")), alpha)?)
}

/// The middle of a photo, shrunk.
fn cropped(path: &Path) -> Result<Rgb8> {
    let picture = read_picture(path)?.rgb;
    let side = picture.width.min(picture.height);
    let (left, top) = ((picture.width - side) / 2, (picture.height - side) / 2);
    let row = |y: usize| picture.data[((top + y) * picture.width + left) * 3..][..side * 3].iter().copied();
    Ok(resize_rgb8(&Rgb8 { width: side, height: side, data: (0..side).flat_map(row).collect() }, SIDE, SIDE))
}

fn noise(seed: u64, sigma: f32) -> Plane {
    let plane = gaussian(&Plane::from_fn(SIDE, SIDE, |x, y| unit(hash(seed, &[x as u64, y as u64])) - 0.5), sigma);
    let deviation = (plane.data.iter().map(|v| v * v).sum::<f32>() / plane.data.len() as f32).sqrt();
    plane.map(|v| v / deviation)
}

/// A texture that is sharp in some places and blurred in others.
fn partly_blurred() -> Rgb8 {
    let (coarse, fine, mask) = (noise(1, 4.0), noise(2, 1.0), noise(3, 20.0));
    let sharp = Plane::from_fn(SIDE, SIDE, |x, y| 0.45 + 0.12 * coarse.at(x, y) + 0.10 * fine.at(x, y));
    let blurred = gaussian(&sharp, 4.0);
    let value = |x: usize, y: usize| {
        let share = (0.5 + 2.0 * mask.at(x, y)).clamp(0.0, 1.0);
        share * sharp.at(x, y) + (1.0 - share) * blurred.at(x, y)
    };
    grey(&Plane::from_fn(SIDE, SIDE, value))
}

/// Dots of a patch's size, all alike, none touching another.
fn repetitive() -> Rgb8 {
    let cell = 7usize;
    let jitter = |c: usize, r: usize, k: u64| 1.0 * (unit(hash(9, &[c as u64, r as u64, k])) - 0.5);
    let value = |x: usize, y: usize| {
        let mut nearest = f32::MAX;
        for r in (y / cell).saturating_sub(1)..=y / cell + 1 {
            for c in (x / cell).saturating_sub(1)..=x / cell + 1 {
                let across = (c as f32 + 0.5 + 0.5 * (r % 2) as f32) * cell as f32 + jitter(c, r, 0);
                let down = (r as f32 + 0.5) * cell as f32 + jitter(c, r, 1);
                nearest = nearest.min((x as f32 - across).hypot(y as f32 - down));
            }
        }
        0.2 + 0.6 * (0.5 * (3.2 - nearest)).clamp(0.0, 1.0)
    };
    grey(&Plane::from_fn(SIDE, SIDE, value))
}

fn grey(plane: &Plane) -> Rgb8 {
    let data = plane.data.iter().flat_map(|v| [(v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8; 3]).collect();
    Rgb8 { width: plane.width, height: plane.height, data }
}
