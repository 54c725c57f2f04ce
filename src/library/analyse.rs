//! From a clip's frames to its descriptor grids, in one streamed pass with bounded memory.
//!
//! Frames come in blocks of 16. While one block is analysed on all threads, the next is read. Per scale, each pair of
//! neighbouring frames gives a motion field; fields go into the mean motion, its mean length and the motion spectrum;
//! frames go into the mean picture, the textureness and the temporal deviation. Sums run in the order of the frames,
//! so the result does not depend on the number of threads.

use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::Instant;

use half::f16;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::par;
use crate::descriptor::motion_spectrum::HOP;
use crate::flow::field::Field;
use crate::flow::tv_l1::{Params, TvL1};
use crate::raster::image::{Plane, Rgb8};
use crate::raster::resample;

use super::grid::{Cell, CellGrid};
use super::significance;
use super::statistics::{Deviation, PARTS, Statistics};
use super::variant::{CELL, SCALES, level_size};

/// Fewest frames of a usable clip, at 25 frames/s (one window of the motion spectrum and a little more).
pub const MIN_FRAMES: usize = 40;

/// Name of the stage that [`Observer`] hears of; one step is a frame.
pub const STAGE: &str = "analyse";

/// Where frames come from: the next frame, or `None` after the last.
pub trait Frames: Send {
    /// The next frame, all of one size.
    ///
    /// # Errors
    /// When the clip cannot be read any further.
    fn next_frame(&mut self) -> Result<Option<Rgb8>>;
}

impl<F: FnMut() -> Result<Option<Rgb8>> + Send> Frames for F {
    fn next_frame(&mut self) -> Result<Option<Rgb8>> {
        self()
    }
}

/// Takes each frame on, in order, while the pass runs (to be stored, to be judged).
pub type FrameSink<'a> = dyn FnMut(&Rgb8) -> Result<()> + Send + 'a;

/// A motion field between two frames of equal size; called on many threads at once.
pub type FlowMaker<'a> = dyn Fn(&Plane, &Plane) -> Field + Sync + 'a;

/// Mean of a clip's frames, red, green, blue, 16 bits for [0, 1].
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Average {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Three planes of `width * height` values; 65535 is 1.
    pub planes: [Vec<u16>; 3],
}

/// What the library keeps of a clip besides its frames.
#[derive(Debug, Clone, PartialEq)]
pub struct Analysis {
    /// Frames seen.
    pub frames: usize,
    /// Mean picture ("representative image", Okabe et al. 2011, §4).
    pub average: Average,
    /// Descriptor grids, one per scale of [`SCALES`].
    pub grids: [CellGrid; SCALES.len()],
    /// Share of the pixels with significant motion, 0 to 1.
    pub significant: f32,
    /// Mean length of the motion over the significant pixels, working pixels per frame.
    pub activity: f32,
}

/// Per-pixel results of the pass, before they are reduced to cells.
#[derive(Debug, Clone)]
pub struct Gathered {
    /// Frames seen.
    pub frames: usize,
    /// Mean picture.
    pub average: Average,
    /// Motion and texture, one per scale of [`SCALES`].
    pub scales: [Statistics; SCALES.len()],
    /// Temporal standard deviation of luma, in working pixels.
    pub deviation: Plane,
}

/// Analyses the frames of a clip of `width` × `height` working pixels (multiples of 16) at 25 frames/s. `mask`, in
/// working pixels, excludes other moving objects (white = use). Each frame is handed to `sink` in order.
///
/// # Errors
/// Those of `frames` and `sink`; a clip of fewer than [`MIN_FRAMES`] frames; frames of another size; a cancel.
pub fn analyse(
    frames: &mut dyn Frames,
    (width, height): (usize, usize),
    mask: Option<&Plane>,
    observer: &dyn Observer,
    sink: &mut FrameSink<'_>,
) -> Result<Analysis> {
    if mask.is_some_and(|m| (m.width, m.height) != (width, height)) {
        let problem = "its size is not the clip's working size";
        return Err(Error::new(Kind::Unusable, "clip mask", problem).allowed(format!("{width} × {height} px")));
    }
    let gathered = gather(frames, (width, height), observer, sink, &library_flow())?;
    Ok(gathered.reduce(mask))
}

/// The streamed pass of [`analyse`] with any motion estimator, keeping the results per pixel.
///
/// # Errors
/// As [`analyse`].
pub fn gather(
    frames: &mut dyn Frames,
    (width, height): (usize, usize),
    observer: &dyn Observer,
    sink: &mut FrameSink<'_>,
    flow: &FlowMaker<'_>,
) -> Result<Gathered> {
    let mut reader = Reader { frames, sink, size: (width, height), seconds: 0.0 };
    let mut pass = Pass::new(width, height)?;
    observer.begin(STAGE, 0);
    // One frame more than a block, so that every block brings as many motion fields as windows are apart.
    let mut block = reader.block(HOP + 1)?;
    while !block.is_empty() {
        observe::check(observer)?;
        let (next, ()) = par::join(|| reader.block(HOP), || pass.add(&block, flow));
        observer.advance(STAGE, block.len() as u64);
        block = next?;
    }
    observer.end("analyse: read", reader.seconds);
    pass.finish(observer)
}

/// Reads blocks of frames and hands them on.
struct Reader<'a, 'b> {
    frames: &'a mut dyn Frames,
    sink: &'a mut FrameSink<'b>,
    size: (usize, usize),
    seconds: f64,
}

impl Reader<'_, '_> {
    /// The next `count` frames, fewer at the end of the clip.
    fn block(&mut self, count: usize) -> Result<Vec<Rgb8>> {
        let start = Instant::now();
        let mut block = Vec::with_capacity(count);
        while block.len() < count {
            let Some(frame) = self.frames.next_frame()? else { break };
            if (frame.width, frame.height) != self.size {
                let problem = format!("a frame of {} × {} px among others", frame.width, frame.height);
                let allowed = format!("{} × {} px", self.size.0, self.size.1);
                return Err(Error::new(Kind::Data, "clip", problem).allowed(allowed));
            }
            (self.sink)(&frame)?;
            block.push(frame);
        }
        self.seconds += start.elapsed().as_secs_f64();
        Ok(block)
    }
}

/// What the pass accumulates.
struct Pass {
    frames: usize,
    /// Sums of the bytes, as the frames hold them.
    colors: Vec<u32>,
    scales: [Statistics; SCALES.len()],
    deviation: Deviation,
    last: Option<[Plane; SCALES.len()]>,
    size: (usize, usize),
    /// Seconds spent on levels, flow, texture, motion.
    seconds: [f64; 4],
}

impl Pass {
    fn new(width: usize, height: usize) -> Result<Self> {
        const LIMIT: usize = 4096;
        if [width, height].into_iter().any(|side| side == 0 || side % 16 != 0 || side > LIMIT) {
            let problem = format!("working size {width} × {height} px");
            return Err(Error::new(Kind::Unusable, "clip", problem).allowed("multiples of 16 from 16 to 4096 px"));
        }
        let scale = |s: usize| level_size(width, height, s as u8);
        Ok(Self {
            frames: 0,
            colors: vec![0; 3 * width * height],
            scales: std::array::from_fn(|s| Statistics::new(scale(s).0, scale(s).1)),
            deviation: Deviation::default(),
            last: None,
            size: (width, height),
            seconds: [0.0; 4],
        })
    }

    /// Adds the next frames.
    fn add(&mut self, block: &[Rgb8], flow: &FlowMaker<'_>) {
        let start = Instant::now();
        let lumas = par::map(block.len(), |i| levels(&block[i]));
        self.add_colors(block);
        let levels_done = start.elapsed().as_secs_f64();
        let fields = fields(self.last.as_ref(), &lumas, flow);
        let flow_done = start.elapsed().as_secs_f64();
        self.add_textures(&lumas);
        self.deviation.add(&lumas.iter().map(|l| &l[0]).collect::<Vec<_>>());
        let texture_done = start.elapsed().as_secs_f64();
        self.scales.iter_mut().zip(fields).for_each(|(scale, fields)| scale.add_fields(fields));
        let motion_done = start.elapsed().as_secs_f64();
        self.frames += block.len();
        self.last = lumas.into_iter().next_back();
        let ends = [0.0, levels_done, flow_done, texture_done, motion_done];
        self.seconds.iter_mut().zip(ends.windows(2)).for_each(|(sum, span)| *sum += span[1] - span[0]);
    }

    fn add_colors(&mut self, block: &[Rgb8]) {
        let row = 3 * self.size.0;
        par::for_each_chunk(&mut self.colors, row, |y, sums| {
            for frame in block {
                sums.iter_mut().zip(&frame.data[y * row..]).for_each(|(sum, &byte)| *sum += u32::from(byte));
            }
        });
    }

    fn add_textures(&mut self, lumas: &[[Plane; SCALES.len()]]) {
        let first = self.frames;
        let scales = self.scales.iter_mut().enumerate();
        let mut parts: Vec<_> = scales
            .flat_map(|(s, scale)| scale.textureness.iter_mut().enumerate().map(move |(part, sum)| (s, part, sum)))
            .collect();
        par::for_each_chunk(&mut parts, 1, |_, chunk| {
            for (s, part, sum) in chunk {
                let mine = lumas.iter().enumerate().filter(|(i, _)| (first + i) % PARTS == *part);
                mine.for_each(|(_, luma)| sum.add(&luma[*s]));
            }
        });
    }

    fn finish(mut self, observer: &dyn Observer) -> Result<Gathered> {
        for (stage, seconds) in ["levels", "flow", "texture", "motion"].into_iter().zip(self.seconds) {
            observer.end(&format!("{STAGE}: {stage}"), seconds);
        }
        observer.end(STAGE, self.seconds.iter().sum());
        if self.frames < MIN_FRAMES {
            let problem = format!("only {} frames at 25 frames/s", self.frames);
            return Err(Error::new(Kind::Unusable, "clip", problem).allowed(format!("{MIN_FRAMES} or more")));
        }
        self.scales.iter_mut().for_each(Statistics::finish);
        let (width, height) = self.size;
        let average = Average { width, height, planes: average(&self.colors, self.frames) };
        Ok(Gathered { frames: self.frames, average, scales: self.scales, deviation: self.deviation.plane() })
    }
}

/// Luma of a frame at every scale.
fn levels(frame: &Rgb8) -> [Plane; SCALES.len()] {
    let luma = frame.luma();
    std::array::from_fn(|s| {
        let (width, height) = level_size(frame.width, frame.height, s as u8);
        resample::resize(&luma, width, height)
    })
}

/// Motion fields between neighbouring frames per scale, from `last` (of the block before) on.
fn fields(
    last: Option<&[Plane; SCALES.len()]>,
    lumas: &[[Plane; SCALES.len()]],
    flow: &FlowMaker<'_>,
) -> [Vec<Field>; SCALES.len()] {
    let frames: Vec<_> = last.into_iter().chain(lumas).collect();
    let pairs = frames.len().saturating_sub(1);
    // Large scales first, so that threads finish together.
    let pair = |i: usize| flow(&frames[i % pairs][i / pairs], &frames[i % pairs + 1][i / pairs]);
    let mut all = par::map(SCALES.len() * pairs, pair).into_iter();
    std::array::from_fn(|_| all.by_ref().take(pairs).collect())
}

/// Mean of bytes as 16-bit fractions, rounded, in integers.
fn average(sums: &[u32], frames: usize) -> [Vec<u16>; 3] {
    let whole = 255 * frames as u64;
    std::array::from_fn(|c| {
        let mean = |pixel: &[u32]| ((u64::from(pixel[c]) * 65535 + whole / 2) / whole) as u16;
        sums.chunks_exact(3).map(mean).collect()
    })
}

impl Gathered {
    /// 1 where motion is significant, in working pixels.
    pub fn significance(&self, mask: Option<&Plane>) -> Plane {
        significance::mask(&self.scales[0].activity(), &self.deviation, mask)
    }

    /// The cells of every scale.
    pub fn reduce(self, mask: Option<&Plane>) -> Analysis {
        let significant = self.significance(mask);
        let grids = std::array::from_fn(|s| cells(&self.scales[s], &significant, SCALES[s]));
        let count: f32 = significant.data.iter().sum();
        let active = self.scales[0].activity();
        let activity: f32 = active.data.iter().zip(&significant.data).map(|(a, s)| a * s).sum();
        Analysis {
            frames: self.frames,
            average: self.average,
            grids,
            significant: count / significant.data.len() as f32,
            activity: activity / count.max(1.0),
        }
    }
}

/// Cells of one scale; `significant` is in working pixels.
fn cells(of: &Statistics, significant: &Plane, scale: f32) -> CellGrid {
    let (width, height) = (of.size().0 / CELL, of.size().1 / CELL);
    let side = CELL as f32 / scale;
    let cell = |i: usize| {
        let (cx, cy) = (i % width, i / width);
        let (x, y) = (CELL * cx, CELL * cy);
        let [u, v, length] = of.motion(x, y, CELL);
        let from = (cx as f32 * side, cy as f32 * side);
        let to = ((cx + 1) as f32 * side, (cy + 1) as f32 * side);
        Cell {
            mean: [u, v].map(f16::from_f32),
            spectrum: of.spectrum.cell(x, y, CELL).map(f16::from_f32),
            textureness: of.textureness[0].cell(x, y, CELL).map(f16::from_f32),
            activity: f16::from_f32(length),
            significant: f16::from_f32(significance::area_mean(significant, from, to)),
        }
    };
    CellGrid { width, height, cells: par::map(width * height, cell) }
}

/// TV-L1 motion with the library's settings, for frames of any size; workspaces are used again.
pub fn library_flow() -> impl Fn(&Plane, &Plane) -> Field + Sync {
    type Idle = Vec<((usize, usize), TvL1)>;
    fn lock(idle: &Mutex<Idle>) -> MutexGuard<'_, Idle> {
        idle.lock().unwrap_or_else(PoisonError::into_inner)
    }
    let idle = Mutex::new(Idle::new());
    move |from, to| {
        let size = (from.width, from.height);
        let found = {
            let mut idle = lock(&idle);
            idle.iter().position(|(s, _)| *s == size).map(|i| idle.swap_remove(i).1)
        };
        let mut solver = found.unwrap_or_else(|| TvL1::new(size.0, size.1, Params::library()));
        let mut field = Field::zeros(size.0, size.1);
        solver.flow(from, to, &mut field);
        lock(&idle).push((size, solver));
        field
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng;

    const SIZE: (usize, usize) = (96, 64);

    /// A smooth random texture at a continuous position.
    fn texture(x: f32, y: f32) -> f32 {
        let value = |x: i32, y: i32| rng::unit(rng::hash(9, &[x as u64, y as u64]));
        let (x, y) = (x / 3.0 + 100.0, y / 3.0 + 100.0);
        let (ax, ay) = (x.fract(), y.fract());
        let (x, y) = (x as i32, y as i32);
        let top = value(x, y) * (1.0 - ax) + value(x + 1, y) * ax;
        top * (1.0 - ay) + (value(x, y + 1) * (1.0 - ax) + value(x + 1, y + 1) * ax) * ay
    }

    fn frame(f: impl Fn(usize, usize) -> f32) -> Rgb8 {
        let mut frame = Rgb8::black(SIZE.0, SIZE.1);
        for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
            pixel.fill((255.0 * f(i % SIZE.0, i / SIZE.0)).round() as u8);
        }
        frame
    }

    /// A still texture whose right half moves by `shift(t)` since frame 0.
    fn clip(count: usize, shift: impl Fn(usize) -> f32) -> Vec<Rgb8> {
        let at = |t| {
            let shift = shift(t);
            frame(move |x, y| texture(x as f32 - if x < 48 { 0.0 } else { shift }, y as f32))
        };
        (0..count).map(at).collect()
    }

    fn run(clip: &[Rgb8], mask: Option<&Plane>) -> Analysis {
        let mut frames = clip.iter().cloned();
        analyse(&mut || Ok(frames.next()), SIZE, mask, &Silent, &mut |_| Ok(())).unwrap()
    }

    #[test]
    fn the_moving_half_is_significant_at_every_scale() {
        let analysis = run(&clip(48, |t| t as f32), None);
        for (grid, scale) in analysis.grids.iter().zip(SCALES) {
            let row = grid.height / 2;
            let (still, moving) = (grid.cells[row * grid.width + 2], grid.cells[row * grid.width + grid.width * 3 / 4]);
            assert!(still.significant.to_f32() == 0.0 && moving.significant.to_f32() == 1.0);
            let [u, v] = moving.mean.map(f16::to_f32);
            assert!((u - scale).abs() < 0.25 * scale && v.abs() < 0.15, "{u} {v} at {scale}");
            assert!(still.activity.to_f32() < 0.1);
        }
        assert!((analysis.significant - 0.5).abs() < 0.1 && analysis.activity > 0.6);
    }

    #[test]
    fn an_oscillation_has_no_mean_motion_but_is_significant_in_its_band() {
        let analysis = run(&clip(65, |t| 2.0 * (std::f32::consts::TAU * 3.0 * t as f32 / 32.0).sin()), None);
        let grid = &analysis.grids[0];
        let cell = grid.cells[grid.height / 2 * grid.width + grid.width * 3 / 4];
        assert!(cell.mean[0].to_f32().abs() < 0.1 && cell.significant.to_f32() == 1.0, "{cell:?}");
        let power = cell.spectrum.map(f16::to_f32);
        assert!((0..16).all(|band| band == 2 || power[band] < power[2]), "{power:?}");
    }

    #[test]
    fn the_user_mask_excludes() {
        let left = Plane::from_fn(SIZE.0, SIZE.1, |x, _| f32::from(u8::from(x < 48)));
        // Smoothing leaves a pixel or two of the moving half's rim on the allowed side.
        assert!(run(&clip(41, |t| t as f32), Some(&left)).significant < 0.04);
    }

    #[test]
    fn threads_change_nothing_and_the_sink_sees_all_frames_in_order() {
        let clip = clip(50, |t| 0.7 * t as f32);
        let on = |threads| {
            let mut seen = Vec::new();
            let mut frames = clip.iter().cloned();
            let work = || {
                let mut sink = |frame: &Rgb8| -> Result<()> {
                    seen.push(frame.clone());
                    Ok(())
                };
                analyse(&mut || Ok(frames.next()), SIZE, None, &Silent, &mut sink)
            };
            let analysis = par::with_threads(threads, work).unwrap().unwrap();
            assert_eq!(seen, clip);
            analysis
        };
        let (one, two) = (on(1), on(2));
        assert_eq!(one.average, two.average);
        for (a, b) in one.grids.iter().zip(&two.grids) {
            assert_eq!(bytemuck::cast_slice::<_, u8>(&a.cells), bytemuck::cast_slice::<_, u8>(&b.cells));
        }
    }

    #[test]
    fn a_mirrored_clip_gives_mirrored_grids() {
        let clip = clip(41, |t| 0.6 * t as f32);
        let mirror = |frame: &Rgb8| {
            let mut out = frame.clone();
            out.data.chunks_exact_mut(3 * SIZE.0).for_each(|row| row.as_chunks_mut::<3>().0.reverse());
            out
        };
        let (plain, mirrored) = (run(&clip, None), run(&clip.iter().map(mirror).collect::<Vec<_>>(), None));
        // Forward differences in the total variation are not quite symmetric, so motion agrees to hundredths of a pixel.
        let near = |a: f16, b: f16, by: f32| (a.to_f32() - b.to_f32()).abs() <= by * (1.0 + a.to_f32().abs());
        for (a, b) in plain.grids.iter().zip(&mirrored.grids) {
            for (i, cell) in a.cells.iter().enumerate() {
                let other = b.cells[i - i % a.width + a.width - 1 - i % a.width];
                let mean = near(cell.mean[0], -other.mean[0], 0.03) && near(cell.mean[1], other.mean[1], 0.03);
                let spectrum = cell.spectrum.iter().zip(other.spectrum).all(|(a, b)| near(*a, b, 0.03));
                assert!(mean && spectrum, "{cell:?} {other:?}");
                assert!(cell.textureness.iter().zip(other.textureness).all(|(a, b)| near(*a, b, 1e-3)));
            }
        }
    }

    #[test]
    fn the_average_is_exact() {
        let clip: Vec<_> = (0..41).map(|t| frame(|_, _| if t == 0 { 1.0 } else { 0.0 })).collect();
        let gathered = run(&clip, None);
        assert!(gathered.average.planes.iter().flatten().all(|&v| v == 1598), "65535 / 41 = 1598.4");
    }

    #[test]
    fn bad_clips_are_named() {
        let fails = |clip: Vec<Rgb8>, size| {
            let mut frames = clip.into_iter();
            analyse(&mut || Ok(frames.next()), size, None, &Silent, &mut |_| Ok(())).unwrap_err().to_string()
        };
        assert!(fails(clip(10, |_| 0.0), SIZE).contains("10 frames"));
        assert!(fails(Vec::new(), SIZE).contains("0 frames"));
        assert!(fails(vec![Rgb8::black(32, 32)], SIZE).contains("32 × 32"));
        assert!(fails(Vec::new(), (100, 64)).contains("multiples of 16"));
    }
}
