//! The picture itself carried along the motion that is asked for, without any library: what one-photograph programs do
//! (Holynski, Curless, Seitz & Szeliski 2021, in pixels and without their network).

use crate::base::error::Result;
use crate::base::observe::{Observer, stage};
use crate::base::options::declare_options;
use crate::flow::draw;
use crate::flow::field::Field;
use crate::render::carry::Carry;
use crate::render::composite::Stays;
use crate::render::recover::AssignedMotion;
use crate::scene::file::Output;
use crate::scene::scene::{Scene, Still};
use crate::scene::target::Target;
use crate::synth::maps::{self, Maps, maps};
use crate::synth::memory;
use crate::synth::method::{MethodEntry, Outcome, Sources, Synthesizer};
use crate::synth::record::{RunRecord, Timed};
use crate::synth::separation::{Separation, compositor};
use crate::synth::writing;
use crate::video::clip::Sink;

declare_options! {
    /// Options of carrying the picture.
    pub struct Options named "advect" {
        /// Longest time that detail of the picture travels before it starts again, at 25 frames a second; less where it is
        /// so fast that it would stray far.
        life: f32 = 40.0, in 8, 1000, "frames", "methods §2.4";
        /// Share of that time in which the old and the new are seen together.
        fade: f32 = 0.5, in 0.1, 1, "ratio", "Holynski 2021, §4.2";
        /// Light and shade of the picture coarser than this stay in their place: σ of a Gaussian.
        steady: f32 = 16.0, in 1, 200, "pixels", "methods §2.4";
    }
}

/// Registry entry.
pub const ENTRY: MethodEntry = MethodEntry {
    name: "advect",
    summary: "carries the picture along the motion that is asked for; needs strokes or a direction, and no library",
    citation: "after Holynski, Curless, Seitz & Szeliski, \"Animating Pictures with Eulerian Motion Fields\", CVPR 2021, \
               without the network",
    library: false,
    exemplars: 0,
    designed: false,
    options: Options::declared,
    complete: |table| Ok(Options::from_table(table)?.to_table()),
    preview: |_| {},
    build: |table| Ok(Box::new(Advect { options: Options::from_table(table)? })),
};

impl Options {
    /// How the picture is carried along `flow` in the loop of `output`.
    pub fn carry<'a>(&self, flow: &'a Field, output: &Output) -> Carry<'a> {
        let &Self { life, fade, .. } = self;
        Carry { flow, frames: output.length(), fps: output.fps, life, fade, seed: output.seed }
    }
}

struct Advect {
    options: Options,
}

impl Synthesizer for Advect {
    fn synthesize(&self, scene: &Scene, _: &Sources, sink: &mut dyn Sink, observer: &Timed) -> Result<Outcome> {
        let still = stage(observer, "read picture", 0, || scene.still(observer))?;
        let target = Target::of(scene, &still)?;
        target.note(observer);
        memory::check(scene)?;
        let (flow, output) = (target.flow(0)?, scene.settings().output);
        let apart = output.alpha.then(|| Separation::standing(&still, observer)).transpose()?;
        if apart.is_none() && still.background.is_some() {
            observer.note("the outline does not move, so the background is not seen");
        }
        let (fluid, matte) = match &apart {
            Some(apart) => (apart.fluid(), apart.matte()),
            None => (&still.working, &still.working_matte),
        };
        let carried = stage(observer, "prepare", 0, || {
            Ok(compositor(&still, apart.as_ref(), fluid).carrying(
                matte,
                &Stays::Coarser(self.options.steady),
                &self.options.carry(&flow, &output),
            ))
        })?;
        writing::carry(scene, &carried, &still.working_matte, sink, observer)?;
        Ok(outcome(&still, flow))
    }
}

fn outcome(still: &Still, flow: Field) -> Outcome {
    let picture = ("motion", draw::colour(&flow, 0.0));
    let arrays = maps::arrays(&flow, still.asked.as_ref());
    let motion = AssignedMotion { activity: flow.magnitude(), mean: flow };
    let Maps { mut pictures, max_speed } = maps(&motion, 1.0, still.asked.as_ref(), &still.working_matte, &still.map);
    pictures.push(picture);
    Outcome { record: RunRecord { max_speed: Some(max_speed), ..RunRecord::default() }, pictures, arrays }
}
