//! How much memory a run takes, and how many frames are made at a time within what is allowed.

use crate::base::error::{Error, Kind, Result};
use crate::base::par;
use crate::base::text::megabytes;
use crate::scene::scene::Scene;

/// Bytes allowed when nothing is said.
const ALLOWED: u64 = 2_000_000_000;
/// Most bytes for the bands of a block of frames: more is no faster.
const BANDS: usize = 256 << 20;
/// Most frames of a block.
const FRAMES: usize = 16;
/// Blocks of differences that live at a time: those that wait for the writer, the one that is made and the one written.
pub const BLOCKS: usize = 4;
/// Most bytes of clips' frames that are kept, so that they need not be read twice.
const KEPT: u64 = 200_000_000;
/// The program itself, with the parts of the library that it looks at and what waits for the encoder, bytes.
const PROGRAM: u64 = 700_000_000;
/// Picture, matte, what the compositor keeps and the frames on their way out, bytes per output pixel.
const PER_OUTPUT_PIXEL: u64 = 44;
/// Planes of the working image that live at a time, bytes per working pixel.
const PER_WORKING_PIXEL: u64 = 200;

/// Refuses a scene that cannot be made within the memory it is allowed, before any long work.
///
/// # Errors
/// [`Kind::Limit`] with an estimate of what it takes.
pub fn check(scene: &Scene) -> Result<()> {
    block_frames(scene, 0, 0).map(|_| ())
}

/// Bytes that a limit leaves when `kept` are kept besides what every run takes; none without a limit.
///
/// # Errors
/// [`Kind::Limit`] with an estimate of what it takes.
pub fn room(scene: &Scene, kept: u64) -> Result<Option<u64>> {
    block_frames(scene, 0, kept)?;
    let taken = fixed_bytes(scene) + frame_bytes(scene, 0) + kept;
    Ok(scene.settings().output.max_memory.map(|limit| limit.saturating_sub(taken)))
}

/// The error of a run that is allowed too little.
pub fn too_little(allowed: u64, taken: u64) -> Error {
    let problem = format!("{} are allowed, and this run takes about {}", megabytes(allowed), megabytes(taken));
    Error::new(Kind::Limit, "output.max_memory", problem)
        .remedy("allow more with --max-memory, or make a smaller video with --size or --working-size")
}

/// Bytes of clips' frames that may be kept in memory from their study on: half of what a limit leaves, and no more than
/// is of use.
pub fn keepable(scene: &Scene) -> u64 {
    let limit = scene.settings().output.max_memory.unwrap_or(ALLOWED);
    KEPT.min(limit.saturating_sub(fixed_bytes(scene) + frame_bytes(scene, BANDS)) / 2)
}

/// Frames to make at a time, 1 to 16, when the bands of one take `bands` bytes and clips' frames take `kept`. The bands
/// of one block live at a time, and the differences of [`BLOCKS`]. Without a limit in the scene one frame is always made.
///
/// # Errors
/// [`Kind::Limit`] with an estimate, when not even one frame fits.
pub fn block_frames(scene: &Scene, bands: usize, kept: u64) -> Result<usize> {
    let limit = scene.settings().output.max_memory;
    let usual = (BANDS / bands.max(1)).clamp(par::threads().min(4), FRAMES);
    let (fixed, frame) = (fixed_bytes(scene) + kept, frame_bytes(scene, bands));
    let fitting = limit.unwrap_or(ALLOWED).saturating_sub(fixed) / frame;
    if let (0, Some(limit)) = (fitting, limit) {
        return Err(too_little(limit, fixed + frame));
    }
    Ok(usual.min(usize::try_from(fitting).unwrap_or(usize::MAX)).max(1))
}

/// What does not depend on the number of frames in a block.
fn fixed_bytes(scene: &Scene) -> u64 {
    let map = scene.frame_map();
    PROGRAM + PER_OUTPUT_PIXEL * pixels(map.output) + PER_WORKING_PIXEL * pixels(map.working)
}

/// What each frame of a block takes: its bands, its differences in every block, its outline and what that is made from.
fn frame_bytes(scene: &Scene, bands: usize) -> u64 {
    bands as u64 + (4 * BLOCKS as u64 + 8) * pixels(scene.frame_map().working)
}

fn pixels((width, height): (usize, usize)) -> u64 {
    width as u64 * height as u64
}
