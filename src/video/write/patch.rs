//! Animations as their formats store them: of each frame only the rectangle that changed.

use std::ops::Range;

use crate::raster::image::Rgb8;

/// Side of the squares that are kept or sent as a whole within the rectangle, in pixels: single pixels that happen to
/// stay would only spoil the prediction of their neighbours.
const BLOCK: usize = 8;

/// What a frame changes.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Patch {
    /// Left edge in pixels.
    pub left: usize,
    /// Top edge in pixels.
    pub top: usize,
    /// Width in pixels, at least 1.
    pub width: usize,
    /// Height in pixels, at least 1.
    pub height: usize,
    /// Red, green, blue and opacity, `width * height * 4` bytes.
    pub pixels: Vec<u8>,
    /// Whether it is laid over what is shown, so that it stays where the patch is transparent; otherwise it replaces it.
    pub over: bool,
}

impl Patch {
    /// Whether no pixel is transparent.
    pub fn opaque(&self) -> bool {
        self.pixels.chunks_exact(4).all(|p| p[3] == 255)
    }
}

/// Tells what changes from frame to frame.
#[derive(Debug)]
pub(super) struct Differ {
    width: usize,
    /// What is shown, packed with opacity; empty before the first frame.
    shown: Vec<u8>,
    /// Left and top edges are multiples of this.
    align: usize,
}

impl Differ {
    /// For frames `width` pixels wide.
    pub fn new(width: usize, align: usize) -> Self {
        Self { width, shown: Vec::new(), align }
    }

    /// The patch that leads to `frame`; the first one is all of it. `alpha` is a byte per pixel; without it, opaque.
    pub fn next(&mut self, frame: &Rgb8, alpha: Option<&[u8]>) -> Patch {
        let packed = pack(frame, alpha);
        let whole = (0..self.width, 0..frame.height);
        let first = self.shown.is_empty();
        let (columns, rows) = if first { whole } else { changed(&self.shown, &packed, self.width, 4) };
        let down = |v: usize| v / self.align * self.align;
        let (columns, rows) = (down(columns.start)..columns.end, down(rows.start)..rows.end);
        let mut pixels = Vec::with_capacity(columns.len() * rows.len() * 4);
        for y in rows.clone() {
            pixels.extend_from_slice(&packed[(y * self.width + columns.start) * 4..(y * self.width + columns.end) * 4]);
        }
        let (left, top, width, height) = (columns.start, rows.start, columns.len(), rows.len());
        let mut patch = Patch { left, top, width, height, pixels, over: false };
        // What is transparent cannot be laid over something.
        if !first && patch.opaque() {
            self.keep_blocks(&mut patch);
            patch.over = !patch.opaque();
        }
        self.shown = packed;
        patch
    }

    /// Makes blocks in which nothing changed transparent.
    fn keep_blocks(&self, patch: &mut Patch) {
        let Patch { left, top, width, height, .. } = *patch;
        for y in (0..height).step_by(BLOCK) {
            for x in (0..width).step_by(BLOCK) {
                let length = 4 * BLOCK.min(width - x);
                let rows = y..(y + BLOCK).min(height);
                let mut old = rows.clone().map(|y| &self.shown[((top + y) * self.width + left + x) * 4..][..length]);
                if rows.clone().all(|y| old.next() == Some(&patch.pixels[(y * width + x) * 4..][..length])) {
                    rows.for_each(|y| patch.pixels[(y * width + x) * 4..][..length].fill(0));
                }
            }
        }
    }
}

/// Red, green, blue and opacity of every pixel; colours that nobody sees are 0.
fn pack(frame: &Rgb8, alpha: Option<&[u8]>) -> Vec<u8> {
    let Some(alpha) = alpha else {
        return frame.data.chunks_exact(3).flat_map(|p| [p[0], p[1], p[2], 255]).collect();
    };
    let pixel = |(p, &a): (&[u8], &u8)| if a == 0 { [0; 4] } else { [p[0], p[1], p[2], a] };
    frame.data.chunks_exact(3).zip(alpha).flat_map(pixel).collect()
}

/// Columns and rows of the smallest rectangle that holds every difference of two images of `bytes` bytes a pixel; one
/// pixel when there is none.
pub(super) fn changed(old: &[u8], new: &[u8], width: usize, bytes: usize) -> (Range<usize>, Range<usize>) {
    let stride = width * bytes;
    let rows = old.chunks_exact(stride).zip(new.chunks_exact(stride)).enumerate().filter(|(_, (a, b))| a != b);
    let mut bounds: Option<(usize, usize, usize, usize)> = None;
    for (y, (a, b)) in rows {
        let differ = |i: &usize| a[*i] != b[*i];
        let (left, right) = ((0..stride).find(differ).unwrap_or(0), (0..stride).rfind(differ).unwrap_or(0));
        let (l, r, top, _) = bounds.unwrap_or((left, right, y, y));
        bounds = Some((l.min(left), r.max(right), top, y));
    }
    bounds.map_or((0..1, 0..1), |(left, right, top, bottom)| (left / bytes..right / bytes + 1, top..bottom + 1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    #[test]
    fn the_changed_rectangle_is_tight() {
        let mut new = vec![0; 40];
        assert_eq!(changed(&[0; 40], &new, 8, 1), (0..1, 0..1));
        new[8 + 3] = 1;
        new[3 * 8 + 6] = 1;
        assert_eq!(changed(&[0; 40], &new, 8, 1), (3..7, 1..4));
        assert_eq!(changed(&[0; 40], &new, 4, 2), (1..4, 1..4));
    }

    /// Lays a patch on a canvas as a viewer does.
    fn lay(canvas: &mut [u8], width: usize, patch: &Patch) {
        for (i, pixel) in patch.pixels.chunks_exact(4).enumerate().filter(|(_, p)| !patch.over || p[3] > 0) {
            assert!(!patch.over || pixel[3] == 255);
            let at = (patch.top + i / patch.width) * width + patch.left + i % patch.width;
            canvas[at * 4..at * 4 + 4].copy_from_slice(pixel);
        }
    }

    #[test]
    fn patches_lead_from_frame_to_frame() {
        let (width, height) = (37, 29);
        for align in [1, 2] {
            let mut differ = Differ::new(width, align);
            let mut canvas = vec![9; width * height * 4];
            let mut frame = Rgb8::black(width, height);
            let mut alpha = vec![255; width * height];
            for t in 0..30u64 {
                for k in 0..rng::below(rng::hash(1, &[t]), 40) {
                    let at = rng::below(rng::hash(2, &[t, k]), (width * height) as u64) as usize;
                    frame.data[at * 3] = t as u8;
                    // Opaque for some frames, then ever more see-through.
                    alpha[at] = if t < 10 { 255 } else { rng::below(rng::hash(3, &[t, k]), 256) as u8 };
                }
                let patch = differ.next(&frame, (t >= 5).then_some(&alpha[..]));
                assert!(patch.left.is_multiple_of(align) && patch.top.is_multiple_of(align));
                assert!(t > 0 || (patch.width, patch.height) == (width, height));
                lay(&mut canvas, width, &patch);
                assert_eq!(canvas, pack(&frame, (t >= 5).then_some(&alpha[..])), "{t}");
            }
            let same = differ.next(&frame, Some(&alpha));
            assert_eq!((same.width, same.height), (1, 1));
        }
    }
}
