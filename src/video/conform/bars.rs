//! Constant black bars: found, and told apart from scenes that are dark at their edges.
//!
//! A bar is a run of rows (or columns) from the frame's edge that never leaves black, and it ends in a straight hard
//! edge: right behind it, along most of its length, the picture is clearly brighter at some time. A flame or smoke on
//! black has no such edge and is left whole.

use crate::video::clip::{Pixels, Range, RawFrame};

/// Luma above black that still counts as black; coding noise stays below it.
const BLACK: u8 = 12;
/// Luma above black that the picture behind a bar must reach.
const BRIGHT: u8 = 36;
/// Rows within which it must reach it.
const EDGE: usize = 4;
/// Part of the bar's length along which it must reach it.
const LENGTH: f64 = 0.5;
/// Least width and height that cropping may leave.
const LEAST: usize = 32;

/// A rectangle of source pixels.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Crop {
    /// Columns left of it.
    pub x: usize,
    /// Rows above it.
    pub y: usize,
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
}

/// Gathers the brightest luma of every pixel over the frames it is shown.
#[derive(Debug, Clone)]
pub struct Bars {
    width: usize,
    height: usize,
    brightest: Vec<u8>,
}

impl Bars {
    /// For frames of `width × height`.
    pub fn new(width: usize, height: usize) -> Self {
        Self { width, height, brightest: vec![0; width * height] }
    }

    /// Adds a frame of the promised size; others are ignored.
    pub fn add(&mut self, frame: &RawFrame) {
        if (frame.width, frame.height) != (self.width, self.height) {
            return;
        }
        let luma = |p: &[u8]| ((54 * u16::from(p[0]) + 183 * u16::from(p[1]) + 19 * u16::from(p[2])) >> 8) as u8;
        let raise = |(b, v): (&mut u8, u8)| *b = v.max(*b);
        match &frame.pixels {
            Pixels::Yuv { planes, range, .. } => {
                let black = if *range == Range::Limited { 16 } else { 0 };
                for (b, &v) in self.brightest.iter_mut().zip(&planes[0]) {
                    *b = (*b).max(v.saturating_sub(black));
                }
            }
            Pixels::Rgb(data) => self.brightest.iter_mut().zip(data.chunks_exact(3).map(luma)).for_each(raise),
            // What is transparent shows black.
            Pixels::Rgba(data) => {
                let seen = data.chunks_exact(4).map(|p| (u16::from(luma(p)) * u16::from(p[3]) / 255) as u8);
                self.brightest.iter_mut().zip(seen).for_each(raise);
            }
        }
    }

    /// Whether anything bright enough to tell a bar was seen.
    pub fn is_decided(&self) -> bool {
        let bright = self.brightest.iter().filter(|&&v| v > BRIGHT).count();
        bright * 20 > self.brightest.len()
    }

    /// The picture without its bars; `None` when it has none.
    pub fn crop(&self) -> Option<Crop> {
        let rows = |columns: (usize, usize)| {
            let row = |y: usize| &self.brightest[y * self.width + columns.0..y * self.width + columns.1];
            let top = bar(self.height, |i| row(i).iter().copied());
            let bottom = bar(self.height, |i| row(self.height - 1 - i).iter().copied());
            (top, self.height - bottom)
        };
        let columns = |rows: (usize, usize)| {
            let column = |x: usize| (rows.0..rows.1).map(move |y| self.brightest[y * self.width + x]);
            let left = bar(self.width, column);
            let right = bar(self.width, |i| column(self.width - 1 - i));
            (left, self.width - right)
        };
        // Bars on all four sides hide each other's edges in part: measure again within what was found.
        let y = rows((0, self.width));
        let x = columns(y);
        let y = rows(x);
        let crop = Crop { x: x.0, y: y.0, width: x.1.checked_sub(x.0)?, height: y.1.checked_sub(y.0)? };
        let smaller = (crop.width, crop.height) != (self.width, self.height);
        (smaller && crop.width >= LEAST && crop.height >= LEAST).then_some(crop)
    }
}

/// Thickness of the bar at the near side of `lines` lines, 0 when there is none.
fn bar<I: Iterator<Item = u8>>(lines: usize, line: impl Fn(usize) -> I) -> usize {
    let black = (0..lines).take_while(|&i| line(i).all(|v| v <= BLACK)).count();
    if black == 0 || black + EDGE >= lines {
        return 0;
    }
    let behind: Vec<Vec<u8>> = (black..black + EDGE).map(|i| line(i).collect()).collect();
    let length = behind[0].len();
    let bright = (0..length).filter(|&j| behind.iter().any(|l| l[j] > BRIGHT)).count();
    if (bright as f64) < LENGTH * length as f64 {
        return 0;
    }
    // Scaled footage has a blended line or two between bar and picture.
    let mean = |l: &[u8]| l.iter().map(|&v| f64::from(v)).sum::<f64>() / length as f64;
    let full = 0.6 * mean(&behind[EDGE - 1]);
    black + behind[..EDGE - 1].iter().take_while(|l| mean(l) < full).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng::{below, hash};

    fn frame(width: usize, height: usize, luma: impl Fn(usize, usize) -> u8) -> RawFrame {
        let data = (0..width * height).flat_map(|i| [luma(i % width, i / width); 3]).collect();
        RawFrame { width, height, time_ns: 0, pixels: Pixels::Rgb(data) }
    }

    fn crop_of(frames: impl Iterator<Item = RawFrame>) -> Option<Crop> {
        let mut bars = Bars::new(160, 120);
        frames.for_each(|f| bars.add(&f));
        bars.crop()
    }

    fn noise(t: usize, x: usize, y: usize, n: u64) -> u8 {
        below(hash(3, &[t as u64, x as u64, y as u64]), n) as u8
    }

    #[test]
    fn letterbox_and_pillarbox_are_cut_exactly() {
        let inside = |x: usize, y: usize| (20..140).contains(&x) && (16..104).contains(&y);
        let luma = |t, x, y| if inside(x, y) { 60 + noise(t, x, y, 100) } else { noise(t, x, y, 6) };
        let crop = crop_of((0..5).map(|t| frame(160, 120, |x, y| luma(t, x, y))));
        assert_eq!(crop, Some(Crop { x: 20, y: 16, width: 120, height: 88 }));
    }

    #[test]
    fn a_blended_line_goes_with_the_bar() {
        let luma = |y: usize| match y {
            0..=9 => 2,
            10 => 40,
            _ => 150,
        };
        let crop = crop_of(std::iter::once(frame(160, 120, |_, y| luma(y))));
        assert_eq!(crop, Some(Crop { x: 0, y: 11, width: 160, height: 109 }));
    }

    #[test]
    fn a_flame_on_black_is_left_whole() {
        // A soft bright blob that sways: black all round, no straight edge.
        let blob = |t: usize, x: usize, y: usize| {
            let (dx, dy) = (x as f32 - 80.0 - 10.0 * (t as f32).sin(), (y as f32 - 75.0) / 1.5);
            (250.0 * (-(dx * dx + dy * dy) / 500.0).exp()) as u8
        };
        assert_eq!(crop_of((0..20).map(|t| frame(160, 120, |x, y| blob(t, x, y)))), None);
    }

    #[test]
    fn a_dark_bank_under_bright_water_with_a_ragged_edge_is_left_whole() {
        let luma = |x: usize, y: usize| if y > 80 + (noise(0, x / 8, 0, 30) as usize) { 4 } else { 120 };
        assert_eq!(crop_of(std::iter::once(frame(160, 120, luma))), None);
    }

    #[test]
    fn all_black_has_no_bars() {
        assert_eq!(crop_of((0..3).map(|_| frame(160, 120, |_, _| 0))), None);
    }
}
