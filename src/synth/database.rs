//! The database method: motion borrowed piece by piece from a library (Okabe, Anjyo & Onai 2011).

use std::collections::BTreeSet;

use super::assignment_picture::{assignment_picture, colour};
use super::footage::{Clip, Stream, bands_of, frame_bytes};
use super::gate;
use super::maps::{Maps, maps};
use super::memory;
use super::outline::{self, Outline};
use super::pick::{self, Choice, LabelOptions, Labels};
use super::rates::{self, RATES};
use super::record::{AssignmentRecord, ClipShare, NodeRecord, RunRecord, Timed};
use super::{MethodEntry, Outcome, Sources, Synthesizer};
use crate::assign::candidates;
use crate::assign::nodes::NodeGrid;
use crate::assign::pair_costs::Weights;
use crate::assign::solve::{self, Solver};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, stage};
use crate::base::options::declare_options;
use crate::base::{par, rng};
use crate::flow::draw;
use crate::flow::field::Field;
use crate::library::grid::Cell;
use crate::library::tile::Tile;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::resample::resize;
use crate::render::appearance::{Appearance, Matching};
use crate::render::blend::Blender;
use crate::render::boundary::Boundary;
use crate::render::composite::Compositor;
use crate::render::contrast::{Strength, Variance, match_contrast};
use crate::render::drift::Travel;
use crate::render::layers::Layers;
use crate::render::layout::{Layout, LevelKey, PlacedCell, Placement};
use crate::render::recover::{AssignedMotion, Recovery, assigned_motion, make_room, recover};
use crate::scene::asked::Wish;
use crate::scene::scene::{Scene, Still};
use crate::video::clip::Sink;

/// Frames that appearance matching learns from.
const MATCHED: usize = 8;

declare_options! {
    /// Options of the database method.
    pub struct Options named "database" {
        /// Candidates per node; more is slower.
        candidates: usize = 100, in 1, 1000, "pieces", "Okabe 2011, §5.1";
        /// Most candidates from one place of one clip; 0 is no limit.
        per_place: usize = 0, in 0, 1000, "pieces", "methods §1.6";
        /// Weight of the motion spectrum against the mean motion, between neighbours.
        sigma: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 3";
        /// Weight of the textureness between neighbours.
        rho: f32 = 1.0, in 0, 100, "ratio", "Okabe 2011, Eq. 2";
        /// Weight of the smoothness term against the data term.
        lambda: f32 = 0.06, in 0, 10, "ratio", "Okabe 2011, §5.3";
        /// Weight of how rough picture and piece are, as part of the data term.
        texture: f32 = 0.1, in 0, 10, "ratio", "methods §1.6";
        /// Weight of how slowly a piece changes, as part of the data term: 0 takes quiet pieces for wild water as well.
        lively: f32 = 0.2, in 0, 10, "ratio", "methods §1.6";
        /// Weight of the share of a piece that stands still where the picture's fluid should move.
        still: f32 = 0.2, in 0, 10, "ratio", "methods §1.1";
        /// Weight of half the angle's versine between a piece's motion and the asked direction, as part of the data term.
        direction: f32 = 0.4, in 0, 10, "ratio", "Okabe 2011, §5";
        /// Weight of every octave by which a piece is too slow or too fast for the asked speed, beyond what playback mends.
        speed: f32 = 0.1, in 0, 10, "ratio", "methods §1.6";
        /// How the energy is minimised: messages and then moves, one of them alone; "expansion" is the paper's.
        solver: Solver = Solver::Dual, in 0, 2, "", "Okabe 2011, §5.3";
        /// Most sweeps of messages, and most rounds of moves; both end sooner when nothing changes.
        sweeps: usize = 100, in 0, 10000, "sweeps", "Kolmogorov 2006";
        /// Exposure of the recovered average image: a streak is this many frames of motion long.
        shutter: f32 = 6.0, in 0, 100, "frames", "Okabe 2011, §6";
        /// Width of the Gaussian in the recovered average image, per speed.
        blur: f32 = 0.5, in 0, 10, "frames", "Okabe 2011, §6";
        /// Share of the recovered average image; the rest keeps the picture's own detail, still.
        recovery: f32 = 0.8, in 0, 1, "ratio", "methods §1.6";
        /// Contrast of the motion relative to the contrast of the picture.
        strength: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Largest factor on a clip's differences; more lifts its noise.
        max_gain: f32 = 3.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
        /// Factor of the coarse bands of the differences, where swell, changing light and large flames live.
        coarse: f32 = 1.5, in 0, 4, "ratio", "methods §1.6";
        /// Share of the way to the picture's own distribution of detail that frames are brought, place by place.
        appearance: f32 = 0.5, in 0, 1, "ratio", "Heeger & Bergen 1995";
        /// Side of the places.
        regions: usize = 96, in 24, 10000, "pixels", "Okabe 2011, §6";
        /// Largest factor on the detail of frames on that way.
        appearance_gain: f32 = 2.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
        /// How far the outline lets go of the matte, as fire and smoke do: 0 not at all, 0.9 much; -1 takes 0.9 where most
        /// pieces come from clips tagged fire or smoke, else 0.
        tau: f32 = -1.0, in -1, 0.98, "ratio", "Okabe 2011, §6";
        /// How much an outline that moves opens and closes with the bright and dark of the fluid in it.
        flicker: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Detail finer than a working pixel travels with the flow where the output is larger; false keeps it in place.
        drift: bool = true, in 0, 1, "switch", "methods §2.4";
        /// Phases of its loop that a clip is used at; more keeps copies from moving in unison, and is slower.
        phases: usize = 1, in 1, 8, "phases", "methods §1.5";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "database",
    summary: "borrows motion piece by piece from a library of clips",
    citation: "Okabe, Anjyo & Onai, \"Creating Fluid Animation from a Single Image using Video Database\", CGF 30(7), 2011",
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.checked()?.to_table()),
    build: |table| Ok(Box::new(Database { options: Options::from_table(table)?.checked()?, random: false })),
};

impl Options {
    /// What a range alone cannot say.
    fn checked(self) -> Result<Self> {
        if self.tau < 0.0 && self.tau != -1.0 {
            return Err(Error::new(Kind::Usage, "database.tau", format!("{} is out of range", self.tau))
                .allowed("0 to 0.98, or -1 for what the clips' fluid wants"));
        }
        Ok(self)
    }
}

/// The method with its options.
pub struct Database {
    options: Options,
    random: bool,
}

/// Pieces in their places, and where they come from.
struct Placed {
    layout: Layout,
    /// Per placement: the piece.
    choices: Vec<Choice>,
    /// What is asked of each.
    wishes: Vec<Wish>,
    /// Every clip that is used, at every rate it is used at.
    clips: Vec<Footage>,
    /// Per source of the layout: its clip, as a number within `clips`, and its phase.
    sources: Vec<(usize, usize)>,
}

/// A clip at a rate of playback.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Footage {
    pack: usize,
    clip: u32,
    /// Number of the rate in [`RATES`].
    rate: usize,
}

/// The picture taken apart, for an outline that moves or fluid alone.
struct Apart {
    layers: Layers,
    /// The background that was made, where none was given.
    made: Option<Rgb8>,
    /// How far the outline lets go of the matte.
    tau: f32,
}

/// What frames should look like, and what they start from; planes at working size.
struct Target {
    matching: Matching,
    /// Luma of the picture's fluid.
    picture: Plane,
    /// Luma of the recovered average.
    base: Plane,
    matte: Plane,
}

impl Target {
    /// The curves that bring frames of the loop to the picture, where that is wanted.
    fn learn(
        &self,
        blender: &Blender,
        streams: &[Stream],
        frames: usize,
        observer: &Timed,
    ) -> Result<Option<Appearance>> {
        if self.matching.amount == 0.0 {
            return Ok(None);
        }
        let count = MATCHED.min(frames);
        let sample = |t: usize| Ok(blender.frame(&bands_of(streams, t..t + 1, observer)?[0]));
        let samples = (0..count).map(|i| sample(i * frames / count)).collect::<Result<Vec<_>>>()?;
        Ok(Some(Appearance::learn(&self.picture, &self.base, &self.matte, &samples, &self.matching)))
    }
}

/// Everything about the frames that does not change with time.
struct Rendering {
    motion: AssignedMotion,
    blender: Blender,
    /// What frames are matched to.
    target: Target,
    compositor: Compositor,
    /// The outline before the first frame, and how many frames before it has to be followed from.
    outline: Outline,
    run_in: usize,
    /// The background that was made for this picture.
    background: Option<Rgb8>,
}

impl Synthesizer for Database {
    fn synthesize(&self, scene: &Scene, sources: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        check_sources(sources)?;
        let still = stage(observer, "read picture", 0, || scene.still(observer))?;
        let grid = NodeGrid::over(&still.working_matte, 0.02)?;
        let wishes = gate::wishes(&grid, &still);
        let candidates = pick::candidates(&grid, &still, &wishes, sources, scene, &self.search(), observer)?;
        memory::check(scene)?;
        let labels = match self.random {
            true => pick::random_labels(&candidates, scene.settings().output.seed),
            false => pick::labels(&grid, &still, &wishes, &candidates, sources, &self.labelling(scene), observer)?,
        };
        let placed = self.place(&grid, &labels.choices, wishes, &still, sources, scene)?;
        let clips = study(&placed, scene, sources, observer)?;
        // A library cut short by somebody else while it is mapped must not be read any further.
        sources.packs.iter().try_for_each(|(_, pack)| pack.check_length())?;
        let layers = self.separate(&placed, &still, sources, scene, observer)?;
        let mut rendering = stage(observer, "prepare", 0, || self.prepare(&placed, &clips, &still, layers))?;
        if self.options.drift {
            let output = scene.settings().output;
            let pace = sources.packs[0].1.parameters().rate as f32 / output.fps;
            let travel = Travel { motion: &rendering.motion.mean, pace, frames: output.frames, fps: output.fps };
            rendering.compositor = rendering.compositor.drifting(&still.working, &travel);
        }
        frames(&placed, &clips, &rendering, scene, sink, observer)?;
        let mut outcome = outcome(&placed, &clips, &rendering, &labels, &still, sources, scene)?;
        outcome.record.assignment.iter_mut().for_each(|a| a.widened = candidates.widened);
        Ok(outcome)
    }
}

impl Database {
    /// The method with a random candidate at every node: what the labels are worth is measured against it.
    ///
    /// # Errors
    /// Options that do not go together.
    pub fn with_random_labels(options: Options) -> Result<Self> {
        Ok(Self { options: options.checked()?, random: true })
    }

    fn search(&self) -> candidates::Options {
        candidates::Options { count: self.options.candidates, per_place: self.options.per_place }
    }

    fn labelling(&self, scene: &Scene) -> LabelOptions {
        let Options { sigma, rho, lambda, texture, still, lively, direction, speed, solver, sweeps, .. } = self.options;
        let solver = solve::Options { solver, sweeps };
        let (weights, fps) = (Weights { sigma, rho }, scene.settings().output.fps);
        LabelOptions { weights, lambda, texture, still, lively, direction, speed, fps, solver }
    }

    /// Puts the chosen pieces onto their nodes, played as fast as is asked.
    fn place(
        &self,
        grid: &NodeGrid,
        choices: &[Choice],
        wishes: Vec<Wish>,
        still: &Still,
        sources: &Sources,
        scene: &Scene,
    ) -> Result<Placed> {
        let pack = |c: &Choice| &sources.packs[c.pack].1;
        let pieces = choices.iter().map(|c| pack(c).piece(c.piece)).collect::<Result<Vec<_>>>()?;
        let tiles = par::try_map(choices.len(), |i| pack(&choices[i]).tile(choices[i].piece))?;
        let owners: Vec<(usize, u32)> = choices.iter().zip(&pieces).map(|(c, p)| (c.pack, p.clip)).collect();
        let clips: Vec<(usize, u32)> = BTreeSet::from_iter(owners.iter().copied()).into_iter().collect();
        let size = |&(pack, clip): &(usize, u32)| {
            let meta = &sources.packs[pack].1.clips()[clip as usize];
            (meta.width as usize, meta.height as usize)
        };
        let place = |i: usize| Placement {
            node: (grid.nodes[i].x as usize, grid.nodes[i].y as usize),
            source: clips.partition_point(|c| *c < owners[i]),
            variant: pieces[i].variant(),
            piece: (pieces[i].x as usize, pieces[i].y as usize),
            cells: placed_cells(&tiles[i]),
        };
        let mut layout = Layout {
            canvas: still.map.working,
            sources: clips.iter().map(size).collect(),
            placements: (0..choices.len()).map(place).collect(),
        };
        let pace = |i: usize| sources.packs[choices[i].pack].1.parameters().rate as f32 / scene.settings().output.fps;
        let rates = rates::choose(&layout, &wishes, |i| pace(i) * layout.placements[i].motion().1);
        let clips = play_at(&mut layout, &rates, &clips);
        let phases = spread_phases(&mut layout, self.options.phases, scene.settings().output.seed);
        Ok(Placed { layout, choices: choices.to_vec(), wishes, clips, sources: phases })
    }

    /// Takes the picture apart where the outline moves or the fluid is wanted alone.
    fn separate(
        &self,
        placed: &Placed,
        still: &Still,
        sources: &Sources,
        scene: &Scene,
        observer: &Timed,
    ) -> Result<Option<Apart>> {
        let tag = |choice: &Choice| {
            let pack = &sources.packs[choice.pack].1;
            Ok(pack.clips()[pack.piece(choice.piece)?.clip as usize].tag.as_str())
        };
        let tags = placed.choices.iter().map(tag).collect::<Result<Vec<_>>>()?;
        // The option is meant for the library's rate: an outline must not stray farther where frames are fewer.
        let per_frame = 25.0 / scene.settings().output.fps;
        let tau = outline::looseness(self.options.tau, still, &tags, observer).powf(per_frame);
        if tau > 0.0 || scene.settings().output.alpha {
            let (layers, made) = outline::separate(still, observer)?;
            return Ok(Some(Apart { layers, made, tau }));
        }
        if still.background.is_some() {
            observer.note("the outline does not move, so the background is not seen (database.tau = 0)");
        }
        Ok(None)
    }

    fn matching(&self) -> Matching {
        let Options { appearance: amount, regions: region, appearance_gain: max_gain, .. } = self.options;
        Matching { amount, region, max_gain }
    }

    /// Weights, gains, recovered image: what all frames share.
    fn prepare(&self, placed: &Placed, clips: &[Clip], still: &Still, apart: Option<Apart>) -> Result<Rendering> {
        let Options { shutter, blur, recovery: amount, strength, max_gain, coarse, .. } = self.options;
        let variance = |key: &LevelKey| {
            let clip = &clips[placed.sources[key.source].0];
            clip.variance(key.scale).expect("a clip is studied at every scale it is used at")
        };
        let variances: Vec<&Variance> = placed.layout.levels().iter().map(variance).collect();
        let strength = Strength { strength, max_gain, coarse };
        let luma = still.working.luma();
        let matched = match_contrast(&placed.layout, &variances, &luma, &still.working_matte, &strength);
        let motion = assigned_motion(&placed.layout);
        // Before a background the fluid is recovered wherever it may come, from its own colours.
        let (fluid, matte) = match &apart {
            Some(Apart { layers, .. }) => (&layers.fluid, &layers.reach),
            None => (&still.working, &still.working_matte),
        };
        let recovery = Recovery { shutter, blur, amount };
        let recovered = recover(fluid, matte, &motion, &recovery);
        let shares = std::array::from_fn(|band| placed.layout.spread(|i| matched.shares[i][band]));
        let recovered = make_room(&recovered, fluid, matte, &shares);
        let blender = Blender::new(&placed.layout, &matched.gains);
        let target = Target {
            matching: self.matching(),
            picture: fluid.luma(),
            base: recovered.luma(),
            matte: still.working_matte.clone(),
        };
        let picture = still.picture.clone();
        Ok(match apart {
            None => {
                let outline = Outline::fixed(&still.working_matte);
                let compositor =
                    Compositor::new(picture, &still.matte, &still.working, &still.working_matte, &recovered);
                Rendering { motion, blender, target, compositor, outline, run_in: 0, background: None }
            }
            Some(Apart { layers, made, tau }) => {
                let outline = Outline::new(&layers, &recovered.luma(), tau, self.options.flicker);
                let compositor = Compositor::layered(picture, &still.matte, &still.working, &layers, &recovered);
                let run_in = Boundary::run_in(tau);
                Rendering { motion, blender, target, compositor, outline, run_in, background: made }
            }
        })
    }
}

fn check_sources(sources: &Sources) -> Result<()> {
    if sources.packs.is_empty() {
        return Err(Error::new(Kind::Usage, "library", "the database method needs a library")
            .remedy("build one with `enliven-db build CLIPS -o NAME.pack`, and name it with --library NAME.pack"));
    }
    Ok(())
}

fn placed_cells(tile: &Tile) -> Vec<PlacedCell> {
    let cell = |c: &Cell| PlacedCell {
        mean: (c.mean[0].to_f32(), c.mean[1].to_f32()),
        activity: c.activity.to_f32(),
        significant: c.significant.to_f32(),
    };
    tile.cells.iter().map(cell).collect()
}

/// Plays every placement at its rate: its motion grows with it, and the layout's sources become clips at rates.
fn play_at(layout: &mut Layout, rates: &[usize], clips: &[(usize, u32)]) -> Vec<Footage> {
    for (placement, &rate) in layout.placements.iter_mut().zip(rates) {
        for cell in &mut placement.cells {
            cell.mean = (RATES[rate] * cell.mean.0, RATES[rate] * cell.mean.1);
            cell.activity *= RATES[rate];
        }
    }
    let sources = split_sources(layout, rates.to_vec());
    sources.iter().map(|&(source, rate)| Footage { pack: clips[source].0, clip: clips[source].1, rate }).collect()
}

/// Splits the sources of a layout by a property of the placements; the new sources, in order, as (old source, property).
fn split_sources(layout: &mut Layout, property: Vec<usize>) -> Vec<(usize, usize)> {
    let keys: Vec<_> = layout.placements.iter().map(|p| p.source).zip(property).collect();
    let sources: Vec<_> = BTreeSet::from_iter(keys.iter().copied()).into_iter().collect();
    layout.sources = sources.iter().map(|&(source, _)| layout.sources[source]).collect();
    for (placement, key) in layout.placements.iter_mut().zip(&keys) {
        placement.source = sources.partition_point(|s| s < key);
    }
    sources
}

/// Gives every stretch of continuous footage one of `phases` phases of its clip's loop, so that two copies of a place
/// do not move in unison; the layout's sources become clips at phases, which are returned as (clip, phase).
fn spread_phases(layout: &mut Layout, phases: usize, seed: u64) -> Vec<(usize, usize)> {
    let groups = layout.groups();
    let phase = |group: usize| rng::below(rng::hash(seed, &[group as u64]), phases as u64) as usize;
    let chosen = groups.iter().map(|&group| phase(group)).collect();
    split_sources(layout, chosen)
}

/// Finds the loop of every clip that is used, and how strong its differences are.
fn study(placed: &Placed, scene: &Scene, sources: &Sources, observer: &Timed) -> Result<Vec<Clip>> {
    let output = scene.settings().output;
    let levels = placed.layout.levels();
    stage(observer, "loops", placed.clips.len() as u64, || {
        par::try_map(placed.clips.len(), |i| {
            let Footage { pack, clip, rate } = placed.clips[i];
            let pack = &sources.packs[pack].1;
            // As many library frames as the output lasts at this rate, so that water falls as fast at any frame rate.
            let seconds = RATES[rate] * output.frames as f32 / output.fps;
            let frames = ((seconds * pack.parameters().rate as f32).round() as usize).max(2);
            let used = levels.iter().filter(|l| placed.sources[l.source].0 == i).map(|l| l.scale);
            let scales = BTreeSet::from_iter(used).into_iter().collect();
            let clip = Clip::study(pack, clip, scales, frames, observer);
            observer.advance("loops", 1);
            clip
        })
    })
}

/// Makes the frames in blocks: the clips of a block are decoded in parallel, then its differences are blended in
/// parallel, while the frames of the block before are put together and written. An outline that moves is followed
/// through some frames of the loop before the first one that is written.
fn frames(
    placed: &Placed,
    clips: &[Clip],
    rendering: &Rendering,
    scene: &Scene,
    sink: &mut dyn Sink,
    observer: &Timed,
) -> Result<()> {
    let (output, wanted) = (scene.settings().output, scene.wanted_frames());
    let phases = placed.sources.iter().map(|s| s.1).max().unwrap_or(0) + 1;
    let levels = rendering.blender.levels();
    let stream = |(source, &(clip, phase)): (usize, &(usize, usize))| {
        let scales = levels.iter().filter(|l| l.source == source).map(|l| l.scale).collect();
        Stream::new(&clips[clip], stagger(clip) + phase as f64 / phases as f64, output.frames, scales)
    };
    let streams = placed.sources.iter().enumerate().map(stream).collect::<Result<Vec<_>>>()?;
    let block = memory::block_frames(scene, frame_bytes(&streams))?;
    // Streams repeat, so the frames before the first are those that far before the end of a later round. A part of the
    // loop follows an outline that moves from the same frame on.
    let first = rendering.run_in.next_multiple_of(output.frames);
    let start = if rendering.run_in == 0 { first + wanted.start } else { first - rendering.run_in };
    let (first, end) = (first + wanted.start, first + wanted.end);
    let matched = stage(observer, "appearance", 0, || {
        rendering.target.learn(&rendering.blender, &streams, output.frames, observer)
    })?;
    let make = |b: usize| {
        let range = start + b * block..(start + (b + 1) * block).min(end);
        let levels = bands_of(&streams, range, observer)?;
        let blended = |i: usize| rendering.blender.frame(&levels[i]);
        Ok(par::map(levels.len(), |i| matched.as_ref().map_or_else(|| blended(i), |m| m.apply(&blended(i)))))
    };
    let mut outline = rendering.outline.clone();
    let mut writer = Writer { compositor: &rendering.compositor, alpha: output.alpha, sink, observer };
    stage(observer, "frames", wanted.len() as u64, || {
        par::ordered_map(0..(end - start).div_ceil(block), 2, make, |b, differences: Vec<Plane>| {
            observe::check(observer)?;
            let outlines = outline.follow(&differences);
            let before = (first - start).saturating_sub(b * block).min(differences.len());
            let t = (start + b * block + before) % output.frames;
            writer.write(t, &differences[before..], &outlines[before..])
        })
    })
}

/// Puts frames together and hands them on.
struct Writer<'a> {
    compositor: &'a Compositor,
    alpha: bool,
    sink: &'a mut dyn Sink,
    observer: &'a Timed<'a>,
}

impl Writer<'_> {
    /// Writes the frames from `t` on, given as luma differences and outlines; one is made while the one before is written.
    fn write(&mut self, t: usize, differences: &[Plane], outlines: &[Plane]) -> Result<()> {
        let (compositor, alpha, observer) = (self.compositor, self.alpha, self.observer);
        let make = |i: usize| {
            Ok(if alpha {
                let (fluid, opacity) = compositor.fluid(t + i, &differences[i], &outlines[i]);
                (fluid, Some(opacity))
            } else {
                (compositor.frame(t + i, &differences[i], &outlines[i]), None)
            })
        };
        par::ordered_map(0..differences.len(), 2, make, |_, (frame, opacity)| {
            observe::check(observer)?;
            match opacity {
                Some(opacity) => self.sink.push_with_alpha(&frame, &opacity)?,
                None => self.sink.push(&frame)?,
            }
            observer.advance("frames", 1);
            Ok(())
        })
    }
}

/// Phase of the loop at which the `clip`th clip begins, spread evenly however many there are (multiples of the golden
/// ratio): with all loops closing at the same frame, their fades would be seen as one.
fn stagger(clip: usize) -> f64 {
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    (clip as f64 * GOLDEN).fract()
}

fn outcome(
    placed: &Placed,
    clips: &[Clip],
    rendering: &Rendering,
    labels: &Labels,
    still: &Still,
    sources: &Sources,
    scene: &Scene,
) -> Result<Outcome> {
    let clip_of: Vec<usize> = placed.layout.placements.iter().map(|p| placed.sources[p.source].0).collect();
    let assignment = assignment(placed, clips, &clip_of, labels, sources, scene.settings().output.fps)?;
    let picture = assignment_picture(&still.working.luma(), &still.working_matte, &placed.layout, &clip_of);
    let motion = &rendering.motion;
    let full = |plane: &Plane| resize(plane, still.map.working.0, still.map.working.1);
    let field = Field { u: full(&motion.mean.u), v: full(&motion.mean.v) };
    // The rate of the library is a constant of the program that built it; several libraries have the same.
    let pace = sources.packs[0].1.parameters().rate as f32 / scene.settings().output.fps;
    let Maps { mut pictures, max_speed } = maps(motion, pace, still.asked.as_ref(), &still.map);
    pictures.extend(rendering.background.iter().map(|made| ("background", made.clone())));
    pictures.extend([("assignment", picture), ("motion", draw::colour(&field, 0.0))]);
    let record = RunRecord { assignment: Some(assignment), max_speed: Some(max_speed), ..RunRecord::default() };
    Ok(Outcome { record, pictures })
}

fn assignment(
    placed: &Placed,
    clips: &[Clip],
    clip_of: &[usize],
    labels: &Labels,
    sources: &Sources,
    fps: f32,
) -> Result<AssignmentRecord> {
    let share = |(i, &Footage { pack: library, clip, rate }): (usize, &Footage)| {
        let meta = &sources.packs[library].1.clips()[clip as usize];
        let nodes = clip_of.iter().filter(|&&c| c == i).count();
        let segment = clips[i].plan.segments().into_iter().max().unwrap_or(0);
        ClipShare {
            library,
            clip: meta.id.to_string(),
            tag: meta.tag.clone(),
            colour: colour(i),
            nodes,
            share: nodes as f64 / clip_of.len() as f64,
            rate: RATES[rate],
            loop_frames: (clips[i].plan.start(), clips[i].plan.start() + segment),
        }
    };
    let mut shares: Vec<ClipShare> = placed.clips.iter().enumerate().map(share).collect();
    shares.sort_by(|a, b| b.nodes.cmp(&a.nodes).then_with(|| a.clip.cmp(&b.clip)));
    let node = |i: usize| {
        let (placement, choice, wish) = (&placed.layout.placements[i], &placed.choices[i], &placed.wishes[i]);
        let pack = &sources.packs[choice.pack].1;
        let pace = pack.parameters().rate as f32 / fps;
        let (mean, activity) = placement.motion();
        Ok(NodeRecord {
            x: placement.node.0,
            y: placement.node.1,
            library: choice.pack,
            piece: pack.piece_ref(choice.piece)?,
            motion: (pace * mean.0, pace * mean.1),
            activity: pace * activity,
            rate: RATES[placed.clips[clip_of[i]].rate],
            asked: wish.direction,
            asked_speed: wish.speed,
        })
    };
    let solution = &labels.solution;
    Ok(AssignmentRecord {
        energy: solution.energy,
        data_only_energy: solution.history[0],
        data_energy: labels.data_energy,
        bound: solution.bound,
        gap: solution.gap(),
        history: solution.history.clone(),
        bounds: solution.bounds.clone(),
        widened: 0,
        clips: shares,
        nodes: (0..placed.choices.len()).map(node).collect::<Result<_>>()?,
    })
}
