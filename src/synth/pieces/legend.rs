//! A legend beside the picture of which clip went where: per clip its colour, its number and its share.

use crate::raster::image::Rgb8;
use crate::synth::record::ClipShare;

/// Pixels of the picture per dot of a sign, 3 × 5 dots each.
const DOT: usize = 2;
/// Height of a row, pixels.
const ROW: usize = 18;
/// Side of a swatch of colour, pixels.
const SWATCH: usize = 12;
/// Width of a column, pixels: swatch, number of up to three digits, share of up to four signs.
const COLUMN: usize = 92;
/// Left edges of the three within a column.
const EDGES: [usize; 3] = [8, 28, 58];
const GROUND: u8 = 24;
const INK: u8 = 230;

/// The picture with columns at its right, as many as its height asks for: a row for every clip, in the order of the
/// record, with the swatch of its colour, its number there, and its share of the nodes in percent.
pub fn with_legend(picture: &Rgb8, clips: &[ClipShare]) -> Rgb8 {
    let rows = (picture.height / ROW).max(1);
    let width = picture.width + clips.len().div_ceil(rows) * COLUMN;
    let mut out = Rgb8 { width, height: picture.height, data: vec![GROUND; width * picture.height * 3] };
    for (row, source) in out.data.chunks_exact_mut(3 * width).zip(picture.data.chunks_exact(3 * picture.width)) {
        row[..source.len()].copy_from_slice(source);
    }
    for (i, clip) in clips.iter().enumerate() {
        let (x, y) = (picture.width + i / rows * COLUMN, i % rows * ROW + (ROW - SWATCH) / 2);
        fill(&mut out, (x + EDGES[0], y), (SWATCH, SWATCH), clip.colour);
        write(&mut out, (x + EDGES[1], y + 1), &clip.number.to_string());
        write(&mut out, (x + EDGES[2], y + 1), &percent(clip.share));
    }
    out
}

fn percent(share: f64) -> String {
    if share > 0.0 && share < 0.005 { "<1%".to_owned() } else { format!("{:.0}%", 100.0 * share) }
}

/// Writes signs from left to right; what has none is a gap.
fn write(out: &mut Rgb8, (x, y): (usize, usize), text: &str) {
    for (i, sign) in text.chars().enumerate() {
        for (j, row) in dots(sign).into_iter().enumerate() {
            for k in (0..3).filter(|k| row & (4 >> k) != 0) {
                fill(out, (x + (4 * i + k) * DOT, y + j * DOT), (DOT, DOT), [INK; 3]);
            }
        }
    }
}

/// The rows of a sign, three bits each, the leftmost dot the highest.
fn dots(sign: char) -> [u8; 5] {
    match sign {
        '0' => [7, 5, 5, 5, 7],
        '1' => [2, 6, 2, 2, 7],
        '2' => [7, 1, 7, 4, 7],
        '3' => [7, 1, 3, 1, 7],
        '4' => [5, 5, 7, 1, 1],
        '5' => [7, 4, 7, 1, 7],
        '6' => [7, 4, 7, 5, 7],
        '7' => [7, 1, 2, 2, 2],
        '8' => [7, 5, 7, 5, 7],
        '9' => [7, 5, 7, 1, 7],
        '%' => [5, 1, 2, 4, 5],
        '<' => [1, 2, 4, 2, 1],
        _ => [0; 5],
    }
}

/// Fills a rectangle, as far as it lies on the picture.
fn fill(out: &mut Rgb8, (x, y): (usize, usize), (width, height): (usize, usize), colour: [u8; 3]) {
    let (x, end) = (x.min(out.width), (x + width).min(out.width));
    for row in out.data.chunks_exact_mut(3 * out.width).skip(y).take(height) {
        row[3 * x..3 * end].chunks_exact_mut(3).for_each(|pixel| pixel.copy_from_slice(&colour));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn share(number: usize, share: f64, colour: [u8; 3]) -> ClipShare {
        ClipShare { number, share, colour, ..ClipShare::default() }
    }

    #[test]
    fn every_clip_has_its_swatch_number_and_share_beside_the_picture() {
        let picture = Rgb8 { width: 50, height: 60, data: (0..50 * 60 * 3).map(|i| i as u8).collect() };
        let clips: Vec<ClipShare> = (0..5).map(|i| share(i + 1, 0.2, [200, i as u8, 9])).collect();
        let out = with_legend(&picture, &clips);
        assert_eq!((out.width, out.height), (50 + 2 * COLUMN, 60));
        assert!((0..60).all(|y| (0..50).all(|x| out.pixel(x, y) == picture.pixel(x, y))));
        for (i, (x, y)) in
            [(50, 0), (50, ROW), (50, 2 * ROW), (50 + COLUMN, 0), (50 + COLUMN, ROW)].into_iter().enumerate()
        {
            assert_eq!(out.pixel(x + EDGES[0] + 5, y + ROW / 2), [200, i as u8, 9], "clip {i}");
            let ink = |from: usize, to: usize| {
                (from..to)
                    .flat_map(|x| (y..y + ROW).map(move |y| (x, y)))
                    .filter(|&(x, y)| out.pixel(x, y) == [INK; 3])
                    .count()
            };
            let lit = dots(char::from_digit(i as u32 + 1, 10).unwrap()).iter().map(|row| row.count_ones()).sum::<u32>();
            assert_eq!(ink(x + EDGES[1], x + EDGES[2]), lit as usize * DOT * DOT, "number {}", i + 1);
            assert!(ink(x + EDGES[2], x + COLUMN) > 0, "the share of clip {i}");
        }
        assert_eq!(with_legend(&picture, &[]), picture);
        let tiny = Rgb8::black(4, 3);
        assert_eq!(with_legend(&tiny, &clips).height, 3);
    }

    #[test]
    fn shares_are_whole_percent() {
        assert_eq!([1.0, 0.456, 0.001, 0.0].map(percent), ["100%", "46%", "<1%", "0%"]);
    }
}
