//! Reading clips: every embedded format from files made here, containers' oddities, and bad input.

mod make;

use std::path::{Path, PathBuf};

use enliven::base::error::{Error, Kind, Result};
use enliven::base::rng::{below, hash};
use enliven::raster::image::Rgb8;
use enliven::video::clip::{RawFrame, Source, Turn};
use enliven::video::conform::scale::to_rgb8;
use enliven::video::conform::{ConformOptions, ConformReport, Conformed};
use enliven::video::read::source::{self, Decoder};
use make::{Mp4, number, picture};

const SIZE: (usize, usize) = (96, 64);

fn frames(n: usize) -> Vec<Rgb8> {
    (0..n).map(|t| picture(t, SIZE.0, SIZE.1)).collect()
}

fn folder() -> tempfile::TempDir {
    tempfile::tempdir().unwrap()
}

fn write(dir: &tempfile::TempDir, name: &str, bytes: &[u8]) -> PathBuf {
    let path = dir.path().join(name);
    std::fs::write(&path, bytes).unwrap();
    path
}

fn open(path: &Path) -> Result<Box<dyn Source>> {
    source::open_with(path, Decoder::Embedded)
}

/// All frames, and the error that ended them, if one did.
fn read(path: &Path) -> (Vec<RawFrame>, Option<Error>) {
    let mut source = open(path).unwrap();
    let mut frames = Vec::new();
    loop {
        match source.next_frame() {
            Ok(Some(frame)) => frames.push(frame),
            Ok(None) => return (frames, None),
            Err(error) => return (frames, Some(error)),
        }
    }
}

fn refusal(path: &Path) -> Error {
    open(path).err().expect("a refusal")
}

fn order(frames: &[RawFrame]) -> Vec<(usize, u64)> {
    frames.iter().map(|f| (number(&to_rgb8(f)), f.time_ns / 1_000_000)).collect()
}

#[test]
fn every_embedded_format_reads_back() {
    let clip = frames(12);
    let jpegs: Vec<Vec<u8>> = clip.iter().map(make::jpeg).collect();
    let avi = make::avi(b"MJPG", (SIZE.0 as u32, SIZE.1 as u32), &jpegs);
    let files = [
        ("a.mp4", "embedded h264", make::mp4(&clip), 4.0),
        ("a.avi", "embedded mjpeg", avi, 4.0),
        ("a.webm", "embedded vp9", make::webm(&clip), 5.0),
        ("a.gif", "embedded gif", make::gif(&clip), 4.0),
        ("a.png", "embedded apng", make::apng(&clip), 0.0),
        ("a.webp", "embedded webp", make::webp(&clip), 0.0),
        ("a.y4m", "embedded y4m", make::y4m(&clip), 3.0),
    ];
    let dir = folder();
    for (name, decoder, bytes, allowed) in files {
        // The name says nothing: content decides.
        let path = write(&dir, &name.replace("a.", "clip-"), &bytes);
        assert_eq!(open(&path).unwrap().info().decoder, decoder);
        let (read, error) = read(&path);
        assert!(error.is_none(), "{name}: {error:?}");
        assert_eq!(read.len(), clip.len(), "{name}");
        for (t, (frame, expected)) in read.iter().zip(&clip).enumerate() {
            assert_eq!(frame.time_ns / 1_000_000, 40 * t as u64, "{name}");
            let image = to_rgb8(frame);
            let sum: f64 = image.data.iter().zip(&expected.data).map(|(a, b)| f64::from(a.abs_diff(*b))).sum();
            let mean = sum / image.data.len() as f64;
            assert!(mean <= allowed, "{name} frame {t}: mean difference {mean}");
        }
    }
}

#[test]
fn folders_are_read_in_natural_order() {
    let dir = folder();
    for t in 0..12 {
        let f = picture(t, 32, 32);
        image::save_buffer(dir.path().join(format!("{t}.png")), &f.data, 32, 32, image::ColorType::Rgb8).unwrap();
    }
    write(&dir, "notes.txt", b"not a picture");
    let (read, error) = read(dir.path());
    assert!(error.is_none());
    assert_eq!(order(&read), (0..12).map(|t| (t, 40 * t as u64)).collect::<Vec<_>>());
    let before = source::content_hash(dir.path()).unwrap();
    std::fs::rename(dir.path().join("3.png"), dir.path().join("30.png")).unwrap();
    assert_ne!(before, source::content_hash(dir.path()).unwrap(), "the order of the frames is part of the identity");
}

#[test]
fn composition_offsets_give_presentation_order() {
    let coded = make::h264(&[0, 2, 1, 3].map(|t| picture(t, 96, 64)), true);
    let mut spec = Mp4::new((96, 64), vec![40; 4]);
    spec.shifts = Some(vec![0, 40, -40, 0]);
    spec.wide_offsets = true;
    let dir = folder();
    let (read, error) = read(&write(&dir, "b.mp4", &spec.file(&coded)));
    assert!(error.is_none());
    assert_eq!(order(&read), [(0, 0), (1, 40), (2, 80), (3, 120)]);
}

#[test]
fn edit_lists_delay_trim_and_repeat() {
    let coded = make::h264(&frames(8), false);
    let mut spec = Mp4::new((96, 64), vec![40; 8]);
    spec.edits = vec![(100, -1), (80, 120), (40, 0)];
    let dir = folder();
    let (read, error) = read(&write(&dir, "e.mp4", &spec.file(&coded)));
    assert!(error.is_none());
    assert_eq!(order(&read), [(3, 100), (4, 140), (0, 180)]);
}

#[test]
fn rotation_tags_turn_the_frames() {
    let coded = make::h264(&frames(3), false);
    let dir = folder();
    let turns = [
        ([1, 0, 0, 1], Turn::None),
        ([0, 1, -1, 0], Turn::Right),
        ([-1, 0, 0, -1], Turn::Half),
        ([0, -1, 1, 0], Turn::Left),
    ];
    for (matrix, turn) in turns {
        let mut spec = Mp4::new((96, 64), vec![40; 3]);
        spec.matrix = matrix;
        let path = write(&dir, "r.mp4", &spec.file(&coded));
        assert_eq!(open(&path).unwrap().info().turn, turn);
        let (images, report) = conform(&path);
        let upright = if matches!(turn, Turn::None | Turn::Half) { (96, 64) } else { (64, 96) };
        assert_eq!(report.working, upright);
        // The grey half is left in the file: turned right it is on top.
        let grey =
            |x: usize, y: usize| images[0].pixel(x, y)[0].abs_diff(30) < 8 && images[0].pixel(x, y)[2].abs_diff(30) < 8;
        let (w, h) = upright;
        let (near, far) = match turn {
            Turn::None => ((4, h / 2), (w - 4, h / 2)),
            Turn::Right => ((w / 2, 4), (w / 2, h - 4)),
            Turn::Half => ((w - 4, h / 2), (4, h / 2)),
            Turn::Left => ((w / 2, h - 4), (w / 2, 4)),
        };
        assert!(grey(near.0, near.1) && !grey(far.0, far.1), "{turn:?}");
    }
}

fn conform(path: &Path) -> (Vec<Rgb8>, ConformReport) {
    let options = ConformOptions { decoder: Decoder::Embedded, ..ConformOptions::default() };
    let mut clip = Conformed::open(path, &options).unwrap();
    let images: Vec<Rgb8> = std::iter::from_fn(|| clip.next_frame().unwrap()).collect();
    assert!(images.iter().all(|i| (i.width, i.height) == clip.report().working));
    (images, clip.report().clone())
}

#[test]
fn duplicates_are_removed_and_told() {
    // 24 pictures, every fourth twice: 30 frames at 30 a second.
    let numbers: Vec<usize> = (0..24).flat_map(|t| std::iter::repeat_n(t, 1 + usize::from(t % 4 == 3))).collect();
    let clip: Vec<Rgb8> = numbers.iter().map(|&t| picture(t, 96, 64)).collect();
    let durations = (0..30).map(|i| if i % 3 == 0 { 34 } else { 33 }).collect();
    let dir = folder();
    let path = write(&dir, "d.mp4", &Mp4::new((96, 64), durations).file(&make::h264(&clip, false)));
    let (images, report) = conform(&path);
    assert_eq!((report.frames_read, report.duplicates_removed, report.frames_out), (30, 6, 24));
    assert_eq!(images.iter().map(number).collect::<Vec<_>>(), (0..24).collect::<Vec<_>>());
    assert!((report.source_rate - 30.0).abs() < 0.2 && !report.variable_rate);
}

#[test]
fn variable_rates_come_to_the_library_rate() {
    // Ten frames of 20 ms, then ten of 40 ms: 15 ticks of 40 ms.
    let durations: Vec<u32> = (0..20).map(|i| if i < 10 { 20 } else { 40 }).collect();
    let dir = folder();
    let path = write(&dir, "v.mp4", &Mp4::new((96, 64), durations).file(&make::h264(&frames(20), false)));
    let (images, report) = conform(&path);
    assert!(report.variable_rate);
    assert_eq!(images.len(), 15);
    assert_eq!(images.iter().map(number).collect::<Vec<_>>(), [0, 2, 4, 6, 8, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19]);
}

#[test]
fn black_bars_are_cropped_and_odd_sizes_are_read() {
    let boxed = |t: usize| {
        let (inner, mut image) = (picture(t, 97, 65), Rgb8::black(141, 97));
        for y in 0..65 {
            let at = ((y + 16) * 141 + 22) * 3;
            image.data[at..at + 97 * 3].copy_from_slice(&inner.data[y * 97 * 3..(y + 1) * 97 * 3]);
        }
        image
    };
    let dir = folder();
    let path = write(&dir, "bars.png", &make::apng(&(0..12).map(boxed).collect::<Vec<_>>()));
    let (images, report) = conform(&path);
    let bars = report.black_bars.unwrap();
    assert_eq!((bars.x, bars.y, bars.width, bars.height), (22, 16, 97, 65));
    assert_eq!((report.working, images.len()), ((96, 64), 12));
}

#[test]
fn what_is_no_video_is_refused_by_name() {
    let dir = folder();
    let text = refusal(&write(&dir, "text.mp4", b"Dear diary, today I filmed a waterfall.\n"));
    assert!(text.kind() == Kind::Data && text.to_string().contains("text.mp4"), "{text}");
    assert!(refusal(&write(&dir, "empty.mp4", b"")).to_string().contains("empty"));
    let still = refusal(&write(&dir, "still.jpg", &make::jpeg(&picture(0, 32, 32))));
    assert!(still.kind() == Kind::Unusable && still.to_string().contains("still picture"));
    assert_eq!(refusal(&dir.path().join("nowhere.mp4")).kind(), Kind::Io);
    let nothing = folder();
    assert!(refusal(nothing.path()).to_string().contains("no PNG or JPEG pictures"));
}

#[test]
fn a_missing_ffmpeg_names_codec_and_remedy() {
    let dir = folder();
    let coded = make::h264(&frames(2), false);
    let mut spec = Mp4::new((96, 64), vec![40; 2]);
    spec.codec = *b"hvc1";
    let files = [
        ("phone.mov", spec.file(&coded), "HEVC (hvc1)"),
        ("old.webm", make::webm_of("V_VP8", (96, 64), &[vec![0; 9]]), "VP8"),
        ("old.avi", make::avi(b"MP42", (96, 64), &[vec![0; 9]]), "msmpeg4v2 (MP42)"),
        ("old.ogv", b"OggS\0\0\0\0\0\0\0\0".to_vec(), "Ogg"),
    ];
    for (name, bytes, codec) in files {
        let error = refusal(&write(&dir, name, &bytes));
        assert_eq!(error.kind(), Kind::Unsupported, "{error}");
        let said = error.to_string();
        assert!(said.contains(codec) && said.contains("ffmpeg") && said.contains("convert"), "{said}");
    }
}

#[test]
fn frames_before_damage_are_delivered() {
    let clip = frames(12);
    let jpegs: Vec<Vec<u8>> = clip.iter().map(make::jpeg).collect();
    let avi = make::avi(b"MJPG", (SIZE.0 as u32, SIZE.1 as u32), &jpegs);
    let dir = folder();
    for (name, bytes) in [
        ("cut.mp4", make::mp4(&clip)),
        ("cut.avi", avi),
        ("cut.y4m", make::y4m(&clip)),
        ("cut.webm", make::webm(&clip)),
    ] {
        let path = write(&dir, name, &bytes[..bytes.len() * 4 / 5]);
        let (read, error) = read(&path);
        let error = error.unwrap_or_else(|| panic!("{name}: no error"));
        assert!(error.kind() == Kind::Data && error.to_string().contains(name), "{error}");
        assert!((1..12).contains(&read.len()), "{name}: {}", read.len());
        assert!(read.iter().enumerate().all(|(t, f)| number(&to_rgb8(f)) == t), "{name}");
        // The same through conform: frames first, the error last.
        let mut conformed = Conformed::open(&path, &ConformOptions::default()).unwrap();
        let mut given = 0;
        while let Ok(Some(_)) = conformed.next_frame() {
            given += 1;
        }
        assert_eq!(given, read.len(), "{name}");
    }
    let mp4 = make::mp4(&clip);
    assert!(refusal(&write(&dir, "headless.mp4", &mp4[..200])).to_string().contains("moov"));
}

#[test]
fn a_clip_without_frames_is_an_error() {
    let dir = folder();
    let (sps, pps, _) = make::h264(&frames(1), false);
    let path = write(&dir, "none.mp4", &Mp4::new((96, 64), vec![]).file(&(sps, pps, vec![])));
    let error = Conformed::open(&path, &ConformOptions::default()).err().unwrap();
    assert!(error.to_string().contains("no frames"), "{error}");
    let path = write(&dir, "none.y4m", b"YUV4MPEG2 W64 H64 F25:1\n");
    assert!(Conformed::open(&path, &ConformOptions::default()).is_err());
}

#[test]
fn folders_of_mixed_sizes_name_the_odd_one() {
    let dir = folder();
    for (name, side) in [("0.png", 32), ("1.png", 48)] {
        let f = picture(0, side, side);
        let (w, color) = (side as u32, image::ColorType::Rgb8);
        image::save_buffer(dir.path().join(name), &f.data, w, w, color).unwrap();
    }
    let (read, error) = read(dir.path());
    let said = error.unwrap().to_string();
    assert!(read.len() == 1 && said.contains("1.png") && said.contains("32 × 32"), "{said}");
}

#[test]
fn too_small_a_clip_is_unusable() {
    let dir = folder();
    let path = write(&dir, "tiny.png", &make::apng(&[picture(0, 12, 40), picture(1, 12, 40)]));
    assert_eq!(Conformed::open(&path, &ConformOptions::default()).err().unwrap().kind(), Kind::Unusable);
}

/// Any damage ends in frames or a named error: no panic, no endless reading, no giant allocation.
#[test]
fn mutated_files_do_no_harm() {
    let clip: Vec<Rgb8> = (0..3).map(|t| picture(t, 48, 32)).collect();
    let jpegs: Vec<Vec<u8>> = clip.iter().map(make::jpeg).collect();
    let files = [
        ("m.mp4", make::mp4(&clip), 300),
        ("m.avi", make::avi(b"MJPG", (48, 32), &jpegs), 150),
        ("m.webm", make::webm(&clip), 150),
        ("m.gif", make::gif(&clip), 80),
        ("m.apng", make::apng(&clip), 80),
        ("m.webp", make::webp(&clip), 80),
        ("m.y4m", make::y4m(&clip), 80),
    ];
    let dir = folder();
    for (name, bytes, rounds) in files {
        for round in 0..rounds {
            let mut damaged = bytes.clone();
            // Headers matter most: half of the hits go to the first kilobyte.
            for hit in 0..1 + round % 4 {
                let h = hash(round, &[hit]);
                let span = if h.is_multiple_of(2) { damaged.len().min(1024) } else { damaged.len() };
                let at = below(hash(h, &[1]), span as u64) as usize;
                damaged[at] = [0, 255, damaged[at] ^ 1 << (h >> 8 & 7), (h >> 16) as u8][(h >> 32) as usize % 4];
            }
            let path = write(&dir, name, &damaged);
            if let Ok(mut source) = open(&path) {
                let read = (0..100).take_while(|_| matches!(source.next_frame(), Ok(Some(_)))).count();
                assert!(read < 100, "{name} round {round}: endless frames");
            }
        }
    }
}
