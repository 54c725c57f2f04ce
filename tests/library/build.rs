//! Building libraries from small clips.

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

use enliven::base::error::{Kind, Result};
use enliven::base::observe::{Observer, Silent};
use enliven::base::par;
use enliven::library::build::{BuildReport, build};
use enliven::library::options::Options;
use enliven::library::piece::PieceIx;
use enliven::library::reader::Pack;
use enliven::library::verify::verify;

use crate::common;

fn run(clips: &[PathBuf], output: &Path) -> Result<BuildReport> {
    build(clips, output, &common::options(), &Silent)
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn the_same_bytes_for_any_number_of_threads_and_any_order() {
    let folder = tempfile::tempdir().unwrap();
    let mut clips = common::write_clips(folder.path());
    let mut packs = Vec::new();
    for (i, threads) in [1, 2, 3].into_iter().enumerate() {
        let output = folder.path().join(format!("{i}.pack"));
        par::with_threads(threads, || run(&clips, &output)).unwrap().unwrap();
        packs.push(fs::read(output).unwrap());
        clips.rotate_left(1);
        clips.swap(0, 1);
    }
    assert!(packs[0] == packs[1] && packs[1] == packs[2]);
}

#[test]
fn a_pack_holds_its_clips_and_their_pieces() {
    let folder = tempfile::tempdir().unwrap();
    let clips = common::write_clips(folder.path());
    let output = folder.path().join("l.pack");
    let report = run(&clips, &output).unwrap();
    assert_eq!(names(folder.path()), ["a.y4m", "b.y4m", "c.y4m", "l.pack", "l.pack.names.toml"]);
    let pack = Pack::open(&output).unwrap();
    verify(&pack, &Silent).unwrap();
    assert_eq!(pack.clips().len(), 3);
    assert_eq!(report.pieces as usize, pack.piece_count());
    assert_eq!(pack.parameters().words, 12);
    for (clip, accepted) in pack.clips().iter().zip(&report.accepted) {
        assert_eq!((clip.id.to_string(), clip.pieces()), (accepted.id.clone(), accepted.pieces));
        assert_eq!((clip.width, clip.height, clip.tag.as_str()), (96, 80, "test"));
        assert!(clip.frames as usize == common::FRAMES && clip.pieces() > 0);
    }
    // The fall sinks a pixel and a half a frame, and an unflipped, unturned, full-size piece says so.
    let mut seen = 0;
    for i in 0..pack.piece_count() as u32 {
        let piece = pack.piece(PieceIx(i)).unwrap();
        if piece.variant().index() == 0 && piece.x >= 32 {
            let (u, v) = pack.tile(PieceIx(i)).unwrap().mean_motion();
            assert!(u.abs() < 0.5 && (0.8..2.2).contains(&v), "piece {i} moves by {u}, {v}");
            seen += 1;
        }
    }
    assert!(seen > 0);
}

#[test]
fn bad_clips_are_refused_by_name_and_doubles_used_once() {
    let folder = tempfile::tempdir().unwrap();
    let mut clips = common::write_clips(folder.path());
    let put = |name: &str, bytes: &[u8]| {
        fs::write(folder.path().join(name), bytes).unwrap();
        folder.path().join(name)
    };
    let whole = fs::read(&clips[0]).unwrap();
    clips.push(put("text.mp4", b"this is no video"));
    clips.push(put("empty.mp4", b""));
    clips.push(put("cut.y4m", &whole[..whole.len() / 2 + 100]));
    clips.push(put("copy.y4m", &whole));
    let report = run(&clips, &folder.path().join("l.pack")).unwrap();
    assert_eq!(report.accepted.len(), 3);
    let refused: Vec<String> =
        report.refused.iter().map(|r| r.path.file_name().unwrap().to_string_lossy().into_owned()).collect();
    assert_eq!(refused, ["text.mp4", "empty.mp4", "cut.y4m"]);
    assert!(report.refused.iter().all(|r| !r.reason.is_empty()));
    assert_eq!(report.duplicates, [folder.path().join("copy.y4m")]);

    let error = run(&clips[3..6], &folder.path().join("none.pack")).unwrap_err();
    assert_eq!(error.kind(), Kind::Unusable);
    assert!(error.to_string().contains("text.mp4"), "{error}");
    assert!(!folder.path().join("none.pack").exists());
}

/// Cancels after some frames.
struct Impatient(AtomicU64);

impl Observer for Impatient {
    fn advance(&self, stage: &str, steps: u64) {
        if stage == "decode" {
            self.0.fetch_add(steps, Ordering::SeqCst);
        }
    }

    fn cancelled(&self) -> bool {
        self.0.load(Ordering::SeqCst) > common::FRAMES as u64 + 5
    }
}

#[test]
fn a_cancelled_build_is_resumed_and_damaged_leftovers_are_made_anew() {
    let folder = tempfile::tempdir().unwrap();
    let clips = common::write_clips(folder.path());
    let output = folder.path().join("l.pack");
    let impatient = Impatient(AtomicU64::new(0));
    let error = build(&clips, &output, &common::options(), &impatient).unwrap_err();
    assert_eq!(error.kind(), Kind::Interrupted);
    assert!(!output.exists());
    let report = run(&clips, &output).unwrap();
    assert_eq!(report.accepted.iter().filter(|c| c.resumed).count(), 1);
    let expected = fs::read(&output).unwrap();

    let error = build(&clips, &output, &common::options(), &Impatient(AtomicU64::new(0))).unwrap_err();
    assert_eq!(error.kind(), Kind::Interrupted);
    assert!(fs::read(&output).unwrap() == expected, "the old pack stays until the new one is whole");
    let work = folder.path().join("l.pack.build");
    let segment = names(&work).into_iter().find(|n| n.ends_with(".segment")).unwrap();
    let mut bytes = fs::read(work.join(&segment)).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    fs::write(work.join(&segment), bytes).unwrap();
    let report = run(&clips, &output).unwrap();
    assert!(report.accepted.iter().all(|c| !c.resumed));
    assert!(fs::read(&output).unwrap() == expected);
}

#[test]
fn bad_options_and_places_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("a.y4m");
    common::write_clip(&clip, 1);
    let output = folder.path().join("l.pack");
    let bad = [
        Options { stride: 10, ..common::options() },
        Options { stride: 0, ..common::options() },
        Options { words: 0, ..common::options() },
        Options { words: 256, ..common::options() },
        Options { working: 10, ..common::options() },
        Options { moving_permille: 1001, ..common::options() },
        Options { tag: "a,b".into(), ..common::options() },
    ];
    for options in bad {
        let error = build(std::slice::from_ref(&clip), &output, &options, &Silent).unwrap_err();
        assert_eq!(error.kind(), Kind::Usage, "{error}");
    }
    assert_eq!(run(&[], &output).unwrap_err().kind(), Kind::Usage);
    assert_eq!(run(&[folder.path().join("none.mp4")], &output).unwrap_err().kind(), Kind::Io);
    assert_eq!(run(std::slice::from_ref(&clip), folder.path()).unwrap_err().kind(), Kind::Usage);
    assert!(run(&[clip], &folder.path().join("no/such/l.pack")).is_err());
    assert_eq!(names(folder.path()), ["a.y4m"]);
}

#[test]
fn a_mask_leaves_out_what_it_covers() {
    let folder = tempfile::tempdir().unwrap();
    let clip = folder.path().join("a.y4m");
    common::write_clip(&clip, 4);
    let plain = run(std::slice::from_ref(&clip), &folder.path().join("plain.pack")).unwrap();
    let mask = |width: usize| {
        let left = |x: usize, _| f32::from(u8::from(x < width / 2));
        let mask = enliven::raster::image::Plane::from_fn(width, 80, left);
        enliven::raster::picture_io::write_grey_png(&folder.path().join("a.mask.png"), &mask).unwrap();
    };
    mask(96);
    let masked = run(std::slice::from_ref(&clip), &folder.path().join("masked.pack")).unwrap();
    assert!(masked.pieces < plain.pieces, "{} of {} pieces", masked.pieces, plain.pieces);
    mask(50);
    let error = run(&[clip], &folder.path().join("bad.pack")).unwrap_err();
    assert!(error.to_string().contains("50 × 80"), "{error}");
}

#[test]
fn a_library_is_not_replaced_by_one_that_lacks_its_clips() {
    let folder = tempfile::tempdir().unwrap();
    let clips = common::write_clips(folder.path());
    let pack = folder.path().join("l.pack");
    run(&clips[..2], &pack).unwrap();
    let before = fs::read(&pack).unwrap();
    let error = run(&clips[1..], &pack).unwrap_err();
    assert!(error.to_string().contains("1 of its 2 clips") && error.to_string().contains("--replace"), "{error}");
    assert_eq!(fs::read(&pack).unwrap(), before);
    let report = build(&clips[1..], &pack, &Options { replace: true, ..common::options() }, &Silent).unwrap();
    assert!(report.accepted.len() == 2 && report.accepted.iter().any(|clip| clip.resumed));
    run(&clips, &pack).unwrap();
    assert_eq!(Pack::open(&pack).unwrap().clips().len(), 3);
}
