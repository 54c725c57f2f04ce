//! Frames side by side in one picture, to look at a video at a glance.

use crate::raster::image::Rgb8;
use crate::raster::resample::resize_rgb8;

/// Pixels between frames and around them.
const GAP: usize = 4;
/// Grey of the gaps.
const GREY: u8 = 32;

/// `frames` row by row in `columns` columns, shrunk (never enlarged) so that the sheet is at most `max_width` pixels
/// wide; a frame keeps its proportions, and the largest one sets the cell. No frames give an empty picture.
pub fn contact_sheet(frames: &[Rgb8], columns: usize, max_width: usize) -> Rgb8 {
    let columns = columns.clamp(1, frames.len().max(1));
    let widest = frames.iter().map(|f| f.width).max().unwrap_or(0);
    if widest == 0 {
        return Rgb8::default();
    }
    let room = max_width.saturating_sub(GAP * (columns + 1)) / columns;
    let scale = (room as f64 / widest as f64).clamp(1.0 / widest as f64, 1.0);
    let shrunk = |size: usize| ((size as f64 * scale).round() as usize).max(1);
    let (cell_width, cell_height) = (shrunk(widest), frames.iter().map(|f| shrunk(f.height)).max().unwrap_or(1));
    let rows = frames.len().div_ceil(columns);
    let (width, height) = (GAP + columns * (cell_width + GAP), GAP + rows * (cell_height + GAP));
    let mut sheet = Rgb8 { width, height, data: vec![GREY; width * height * 3] };
    for (i, frame) in frames.iter().enumerate().filter(|(_, f)| f.width > 0 && f.height > 0) {
        let small = resize_rgb8(frame, shrunk(frame.width), shrunk(frame.height));
        let (x, y) = (GAP + i % columns * (cell_width + GAP), GAP + i / columns * (cell_height + GAP));
        paste(&mut sheet, &small, x, y);
    }
    sheet
}

/// `count` frame numbers spread evenly over `0..total`, the first included.
pub fn spread(total: usize, count: usize) -> Vec<usize> {
    let count = count.min(total);
    (0..count).map(|i| i * total / count).collect()
}

fn paste(sheet: &mut Rgb8, picture: &Rgb8, x: usize, y: usize) {
    let length = picture.width * 3;
    for (row, source) in picture.data.chunks_exact(length).enumerate() {
        let start = ((y + row) * sheet.width + x) * 3;
        sheet.data[start..start + length].copy_from_slice(source);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(width: usize, height: usize, value: u8) -> Rgb8 {
        Rgb8 { width, height, data: vec![value; width * height * 3] }
    }

    #[test]
    fn frames_lie_in_reading_order() {
        let frames: Vec<Rgb8> = (0..5).map(|i| flat(20, 10, 100 + i)).collect();
        let sheet = contact_sheet(&frames, 3, 1000);
        assert_eq!((sheet.width, sheet.height), (3 * 24 + 4, 2 * 14 + 4));
        for i in 0..5 {
            let (x, y) = (4 + 24 * (i % 3), 4 + 14 * (i / 3));
            assert_eq!(sheet.pixel(x, y), [100 + i as u8; 3]);
            assert_eq!(sheet.pixel(x + 19, y + 9), [100 + i as u8; 3]);
            assert_eq!(sheet.pixel(x - 1, y), [GREY; 3]);
        }
    }

    #[test]
    fn shrinks_to_the_width_and_keeps_proportions() {
        let sheet = contact_sheet(&[flat(640, 360, 9), flat(320, 360, 9)], 2, 400);
        assert!(sheet.width <= 400 && sheet.width > 380);
        assert_eq!(sheet.pixel(sheet.width - 10, 20), [GREY; 3]);
        assert_eq!(contact_sheet(&[], 3, 100), Rgb8::default());
        assert!(contact_sheet(&[flat(10, 10, 1)], 1, 0).width > 0);
    }

    #[test]
    fn spread_is_even() {
        assert_eq!(spread(100, 4), [0, 25, 50, 75]);
        assert_eq!(spread(3, 8), [0, 1, 2]);
        assert!(spread(0, 8).is_empty());
    }
}
