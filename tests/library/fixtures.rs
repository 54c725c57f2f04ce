//! The small inputs in `fixtures/`: readable, consistent with each other, and small.

use std::path::{Path, PathBuf};

use enliven::scene::file;
use enliven::video::read::source;
use serde::Deserialize;

#[path = "../../examples/make_fixtures/matte.rs"]
mod matte;

/// Picture and what belongs to it, by the stem of its name.
const PICTURES: [&str; 3] = ["falls.png", "stream.jpg", "campfire.png"];

fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures")
}

fn beside(picture: &str, ending: &str) -> PathBuf {
    let stem = picture.split('.').next().unwrap();
    fixtures().join("pictures").join(format!("{stem}.{ending}"))
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries.flat_map(|p| if p.is_dir() { files(&p) } else { vec![p] }).collect()
}

#[test]
fn all_files_together_stay_below_15_megabytes() {
    let total: u64 = files(&fixtures()).iter().map(|f| f.metadata().unwrap().len()).sum();
    assert!(total < 15_000_000, "{total} bytes");
}

#[test]
fn every_picture_has_a_matte_of_its_size_with_fluid_and_land() {
    for picture in PICTURES {
        let size = image::image_dimensions(fixtures().join("pictures").join(picture)).unwrap();
        let matte = image::open(beside(picture, "matte.png")).unwrap().to_luma8();
        assert_eq!(matte.dimensions(), size, "{picture}");
        let share = |keep: fn(u8) -> bool| matte.pixels().filter(|p| keep(p.0[0])).count() as f32 / matte.len() as f32;
        let (fluid, land) = (share(|v| v > 250), share(|v| v < 5));
        assert!(fluid > 0.05 && land > 0.3, "{picture}: fluid {fluid}, land {land}");
        assert!(share(|v| (5..=250).contains(&v)) > 0.002, "{picture}: hard edges");
    }
}

#[test]
fn the_clean_background_differs_from_the_picture_only_near_the_fire() {
    let open = |path: PathBuf| image::open(path).unwrap().to_rgb8();
    let (picture, clean) = (open(beside("campfire.png", "png")), open(beside("campfire.png", "clean.png")));
    assert_eq!(picture.dimensions(), clean.dimensions());
    let matte = image::open(beside("campfire.png", "matte.png")).unwrap().to_luma8();
    let differs = |(a, b): (&image::Rgb<u8>, &image::Rgb<u8>)| a.0.iter().zip(b.0).any(|(&a, b)| a.abs_diff(b) > 24);
    let outside = picture.pixels().zip(clean.pixels()).zip(matte.pixels()).filter(|(_, m)| m.0[0] < 5);
    let (mut all, mut changed) = (0, 0);
    for (pair, _) in outside {
        all += 1;
        changed += usize::from(differs(pair));
    }
    assert!(changed * 200 < all, "{changed} of {all} pixels outside the matte differ");
}

#[derive(Deserialize)]
struct Strokes {
    strokes: Vec<Stroke>,
}

#[derive(Deserialize)]
struct Stroke {
    points: Vec<[f32; 2]>,
    speed: Option<f32>,
}

#[test]
fn every_stroke_lies_in_its_fluid() {
    for picture in PICTURES {
        let text = std::fs::read_to_string(beside(picture, "strokes.json")).unwrap();
        let strokes: Strokes = serde_json::from_str(&text).unwrap();
        let matte = image::open(beside(picture, "matte.png")).unwrap().to_luma8();
        assert!(!strokes.strokes.is_empty());
        for stroke in &strokes.strokes {
            assert!(stroke.points.len() >= 2 && stroke.speed.is_none_or(|s| s > 0.0), "{picture}");
            for [x, y] in &stroke.points {
                assert!(*x >= 0.0 && *y >= 0.0, "{picture}: ({x}, {y})");
                let value = matte.get_pixel_checked(*x as u32, *y as u32).map(|p| p.0[0]);
                assert!(value.is_some_and(|v| v > 127), "{picture}: ({x}, {y}) is on {value:?}");
            }
        }
    }
}

#[test]
fn the_photograph_s_matte_is_what_its_outlines_say() {
    let stored = image::open(beside("stream.jpg", "matte.png")).unwrap().to_luma8();
    let outlines = matte::Outlines::read(&beside("stream.jpg", "matte.json")).unwrap();
    let drawn = outlines.fill(stored.width() as usize, stored.height() as usize);
    for (pixel, value) in stored.pixels().zip(&drawn.data) {
        assert!((f32::from(pixel.0[0]) - 255.0 * value).abs() <= 1.0);
    }
}

#[test]
fn every_clip_is_read_by_the_embedded_decoder() {
    let clips: Vec<PathBuf> = files(&fixtures().join("clips"));
    assert!(clips.len() >= 4);
    for clip in clips {
        let mut source = source::open(&clip).unwrap();
        let (width, height) = (source.info().width, source.info().height);
        assert!(source.info().decoder.starts_with("embedded"), "{}: {}", clip.display(), source.info().decoder);
        assert!(width % 16 == 0 && height % 16 == 0 && width.min(height) >= 240, "{width}x{height}");
        let mut frames = 0;
        while let Some(frame) = source.next_frame().unwrap() {
            assert_eq!((frame.width, frame.height), (width, height));
            frames += 1;
        }
        assert!(frames >= 40, "{}: {frames} frames", clip.display());
    }
}

#[test]
fn every_scene_names_files_that_exist() {
    for name in ["falls", "stream", "fire"] {
        let folder = fixtures().join("scenes").join(name);
        let path = folder.join("scene.toml");
        let scene = file::parse(&std::fs::read_to_string(&path).unwrap(), &path).unwrap();
        assert!(folder.join(&scene.picture).is_file(), "{name}");
        assert!(folder.join(scene.matte.as_ref().unwrap()).is_file(), "{name}");
        assert!(scene.background.as_ref().is_none_or(|b| folder.join(b).is_file()), "{name}");
        assert!(scene.motion.strokes.as_ref().is_none_or(|s| folder.join(s).is_file()), "{name}");
        assert!(scene.motion.direction.is_some() && scene.output.length() >= 25, "{name}");
    }
}
