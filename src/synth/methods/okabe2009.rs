//! One video's residuals, carried along the user's flow (Okabe, Anjyo, Igarashi & Seidel 2009): the forerunner of the
//! database method.
//!
//! A clip is split into its average image, its mean flow and residuals in the frame that moves with the flow. Squares of
//! residuals go to places of the picture that should move alike, turned to the direction that is asked there; they are
//! added up and carried along the asked flow, over the picture's own average image.

use std::borrow::Cow;

use crate::assign::nodes::NodeGrid;
use crate::assign::turned::{self, Choice, Features, Turned, Weights};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer, stage};
use crate::base::options::declare_options;
use crate::base::par;
use crate::flow::along_streaks::{Turning, along_streaks};
use crate::flow::draw;
use crate::flow::field::Field;
use crate::flow::mean_motion::MeanMotion;
use crate::library::variant::CELL;
use crate::raster::filter::gaussian;
use crate::raster::image::{Color, Plane};
use crate::raster::resample::resize;
use crate::render::appearance::{Appearance, Matching, Sample, spread};
use crate::render::band_gains::{BandGains, mean_squares};
use crate::render::carry::inside;
use crate::render::composite::Compositor;
use crate::render::contrast::{FINE, Strength};
use crate::render::drift::Travel;
use crate::render::layout::BANDS;
use crate::render::patchwork::Patchwork;
use crate::render::recover::{AssignedMotion, Recovery, make_room, recover};
use crate::render::residuals::{Packed, Residuals};
use crate::render::transport::{Inflow, Transport};
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::synth::exemplar::differences::Differences;
use crate::synth::maps::{self, Maps, maps};
use crate::synth::memory;
use crate::synth::method::{MethodEntry, Outcome, Sources, Synthesizer};
use crate::synth::record::{RunRecord, SynthesisRecord, Timed};
use crate::synth::separation::{Separation, compositor};
use crate::synth::writing;
use crate::video::clip::Sink;

/// Frames that contrast is measured on.
const SAMPLES: usize = 12;
/// Frames that appearance matching learns from.
const MATCHED: usize = 8;
/// Window over which the share of a band that moves is measured, pixels of the clip.
const WINDOW: f32 = 20.0;

declare_options! {
    /// Options of the method.
    pub struct Options named "okabe2009" {
        /// Share of the way that the asked flow is turned towards the picture's streaks, where these are sure.
        refine: f32 = 0.5, in 0, 1, "ratio", "Okabe 2009; ours";
        /// Streaks farther from the asked direction than this are none of the flow's.
        refine_angle: f32 = 40.0, in 1, 90, "degrees", "ours";
        /// Weight of how unlike the clip's speed is to the one asked for, where a piece of it is chosen.
        speed: f32 = 0.5, in 0, 10, "ratio", "Okabe 2009; ours";
        /// Weight of how unlike its texture is to the picture's.
        texture: f32 = 1.0, in 0, 10, "ratio", "Okabe 2009; ours";
        /// Weight of the share of its contrast that stands still.
        still: f32 = 0.5, in 0, 10, "ratio", "ours";
        /// Weight of pieces that do not continue their neighbours.
        smooth: f32 = 0.2, in 0, 10, "ratio", "ours";
        /// Weight of places that are shown elsewhere as well.
        repeat: f32 = 0.3, in 0, 10, "ratio", "ours";
        /// Phases of its loop that the clip is used at: more keeps copies from moving in unison.
        phases: usize = 4, in 1, 16, "phases", "ours";
        /// Long side of the clip; 0 is that of the working image. It is never enlarged.
        exemplar_size: usize = 0, in 0, 4096, "pixels", "ours";
        /// Exposure of the average image: a streak is this many frames of motion long.
        shutter: f32 = 6.0, in 0, 100, "frames", "Okabe 2011, §6";
        /// Width of the Gaussian in the average image, per speed.
        blur: f32 = 0.5, in 0, 10, "frames", "Okabe 2011, §6";
        /// Share of the average image; the rest keeps the picture's own detail, still.
        recovery: f32 = 0.8, in 0, 1, "ratio", "methods §1.6";
        /// Contrast of what moves relative to the picture's.
        strength: f32 = 1.0, in 0, 4, "ratio", "methods §1.5";
        /// Largest factor on the clip's differences; more lifts its noise.
        max_gain: f32 = 3.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
        /// Factor of the coarse bands, where changing light lives.
        coarse: f32 = 1.0, in 0, 4, "ratio", "methods §1.6";
        /// Share of the way to the picture's own distribution of detail that frames are brought, place by place.
        appearance: f32 = 0.5, in 0, 1, "ratio", "Heeger & Bergen 1995";
        /// Side of the places.
        regions: usize = 96, in 24, 10000, "pixels", "Okabe 2011, §6";
        /// Largest factor on the detail of frames on that way.
        appearance_gain: f32 = 2.0, in 1, 20, "ratio", "Okabe 2011, Fig. 13";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "okabe2009",
    summary: "carries what changes in one clip along the motion that is asked for; needs strokes or a direction",
    citation: "Okabe, Anjyo, Igarashi & Seidel, \"Animating Pictures of Fluid using Video Examples\", CGF 28(2), 2009",
    library: false,
    exemplars: 1,
    designed: false,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.to_table()),
    preview: |_| {},
    build: |table| Ok(Box::new(Okabe2009 { options: Options::from_table(table)? })),
};

struct Okabe2009 {
    options: Options,
}

/// What every stage of a run looks at.
#[derive(Clone, Copy)]
struct Run<'a> {
    options: &'a Options,
    scene: &'a Scene,
    still: &'a Still,
    /// The refined flow, working pixels per frame; outside the fluid as it is beside.
    flow: &'a Field,
    observer: &'a Timed<'a>,
}

/// A clip taken apart.
struct TakenApart {
    differences: Differences,
    /// Mean squares of its bands: of what moves, and of what is seen.
    squares: [Vec<Plane>; 2],
    motion: MeanMotion,
    residuals: Residuals,
}

impl Synthesizer for Okabe2009 {
    fn synthesize(&self, scene: &Scene, _: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        let still = stage(observer, "read picture", 0, || scene.still(observer))?;
        let target = Target::of(scene, &still)?;
        target.note(observer);
        let asked = target.flow(0)?;
        let flow = refined(&self.options, &still, &asked);
        let run = Run { options: &self.options, scene, still: &still, flow: &flow, observer };
        let clip = take_apart(&run)?;
        let size = clip.differences.size();
        let grid = NodeGrid::over(&still.working_matte, 0.02)?;
        let footage = choose(&run, &grid, &clip)?;
        let patchwork = Patchwork::new(still.map.working, &grid, &footage);
        let moving = moving(&clip.squares, &patchwork);
        let made = carry(&run, &clip.residuals, &patchwork)?;
        drop(clip);
        let (compositor, shown) = finish(&run, made, &moving)?;
        writing::show(scene, &compositor, &still.working_matte, |t| Cow::Owned(shown[t].unpacked()), sink, observer)?;
        Ok(outcome(&still, flow, size))
    }
}

/// The asked flow along the picture's streaks, continued outside the fluid.
fn refined(options: &Options, still: &Still, asked: &Field) -> Field {
    let turning = Turning { amount: options.refine, reach: options.refine_angle.to_radians() };
    inside(&along_streaks(asked, &still.working.luma(), &still.working_matte, &turning), &still.working_matte)
}

/// Reads the clip, and splits it into average image, mean flow and residuals.
fn take_apart(run: &Run) -> Result<TakenApart> {
    let Run { scene, still, observer, options, .. } = *run;
    let (width, height) = still.map.working;
    let frames = scene.settings().output.length();
    let long_side = if options.exemplar_size == 0 { width.max(height) } else { options.exemplar_size };
    let kept = (frames * Packed::bytes(width * height)) as u64;
    let room = memory::room(scene, kept)?;
    let differences =
        stage(observer, "exemplar", 0, || Differences::of(scene, ENTRY.name, (long_side, frames), room, observer))?;
    let size = differences.size();
    memory::room(scene, kept + differences.bytes() + (frames * Packed::bytes(size.0 * size.1)) as u64)?;
    let count = differences.count();
    let motion = stage(observer, "motion", MeanMotion::pairs(count) as u64, || {
        MeanMotion::of(count, |t| differences.frame(t), "motion", observer)
    })?;
    let transport = Transport::along(&motion.mean, Inflow::Border);
    let residuals = stage(observer, "residuals", frames as u64, || {
        Residuals::of(frames, |t| differences.at(t), &transport, "residuals", observer)
    })?;
    Ok(TakenApart { squares: squares(&differences), differences, motion, residuals })
}

/// Mean squares of the bands of a clip, at its size: of what moves, and of what is seen.
fn squares(differences: &Differences) -> [Vec<Plane>; 2] {
    let moving = par::map(SAMPLES, |i| differences.at(i * differences.length() / SAMPLES));
    let seen: Vec<Plane> = moving.iter().map(|d| differences.seen(d.clone())).collect();
    [moving, seen].map(|planes| sized(&mean_squares(&planes), differences.size()))
}

fn sized(planes: &[Plane], (width, height): (usize, usize)) -> Vec<Plane> {
    planes.iter().map(|p| resize(p, width, height)).collect()
}

/// Which piece of the clip goes where.
fn choose(run: &Run, grid: &NodeGrid, clip: &TakenApart) -> Result<Vec<Turned>> {
    let Run { options, scene, still, flow, .. } = *run;
    let (matte, luma) = (&still.working_matte, spread(&still.working.luma(), &still.working_matte));
    let seen = sized(&mean_squares(&[luma]), still.map.working);
    let picture = Features::new([&flow.u, &flow.v], &flow.magnitude(), (&seen, &seen), matte);
    let size = clip.differences.size();
    let everywhere = Plane::filled(size.0, size.1, 1.0);
    let ([moving, seen], mean) = (&clip.squares, &clip.motion.mean);
    let features = Features::new([&mean.u, &mean.v], &clip.motion.activity, (moving, seen), &everywhere);
    let &Options { speed, texture, still: stands, smooth, repeat, .. } = options;
    let weights = Weights { speed, texture, still: stands, smooth, repeat };
    let choice = Choice { clip: size, phases: options.phases, seed: scene.settings().output.seed };
    turned::choose(grid, &picture, &features, &weights, &choice).ok_or_else(|| {
        Error::new(Kind::Unusable, "exemplar", "nothing in the clip moves enough to be seen")
            .remedy("name another clip")
    })
}

/// Share of the clip's contrast that moves, band by band, where its pieces lie on the picture.
fn moving([moving, seen]: &[Vec<Plane>; 2], patchwork: &Patchwork) -> [Plane; BANDS] {
    std::array::from_fn(|k| {
        let [moving, seen] = [&moving[k], &seen[k]].map(|s| gaussian(s, WINDOW));
        let pairs = moving.data.iter().zip(&seen.data);
        let share = pairs.map(|(m, s)| (m.max(0.0) / s.max(1e-9)).min(1.0).sqrt()).collect();
        patchwork.quantity(&Plane::from_vec(moving.width, moving.height, share))
    })
}

/// Adds the residuals up along the flow: `D′_t = ρ W′(D′_{t−1}) + R′_t`. Residuals go round, so what is left of the first
/// frames' past after some rounds closes the loop by itself.
fn carry(run: &Run, residuals: &Residuals, patchwork: &Patchwork) -> Result<Vec<Packed>> {
    let (observer, frames) = (run.observer, residuals.count());
    let memory = residuals.memory.placed(|rho| patchwork.quantity(rho));
    let transport = Transport::along(run.flow, Inflow::Nothing);
    let run_in = memory.length();
    stage(observer, "carry", (2 * frames + run_in) as u64, || {
        let mut made = transferred(run, residuals, patchwork)?;
        let mut now = made[0].unpacked().map(|_| 0.0);
        for step in 0..run_in + frames {
            observe::check(observer)?;
            let t = (step + run_in * frames - run_in) % frames;
            now = memory.of(&transport.apply(&now));
            now.data.iter_mut().zip(&made[t].unpacked().data).for_each(|(d, r)| *d += r);
            if step >= run_in {
                made[t] = Packed::new(&now);
            }
            observer.advance("carry", 1);
        }
        Ok(made)
    })
}

/// The residuals of every frame where they lie on the picture.
fn transferred(run: &Run, residuals: &Residuals, patchwork: &Patchwork) -> Result<Vec<Packed>> {
    let Run { options: &Options { phases, .. }, observer, .. } = *run;
    let frames = residuals.count();
    let frame = |t: usize| {
        observe::check(observer)?;
        let shown = par::map(phases, |phase| residuals.at(t + phase * frames / phases));
        observer.advance("carry", 1);
        Ok(Packed::new(&patchwork.residual(&shown)))
    };
    (0..frames).map(frame).collect()
}

/// The picture's average image, what is laid over it, and the differences as they are shown.
fn finish(run: &Run, mut made: Vec<Packed>, moving: &[Plane; BANDS]) -> Result<(Compositor, Vec<Packed>)> {
    let Run { options, scene, still, flow, observer } = *run;
    let output = scene.settings().output;
    let apart = output.alpha.then(|| Separation::standing(still, observer)).transpose()?;
    if apart.is_none() && still.background.is_some() {
        observer.note("the outline does not move, so the background is not seen");
    }
    let (fluid, matte) = match &apart {
        Some(apart) => (apart.fluid(), apart.matte()),
        None => (&still.working, &still.working_matte),
    };
    let motion = on_cells(flow);
    let frames = made.len();
    let spaced = |count: usize| (0..count.min(frames)).map(move |i| i * frames / count.min(frames));
    let picture = fluid.luma();
    let gains = stage(observer, "contrast", 0, || {
        let samples: Vec<Plane> = spaced(SAMPLES).map(|t| made[t].unpacked()).collect();
        Ok(BandGains::new(&samples, &spread(&picture, matte), matte, moving, &options.strength()))
    })?;
    let recovered = average(options, fluid, matte, &motion, &gains);
    let base = spread(&recovered.luma(), matte);
    let sample = |differences: Plane| Sample { base: Cow::Borrowed(&base), differences };
    stage(observer, "appearance", made.len() as u64, || {
        let learned = spaced(MATCHED).collect::<Vec<_>>();
        let samples = par::map(learned.len(), |i| sample(gains.apply(&made[learned[i]].unpacked())));
        let curves = Appearance::learn(&picture, matte, &samples, &options.matching());
        for block in made.chunks_mut(memory::BLOCKS * 2) {
            observe::check(observer)?;
            let shown =
                par::map(block.len(), |i| Packed::new(&curves.apply(&sample(gains.apply(&block[i].unpacked())))));
            observer.advance("appearance", shown.len() as u64);
            block.clone_from_slice(&shown);
        }
        Ok(())
    })?;
    let travel = Travel { motion: &motion.mean, pace: 1.0, frames: output.length(), fps: output.fps };
    let compositor = compositor(still, apart.as_ref(), &recovered).drifting(&still.working, &travel);
    Ok((compositor, made))
}

/// The picture as a long exposure would show it, with as much contrast left as stays still.
fn average(options: &Options, fluid: &Color, matte: &Plane, motion: &AssignedMotion, gains: &BandGains) -> Color {
    let &Options { shutter, blur, recovery: amount, .. } = options;
    let recovered = recover(fluid, matte, motion, &Recovery { shutter, blur, amount });
    make_room(&recovered, fluid, matte, &gains.shares)
}

impl Options {
    fn strength(&self) -> Strength {
        let bands = std::array::from_fn(|band| if band < FINE { 1.0 } else { self.coarse });
        Strength { strength: self.strength, max_gain: self.max_gain, bands }
    }

    fn matching(&self) -> Matching {
        Matching { amount: self.appearance, region: self.regions, max_gain: self.appearance_gain }
    }
}

/// A flow on cells of the working image.
fn on_cells(flow: &Field) -> AssignedMotion {
    let cells = |plane: &Plane| resize(plane, plane.width.div_ceil(CELL), plane.height.div_ceil(CELL));
    AssignedMotion { mean: Field { u: cells(&flow.u), v: cells(&flow.v) }, activity: cells(&flow.magnitude()) }
}

fn outcome(still: &Still, flow: Field, exemplar_size: (usize, usize)) -> Outcome {
    let arrays = maps::arrays(&flow, still.asked.as_ref());
    let picture = ("motion", draw::colour(&flow, 0.0));
    let motion = AssignedMotion { activity: flow.magnitude(), mean: flow };
    let Maps { mut pictures, max_speed } = maps(&motion, 1.0, still.asked.as_ref(), &still.working_matte, &still.map);
    pictures.push(picture);
    let synthesis = Some(SynthesisRecord { exemplar_size, frames: Vec::new() });
    Outcome { record: RunRecord { synthesis, max_speed: Some(max_speed), ..RunRecord::default() }, pictures, arrays }
}
