//! What is written can be read back: the right frames, colours, times, and nothing half-written.

use std::fs;
use std::path::{Path, PathBuf};

use enliven::base::error::Kind;
use enliven::base::par;
use enliven::base::rng;
use enliven::raster::image::Rgb8;
use enliven::raster::picture_io::read_picture;
use enliven::video::clip::{ClipInfo, Matrix, Pixels, Range, RawFrame, Turn};
use enliven::video::conform::scale::to_rgb8;
use enliven::video::read::source;
use enliven::video::write::options::{FrameRate, SinkOptions};
use enliven::video::write::sink;
use enliven::video::yuv;
use image::AnimationDecoder;
use proptest::prelude::*;

/// Flat colours, the corners of the cube and some between.
const COLOURS: [[u8; 3]; 8] = [
    [255, 255, 255],
    [0, 0, 0],
    [200, 30, 30],
    [30, 200, 30],
    [30, 30, 200],
    [128, 128, 128],
    [240, 140, 20],
    [20, 90, 120],
];

/// Three rows of flat patches: the frame number in binary, eight colours, and eight that change with time.
fn patches(width: usize, height: usize, t: usize) -> Rgb8 {
    let mut frame = Rgb8::black(width, height);
    for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
        let (column, row) = (i % width * 8 / width, i / width * 3 / height);
        let colour = match row {
            0 if t >> column & 1 == 1 => [255; 3],
            0 => [0; 3],
            1 => COLOURS[column],
            _ => COLOURS[(column + t) % 8],
        };
        pixel.copy_from_slice(&colour);
    }
    frame
}

/// Patches with grain: hard to code, as water is.
fn grainy(width: usize, height: usize, t: usize) -> Rgb8 {
    let mut frame = patches(width, height, t);
    for (i, value) in frame.data.iter_mut().enumerate() {
        let noise = rng::unit(rng::hash(1, &[t as u64, i as u64])) - 0.5;
        *value = (f32::from(*value) * 0.8 + 25.0 + 16.0 * noise) as u8;
    }
    frame
}

fn options(width: usize, height: usize, fps: f64) -> SinkOptions {
    SinkOptions { width, height, rate: FrameRate::new(fps).unwrap(), loops: true, alpha: false }
}

fn write(path: &Path, frames: &[Rgb8], fps: f64) {
    let mut sink = sink::create(path, options(frames[0].width, frames[0].height, fps)).unwrap();
    frames.iter().for_each(|frame| sink.push(frame).unwrap());
    sink.finish().unwrap();
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<_> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

fn number(bytes: &[u8]) -> usize {
    bytes.iter().fold(0, |sum, &b| sum << 8 | usize::from(b))
}

/// Content of the boxes on the way `path`, each the first of its name.
fn find_box<'a>(mut bytes: &'a [u8], path: &[&str]) -> &'a [u8] {
    let Some((name, rest)) = path.split_first() else { return bytes };
    loop {
        let long = number(&bytes[..4]) == 1;
        let (head, length) = if long { (16, number(&bytes[8..16])) } else { (8, number(&bytes[..4])) };
        if &bytes[4..8] == name.as_bytes() {
            // Children of a sample description come after its own fields.
            let skip = match *name {
                "stsd" => 8,
                "avc1" => 78,
                _ => 0,
            };
            return find_box(&bytes[head + skip..length], rest);
        }
        assert!(length >= 8);
        bytes = &bytes[length..];
    }
}

const TABLES: [&str; 5] = ["moov", "trak", "mdia", "minf", "stbl"];

fn table<'a>(file: &'a [u8], name: &str) -> &'a [u8] {
    find_box(file, &[&TABLES[..], &[name]].concat())
}

/// Decodes by the tables alone: offsets, sizes, parameter sets; luma and chroma planes of every frame.
fn decode_mp4(file: &[u8]) -> Vec<rusty_h264::YuvFrame> {
    let record = table(file, "stsd");
    let record = find_box(record, &["avc1", "avcC"]);
    let sps_length = number(&record[6..8]);
    let pps_at = 8 + sps_length + 1;
    let pps = &record[pps_at + 2..][..number(&record[pps_at..pps_at + 2])];
    let mut stream = [&[0, 0, 1][..], &record[8..8 + sps_length], &[0, 0, 1], pps].concat();
    let (sizes, chunks, runs) = (table(file, "stsz"), table(file, "co64"), table(file, "stsc"));
    let sizes: Vec<usize> = sizes[12..].chunks(4).map(number).collect();
    let per_chunk = number(&runs[12..16]);
    for (chunk, at) in chunks[8..].chunks(8).map(number).enumerate() {
        let mut at = at;
        for &size in sizes.iter().skip(chunk * per_chunk).take(per_chunk) {
            let mut sample = &file[at..at + size];
            while !sample.is_empty() {
                let length = number(&sample[..4]);
                stream.extend([0, 0, 1]);
                stream.extend(&sample[4..4 + length]);
                sample = &sample[4 + length..];
            }
            at += size;
        }
    }
    rusty_h264::Decoder::new().decode_stream(&stream).unwrap()
}

fn psnr(a: &[u8], b: &[u8]) -> f64 {
    assert_eq!(a.len(), b.len());
    let error: f64 = a.iter().zip(b).map(|(a, b)| (f64::from(*a) - f64::from(*b)).powi(2)).sum();
    10.0 * (255.0f64.powi(2) * a.len() as f64 / error.max(1e-9)).log10()
}

#[test]
fn mp4_holds_the_frames_near_losslessly() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let frames: Vec<Rgb8> = (0..30).map(|t| grainy(160, 96, t)).collect();
    write(&path, &frames, 25.0);
    let decoded = decode_mp4(&fs::read(&path).unwrap());
    assert_eq!(decoded.len(), 30);
    for (t, (out, frame)) in decoded.iter().zip(&frames).enumerate() {
        let [y, u, v] = yuv::from_rgb8(frame, Matrix::Bt709, Range::Limited);
        assert!(psnr(&out.y, &y) > 40.0, "{t}: {}", psnr(&out.y, &y));
        assert!(psnr(&out.u, &u) > 40.0 && psnr(&out.v, &v) > 40.0, "{t}");
    }
    assert_eq!(names(folder.path()), ["a.mp4"]);
}

/// Pixels of a flat patch.
const PATCH: usize = 48;

/// Flat patches of the colours whose channels are 0, 128 or 255, and of greys, eight in a row.
fn saturated() -> (Rgb8, Vec<[u8; 3]>) {
    let level = |i: usize, place: u32| [0, 128, 255][i / 3usize.pow(place) % 3];
    let corners = (0..27).map(|i| [0, 1, 2].map(|place| level(i, place)));
    let greys = (0..37).map(|i| [(i * 7) as u8; 3]);
    let colours: Vec<[u8; 3]> = corners.chain(greys).collect();
    let side = 8 * PATCH;
    let mut frame = Rgb8::black(side, side);
    for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
        pixel.copy_from_slice(&colours[i / side / PATCH * 8 + i % side / PATCH]);
    }
    (frame, colours)
}

#[test]
fn flat_colours_come_back_from_mp4_within_two_of_255() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let (frame, colours) = saturated();
    write(&path, &vec![frame; 6], 25.0);
    let mut source = source::open(&path).unwrap();
    let mut count = 0;
    while let Some(raw) = source.next_frame().unwrap() {
        let shown = to_rgb8(&raw);
        for (i, colour) in colours.iter().enumerate() {
            // Blocks that touch another colour are not flat.
            for (x, y) in (16..PATCH - 16).flat_map(|x| (16..PATCH - 16).map(move |y| (x, y))) {
                let out = shown.pixel(i % 8 * PATCH + x, i / 8 * PATCH + y);
                let off = out.iter().zip(colour).map(|(a, b)| a.abs_diff(*b)).max();
                assert!(off <= Some(2), "frame {count}: {colour:?} came back as {out:?}");
            }
        }
        count += 1;
    }
    assert_eq!(count, 6);
}

#[test]
fn mp4_says_its_times_keyframes_and_colours() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    for (fps, per_second, exact) in [
        (23.976, 23, (24000, 1001)),
        (25.0, 25, (25, 1)),
        (29.97, 29, (30000, 1001)),
        (30.0, 30, (30, 1)),
        (60.0, 60, (60, 1)),
    ] {
        let frames: Vec<Rgb8> = (0..70).map(|t| patches(64, 48, t)).collect();
        write(&path, &frames, fps);
        let file = fs::read(&path).unwrap();
        let media = find_box(&file, &["moov", "trak", "mdia", "mdhd"]);
        let (timescale, duration) = (number(&media[20..24]), number(&media[24..32]));
        assert_eq!(duration * exact.0, 70 * timescale * exact.1, "{fps}");
        let times = table(&file, "stts");
        assert_eq!(number(&times[8..12]), 70);
        assert_eq!(number(&times[12..16]) * exact.0, timescale * exact.1);
        let keyframes: Vec<usize> = table(&file, "stss")[8..].chunks(4).map(number).collect();
        // One a second; the last group may be encoded in two parts, each from a keyframe of its own.
        let (seconds, more) = keyframes.split_at(70usize.div_ceil(per_second));
        assert_eq!(seconds, (1..=70).step_by(per_second).collect::<Vec<_>>(), "{fps}");
        assert!(more.len() <= 1 && more.iter().all(|m| m > &seconds[seconds.len() - 1]), "{fps}: {more:?}");
        let colour = find_box(table(&file, "stsd"), &["avc1", "colr"]);
        assert_eq!(colour, b"nclx\0\x01\0\x01\0\x01\0");
        // Tables first, so that it plays while it loads.
        assert_eq!(&file[4..8], b"ftyp");
        assert_eq!(&file[number(&file[..4]) + 4..][..4], b"moov");
    }
}

#[test]
fn slow_and_large_videos_have_keyframes_where_they_may() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    let keyframes = |fps: f64, frames: &[Rgb8]| -> Vec<usize> {
        write(&path, frames, fps);
        let file = fs::read(&path).unwrap();
        assert_eq!(decode_mp4(&file).len(), frames.len());
        table(&file, "stss")[8..].chunks(4).map(number).collect()
    };
    // One after the other would need numbers of their own.
    let frames: Vec<Rgb8> = (0..5).map(|t| patches(32, 32, t)).collect();
    assert_eq!(keyframes(1.0, &frames), [1, 3, 5]);
    // 64 MiB are seven frames of 2560 × 2304.
    let frames = vec![patches(2560, 2304, 1); 9];
    assert_eq!(keyframes(25.0, &frames), [1, 8]);
}

#[test]
fn odd_sizes_gain_a_copy_of_the_edge_in_mp4() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.mp4");
    for (width, height) in [(63, 47), (1, 1), (64, 47), (17, 2)] {
        let frames: Vec<Rgb8> = (0..3).map(|t| patches(width, height, t)).collect();
        write(&path, &frames, 25.0);
        let decoded = decode_mp4(&fs::read(&path).unwrap());
        assert_eq!((decoded[0].width, decoded[0].height), (width.next_multiple_of(2), height.next_multiple_of(2)));
        assert_eq!(decoded.len(), 3);
    }
}

#[test]
fn the_same_frames_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Rgb8> = (0..40).map(|t| grainy(96, 64, t)).collect();
    for name in ["a.mp4", "a.gif", "a.webp", "a.apng", "a.y4m"] {
        let path = folder.path().join(name);
        let bytes = [1, 2, 3].map(|threads| {
            par::with_threads(threads, || write(&path, &frames, 25.0)).unwrap();
            fs::read(&path).unwrap()
        });
        assert!(bytes[0] == bytes[1] && bytes[0] == bytes[2], "{name}");
    }
}

/// Frames as a viewer shows them, with their delays in 1/100 s.
fn decode_gif(path: &Path) -> (Vec<Rgb8>, Vec<u16>, gif::Repeat) {
    let mut options = gif::DecodeOptions::new();
    options.set_color_output(gif::ColorOutput::RGBA);
    let mut decoder = options.read_info(fs::File::open(path).unwrap()).unwrap();
    let (width, height) = (usize::from(decoder.width()), usize::from(decoder.height()));
    let mut shown = Rgb8::black(width, height);
    let (mut frames, mut delays) = (Vec::new(), Vec::new());
    while let Some(frame) = decoder.read_next_frame().unwrap() {
        let (left, top, columns) = (usize::from(frame.left), usize::from(frame.top), usize::from(frame.width));
        for (i, pixel) in frame.buffer.chunks_exact(4).enumerate().filter(|(_, p)| p[3] != 0) {
            let at = ((top + i / columns) * width + left + i % columns) * 3;
            shown.data[at..at + 3].copy_from_slice(&pixel[..3]);
        }
        delays.push(frame.delay);
        frames.push(shown.clone());
    }
    (frames, delays, decoder.repeat())
}

#[test]
fn gif_holds_the_frames_and_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gif");
    for (fps, delays) in [(25.0, vec![4]), (30.0, vec![3, 4, 3]), (24.0, vec![4, 4, 5, 4])] {
        let frames: Vec<Rgb8> = (0..24).map(|t| patches(67, 45, t)).collect();
        write(&path, &frames, fps);
        let (decoded, times, repeat) = decode_gif(&path);
        assert_eq!(repeat, gif::Repeat::Infinite);
        assert_eq!(decoded.len(), 24);
        let total: u32 = times.iter().map(|&d| u32::from(d)).sum();
        assert!((f64::from(total) / 100.0 - 24.0 / fps).abs() < 0.006, "{fps}: {total}");
        assert!(times.iter().all(|d| delays.contains(d)), "{fps}: {times:?}");
        for (out, frame) in decoded.iter().zip(&frames) {
            assert!(out.data.iter().zip(&frame.data).all(|(a, b)| a.abs_diff(*b) <= 2));
        }
    }
    write(&path, &(0..60).map(|t| patches(32, 24, t)).collect::<Vec<_>>(), 60.0);
    let (_, times, _) = decode_gif(&path);
    assert!(times.iter().all(|&d| d >= 2) && times.iter().map(|&d| u32::from(d)).sum::<u32>() == 100);
}

#[test]
fn gif_does_not_flicker_where_nothing_moves() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.gif");
    let still = grainy(80, 60, 0);
    let frames: Vec<Rgb8> = (0..6)
        .map(|t| {
            let mut frame = grainy(80, 60, t);
            frame.data[..80 * 30 * 3].copy_from_slice(&still.data[..80 * 30 * 3]);
            frame
        })
        .collect();
    write(&path, &frames, 25.0);
    let (decoded, _, _) = decode_gif(&path);
    for frame in &decoded {
        assert_eq!(frame.data[..80 * 30 * 3], decoded[0].data[..80 * 30 * 3]);
        assert_eq!(frame.data.len(), still.data.len());
    }
    assert!(psnr(&decoded[3].data, &frames[3].data) > 28.0);
}

type Shown = (Vec<Vec<u8>>, Vec<u64>);

/// Frames of an animated WebP or PNG as the `image` crate composes them (colours and opacity), with their times in
/// microseconds.
fn decode_animation(path: &Path) -> Shown {
    let input = std::io::BufReader::new(fs::File::open(path).unwrap());
    let frames = if path.extension().unwrap() == "webp" {
        let decoder = image::codecs::webp::WebPDecoder::new(input).unwrap();
        assert!(matches!(decoder.loop_count(), image::metadata::LoopCount::Infinite));
        decoder.into_frames()
    } else {
        let decoder = image::codecs::png::PngDecoder::new(input).unwrap().apng().unwrap();
        assert!(matches!(decoder.loop_count(), image::metadata::LoopCount::Infinite));
        decoder.into_frames()
    };
    let frame = |frame: image::ImageResult<image::Frame>| {
        let frame = frame.unwrap();
        let (numerator, denominator) = frame.delay().numer_denom_ms();
        (frame.into_buffer().into_raw(), u64::from(numerator) * 1000 / u64::from(denominator))
    };
    frames.map(frame).unzip()
}

fn with_opacity(frame: &Rgb8, alpha: impl Fn(usize) -> u8) -> Vec<u8> {
    let pixel = |(i, p): (usize, &[u8])| [p[0], p[1], p[2], alpha(i)];
    frame.data.chunks_exact(3).enumerate().flat_map(pixel).collect()
}

#[test]
fn webp_and_apng_are_exact_and_keep_their_times() {
    let folder = tempfile::tempdir().unwrap();
    let still = grainy(67, 45, 0);
    // Noise in a corner, patches that change, and frames that do not.
    let frame = |t: usize| {
        let (mut frame, noise) = (still.clone(), grainy(67, 45, t / 2));
        for y in 20..45 {
            frame.data[(y * 67 + 30) * 3..(y * 67 + 67) * 3]
                .copy_from_slice(&noise.data[(y * 67 + 30) * 3..(y * 67 + 67) * 3]);
        }
        frame
    };
    for name in ["a.webp", "a.apng", "b.png"] {
        let path = folder.path().join(name);
        for fps in [24.0, 25.0, 29.97, 30.0, 7.3, 60.0, 89.123] {
            let frames: Vec<Rgb8> = (0..24).map(frame).collect();
            write(&path, &frames, fps);
            let (decoded, times) = decode_animation(&path);
            assert_eq!(decoded.len(), 24);
            for (t, (out, frame)) in decoded.iter().zip(&frames).enumerate() {
                // Readers of WebP may round what is laid over.
                let off = out.iter().zip(with_opacity(frame, |_| 255)).map(|(a, b)| a.abs_diff(b)).max();
                assert!(off <= Some(u8::from(name == "a.webp")), "{name} {t} {off:?}");
            }
            let total: u64 = times.iter().sum();
            assert!((total as f64 / 1e6 - 24.0 / fps).abs() < 0.0006, "{name} {fps}: {total}");
            assert!(times.iter().all(|&d| (d as f64 / 1e6 - 1.0 / fps).abs() < 0.001), "{name} {fps}: {times:?}");
        }
        // Faster than browsers show: frames are left out, the speed is kept.
        write(&path, &(0..120).map(|t| patches(32, 24, t)).collect::<Vec<_>>(), 120.0);
        let (_, times) = decode_animation(&path);
        assert!(
            times.iter().all(|&d| d > 10_000) && times.iter().sum::<u64>().abs_diff(1_000_000) < 12_000,
            "{times:?}"
        );
    }
    assert_eq!(names(folder.path()), ["a.apng", "a.webp", "b.png"]);
}

/// A disc that grows and wanders, with a soft edge.
fn disc(width: usize, height: usize, t: usize) -> Vec<u8> {
    let alpha = |i: usize| {
        let (x, y) = ((i % width) as f32 - 10.0 - 2.0 * t as f32, (i / width) as f32 - 20.0);
        (40.0 * (9.0 + t as f32 - x.hypot(y))).clamp(0.0, 255.0) as u8
    };
    (0..width * height).map(alpha).collect()
}

fn write_with_alpha(path: &Path, frames: &[(Rgb8, Vec<u8>)]) {
    let options = SinkOptions { alpha: true, ..options(frames[0].0.width, frames[0].0.height, 25.0) };
    let mut sink = sink::create(path, options).unwrap();
    frames.iter().for_each(|(frame, alpha)| sink.push_with_alpha(frame, alpha).unwrap());
    sink.finish().unwrap();
}

#[test]
fn opacity_is_kept_where_the_format_holds_it() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<(Rgb8, Vec<u8>)> = (0..9).map(|t| (grainy(61, 40, t / 2), disc(61, 40, t))).collect();
    // What cannot be seen has no colour.
    let expected = |(frame, alpha): &(Rgb8, Vec<u8>)| {
        let mut pixels = with_opacity(frame, |i| alpha[i]);
        pixels.chunks_exact_mut(4).filter(|p| p[3] == 0).for_each(|p| p.fill(0));
        pixels
    };
    for name in ["a.webp", "a.apng"] {
        write_with_alpha(&folder.path().join(name), &frames);
        let (decoded, _) = decode_animation(&folder.path().join(name));
        assert_eq!(decoded.len(), 9);
        decoded.iter().zip(&frames).for_each(|(out, frame)| assert!(*out == expected(frame), "{name}"));
    }
    write_with_alpha(&folder.path().join("frames"), &frames);
    for (t, (frame, alpha)) in frames.iter().enumerate() {
        let read = read_picture(&folder.path().join(format!("frames/{t:05}.png"))).unwrap();
        assert_eq!((&read.rgb, read.alpha.as_ref()), (frame, Some(alpha)));
    }
    // In GIF a pixel is seen from one half on, and nothing of an earlier frame stays.
    let path = folder.path().join("a.gif");
    write_with_alpha(&path, &frames);
    let decoder = image::codecs::gif::GifDecoder::new(std::io::BufReader::new(fs::File::open(&path).unwrap())).unwrap();
    let decoded = decoder.into_frames().collect_frames().unwrap();
    assert_eq!(decoded.len(), 9);
    for (out, (frame, alpha)) in decoded.iter().zip(&frames) {
        let pixels = out.buffer().as_raw().chunks_exact(4).zip(frame.data.chunks_exact(3)).zip(alpha);
        for ((out, sent), &alpha) in pixels {
            assert_eq!(out[3] == 255, alpha >= 128);
            assert!(alpha < 128 || out.iter().zip(sent).all(|(a, b)| a.abs_diff(*b) < 60));
        }
    }
}

#[test]
fn opacity_is_refused_where_it_is_lost() {
    let folder = tempfile::tempdir().unwrap();
    let with = SinkOptions { alpha: true, ..options(32, 32, 25.0) };
    for name in ["a.mp4", "a.y4m", "-"] {
        let error = sink::create(&folder.path().join(name), with).err().filter(|_| name != "-");
        let error = error.unwrap_or_else(|| sink::create(Path::new("-"), with).err().unwrap());
        assert_eq!(error.kind(), Kind::Usage);
        assert!(error.to_string().contains("carries no opacity") && error.to_string().contains(".webp"), "{error}");
    }
    assert!(names(folder.path()).is_empty());
    for name in ["a.gif", "a.webp", "a.apng", "frames", "a.mp4", "a.y4m"] {
        let mut sink = sink::create(&folder.path().join(name), options(32, 32, 25.0)).unwrap();
        assert!(sink.push_with_alpha(&patches(32, 32, 0), &[255; 32 * 32]).is_err(), "{name}");
    }
    for name in ["a.gif", "a.webp", "a.apng", "frames"] {
        let mut sink = sink::create(&folder.path().join(name), with).unwrap();
        let error = sink.push_with_alpha(&patches(32, 32, 0), &[255; 9]).unwrap_err();
        assert!(error.to_string().contains("opacity of 9 pixels"), "{error}");
    }
}

#[test]
fn png_folders_are_exact_and_replaced_whole() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("frames");
    for count in [5, 3] {
        let frames: Vec<Rgb8> = (0..count).map(|t| grainy(33, 21, t + count)).collect();
        write(&path, &frames, 25.0);
        assert_eq!(names(&path).len(), count);
        for (t, frame) in frames.iter().enumerate() {
            assert_eq!(&read_picture(&path.join(format!("{t:05}.png"))).unwrap().rgb, frame);
        }
    }
    fs::write(path.join("notes.txt"), "mine").unwrap();
    let error = sink::create(&path, options(33, 21, 25.0)).err().unwrap();
    assert!(error.to_string().contains("notes.txt"), "{error}");
    assert!(sink::check_writable(&path).is_err());
    assert_eq!(names(&path).len(), 4);
}

#[test]
fn y4m_has_a_header_and_whole_frames() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.y4m");
    write(&path, &[patches(33, 21, 0), patches(33, 21, 1)], 29.97);
    let bytes = fs::read(&path).unwrap();
    let header = b"YUV4MPEG2 W33 H21 F30000:1001 Ip A1:1 C420mpeg2 XCOLORRANGE=LIMITED\n";
    assert!(bytes.starts_with(header));
    assert_eq!(bytes.len(), header.len() + 2 * (6 + 33 * 21 + 2 * 17 * 11));
}

#[test]
fn a_dropped_sink_leaves_nothing_and_the_old_file_stays() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mp4", "a.gif", "a.webp", "a.apng", "a.y4m", "frames"] {
        let path = folder.path().join(name);
        let mut sink = sink::create(&path, options(32, 32, 25.0)).unwrap();
        (0..3).for_each(|t| sink.push(&patches(32, 32, t)).unwrap());
        drop(sink);
        assert!(names(folder.path()).is_empty(), "{name}");
        let empty = sink::create(&path, options(32, 32, 25.0)).unwrap();
        assert_eq!(empty.finish().unwrap_err().kind(), Kind::Unusable);
        assert!(names(folder.path()).is_empty(), "{name}");
    }
    let path = folder.path().join("a.mp4");
    fs::write(&path, "old").unwrap();
    let mut sink = sink::create(&path, options(32, 32, 25.0)).unwrap();
    sink.push(&patches(32, 32, 0)).unwrap();
    drop(sink);
    assert_eq!(fs::read(&path).unwrap(), b"old");
}

#[test]
fn places_that_cannot_be_written_are_told_before_any_work() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("file"), "").unwrap();
    for parent in ["missing", "file"] {
        for name in ["a.mp4", "a.gif", "a.webp", "a.apng", "a.y4m", "frames"] {
            let path: PathBuf = folder.path().join(parent).join(name);
            let error = sink::check_writable(&path).unwrap_err();
            assert_eq!(error.kind(), Kind::Io, "{error}");
            assert!(error.to_string().contains("write elsewhere"), "{error}");
            assert!(sink::create(&path, options(32, 32, 25.0)).is_err());
        }
    }
    // A file where a folder of frames should be.
    assert!(sink::check_writable(&folder.path().join("file")).is_err());
    assert_eq!(fs::read(folder.path().join("file")).unwrap(), b"");
    assert_eq!(sink::check_writable(&folder.path().join("a.xyz")).unwrap_err().kind(), Kind::Usage);
    for (width, height) in [(0, 10), (10, 0), (20_000, 10), (8192, 8192)] {
        let error = sink::create(&folder.path().join("a.mp4"), options(width, height, 25.0)).err().unwrap();
        assert_eq!(error.kind(), Kind::Limit, "{error}");
    }
    assert_eq!(names(folder.path()), ["file"]);
}

#[test]
fn frames_of_another_size_are_refused() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["a.mp4", "a.gif", "a.webp", "a.apng", "a.y4m", "frames"] {
        let mut sink = sink::create(&folder.path().join(name), options(32, 32, 25.0)).unwrap();
        let error = sink.push(&patches(32, 16, 0)).unwrap_err();
        assert!(error.to_string().contains("32 × 16"), "{error}");
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn any_small_video_has_its_frames(width in 1usize..50, height in 1usize..50, count in 1usize..5, seed in 0usize..99) {
        let folder = tempfile::tempdir().unwrap();
        let frames: Vec<Rgb8> = (0..count).map(|t| grainy(width, height, t + seed)).collect();
        let (mp4, gif) = (folder.path().join("a.mp4"), folder.path().join("a.gif"));
        for name in ["a.webp", "a.apng"] {
            let path = folder.path().join(name);
            write(&path, &frames, 30.0);
            let opaque: Vec<Vec<u8>> = frames.iter().map(|f| with_opacity(f, |_| 255)).collect();
            let decoded = decode_animation(&path).0;
            prop_assert_eq!(decoded.len(), count);
            prop_assert!(decoded.concat().iter().zip(opaque.concat()).all(|(a, b)| a.abs_diff(b) <= 1));
        }
        write(&mp4, &frames, 30.0);
        write(&gif, &frames, 30.0);
        prop_assert_eq!(decode_mp4(&fs::read(&mp4).unwrap()).len(), count);
        let decoded = decode_gif(&gif).0;
        prop_assert_eq!(decoded.len(), count);
        prop_assert_eq!((decoded[0].width, decoded[0].height), (width, height));
    }
}

/// Frames and times in nanoseconds, as our own reader gives them.
fn read_back(path: &Path) -> (Vec<RawFrame>, ClipInfo) {
    let mut source = source::open(path).unwrap();
    let frames = std::iter::from_fn(|| source.next_frame().unwrap()).collect();
    (frames, source.info().clone())
}

#[test]
fn our_own_reader_reads_what_we_write() {
    let folder = tempfile::tempdir().unwrap();
    let frames: Vec<Rgb8> = (0..30).map(|t| grainy(96, 64, t)).collect();
    for (name, tagged) in [("a.mp4", Matrix::Bt709), ("a.y4m", Matrix::Bt601)] {
        let path = folder.path().join(name);
        write(&path, &frames, 29.97);
        let (read, info) = read_back(&path);
        assert_eq!((read.len(), info.width, info.height, info.turn), (30, 96, 64, Turn::None), "{name}");
        for (t, (out, frame)) in read.iter().zip(&frames).enumerate() {
            assert!(out.time_ns.abs_diff(t as u64 * 1_001_000_000 / 30) < 1000, "{name} {t}: {}", out.time_ns);
            let Pixels::Yuv { planes, matrix, range, .. } = &out.pixels else { panic!("{name}: not Y'CbCr") };
            assert_eq!((*matrix, *range), (tagged, Range::Limited), "{name}");
            let sent = yuv::from_rgb8(frame, tagged, Range::Limited);
            assert!(planes.iter().zip(&sent).all(|(a, b)| psnr(a, b) > 40.0), "{name} {t}");
        }
    }
    for name in ["a.gif", "a.webp", "a.apng", "frames"] {
        let path = folder.path().join(name);
        write(&path, &frames, 25.0);
        assert_eq!(read_back(&path).0.len(), 30, "{name}");
    }
}
