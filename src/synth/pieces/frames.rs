//! From clips to frames: loops are found, then frames are made in blocks and handed on in order.

use std::borrow::Cow;
use std::collections::BTreeSet;

use super::footage::{Clip, Playing, Stream, Wanted, bands_of, frame_bytes, kept_bytes, loop_bytes, study_bytes};
use super::phases::playing;
use super::placing::{Placed, PlayedClip};
use super::playback::RATES;
use super::rendering::{Rendering, Target};
use super::run::Run;
use crate::base::error::Result;
use crate::base::observe::{self, Observer, stage};
use crate::base::par;
use crate::library::variant::CELL;
use crate::raster::image::Plane;
use crate::render::appearance::Appearance;
use crate::render::sway::Sway;
use crate::synth::memory;
use crate::synth::record::Timed;
use crate::synth::writing::Writer;
use crate::video::clip::Sink;

/// Frames that appearance matching learns from.
const MATCHED: usize = 8;
/// Bytes of the frames of clips that are studied at the same time; one is, however large.
const STUDIED: u64 = 1 << 30;

/// Finds the loop of every clip that is used, and how strong its differences are.
///
/// # Errors
/// A damaged pack, a clip that cannot be looped, a cancel.
pub fn study(run: &Run, placed: &Placed) -> Result<Vec<Clip>> {
    let Run { scene, sources, observer, .. } = *run;
    let output = scene.settings().output;
    let levels = placed.layout.levels();
    // As many library frames as the output lasts at its rate, so that water falls as fast at any frame rate.
    let frames = |&PlayedClip { pack, rate, .. }: &PlayedClip| {
        let seconds = RATES[rate] * output.length() as f32 / output.fps;
        ((seconds * sources.packs[pack].1.parameters().rate as f32).round() as usize).max(2)
    };
    let bytes = |f: &PlayedClip| loop_bytes(&sources.packs[f.pack].1, f.clip, frames(f));
    let keep = first_within(memory::keepable(scene), placed.clips.iter().map(bytes));
    let study = |i: usize| {
        let PlayedClip { pack, clip, .. } = placed.clips[i];
        let used = levels.iter().filter(|l| placed.sources[l.source].0 == i).map(|l| l.scale);
        let scales = BTreeSet::from_iter(used).into_iter().collect();
        let frames = frames(&placed.clips[i]);
        let wanted = Wanted { frames: i < keep, motion: run.swaying().is_some() };
        let clip = Clip::study(&sources.packs[pack].1, clip, scales, frames, wanted, observer);
        observer.advance("loops", 1);
        clip
    };
    let largest = |f: &PlayedClip| study_bytes(&sources.packs[f.pack].1, f.clip, frames(f));
    let largest = placed.clips.iter().map(largest).max().unwrap_or(0).max(1);
    let at_once = par::threads().min((STUDIED / largest).max(1) as usize);
    stage(observer, "loops", placed.clips.len() as u64, || {
        // A clip under study is large: a thread that waits must not begin another one.
        let mut clips = Vec::with_capacity(placed.clips.len());
        while clips.len() < placed.clips.len() {
            let (done, count) = (clips.len(), at_once.min(placed.clips.len() - clips.len()));
            clips.extend(par::try_map(count, |k| study(done + k))?);
        }
        Ok(clips)
    })
}

/// How many of `sizes`, from the first on, fit into `room`.
fn first_within(room: u64, sizes: impl Iterator<Item = u64>) -> usize {
    let sums = sizes.scan(0u64, |sum, size| {
        *sum = sum.saturating_add(size);
        Some(*sum)
    });
    sums.take_while(|&sum| sum <= room).count()
}

/// Makes the frames in blocks: the clips of a block are decoded in parallel, then its differences are blended in
/// parallel, while the frames of the block before are put together and written. An outline that moves is followed
/// through some frames of the loop before the first one that is written.
///
/// # Errors
/// A damaged pack, a sink that fails, a cancel.
pub fn make(run: &Run, placed: &Placed, clips: &[Clip], rendering: &Rendering, sink: &mut dyn Sink) -> Result<()> {
    let Run { scene, observer, .. } = *run;
    let (output, wanted) = (scene.settings().output, scene.wanted_frames());
    let streams = streams(placed, clips, rendering, output.length())?;
    let sway = run.swaying().map_or(0, |_| Sway::bytes(output.length(), placed.layout.canvas, CELL));
    let block = memory::block_frames(scene, frame_bytes(&streams), kept_bytes(clips) + sway)?;
    // Streams repeat, so the frames before the first are those that far before the end of a later round. A part of the
    // loop follows an outline that moves from the same frame on.
    let first = rendering.run_in.next_multiple_of(output.length());
    let start = if rendering.run_in == 0 { first + wanted.start } else { first - rendering.run_in };
    let (first, end) = (first + wanted.start, first + wanted.end);
    let matched = stage(observer, "appearance", 0, || learn(rendering, &streams, (output.length(), block), observer))?;
    let make = |b: usize| {
        let frames: Vec<usize> = (start + b * block..(start + (b + 1) * block).min(end)).collect();
        let levels = bands_of(&streams, &frames, observer)?;
        Ok(par::map(levels.len(), |i| {
            let blended = rendering.blender.frame(&levels[i]);
            match &matched {
                None => blended,
                Some(curves) => curves.apply(&rendering.sample(frames[i] % output.length(), blended)),
            }
        }))
    };
    let mut outline = rendering.outline.clone();
    let mut writer = Writer::new(&rendering.compositor, scene, sink, observer);
    stage(observer, "frames", wanted.len() as u64, || {
        par::ordered_map(0..(end - start).div_ceil(block), memory::BLOCKS, make, |b, differences: Vec<Plane>| {
            observe::check(observer)?;
            let outlines = outline.follow(&differences);
            let before = (first - start).saturating_sub(b * block).min(differences.len());
            let t = (start + b * block + before) % output.length();
            let frame = |i: usize| (t + i, Cow::Borrowed(&differences[before + i]), &outlines[before + i]);
            writer.write(differences.len() - before, frame)
        })
    })
}

/// Per source of the layout: its clip's frames, from its phase on.
fn streams<'a>(placed: &Placed, clips: &'a [Clip], rendering: &Rendering, frames: usize) -> Result<Vec<Stream<'a>>> {
    let levels = rendering.blender.levels();
    let stream = |(source, playing): (usize, Playing<'a>)| {
        let scales = levels.iter().filter(|l| l.source == source).map(|l| l.scale).collect();
        Stream::new(playing, scales)
    };
    playing(placed, clips, frames).into_iter().enumerate().map(stream).collect()
}

/// The curves that bring `frames` frames of the loop to the picture, where that is wanted; learned on some of them, made
/// `block` at a time.
fn learn(
    rendering: &Rendering,
    streams: &[Stream],
    (frames, block): (usize, usize),
    observer: &Timed,
) -> Result<Option<Appearance>> {
    let Target { matching, picture, matte, .. } = &rendering.target;
    if matching.amount == 0.0 {
        return Ok(None);
    }
    let count = MATCHED.min(frames);
    let sampled: Vec<usize> = (0..count).map(|i| i * frames / count).collect();
    let mut samples = Vec::with_capacity(count);
    for block in sampled.chunks(block) {
        let levels = bands_of(streams, block, observer)?;
        samples.extend(par::map(block.len(), |i| rendering.sample(block[i], rendering.blender.frame(&levels[i]))));
    }
    Ok(Some(Appearance::learn(picture, matte, &samples, matching)))
}
