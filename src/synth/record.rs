//! What is written down of a run.

use std::collections::BTreeSet;
use std::sync::Mutex;
use std::time::Instant;

use serde::{Deserialize, Serialize};

use crate::base::instructions::InstructionSet;
use crate::base::observe::Observer;
use crate::base::par;
use crate::library::names::Names;
use crate::library::piece::{ClipId, PieceRef};
use crate::scene::file::SceneFile;
use crate::scene::scene::Scene;

/// Everything that is known of a run.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct RunRecord {
    /// Version of the program.
    pub version: String,
    /// Name of the instruction set in use; frames may differ in the last bit between sets.
    pub instructions: String,
    /// Worker threads.
    pub threads: usize,
    /// The settings, every option included.
    pub scene: SceneFile,
    /// Width and height of the working image.
    pub working_size: (usize, usize),
    /// Width and height of the frames.
    pub output_size: (usize, usize),
    /// Stages with their wall time, in order.
    pub stages: Vec<Stage>,
    /// Seconds from start to end.
    pub seconds: f64,
    /// What the user was told, in order.
    #[serde(default)]
    pub notes: Vec<String>,
    /// Which piece went where, where the method assigns pieces.
    pub assignment: Option<AssignmentRecord>,
    /// How frames were synthesised, where the method borrows from an exemplar.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub synthesis: Option<SynthesisRecord>,
    /// Speed at white of the speed map in the report, pixels of the picture per output frame: `max_speed` to feed it back.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub max_speed: Option<f32>,
}

/// A stage and its time.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Stage {
    /// Name.
    pub name: String,
    /// Wall time in seconds.
    pub seconds: f64,
}

/// How frames were synthesised from an exemplar.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct SynthesisRecord {
    /// Width and height of the exemplar as it was used, pixels.
    pub exemplar_size: (usize, usize),
    /// The frames in the order in which they were made; numbers below 0 lead to the first.
    pub frames: Vec<FrameRecord>,
}

/// How a frame was synthesised.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct FrameRecord {
    /// Its number.
    pub frame: i64,
    /// Energy per patch in the end, in units of squared values in [0, 1] at weight 1.
    pub energy: f64,
    /// Rounds of search and vote, coarse to fine.
    pub rounds: Vec<usize>,
    /// How often the exemplar's patches on the outline were used, at least and at most, where it has any.
    pub outline_usage: Option<(u32, u32)>,
    /// The same for those inside.
    pub inside_usage: Option<(u32, u32)>,
}

/// Which piece went where.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct AssignmentRecord {
    /// Energy of the labels (Okabe et al. 2011, §5.3).
    pub energy: f64,
    /// Energy of the labels that the data terms alone would choose.
    pub data_only_energy: f64,
    /// Data terms within [`AssignmentRecord::energy`].
    pub data_energy: f64,
    /// No labels have less energy than this.
    pub bound: f64,
    /// `(energy − bound) / (data_only_energy − bound)`: what could still be gained, at most. The solver's time is that of
    /// the stage "labels".
    pub gap: f64,
    /// Energy at the start, after each sweep of messages, and after each round of moves.
    pub history: Vec<f64>,
    /// Bound after each sweep of messages.
    pub bounds: Vec<f64>,
    /// Nodes for which too few pieces moved as asked, so that others were let in.
    #[serde(default)]
    pub widened: usize,
    /// Every clip that is used, the most used first.
    pub clips: Vec<ClipShare>,
    /// Every node, row by row.
    pub nodes: Vec<NodeRecord>,
}

/// How much of the picture a clip moves.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct ClipShare {
    /// Its number in the legend of the assignment picture, from 1 on.
    #[serde(default)]
    pub number: usize,
    /// Which library, by its place in the scene's list.
    pub library: usize,
    /// First bytes of the clip's identity.
    pub clip: String,
    /// The name of its file, where the library has a sidecar of names.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Its tag.
    pub tag: String,
    /// Its colour in the assignment picture, red, green, blue.
    pub colour: [u8; 3],
    /// Nodes it moves.
    pub nodes: usize,
    /// Share of all nodes, 0 to 1.
    pub share: f64,
    /// Rate it is played at; a clip used at several rates has an entry for each.
    #[serde(default = "plain_rate")]
    pub rate: f32,
    /// Frames of the clip where its loop begins and ends.
    pub loop_frames: (usize, usize),
    /// How unlike the frames are that its loop fades between, at worst: 0 the same, 1 unrelated.
    #[serde(default)]
    pub loop_jump: f64,
}

/// A node and its piece.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct NodeRecord {
    /// Left edge on the working image, pixels.
    pub x: usize,
    /// Top edge on the working image, pixels.
    pub y: usize,
    /// Which library, by its place in the scene's list.
    pub library: usize,
    /// The piece.
    pub piece: PieceRef,
    /// Mean motion of the piece as it is played here (u, v), pixels of the working image per output frame.
    pub motion: (f32, f32),
    /// Mean length of its motion, in the same unit.
    pub activity: f32,
    /// Rate it is played at: seconds of the library per second of output, 1 where no speed is asked.
    #[serde(default = "plain_rate")]
    pub rate: f32,
    /// Direction that was asked for here, a unit vector (u right, v down).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked: Option<(f32, f32)>,
    /// Speed that was asked for here, pixels of the working image per output frame.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub asked_speed: Option<f32>,
}

fn plain_rate() -> f32 {
    1.0
}

impl RunRecord {
    /// Fills in what does not depend on the method.
    pub fn finish(&mut self, scene: &Scene, timed: &Timed) {
        self.version = env!("CARGO_PKG_VERSION").to_owned();
        self.instructions = InstructionSet::chosen().name().to_owned();
        self.threads = par::threads();
        self.scene = scene.settings().clone();
        (self.working_size, self.output_size) = (scene.frame_map().working, scene.frame_map().output);
        self.stages = timed.stages.lock().map(|s| s.clone()).unwrap_or_default();
        self.seconds = timed.start.elapsed().as_secs_f64();
        self.notes = timed.notes.lock().map(|n| n.clone()).unwrap_or_default();
    }
}

impl RunRecord {
    /// Adds the names of the clips' files, given library by library.
    pub fn name_clips(&mut self, names: &[Names]) {
        let Some(assignment) = &mut self.assignment else { return };
        let ids: BTreeSet<(usize, ClipId)> = assignment.nodes.iter().map(|n| (n.library, n.piece.clip)).collect();
        for clip in &mut assignment.clips {
            let id = ids.iter().find(|(library, id)| *library == clip.library && id.to_string() == clip.clip);
            clip.name = id.and_then(|(library, id)| names.get(*library)?.of(*id)).map(str::to_owned);
        }
    }
}

/// Passes everything on to another observer, and keeps the times of the stages and the notes.
pub struct Timed<'a> {
    inner: &'a dyn Observer,
    start: Instant,
    stages: Mutex<Vec<Stage>>,
    notes: Mutex<Vec<String>>,
}

impl<'a> Timed<'a> {
    /// Around `inner`; the clock starts now.
    pub fn new(inner: &'a dyn Observer) -> Self {
        Self { inner, start: Instant::now(), stages: Mutex::default(), notes: Mutex::default() }
    }
}

impl Observer for Timed<'_> {
    fn inner(&self) -> Option<&dyn Observer> {
        Some(self.inner)
    }
    fn end(&self, stage: &str, seconds: f64) {
        if let Ok(mut stages) = self.stages.lock() {
            stages.push(Stage { name: stage.to_owned(), seconds });
        }
        self.inner.end(stage, seconds);
    }
    fn note(&self, message: &str) {
        if let Ok(mut notes) = self.notes.lock() {
            notes.push(message.to_owned());
        }
        self.inner.note(message);
    }
}
