//! The pack: what is written is read back, and no damage passes unnoticed.

use std::io::Cursor;
use std::path::Path;
use std::sync::Arc;

use enliven::base::error::Kind;
use enliven::base::observe::Silent;
use enliven::base::{par, rng};
use enliven::descriptor::vocabulary::Vocabulary;
use enliven::library::assemble::{Tables, assemble};
use enliven::library::format::{BLOCK, MUST_UNDERSTAND, Parameters};
use enliven::library::grid::{Cell, CellGrid};
use enliven::library::metadata::{ClipMeta, Metadata, PieceCounts};
use enliven::library::normalizers::Normalizers;
use enliven::library::piece::{ClipId, PieceIx};
use enliven::library::reader::{Pack, Piece};
use enliven::library::segment::{Segment, SegmentMeta, SegmentWriter};
use enliven::library::store::{Access, AlignedBytes};
use enliven::library::variant::Variant;
use enliven::library::verify::verify;
use enliven::library::writer::Writer;
use enliven::raster::image::Rgb8;
use half::f16;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
const FRAMES: usize = 34;

fn parameters() -> Parameters {
    Parameters {
        rate: 25,
        stride: 16,
        words: 8,
        piece: 48,
        cell: 4,
        cell_bytes: 48,
        working: 640,
        moving_permille: 50,
        features: 1,
    }
}

fn frame(clip: u64, t: usize) -> Rgb8 {
    let mut frame = Rgb8::black(WIDTH, HEIGHT);
    for (i, byte) in frame.data.iter_mut().enumerate() {
        // A texture that moves a pixel a frame, with some noise.
        let place = (i + 3 * t) as u64;
        *byte = (rng::hash(clip, &[place]) % 200) as u8 + (rng::hash(9, &[clip, i as u64, t as u64]) % 5) as u8;
    }
    frame
}

fn grid(clip: u64, scale: u8) -> CellGrid {
    let mut grid = CellGrid::for_clip(WIDTH, HEIGHT, scale);
    for (i, cell) in grid.cells.iter_mut().enumerate() {
        let value = |k: u64| f16::from_f32(rng::unit(rng::hash(clip, &[u64::from(scale), i as u64, k])));
        let values: [f16; 24] = std::array::from_fn(|k| value(k as u64));
        *cell = bytemuck::cast(values);
    }
    grid
}

fn average(clip: u64) -> [Vec<u16>; 3] {
    std::array::from_fn(|c| (0..WIDTH * HEIGHT).map(|i| rng::hash(clip, &[c as u64, i as u64]) as u16).collect())
}

fn id(clip: u64) -> ClipId {
    ClipId([clip as u8; 32])
}

fn segment(clip: u64) -> Segment {
    let mut writer = SegmentWriter::new(Cursor::new(Vec::new()), Path::new("segment"), parameters(), WIDTH).unwrap();
    (0..FRAMES).for_each(|t| writer.push(&frame(clip, t)).unwrap());
    let meta = SegmentMeta {
        id: id(clip),
        width: WIDTH as u32,
        height: HEIGHT as u32,
        frames: FRAMES as u32,
        refusal: None,
        notes: Vec::new(),
    };
    let grids = [grid(clip, 0), grid(clip, 1), grid(clip, 2)];
    let bytes = writer.finish(&meta, &average(clip), &grids).unwrap().into_inner();
    Segment::from_bytes(Arc::new(AlignedBytes::copy_of(&bytes))).unwrap()
}

fn tables(clips: u64) -> Tables {
    let mut pieces = Vec::new();
    let mut metas = Vec::new();
    let mut variants: Vec<Variant> = Variant::all().collect();
    variants.sort();
    for clip in 0..clips {
        let first_piece = pieces.len() as u32;
        let mut counts = [PieceCounts::default(); Variant::COUNT];
        for &variant in &variants {
            let geometry = variant.geometry(WIDTH, HEIGHT);
            for x in (0..geometry.width).step_by(16) {
                for y in (0..geometry.height).step_by(16).filter(|&y| geometry.covers(x, y, 48)) {
                    counts[variant.index() as usize].kept += 1;
                    pieces.push(Piece::new(clip as u32, variant, x as u16, y as u16));
                }
            }
        }
        let (width, height, frames) = (WIDTH as u32, HEIGHT as u32, FRAMES as u32);
        metas.push(ClipMeta { id: id(clip), tag: "water".into(), width, height, frames, first_piece, counts });
    }
    let n = pieces.len();
    let word = |i: usize, p: usize| (rng::hash(3, &[i as u64, p as u64]) % 9) as u8;
    Tables {
        parameters: parameters(),
        metadata: Metadata { clips: metas, normalizers: Normalizers { dc: 0.5, ac: 2.0, texture: 3.0 } },
        vocabulary: Vocabulary::from_centers((0..8).flat_map(|i| [i as u8; 128]).collect()).unwrap(),
        pieces,
        words: (0..n).map(|i| std::array::from_fn(|p| word(i, p))).collect(),
    }
}

fn pack_bytes(clips: u64) -> Vec<u8> {
    let segments: Vec<Segment> = (0..clips).map(segment).collect();
    let out = Cursor::new(Vec::new());
    assemble(out, Path::new("test.pack"), &tables(clips), &segments, &Silent).unwrap().into_inner()
}

fn open(bytes: &[u8]) -> enliven::base::error::Result<Arc<Pack>> {
    Pack::from_bytes(Arc::new(AlignedBytes::copy_of(bytes)))
}

fn check(bytes: &[u8]) -> enliven::base::error::Result<()> {
    verify(&*open(bytes)?, &Silent).map(|_| ())
}

#[test]
fn what_is_written_is_read_back() {
    let pack = open(&pack_bytes(3)).unwrap();
    let tables = tables(3);
    assert_eq!(pack.clips(), tables.metadata.clips);
    assert_eq!(*pack.parameters(), parameters());
    assert_eq!(pack.normalizers().ac, 2.0);
    assert_eq!(pack.pieces().unwrap(), tables.pieces);
    assert_eq!(pack.words().unwrap(), tables.words);
    assert_eq!(pack.vocabulary().unwrap(), tables.vocabulary);
    for clip in 0..3u32 {
        let read: Vec<Rgb8> = pack.frames(clip).unwrap().map(|f| f.unwrap()).collect();
        assert_eq!(read.len(), FRAMES);
        for (t, image) in read.iter().enumerate() {
            assert_eq!(*image, frame(u64::from(clip), t), "clip {clip} frame {t}");
        }
        for scale in 0..3 {
            assert_eq!(pack.grid(clip, scale).unwrap().cells, grid(u64::from(clip), scale).cells);
        }
        let expected = average(u64::from(clip));
        let read = pack.average(clip).unwrap();
        for (plane, expected) in read.planes.iter().zip(expected) {
            assert!(plane.data.iter().zip(expected).all(|(v, e)| (v * 65535.0 - f32::from(e)).abs() < 0.01));
        }
    }
    let report = verify(&pack, &Silent).unwrap();
    assert_eq!((report.clips, report.frames, report.pieces), (3, 3 * FRAMES as u64, tables.pieces.len()));
}

#[test]
fn frames_can_be_asked_for_in_any_order() {
    let pack = open(&pack_bytes(2)).unwrap();
    let mut reader = pack.frames(1).unwrap();
    for t in [33, 0, 15, 16, 17, 20, 3, 3, 32, 31] {
        assert_eq!(reader.at(t).unwrap(), frame(1, t), "frame {t}");
        assert_eq!(pack.frame(1, t).unwrap(), frame(1, t), "frame {t}");
        assert_eq!(reader.luma_at(t).unwrap(), frame(1, t).luma(), "frame {t}");
    }
    assert_eq!(reader.at(FRAMES).unwrap_err().kind(), Kind::Usage);
    assert_eq!(pack.frame(2, 0).unwrap_err().kind(), Kind::Usage);
}

#[test]
fn tiles_are_the_cells_under_the_piece() {
    let pack = open(&pack_bytes(1)).unwrap();
    for i in 0..pack.piece_count() {
        let piece = pack.piece(PieceIx(i as u32)).unwrap();
        let tile = pack.tile(PieceIx(i as u32)).unwrap();
        if piece.variant().rotation != 0 {
            continue;
        }
        let grid = pack.grid(0, piece.variant().scale).unwrap();
        for y in 0..12 {
            for x in 0..12 {
                let column = piece.x as usize / 4 + x;
                let column = if piece.variant().flip { grid.width - 1 - column } else { column };
                let mut expected = grid.cells[(piece.y as usize / 4 + y) * grid.width + column];
                if piece.variant().flip {
                    expected.mean[0] = -expected.mean[0];
                }
                assert_eq!(tile.cells[y * 12 + x], expected, "piece {i} cell {x},{y}");
            }
        }
    }
}

#[test]
fn a_turned_tile_turns_its_vectors() {
    use enliven::library::tile::{GridView, Tile};
    let mut grid = CellGrid::for_clip(320, 240, 0);
    for (i, cell) in grid.cells.iter_mut().enumerate() {
        let (x, y) = (i % 80, i / 80);
        let level = f16::from_f32((x as f32 + 2.0 * y as f32) * 0.01);
        *cell = Cell { mean: [f16::from_f32(2.0), f16::ZERO], activity: level, ..Cell::default() };
    }
    for variant in Variant::all() {
        let geometry = variant.geometry(320, 240);
        if variant.scale > 0 {
            continue;
        }
        let (x, y) = (geometry.width / 8 * 4, geometry.height / 8 * 4);
        assert!(geometry.covers(x, y, 48));
        let tile = Tile::sample(&GridView::from(&grid), &geometry, x, y);
        let angle = variant.degrees().to_radians();
        let sign = if variant.flip { -1.0 } else { 1.0 };
        for (i, cell) in tile.cells.iter().enumerate() {
            let (u, v) = (cell.mean[0].to_f32(), cell.mean[1].to_f32());
            assert!((u - sign * 2.0 * angle.cos()).abs() < 2e-3 && (v - sign * 2.0 * angle.sin()).abs() < 2e-3);
            let centre = |origin: usize, k: usize| (origin + 4 * k + 2) as f32;
            let (lx, ly) = geometry.to_level(centre(x, i % 12), centre(y, i / 12));
            let expected = (lx / 4.0 - 0.5 + 2.0 * (ly / 4.0 - 0.5)) * 0.01;
            assert!((cell.activity.to_f32() - expected).abs() < 3e-3, "{variant:?} cell {i}");
        }
    }
}

/// Flips one bit of every byte of a small pack: opening or verifying must name an error each time.
#[test]
fn every_flipped_byte_is_found() {
    let bytes = pack_bytes(1);
    check(&bytes).unwrap();
    let parts = bytes.len().div_ceil(BLOCK);
    let unnoticed: Vec<Vec<usize>> = par::map(parts, |part| {
        let mut copy = Arc::new(AlignedBytes::copy_of(&bytes));
        let mut unnoticed = Vec::new();
        for at in part * BLOCK..((part + 1) * BLOCK).min(bytes.len()) {
            let flip = 1u8 << (rng::hash(5, &[at as u64]) % 8);
            Arc::get_mut(&mut copy).expect("the last pack is gone").as_mut()[at] ^= flip;
            let noticed = Pack::from_bytes(copy.clone()).and_then(|pack| verify(&pack, &Silent)).is_err();
            Arc::get_mut(&mut copy).expect("the last pack is gone").as_mut()[at] ^= flip;
            if !noticed {
                unnoticed.push(at);
            }
        }
        unnoticed
    });
    assert_eq!(unnoticed.concat(), Vec::<usize>::new());
}

#[test]
fn every_truncation_is_found() {
    let bytes = pack_bytes(1);
    for length in (0..bytes.len()).step_by(1024).chain([bytes.len() - 1, 1, 7, 8, 9]) {
        let error = check(&bytes[..length]).unwrap_err();
        assert_eq!(error.kind(), Kind::Data, "{length} bytes: {error}");
    }
    let longer = [&bytes[..], &[0]].concat();
    assert_eq!(check(&longer).unwrap_err().kind(), Kind::Data);
}

#[test]
fn foreign_files_are_named() {
    for foreign in [&b""[..], b"RIFF", b"\x89PNG\r\n\x1a\n and so on", &[0; 200_000]] {
        let error = open(foreign).map(|_| ()).unwrap_err();
        assert_eq!(error.kind(), Kind::Data);
        assert!(error.to_string().contains("not an Enliven pack"), "{error}");
    }
    // A segment has the container's magic, but not a pack's sections.
    let mut writer = Writer::new(Cursor::new(Vec::new()), Path::new("x"), parameters()).unwrap();
    writer.begin(*b"other\0\0\0", 1).unwrap();
    let bytes = writer.finish().unwrap().into_inner();
    assert_eq!(open(&bytes).map(|_| ()).unwrap_err().kind(), Kind::Unsupported);
}

/// A pack as a later version would write it: the sections of `bytes` and one more.
fn with_section(bytes: &[u8], minor: u16, flags: u32) -> Vec<u8> {
    let header = enliven::library::format::Header::parse("x", &bytes[..BLOCK], bytes.len() as u64).unwrap();
    let mut writer = Writer::new(Cursor::new(Vec::new()), Path::new("x"), header.parameters).unwrap();
    writer.minor(minor);
    for section in &header.sections {
        writer.begin_with_flags(section.id, section.row_bytes as usize, section.flags).unwrap();
        writer.write(&bytes[section.offset as usize..(section.offset + section.length) as usize]).unwrap();
    }
    writer.begin_with_flags(*b"novelty\0", 1, flags).unwrap();
    writer.write(&[7; 100]).unwrap();
    writer.finish().unwrap().into_inner()
}

#[test]
fn later_versions_are_read_or_refused_by_name() {
    let bytes = pack_bytes(1);
    check(&with_section(&bytes, 7, 0)).unwrap();
    let error = check(&with_section(&bytes, 7, MUST_UNDERSTAND)).unwrap_err();
    assert_eq!(error.kind(), Kind::Unsupported);
    assert!(error.to_string().contains("novelty"), "{error}");
    let mut major = bytes.clone();
    major[8] = 2;
    let error = check(&major).unwrap_err();
    assert_eq!(error.kind(), Kind::Unsupported);
    assert!(error.to_string().contains("version 2.x") && error.to_string().contains("newer Enliven"), "{error}");
}

/// The sections of `bytes` with some bytes changed and the checksums made right again.
fn forged(bytes: &[u8], seed: u64) -> Vec<u8> {
    let header = enliven::library::format::Header::parse("x", &bytes[..BLOCK], bytes.len() as u64).unwrap();
    let mut parameters = header.parameters;
    let random = |place: u64, n: u64| rng::below(rng::hash(seed, &[place]), n);
    if random(0, 8) == 0 {
        parameters.words = random(1, 300) as u32;
    }
    let victim = random(2, header.sections.len() as u64) as usize;
    let mut writer = Writer::new(Cursor::new(Vec::new()), Path::new("x"), parameters).unwrap();
    for (i, section) in header.sections.iter().enumerate() {
        let mut content = bytes[section.offset as usize..(section.offset + section.length) as usize].to_vec();
        if i == victim {
            for k in 0..1 + random(3, 4) {
                let at = random(10 + k, content.len() as u64) as usize;
                content[at] = [0, 1, 0x7f, 0x80, 0xff, random(20 + k, 256) as u8][random(30 + k, 6) as usize];
            }
            if random(4, 4) == 0 {
                let rows = content.len() / section.row_bytes as usize;
                content.truncate(random(5, rows as u64 + 1) as usize * section.row_bytes as usize);
            }
        }
        writer.begin_with_flags(section.id, section.row_bytes as usize, section.flags).unwrap();
        writer.write(&content).unwrap();
    }
    writer.finish().unwrap().into_inner()
}

/// Checksums find accidents; whoever forges them right must still get an error or a sound answer, never a panic.
#[test]
fn forged_packs_do_not_panic() {
    let bytes = pack_bytes(2);
    let outcomes = par::map(1500, |seed| {
        let Ok(pack) = open(&forged(&bytes, seed as u64)) else { return [1, 0, 0] };
        for i in 0..pack.piece_count() as u32 + 1 {
            let _ = (pack.piece_ref(PieceIx(i)).is_ok(), pack.tile(PieceIx(i)).is_ok());
        }
        for clip in 0..pack.clips().len() as u32 {
            let _ = (pack.average(clip).is_ok(), pack.frame(clip, 33).is_ok(), pack.grid(clip, 2).is_ok());
        }
        let _ = (pack.vocabulary().is_ok(), pack.words().is_ok());
        if verify(&pack, &Silent).is_err() { [0, 1, 0] } else { [0, 0, 1] }
    });
    let count = |k: usize| outcomes.iter().map(|o| o[k]).sum::<u32>();
    println!("{} refused at opening, {} by verify, {} sound", count(0), count(1), count(2));
    assert!(count(0) > 50 && count(1) > 50);
}

#[test]
fn files_are_mapped_or_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pack");
    std::fs::write(&path, pack_bytes(2)).unwrap();
    for access in [Access::Map, Access::Read] {
        let pack = Pack::open_with(&path, access).unwrap();
        verify(&pack, &Silent).unwrap();
        assert_eq!(pack.frame(1, 5).unwrap(), frame(1, 5));
    }
    let pack = Pack::open(&path).unwrap();
    let file = std::fs::OpenOptions::new().append(true).open(&path).unwrap();
    file.set_len(std::fs::metadata(&path).unwrap().len() + 1).unwrap();
    let error = pack.check_length().unwrap_err();
    assert!(error.to_string().contains("changed while in use"), "{error}");
    assert!(pack.words().is_err(), "blocks not yet checked are not read from a file that changed");
    let error = Pack::open(&folder.path().join("none.pack")).map(|_| ()).unwrap_err();
    assert!(error.to_string().contains("enliven-db build"), "{error}");
    assert_eq!(Pack::open(folder.path()).map(|_| ()).unwrap_err().kind(), Kind::Data);
}

#[test]
fn a_locked_pack_is_not_opened() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.pack");
    std::fs::write(&path, pack_bytes(1)).unwrap();
    let file = std::fs::File::open(&path).unwrap();
    file.lock().unwrap();
    assert!(Pack::open(&path).map(|_| ()).unwrap_err().to_string().contains("another program"));
    file.unlock().unwrap();
    let pack = Pack::open(&path).unwrap();
    assert!(file.try_lock().is_err(), "an open pack holds a shared lock");
    drop(pack);
    file.try_lock().unwrap();
}
