//! Slices through time: one line of every frame beside the next, so that a still picture shows how a video moves. Motion
//! along the line is a slanted streak, what stands still a level one, a jump or a fade an upright border.

use crate::measure::Footage;
use crate::raster::image::Rgb8;

/// A line of pixels through a video.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Line {
    /// A column; else a row.
    upright: bool,
    /// Its number.
    at: usize,
}

impl Line {
    /// The column or row, whichever is nearer to `direction` (a column without one), that has most of what counts.
    pub fn through(footage: &Footage, direction: Option<(f32, f32)>) -> Self {
        let upright = direction.is_none_or(|(u, v)| u.abs() <= v.abs());
        let (width, height) = (footage.width(), footage.height());
        let (lines, across) = if upright { (width, height) } else { (height, width) };
        let index = |line: usize, i: usize| if upright { i * width + line } else { line * width + i };
        let fluid = |&line: &usize| (0..across).filter(|&i| footage.inside()[index(line, i)]).count();
        // The middle one of those with equally much, as in a video without a matte.
        let most = (0..lines).map(|line| fluid(&line)).max().unwrap_or(0);
        let best: Vec<usize> = (0..lines).filter(|line| fluid(line) == most).collect();
        Self { upright, at: best[best.len() / 2] }
    }

    /// The line of every frame, the first at the left. An upright line stands, a level one is turned to stand, its left
    /// end up.
    pub fn slice<'a>(&self, frames: impl ExactSizeIterator<Item = &'a Rgb8>) -> Rgb8 {
        let times = frames.len();
        let mut out = Rgb8::black(times, 0);
        for (t, frame) in frames.enumerate() {
            let length = if self.upright { frame.height } else { frame.width };
            if t == 0 {
                out = Rgb8::black(times, length);
            }
            for i in 0..length {
                let pixel = if self.upright { frame.pixel(self.at, i) } else { frame.pixel(i, self.at) };
                out.data[3 * (i * times + t)..][..3].copy_from_slice(&pixel);
            }
        }
        out
    }

    /// Which line it is.
    pub fn words(&self) -> String {
        let (what, end) = if self.upright { ("column", "top") } else { ("row", "left end") };
        format!("{what} {}, its {end} up", self.at)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::raster::image::Plane;

    fn video() -> Vec<Rgb8> {
        let pixel = |t: usize, x: usize, y: usize| [(10 * t) as u8, x as u8, y as u8];
        let frame = |t| Rgb8 { width: 6, height: 4, data: (0..24).flat_map(|i| pixel(t, i % 6, i / 6)).collect() };
        (0..3).map(frame).collect()
    }

    #[test]
    fn the_line_lies_along_the_motion_where_most_of_the_fluid_is() {
        let matte = Plane::from_fn(6, 4, |x, y| f32::from(u8::from(x == 4 || y == 1 && x > 1)));
        let footage = Footage::new(video(), 25.0, true, Some(&matte)).unwrap();
        assert_eq!(Line::through(&footage, None), Line { upright: true, at: 4 });
        assert_eq!(Line::through(&footage, Some((-2.0, 1.0))), Line { upright: false, at: 1 });
        let whole = Footage::new(video(), 25.0, true, None).unwrap();
        assert_eq!(Line::through(&whole, Some((0.0, 1.0))), Line { upright: true, at: 3 });
    }

    #[test]
    fn a_slice_has_a_frame_in_every_column() {
        let frames = video();
        let slice = Line { upright: true, at: 4 }.slice(frames.iter());
        assert_eq!((slice.width, slice.height), (3, 4));
        assert_eq!(slice.pixel(2, 3), [20, 4, 3]);
        let level = Line { upright: false, at: 1 }.slice(frames.iter());
        assert_eq!((level.width, level.height), (3, 6));
        assert_eq!(level.pixel(1, 5), [10, 5, 1]);
    }
}
