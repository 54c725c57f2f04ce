//! Methods that borrow looks from an exemplar: which exemplars, which patches, what motion, what is refused.

use std::path::PathBuf;

use enliven::base::error::{Error, Result};
use enliven::base::observe::Silent;
use enliven::base::par;
use enliven::base::rng;
use enliven::raster::filter::gaussian;
use enliven::raster::image::{Color, Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};
use enliven::scene::scene::{Scene, open};
use enliven::synth::method::Outcome;
use enliven::synth::run::run;

use crate::keep::Keep;

/// Coloured soft noise.
fn texture(width: usize, height: usize, seed: u64) -> Rgb8 {
    let plane = |c: u64| {
        let noise = Plane::from_fn(width, height, |x, y| rng::unit(rng::hash(seed, &[c, x as u64, y as u64])) - 0.5);
        gaussian(&noise, 1.5).map(|v| (0.5 + 1.6 * v).clamp(0.0, 1.0))
    };
    Color::from_planes([plane(0), plane(1), plane(2)]).to_rgb8()
}

/// A folder with a picture whose right two thirds are fluid.
struct Stage(tempfile::TempDir);

const SIZE: (usize, usize) = (132, 96);

impl Stage {
    fn new() -> Self {
        let stage = Self(tempfile::tempdir().unwrap());
        write_png(&stage.path("p.png"), &texture(SIZE.0, SIZE.1, 1)).unwrap();
        let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, _| ((x as f32 - 40.0) / 4.0).clamp(0.0, 1.0));
        write_grey_png(&stage.path("m.png"), &matte).unwrap();
        write_png(&stage.path("e.png"), &texture(40, 36, 5)).unwrap();
        stage
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn run(&self, more: &str) -> Result<(Vec<Rgb8>, Outcome)> {
        std::fs::write(self.path("scene.toml"), format!("picture = 'p.png'\nmatte = 'm.png'\n{more}")).unwrap();
        let mut sink = Keep::default();
        let outcome = run(&Scene::new(open(&self.path("scene.toml"))?)?, &mut sink, &Silent)?;
        Ok((sink.0, outcome))
    }

    fn error(&self, more: &str) -> Error {
        self.run(more).unwrap_err()
    }
}

const LAZY: &str = "method = 'lazyfluids'\n";
const DOWN: &str = "[motion]\ndirection = 90\n[output]\nframes = 6\n";

#[test]
fn the_first_frame_is_the_picture_itself() {
    let stage = Stage::new();
    let (frames, outcome) = stage.run(&format!("{LAZY}{DOWN}")).unwrap();
    let pictures: Vec<&str> = outcome.pictures.iter().map(|(name, _)| *name).collect();
    assert_eq!(pictures, ["exemplar", "motion", "orientation", "speed", "asked-orientation"]);
    let picture = texture(SIZE.0, SIZE.1, 1);
    let apart = frames[0].data.iter().zip(&picture.data).map(|(a, b)| a.abs_diff(*b)).max();
    assert!(apart <= Some(2), "{apart:?}");
}

#[test]
fn what_cannot_be_borrowed_is_named() {
    let stage = Stage::new();
    let contains = |more: &str, words: &str| {
        let error = stage.error(more).to_string();
        assert!(error.contains(words), "{error:?} should contain {words:?}");
    };
    write_grey_png(&stage.path("black.png"), &Plane::zeros(40, 36)).unwrap();
    write_grey_png(&stage.path("small.png"), &Plane::filled(20, 36, 1.0)).unwrap();
    write_png(&stage.path("tiny.png"), &texture(4, 30, 1)).unwrap();
    contains(&format!("{LAZY}exemplar = 'none.png'\n{DOWN}"), "none.png");
    contains(&format!("{LAZY}exemplar = 'tiny.png'\n{DOWN}"), "tiny.png: an exemplar of 4 × 30 pixels");
    contains(&format!("{LAZY}exemplar_alpha = 'luminance'\n{DOWN}"), "luminance is given without an exemplar");
    let with = |alpha: &str| format!("{LAZY}exemplar = 'e.png'\nexemplar_alpha = '{alpha}'\n{DOWN}");
    contains(&with("nothing.png"), "nothing.png");
    contains(&with("black.png"), "e.png: the exemplar is transparent all over; paint");
    write_png(&stage.path("strip.png"), &texture(900, 8, 1)).unwrap();
    contains(&format!("{LAZY}exemplar = 'strip.png'\n{DOWN}"), "pixels, shrunk from a larger one");
    write_grey_png(&stage.path("half.png"), &Plane::filled(40, 36, 0.5)).unwrap();
    contains(&with("half.png"), "exemplar: it has no inside");
    contains(&with("small.png"), "small.png: is 20 × 36 pixels, the exemplar 40 × 36");
    contains(
        &format!("{LAZY}{DOWN}[lazyfluids]\npatch = 6"),
        "lazyfluids.patch: 6 is out of range (allowed: 3, 5, 7 or 9",
    );
    contains(&format!("{LAZY}{DOWN}[lazyfluids]\nrotations = 3"), "lazyfluids.rotations: 3 is out of range");
    contains(&format!("{LAZY}{DOWN}[lazyfluids]\nl = 0.95"), "lazyfluids.l: 0.95 is out of range");
    contains(&format!("{LAZY}[output]\nframes = 6\n"), "--direction");
}

#[test]
fn every_patch_is_used_equally_often_in_every_frame() {
    let stage = Stage::new();
    for more in ["", "exemplar = 'e.png'\n", "exemplar = 'e.png'\nexemplar_alpha = 'disc.png'\n"] {
        let disc = |x: usize, y: usize| (15.0 - (x as f32 - 20.0).hypot(y as f32 - 18.0)).clamp(0.0, 1.0);
        write_grey_png(&stage.path("disc.png"), &Plane::from_fn(40, 36, disc)).unwrap();
        let (_, outcome) = stage.run(&format!("{LAZY}{more}{DOWN}")).unwrap();
        let synthesis = outcome.record.synthesis.unwrap();
        // Six frames, and three that lead to the first.
        assert_eq!(synthesis.frames.len(), 9);
        for frame in &synthesis.frames {
            let (least, most) = frame.inside_usage.unwrap();
            assert!(most >= 1 && most - least <= 1, "{more} {frame:?}");
            let (least, most) = frame.outline_usage.unwrap_or_default();
            assert!(most - least <= 1, "{more} {frame:?}");
        }
    }
    // The baseline does as it likes.
    let (_, outcome) = stage.run(&format!("method = 'kwatra'\nexemplar = 'e.png'\n{DOWN}")).unwrap();
    let usage = outcome.record.synthesis.unwrap().frames[4].inside_usage.unwrap();
    assert!(usage.1 - usage.0 > 2, "{usage:?}");
}

/// A clip of noise that sinks by a pixel a frame, brightest in its middle.
fn write_clip(path: &std::path::Path, frames: usize) {
    std::fs::create_dir_all(path).unwrap();
    let whole = texture(48, 120, 9);
    for t in 0..frames {
        let mut frame = Rgb8::black(48, 40);
        for y in 0..40 {
            for x in 0..48 {
                let bright = (1.5 - (x as f32 - 24.0).hypot(y as f32 - 20.0) / 20.0).clamp(0.0, 1.0);
                let pixel = whole.pixel(x, y + 60 - t);
                let to = 3 * (y * 48 + x);
                frame.data[to..to + 3].copy_from_slice(&pixel.map(|v| (f32::from(v) * bright) as u8));
            }
        }
        write_png(&path.join(format!("{t:03}.png")), &frame).unwrap();
    }
}

#[test]
fn a_clip_shorter_than_the_video_is_looped_and_black_is_transparent() {
    let stage = Stage::new();
    write_clip(&stage.path("clip"), 20);
    let scene = "exemplar = 'clip'\nexemplar_alpha = 'luminance'\n[motion]\ndirection = 90\n[output]\nframes = 30\n";
    for method in ["lazyfluids", "kwatra"] {
        let (frames, outcome) = stage.run(&format!("method = '{method}'\n{scene}")).unwrap();
        assert_eq!(frames.len(), 30);
        let apart =
            |a: &Rgb8, b: &Rgb8| -> u64 { a.data.iter().zip(&b.data).map(|(a, b)| u64::from(a.abs_diff(*b))).sum() };
        let steps: Vec<u64> = (0..30).map(|t| apart(&frames[t], &frames[(t + 1) % 30])).collect();
        let mut sorted = steps.clone();
        sorted.sort_unstable();
        assert!(sorted[0] > 0 && steps[29] < 2 * sorted[15], "{method}: {steps:?}");
        if method == "lazyfluids" {
            let synthesis = outcome.record.synthesis.unwrap();
            assert!(synthesis.frames.iter().all(|f| f.outline_usage.is_some() && f.inside_usage.is_some()));
        }
    }
}

#[test]
fn larger_videos_have_the_detail_of_the_exemplar() {
    let stage = Stage::new();
    let whole = texture(SIZE.0, SIZE.1, 1);
    let sharp = |frame: &Rgb8| -> f32 {
        let luma = frame.luma();
        let across = (20..80).flat_map(|y| (60..120).map(move |x| (x, y)));
        across.map(|(x, y)| (luma.at(x + 1, y) - 2.0 * luma.at(x, y) + luma.at(x - 1, y)).powi(2)).sum()
    };
    let scene = format!("{LAZY}[motion]\ndirection = 90\n[output]\nframes = 6\nworking_size = 96\n");
    let (frames, _) = stage.run(&scene).unwrap();
    assert_eq!((frames[3].width, frames[3].height), SIZE);
    assert!(sharp(&frames[3]) > 0.6 * sharp(&whole), "{} of {}", sharp(&frames[3]), sharp(&whole));
}
#[test]
fn the_fluid_moves_as_fast_as_is_asked() {
    let stage = Stage::new();
    for speed in [0.25, 0.5, 1.0, 3.0] {
        let strokes = format!(r#"{{"strokes": [{{"points": [[86, 4], [86, 92]], "speed": {speed}}}]}}"#);
        std::fs::write(stage.path("s.json"), strokes).unwrap();
        let scene = format!("{LAZY}[motion]\nstrokes = 's.json'\n[output]\nframes = 24\n[lazyfluids]\nfade = 6\n");
        let (frames, _) = stage.run(&scene).unwrap();
        // Over eight frames, half way down the fluid, which way down is most alike?
        let (first, last) = (frames[4].luma(), frames[12].luma());
        let apart = |down: usize| -> f32 {
            let rows = (34..88).flat_map(|y| (56..120).map(move |x| (x, y)));
            rows.map(|(x, y)| (last.at(x, y) - first.at(x, y - down)).powi(2)).sum()
        };
        let best = (0..32).min_by(|&a, &b| apart(a).total_cmp(&apart(b))).unwrap();
        assert!((best as f32 / 8.0 / speed - 1.0).abs() < 0.3, "{speed}: {best} pixels in 8 frames");
    }
}

/// Mean squared steps across and down, inside the fluid.
fn steps(frame: &Rgb8) -> (f32, f32) {
    let luma = frame.luma();
    let inside = || (12..84).flat_map(|y| (56..120).map(move |x| (x, y)));
    let across = inside().map(|(x, y)| (luma.at(x + 1, y) - luma.at(x, y)).powi(2)).sum();
    (across, inside().map(|(x, y)| (luma.at(x, y + 1) - luma.at(x, y)).powi(2)).sum())
}

#[test]
fn an_open_shutter_blurs_along_the_motion() {
    let stage = Stage::new();
    let strokes = r#"{"strokes": [{"points": [[46, 48], [128, 48]], "speed": 3}]}"#;
    std::fs::write(stage.path("s.json"), strokes).unwrap();
    for method in ["lazyfluids", "kwatra"] {
        let ratio = |shutter: f32| {
            let scene = format!(
                "method = '{method}'\nexemplar = 'e.png'\n[motion]\nstrokes = 's.json'\n[output]\nframes = 4\n\
                 [{method}]\nshutter = {shutter:?}\n"
            );
            let (across, down) = steps(&stage.run(&scene).unwrap().0[3]);
            across / down
        };
        let (closed, open) = (ratio(0.0), ratio(4.0));
        assert!(open < 0.5 * closed, "{method}: {open} {closed}");
    }
}

#[test]
fn turned_copies_of_the_exemplar_are_used_as_well() {
    let stage = Stage::new();
    let stripes = Plane::from_fn(40, 36, |x, _| 0.5 + 0.4 * (x as f32 * 1.3).sin());
    write_grey_png(&stage.path("stripes.png"), &stripes).unwrap();
    let ratio = |rotations: usize| {
        let scene = format!("{LAZY}exemplar = 'stripes.png'\n{DOWN}[lazyfluids]\nrotations = {rotations}\n");
        let (frames, outcome) = stage.run(&scene).unwrap();
        for frame in outcome.record.synthesis.unwrap().frames {
            let (least, most) = frame.inside_usage.unwrap();
            assert!(most - least <= 1, "{rotations}: {frame:?}");
        }
        let (across, down) = steps(&frames[5]);
        down / across
    };
    let (upright, turned) = (ratio(1), ratio(4));
    assert!(turned > 3.0 * upright && turned > 0.5, "{turned} {upright}");
}

#[test]
fn a_clip_gives_the_same_on_any_number_of_threads() {
    let stage = Stage::new();
    write_clip(&stage.path("clip"), 20);
    let scene = format!("{LAZY}exemplar = 'clip'\nexemplar_alpha = 'luminance'\n{DOWN}");
    let run = |threads| par::with_threads(threads, || stage.run(&scene)).unwrap().unwrap().0;
    assert!(run(1) == run(2));
}

#[test]
fn parts_of_a_fluid_keep_to_themselves_at_the_edges_too() {
    let stage = Stage::new();
    // Two fluids, one red and one blue, that come in over the top and go out below.
    let red = |x: usize| x < SIZE.0 / 2;
    let mut picture = texture(SIZE.0, SIZE.1, 1);
    for (i, pixel) in picture.data.chunks_exact_mut(3).enumerate() {
        let bright = pixel[1] / 4;
        pixel.copy_from_slice(&if red(i % SIZE.0) { [150 + bright, 90, 60] } else { [60, 90, 150 + bright] });
    }
    write_png(&stage.path("p.png"), &picture).unwrap();
    let matte = Plane::from_fn(SIZE.0, SIZE.1, |x, _| f32::from(x.abs_diff(SIZE.0 / 2) > 6));
    write_grey_png(&stage.path("m.png"), &matte).unwrap();
    let (frames, _) = stage.run(&format!("{LAZY}[motion]\ndirection = 90\n[output]\nframes = 12\n")).unwrap();
    let fluid: Vec<_> =
        (0..SIZE.1).flat_map(|y| (0..SIZE.0).map(move |x| (x, y))).filter(|&(x, y)| matte.at(x, y) > 0.0).collect();
    for (t, frame) in frames.iter().enumerate() {
        let strange = fluid.iter().filter(|&&(x, y)| (frame.pixel(x, y)[0] > frame.pixel(x, y)[2]) != red(x)).count();
        assert!(strange * 100 <= fluid.len(), "{t}: {strange} of {}", fluid.len());
    }
}

#[test]
fn residuals_are_borrowed_from_clips_that_move_only() {
    let stage = Stage::new();
    let contains = |more: &str, words: &str| {
        let error = stage.error(&format!("method = 'okabe2009'\n{more}")).to_string();
        assert!(error.contains(words), "{error:?} should contain {words:?}");
    };
    write_clip(&stage.path("short"), 8);
    std::fs::create_dir(stage.path("frozen")).unwrap();
    for t in 0..20 {
        write_png(&stage.path("frozen").join(format!("{t:03}.png")), &texture(64, 60, 3)).unwrap();
    }
    contains(DOWN, "okabe2009 borrows from a clip, and none is named; name a clip of a like fluid with --exemplar");
    contains(&format!("exemplar = 'e.png'\n{DOWN}"), "e.png: does not move");
    contains(&format!("exemplar = 'short'\n{DOWN}"), "short: has 8 frames at 25 a second (allowed: 12 at least)");
    contains(&format!("exemplar = 'frozen'\n{DOWN}"), "frozen: nothing moves in the clip");
    contains("exemplar = 'short'\n[output]\nframes = 6\n", "no motion is asked for anywhere on the fluid");
    contains(&format!("exemplar = 'short'\n{DOWN}[okabe2009]\nrefine = 2"), "okabe2009.refine: 2 is out of range");
}

#[test]
fn residuals_flow_as_is_asked_at_the_contrast_of_the_picture() {
    let stage = Stage::new();
    write_clip(&stage.path("clip"), 40);
    // Sinking in the clip, to the right on the picture.
    let scene = "method = 'okabe2009'\nexemplar = 'clip'\n[motion]\ndirection = 0\n[output]\nframes = 24\n";
    let (frames, _) = stage.run(&format!("{scene}[okabe2009]\nrefine = 0\nrecovery = 1\nshutter = 100\n")).unwrap();
    let lumas: Vec<Plane> = frames.iter().map(Rgb8::luma).collect();
    // The default speed is 8 % of 132 pixels a second: half a pixel a frame. What is seen is where it was four frames ago.
    let apart = |across: isize| -> f32 {
        let place = (14..82).flat_map(|y| (60..116).map(move |x| (x, y)));
        let step = |(x, y): (usize, usize)| {
            (4..24)
                .map(|t| (lumas[t].at(x, y) - lumas[t - 4].at((x as isize - across) as usize, y)).powi(2))
                .sum::<f32>()
        };
        place.map(step).sum()
    };
    let best = (-6..=6).min_by(|&a, &b| apart(a).total_cmp(&apart(b))).unwrap();
    assert!((1..=3).contains(&best), "{best}");
    let (across, down) = steps(&frames[7]);
    let whole = steps(&texture(SIZE.0, SIZE.1, 1));
    assert!((across + down) / (whole.0 + whole.1) > 0.3, "{} of {}", across + down, whole.0 + whole.1);
}
