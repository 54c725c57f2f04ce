//! The file that describes a simulation: TOML, with paths relative to its folder.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Kind, Result};
use crate::base::options::{Table, declare_options, explain, refuse_unknown};
use crate::simulate::grid::Sides;

/// Keys outside the tables.
const KEYS: [&str; 15] = [
    "mode",
    "size",
    "frames",
    "run_in",
    "fps",
    "steps",
    "seed",
    "wind",
    "drag",
    "vorticity",
    "sides",
    "gas",
    "water",
    "emitter",
    "obstacle",
];
const SIDES_KEYS: [&str; 4] = ["left", "right", "top", "bottom"];
const EMITTER_KEYS: [&str; 10] =
    ["disc", "box", "mask", "soft", "rate", "temperature", "velocity", "flicker", "from", "until"];
const OBSTACLE_KEYS: [&str; 3] = ["disc", "box", "mask"];

/// What is simulated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mode {
    /// Smoke and fire: an incompressible gas that carries density and heat (Stam 1999).
    #[default]
    Gas,
    /// Water seen from above: shallow-water equations, with a height and a surface whose divergence is not zero.
    Water,
}

/// A simulation as a person writes it. Lengths are pixels, times are frames.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct SimFile {
    /// What is simulated.
    pub mode: Mode,
    /// Width and height of the picture and of the grid, pixels.
    pub size: [usize; 2],
    /// Number of frames.
    pub frames: usize,
    /// Frames that are simulated before the first one and not written. What starts at frame 0 is at work in them too.
    pub run_in: usize,
    /// Frames per second of the preview.
    pub fps: f32,
    /// Steps of the simulation a frame.
    pub steps: usize,
    /// Seed of what flickers.
    pub seed: u64,
    /// Velocity that the fluid is pulled towards, pixels per frame: the wind, or the current of a river.
    pub wind: [f32; 2],
    /// Share of the difference to the wind that is lost in a frame.
    pub drag: f32,
    /// Strength of vorticity confinement.
    pub vorticity: f32,
    /// What is beyond the picture.
    pub sides: Sides,
    /// Options of [`Gas`].
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub gas: Table,
    /// Options of [`Water`].
    #[serde(skip_serializing_if = "Table::is_empty")]
    pub water: Table,
    /// Where something comes in.
    #[serde(rename = "emitter", skip_serializing_if = "Vec::is_empty")]
    pub emitters: Vec<EmitterFile>,
    /// Where nothing passes.
    #[serde(rename = "obstacle", skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Shape>,
}

impl Default for SimFile {
    fn default() -> Self {
        Self {
            mode: Mode::Gas,
            size: [256, 256],
            frames: 120,
            run_in: 0,
            fps: 25.0,
            steps: 1,
            seed: 1,
            wind: [0.0; 2],
            drag: 0.0,
            vorticity: 0.0,
            sides: Sides::default(),
            gas: Table::new(),
            water: Table::new(),
            emitters: Vec::new(),
            obstacles: Vec::new(),
        }
    }
}

/// One of these.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Shape {
    /// Centre x, y and radius, pixels.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub disc: Option<[f32; 3]>,
    /// Left, top, width and height, pixels.
    #[serde(rename = "box", skip_serializing_if = "Option::is_none")]
    pub rectangle: Option<[f32; 4]>,
    /// A grey picture of the simulation's size, white = here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mask: Option<PathBuf>,
}

/// Where something comes in, and what.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct EmitterFile {
    /// Where.
    #[serde(flatten)]
    pub shape: Shape,
    /// Width of the shape's soft edge, pixels.
    pub soft: f32,
    /// Density (gas) or depth in pixels (water) that comes in per frame.
    pub rate: f32,
    /// Temperature that the gas is given there.
    pub temperature: f32,
    /// Velocity that the fluid is given there, pixels per frame; none: as it comes.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub velocity: Option<[f32; 2]>,
    /// How much rate and temperature vary over place and time: 0 not at all, 1 from nothing to double.
    pub flicker: f32,
    /// First frame.
    pub from: usize,
    /// The frame after the last; none: to the end.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub until: Option<usize>,
}

declare_options! {
    /// What a gas does.
    pub struct Gas named "gas" {
        /// Upward acceleration of what has temperature 1.
        buoyancy: f32 = 0.05, in -2.0, 2.0, "pixels / frame²", "Fedkiw et al. 2001, Eq. 8";
        /// Downward acceleration of what has density 1.
        weight: f32 = 0.0, in -2.0, 2.0, "pixels / frame²", "Fedkiw et al. 2001, Eq. 8";
        /// Share of the temperature that is lost in a frame.
        cooling: f32 = 0.01, in 0.0, 1.0, "1 / frame", "";
        /// Share of the density that is lost in a frame.
        fading: f32 = 0.0, in 0.0, 1.0, "1 / frame", "Stam 1999, Eq. 4";
        /// How hard eddies of noise stir the gas where it is opaque; without it what begins symmetric stays so for long.
        turbulence: f32 = 0.0, in 0.0, 2.0, "pixels / frame²", "Bridson, Hourihan & Nordenstam 2007, §2";
        /// Size of those eddies.
        eddies: f32 = 16.0, in 2.0, 256.0, "pixels", "";
        /// How dense looks opaque: alpha is 1 - exp(-opacity × density).
        opacity: f32 = 2.0, in 0.01, 100.0, "1 / density", "";
    }
}

declare_options! {
    /// What water does.
    pub struct Water named "water" {
        /// Depth of the water at rest.
        depth: f32 = 10.0, in 0.5, 1000.0, "pixels", "";
        /// Downward acceleration; waves travel at the square root of gravity × depth.
        gravity: f32 = 0.3, in 0.001, 10.0, "pixels / frame²", "";
        /// How fast short waves die down (damping of divergence); without it those of a few pixels outlive all others.
        damping: f32 = 0.06, in 0.0, 0.2, "pixels² / part of a step", "Skamarock & Klemp 1992";
        /// Depth that is white in the height pictures; 0 is four times the depth at rest.
        white: f32 = 0.0, in 0.0, 65535.0, "pixels", "";
    }
}

/// Reads the text of a simulation's file; `path` is for the messages.
///
/// # Errors
/// Broken TOML, unknown keys (naming the nearest), wrong sorts of values.
pub fn parse(text: &str, path: &Path) -> Result<SimFile> {
    let bad = |e: toml::de::Error| Error::file(Kind::Usage, path, explain(&e, text)).source(e);
    let table: toml::Table = text.parse().map_err(bad)?;
    check_keys(&table).map_err(|error| error.within(path))?;
    toml::from_str(text).map_err(bad)
}

fn check_keys(table: &toml::Table) -> Result<()> {
    refuse_unknown("", table.keys().map(String::as_str), &KEYS)?;
    for (key, known) in [("sides", &SIDES_KEYS[..]), ("emitter", &EMITTER_KEYS), ("obstacle", &OBSTACLE_KEYS)] {
        let value = table.get(key);
        let several = value.and_then(toml::Value::as_array).into_iter().flatten().filter_map(toml::Value::as_table);
        for inner in value.and_then(toml::Value::as_table).into_iter().chain(several) {
            refuse_unknown(key, inner.keys().map(String::as_str), known)?;
        }
    }
    Ok(())
}

/// Writes a simulation as a file's text.
///
/// # Errors
/// A path that is not UTF-8.
pub fn format(file: &SimFile) -> Result<String> {
    toml::to_string_pretty(file)
        .map_err(|e| Error::new(Kind::Unusable, "simulation", format!("cannot be written: {e}")).source(e))
}

/// An error of bad usage about `owner`, such as "emitter 2".
pub(super) fn wrong(owner: &str, problem: impl Into<String>, allowed: impl Into<String>) -> Error {
    Error::new(Kind::Usage, owner, problem).allowed(allowed)
}
