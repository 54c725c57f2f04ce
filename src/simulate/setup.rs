//! A simulation's file, checked, with its shapes as pixels.

use std::path::{Path, PathBuf};

use crate::base::error::{Error, Kind, Result};
use crate::base::rng::hash;
use crate::raster::image::Plane;
use crate::raster::picture_io::read_grey;
use crate::simulate::file::{EmitterFile, Gas, Mode, Shape, SimFile, Water, parse, wrong};
use crate::simulate::grid::Domain;
use crate::simulate::noise::{smooth, smooth_noise};

/// Shortest and longest side of a simulation, pixels.
pub const SIDE: std::ops::RangeInclusive<usize> = 16..=4096;
/// Most pixels of a simulation.
pub const MAX_PIXELS: usize = 1 << 22;
/// Most frames of a simulation.
pub const MAX_FRAMES: usize = 100_000;
/// Farthest that anything may move in one step, pixels.
pub const MAX_WAY: f32 = 16.0;
/// Size and life of a patch of flicker, pixels and frames.
const PATCH: (f32, f32) = (8.0, 6.0);

/// A simulation that can run.
#[derive(Debug, Clone)]
pub struct Setup {
    /// Where the file was read, if it was.
    pub path: Option<PathBuf>,
    /// The file, with every default filled in.
    pub file: SimFile,
    /// The gas's options.
    pub gas: Gas,
    /// The water's options.
    pub water: Water,
    /// Where the fluid may be.
    pub domain: Domain,
    /// What comes in.
    pub emitters: Vec<Emitter>,
}

/// An emitter as pixels.
#[derive(Debug, Clone)]
pub struct Emitter {
    /// What it does.
    pub file: EmitterFile,
    /// How much of each pixel it covers, 0 in obstacles.
    pub cover: Plane,
    seed: u64,
}

impl Setup {
    /// Reads and checks a simulation's file.
    ///
    /// # Errors
    /// Those of [`parse`] and [`Setup::new`]; a gas without emitters.
    pub fn open(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "read", e))?;
        let folder = path.parent().unwrap_or(Path::new(""));
        let file = parse(&text, path)?;
        let empty = file.mode == Mode::Gas && file.emitters.is_empty();
        let mut setup = Self::new(file, folder).map_err(|error| error.within(path))?;
        setup.path = Some(path.to_owned());
        if empty {
            let error = wrong("emitter", "there is none, so nothing would be seen", "at least one table [[emitter]]");
            return Err(error.within(path));
        }
        Ok(setup)
    }

    /// Checks a simulation whose paths are relative to `folder`.
    ///
    /// # Errors
    /// A value out of its range, by name; a shape outside the picture; a mask that cannot be read or is of another size;
    /// speeds that are too great for the steps.
    pub fn new(mut file: SimFile, folder: &Path) -> Result<Self> {
        let gas = Gas::from_table(&file.gas)?;
        let water = Water::from_table(&file.water)?;
        check(&file)?;
        match file.mode {
            Mode::Gas if !file.water.is_empty() => return Err(foreign("water", "gas")),
            Mode::Water if !file.gas.is_empty() => return Err(foreign("gas", "water")),
            Mode::Gas => file.gas = gas.to_table(),
            Mode::Water => file.water = water.to_table(),
        }
        let [width, height] = file.size;
        let mut solid = vec![false; width * height];
        for (shape, n) in file.obstacles.iter_mut().zip(1..) {
            let cover = covered(shape, 0.0, (width, height), folder, &format!("obstacle {n}"))?;
            solid.iter_mut().zip(&cover.data).for_each(|(s, c)| *s |= *c >= 0.5);
        }
        if solid.iter().all(|&s| s) {
            return Err(wrong("obstacle", "no room is left for the fluid", "obstacles that leave some pixels free"));
        }
        let domain = Domain::new(width, height, solid, file.sides);
        let mut emitters = Vec::new();
        for n in 0..file.emitters.len() {
            emitters.push(emitter(&mut file, n, folder, &domain)?);
        }
        Ok(Self { path: None, gas, water, domain, emitters, file })
    }
}

impl Emitter {
    /// Whether it is at work in `frame`, below 0 before the first frame.
    pub fn works(&self, frame: f32) -> bool {
        (self.file.from == 0 || frame >= self.file.from as f32)
            && self.file.until.is_none_or(|until| frame < until as f32)
    }

    /// How strongly it works at a pixel and time, 0 to 2 on average 1: noise that changes smoothly.
    pub fn flicker(&self, x: usize, y: usize, frame: f32) -> f32 {
        if self.file.flicker == 0.0 {
            return 1.0;
        }
        let noise = smooth_noise(self.seed, [x as f32 / PATCH.0, y as f32 / PATCH.0, frame / PATCH.1]);
        1.0 + self.file.flicker * (2.0 * noise - 1.0)
    }
}

fn foreign(table: &str, mode: &str) -> Error {
    wrong(table, format!("a table [{table}] in a simulation of {mode}"), format!("[{mode}]"))
        .remedy(format!("take it out, or set mode = {table:?}"))
}

fn check(file: &SimFile) -> Result<()> {
    let [width, height] = file.size;
    if !(SIDE.contains(&width) && SIDE.contains(&height) && width * height <= MAX_PIXELS) {
        let allowed = format!("sides of {} to {} pixels, up to {MAX_PIXELS} pixels", SIDE.start(), SIDE.end());
        return Err(Error::new(Kind::Limit, "size", format!("{width} × {height} pixels")).allowed(allowed));
    }
    let whole = |name: &str, value: usize, most: usize| match value {
        v if (1..=most).contains(&v) => Ok(()),
        v => Err(wrong(name, format!("{v} is out of range"), format!("1 to {most}"))),
    };
    whole("frames", file.frames, MAX_FRAMES)?;
    whole("steps", file.steps, 64)?;
    if file.run_in > MAX_FRAMES {
        return Err(wrong("run_in", format!("{} is out of range", file.run_in), format!("0 to {MAX_FRAMES}")));
    }
    within("fps", file.fps, 1.0, 240.0)?;
    within("drag", file.drag, 0.0, 1.0)?;
    within("vorticity", file.vorticity, 0.0, 2.0)?;
    file.wind.iter().try_for_each(|&w| speed("wind", w, file.steps))
}

fn within(name: &str, value: f32, low: f32, high: f32) -> Result<()> {
    if (low..=high).contains(&value) {
        return Ok(());
    }
    Err(wrong(name, format!("{value} is out of range"), format!("{low} to {high}")))
}

/// Refuses a velocity that goes too far in one step.
fn speed(name: &str, value: f32, steps: usize) -> Result<()> {
    let most = MAX_WAY * steps as f32;
    if value.abs() <= most {
        return Ok(());
    }
    Err(wrong(
        name,
        format!("{value} pixels per frame are too fast for {steps} steps a frame"),
        format!("up to {MAX_WAY} pixels a step, so up to {most} pixels per frame"),
    )
    .remedy("give more steps, or a slower velocity"))
}

fn emitter(file: &mut SimFile, n: usize, folder: &Path, domain: &Domain) -> Result<Emitter> {
    let owner = format!("emitter {}", n + 1);
    let (mode, steps, frames, seed) = (file.mode, file.steps, file.frames, file.seed);
    let emitter = &mut file.emitters[n];
    let name = |key: &str| format!("{owner}: {key}");
    within(&name("rate"), emitter.rate, 0.0, 100.0)?;
    within(&name("temperature"), emitter.temperature, -100.0, 100.0)?;
    within(&name("flicker"), emitter.flicker, 0.0, 1.0)?;
    within(&name("soft"), emitter.soft, 0.0, 1000.0)?;
    if emitter.soft > 0.0 && emitter.shape.mask.is_some() {
        return Err(
            wrong(&name("soft"), "a mask has its own edges", "disc or box").remedy("blur the mask, and leave soft out")
        );
    }
    emitter.velocity.iter().flatten().try_for_each(|&v| speed(&name("velocity"), v, steps))?;
    if mode == Mode::Water && emitter.temperature != 0.0 {
        return Err(wrong(&name("temperature"), "water has none here", "0").remedy("leave it out"));
    }
    let until = *emitter.until.get_or_insert(frames);
    if emitter.from >= until {
        let problem = format!("from frame {} until frame {until} is no time", emitter.from);
        return Err(wrong(&owner, problem, "from less than until"));
    }
    let mut cover = covered(&mut emitter.shape, emitter.soft, (domain.width, domain.height), folder, &owner)?;
    cover.data.iter_mut().zip(&domain.solid).filter(|(_, s)| **s).for_each(|(c, _)| *c = 0.0);
    if cover.data.iter().all(|&c| c == 0.0) {
        return Err(wrong(&owner, "lies inside obstacles", "a place where the fluid can be"));
    }
    Ok(Emitter { file: emitter.clone(), cover, seed: hash(seed, &[n as u64]) })
}

/// How much of each pixel a shape covers, edges softened over `soft` pixels, at least one. Makes the path of a mask one that
/// does not depend on the folder.
fn covered(shape: &mut Shape, soft: f32, size: (usize, usize), folder: &Path, owner: &str) -> Result<Plane> {
    let (width, height) = size;
    let positive = |values: &[f32]| values.iter().all(|&v| v.is_finite() && v > 0.0);
    let ramp = |inside: f32| {
        let share = (inside / soft.max(1.0) + 0.5).clamp(0.0, 1.0);
        if soft > 1.0 { smooth(share) } else { share }
    };
    let cover = match (shape.disc, shape.rectangle, &mut shape.mask) {
        (Some([x, y, r]), None, None) if positive(&[r]) && x.is_finite() && y.is_finite() => {
            Plane::from_fn(width, height, |i, j| ramp(r - (i as f32 + 0.5 - x).hypot(j as f32 + 0.5 - y)))
        }
        (None, Some([x, y, w, h]), None) if positive(&[w, h]) && x.is_finite() && y.is_finite() => {
            let along = |at: usize, first: f32, length: f32| {
                let at = at as f32 + 0.5;
                ramp((at - first).min(first + length - at))
            };
            Plane::from_fn(width, height, |i, j| along(i, x, w) * along(j, y, h))
        }
        (None, None, Some(path)) => masked(path, size, folder)?,
        (None, None, None) => return Err(wrong(owner, "has no shape", "disc, box or mask")),
        (Some(disc), None, None) => {
            return Err(wrong(owner, format!("disc = {disc:?}"), "x, y and a radius above 0"));
        }
        (None, Some(sides), None) => {
            return Err(wrong(owner, format!("box = {sides:?}"), "left, top, and a width and height above 0"));
        }
        _ => return Err(wrong(owner, "has more than one shape", "one of disc, box and mask")),
    };
    if cover.data.iter().all(|&c| c == 0.0) {
        return Err(wrong(owner, "lies outside the picture", format!("inside {width} × {height} pixels")));
    }
    Ok(cover)
}

fn masked(path: &mut PathBuf, (width, height): (usize, usize), folder: &Path) -> Result<Plane> {
    *path = folder.join(&*path);
    let mask = read_grey(path)?;
    if (mask.width, mask.height) == (width, height) {
        return Ok(mask);
    }
    let problem = format!("is {} × {} pixels", mask.width, mask.height);
    Err(Error::file(Kind::Usage, path, problem).allowed(format!("the simulation's size, {width} × {height}")))
}
