//! Between Y'CbCr as codecs store it and R'G'B' (ITU-T H.273, tables 4 and 8), in integers so that every machine
//! gives the same bytes.
//!
//! Chroma of 4:2:0 is sited left (H.273 `ChromaLocType` 0, what H.264, VP9 and MPEG-2 assume): a chroma sample lies on
//! the even luma columns, halfway between two luma rows.

use macro_rules_attribute::apply;

use super::clip::{Matrix, Range};
use crate::base::instructions::kernel;
use crate::raster::image::Rgb8;

/// Fractional bits of the matrix coefficients.
const BITS: u32 = 14;

/// Luma weights of red and blue.
fn luma_weights(matrix: Matrix) -> (f64, f64) {
    match matrix {
        Matrix::Bt601 => (0.299, 0.114),
        Matrix::Bt709 => (0.2126, 0.0722),
    }
}

/// Black level, code values from black to white, code values of the whole chroma excursion.
fn excursion(range: Range) -> (i32, f64, f64) {
    match range {
        Range::Limited => (16, 219.0, 224.0),
        Range::Full => (0, 255.0, 255.0),
    }
}

fn fixed(value: f64) -> i32 {
    (value * f64::from(1u32 << BITS)).round() as i32
}

/// Y'CbCr → R'G'B' in fixed point.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Decode {
    black: i32,
    luma: i32,
    red_from_cr: i32,
    green_from_cb: i32,
    green_from_cr: i32,
    blue_from_cb: i32,
}

impl Decode {
    /// The transform for a matrix and a range.
    pub fn new(matrix: Matrix, range: Range) -> Self {
        let (kr, kb) = luma_weights(matrix);
        let kg = 1.0 - kr - kb;
        let (black, luma, chroma) = excursion(range);
        let c = 255.0 / chroma;
        Self {
            black,
            luma: fixed(255.0 / luma),
            red_from_cr: fixed(2.0 * (1.0 - kr) * c),
            green_from_cb: fixed(-2.0 * (1.0 - kb) * kb / kg * c),
            green_from_cr: fixed(-2.0 * (1.0 - kr) * kr / kg * c),
            blue_from_cb: fixed(2.0 * (1.0 - kb) * c),
        }
    }

    /// One row: samples with `FRACTION` fractional bits to packed 8-bit RGB, rounded and clamped.
    ///
    /// # Panics
    /// When the slices' lengths disagree.
    pub fn row<const FRACTION: u32>(&self, y: &[i16], cb: &[i16], cr: &[i16], rgb: &mut [u8]) {
        assert!(cb.len() == y.len() && cr.len() == y.len() && rgb.len() == 3 * y.len());
        decode_row(self, FRACTION, y, cb, cr, rgb);
    }
}

#[apply(kernel)]
fn decode_row(m: &Decode, fraction: u32, y: &[i16], cb: &[i16], cr: &[i16], rgb: &mut [u8]) {
    let shift = BITS + fraction;
    let half = 1i32 << (shift - 1);
    let (black, grey) = (m.black << fraction, 128 << fraction);
    let byte = |v: i32| (v >> shift).clamp(0, 255) as u8;
    for (((out, &y), &cb), &cr) in rgb.chunks_exact_mut(3).zip(y).zip(cb).zip(cr) {
        let (cb, cr) = (i32::from(cb) - grey, i32::from(cr) - grey);
        let y = (i32::from(y) - black) * m.luma + half;
        out[0] = byte(y + m.red_from_cr * cr);
        out[1] = byte(y + m.green_from_cb * cb + m.green_from_cr * cr);
        out[2] = byte(y + m.blue_from_cb * cb);
    }
}

/// R'G'B' → Y'CbCr in fixed point.
struct Encode {
    black: i32,
    luma: [i32; 3],
    cb: [i32; 3],
    cr: [i32; 3],
}

impl Encode {
    fn new(matrix: Matrix, range: Range) -> Self {
        let (kr, kb) = luma_weights(matrix);
        let (black, luma, chroma) = excursion(range);
        let (l, c) = (luma / 255.0, chroma / 255.0);
        // Green takes what rounding leaves, so that white is exactly white and grey exactly neutral.
        let (lr, lb) = (fixed(kr * l), fixed(kb * l));
        let (cb_r, cb_b) = (fixed(-kr / (2.0 * (1.0 - kb)) * c), fixed(0.5 * c));
        let (cr_r, cr_b) = (fixed(0.5 * c), fixed(-kb / (2.0 * (1.0 - kr)) * c));
        Self {
            black,
            luma: [lr, fixed(l) - lr - lb, lb],
            cb: [cb_r, -cb_r - cb_b, cb_b],
            cr: [cr_r, -cr_r - cr_b, cr_b],
        }
    }
}

/// `rgb` as Y'CbCr 4:2:0 planes without padding: luma `width × height`, chroma `⌈width/2⌉ × ⌈height/2⌉`, sited left
/// (horizontally ¼, ½, ¼ around the even columns, vertically the mean of two rows).
pub fn from_rgb8(rgb: &Rgb8, matrix: Matrix, range: Range) -> [Vec<u8>; 3] {
    let (width, height) = (rgb.width, rgb.height);
    let encode = Encode::new(matrix, range);
    let (cw, ch) = (width.div_ceil(2), height.div_ceil(2));
    let mut luma = vec![0; width * height];
    let [mut blue, mut red] = [vec![0; cw * ch], vec![0; cw * ch]];
    if luma.is_empty() {
        return [luma, blue, red];
    }
    for (row, out) in rgb.data.chunks_exact(3 * width).zip(luma.chunks_exact_mut(width)) {
        luma_row(&encode, row, out);
    }
    let mut sums = vec![[0i32; 3]; width + 2];
    for (cy, (blue, red)) in blue.chunks_exact_mut(cw).zip(red.chunks_exact_mut(cw)).enumerate() {
        let row = |y: usize| &rgb.data[3 * width * y..3 * width * (y + 1)];
        sum_rows(row(2 * cy), row((2 * cy + 1).min(height - 1)), &mut sums);
        chroma_row(&encode, &sums, blue, red);
    }
    [luma, blue, red]
}

#[apply(kernel)]
fn luma_row(encode: &Encode, rgb: &[u8], out: &mut [u8]) {
    let [r, g, b] = encode.luma;
    let offset = (encode.black << BITS) + (1 << (BITS - 1));
    for (pixel, out) in rgb.chunks_exact(3).zip(out) {
        let sum = r * i32::from(pixel[0]) + g * i32::from(pixel[1]) + b * i32::from(pixel[2]);
        *out = ((sum + offset) >> BITS) as u8;
    }
}

/// Sum of two rows, with the first and last pixel repeated once on either side.
fn sum_rows(top: &[u8], bottom: &[u8], sums: &mut [[i32; 3]]) {
    let last = sums.len() - 1;
    for ((sum, top), bottom) in sums[1..last].iter_mut().zip(top.chunks_exact(3)).zip(bottom.chunks_exact(3)) {
        *sum = std::array::from_fn(|c| i32::from(top[c]) + i32::from(bottom[c]));
    }
    sums[0] = sums[1];
    sums[last] = sums[last - 1];
}

fn chroma_row(encode: &Encode, sums: &[[i32; 3]], blue: &mut [u8], red: &mut [u8]) {
    // Eight times the filtered colour enters, hence three more bits leave.
    let shift = BITS + 3;
    let offset = (128 << shift) + (1 << (shift - 1));
    let dot = |weights: &[i32; 3], v: &[i32; 3]| weights.iter().zip(v).map(|(w, v)| w * v).sum::<i32>();
    for (cx, (blue, red)) in blue.iter_mut().zip(red).enumerate() {
        let three = &sums[2 * cx..2 * cx + 3];
        let colour: [i32; 3] = std::array::from_fn(|c| three[0][c] + 2 * three[1][c] + three[2][c]);
        *blue = ((dot(&encode.cb, &colour) + offset) >> shift).clamp(0, 255) as u8;
        *red = ((dot(&encode.cr, &colour) + offset) >> shift).clamp(0, 255) as u8;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ALL: [(Matrix, Range); 4] = [
        (Matrix::Bt601, Range::Limited),
        (Matrix::Bt601, Range::Full),
        (Matrix::Bt709, Range::Limited),
        (Matrix::Bt709, Range::Full),
    ];

    fn decode_one(matrix: Matrix, range: Range, yuv: [u8; 3]) -> [u8; 3] {
        let [y, cb, cr] = yuv.map(|v| [i16::from(v) << 6]);
        let mut rgb = [0; 3];
        Decode::new(matrix, range).row::<6>(&y, &cb, &cr, &mut rgb);
        rgb
    }

    #[test]
    fn known_colours() {
        // BT.709 limited red is (63, 102, 240), BT.601 limited red is (81, 90, 240): the usual tables.
        let red = Rgb8 { width: 2, height: 2, data: [255, 0, 0].repeat(4) };
        let [y, cb, cr] = from_rgb8(&red, Matrix::Bt709, Range::Limited);
        assert_eq!((y[0], cb[0], cr[0]), (63, 102, 240));
        let [y, cb, cr] = from_rgb8(&red, Matrix::Bt601, Range::Limited);
        assert_eq!((y[0], cb[0], cr[0]), (81, 90, 240));
        assert_eq!(decode_one(Matrix::Bt709, Range::Limited, [16, 128, 128]), [0; 3]);
        assert_eq!(decode_one(Matrix::Bt601, Range::Limited, [235, 128, 128]), [255; 3]);
        assert_eq!(decode_one(Matrix::Bt601, Range::Full, [255, 128, 128]), [255; 3]);
    }

    #[test]
    fn flat_colours_survive_the_way_there_and_back() {
        for (matrix, range) in ALL {
            for i in 0..512u32 {
                let colour = [i * 37 % 256, i * 101 % 256, i * 7 % 256].map(|v| v as u8);
                let image = Rgb8 { width: 3, height: 3, data: colour.repeat(9) };
                let planes = from_rgb8(&image, matrix, range);
                assert_eq!(planes.each_ref().map(Vec::len), [9, 4, 4]);
                let back = decode_one(matrix, range, [planes[0][4], planes[1][3], planes[2][3]]);
                for c in 0..3 {
                    assert!(back[c].abs_diff(colour[c]) <= 3, "{matrix:?} {range:?} {colour:?} → {back:?}");
                }
            }
        }
    }

    #[test]
    fn grey_has_neutral_chroma() {
        for (matrix, range) in ALL {
            for grey in 0..=255u8 {
                let [y, cb, cr] = from_rgb8(&Rgb8 { width: 1, height: 1, data: vec![grey; 3] }, matrix, range);
                assert_eq!((cb[0], cr[0]), (128, 128));
                assert!(decode_one(matrix, range, [y[0], 128, 128])[0].abs_diff(grey) <= 1);
            }
        }
    }

    #[test]
    fn chroma_is_sited_on_even_columns() {
        // A colour step between columns 3 and 4: the sample on column 4 sees a quarter of the left colour.
        let mut data = Vec::new();
        (0..8).for_each(|x| data.extend(if x < 4 { [0, 0, 0] } else { [0, 0, 255] }));
        let [_, cb, _] = from_rgb8(&Rgb8 { width: 8, height: 1, data }, Matrix::Bt709, Range::Full);
        assert_eq!(cb[1], 128);
        assert!(cb[2].abs_diff(128 + 96) <= 1, "{cb:?}");
        assert_eq!(cb[3], 255);
    }
}
