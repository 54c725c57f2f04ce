//! Connected parts of a mask.

use super::image::Plane;

/// The 8-connected parts of a mask.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Components {
    /// Width of the mask.
    pub width: usize,
    /// Per pixel, row by row: the number of its part, counted from 1 in reading order of their first pixels; 0 outside.
    pub labels: Vec<u32>,
    /// Per part: its number of pixels; part 1 first.
    pub sizes: Vec<usize>,
}

impl Components {
    /// Parts of the pixels of `plane` above `threshold`.
    pub fn above(plane: &Plane, threshold: f32) -> Self {
        let inside = |i: usize| plane.data[i] > threshold;
        Self::of(plane.width, plane.height, inside, |_, _| true)
    }

    /// Parts of the pixels that are `inside`, where two neighbours belong together when `joined` says so.
    pub fn of(
        width: usize,
        height: usize,
        inside: impl Fn(usize) -> bool,
        joined: impl Fn(usize, usize) -> bool,
    ) -> Self {
        let mut out = Self { width, labels: vec![0; width * height], sizes: Vec::new() };
        let mut open = Vec::new();
        for seed in 0..width * height {
            if out.labels[seed] != 0 || !inside(seed) {
                continue;
            }
            out.sizes.push(0);
            let label = out.sizes.len() as u32;
            out.labels[seed] = label;
            open.push(seed);
            while let Some(i) = open.pop() {
                out.sizes[label as usize - 1] += 1;
                for j in neighbours(i, width, height) {
                    if out.labels[j] == 0 && inside(j) && joined(i, j) {
                        out.labels[j] = label;
                        open.push(j);
                    }
                }
            }
        }
        out
    }

    /// Number of the part at a position in pixels, 0 outside of all parts and of the mask.
    pub fn at(&self, x: f32, y: f32) -> u32 {
        if x < 0.0 || y < 0.0 || x as usize >= self.width {
            return 0;
        }
        self.labels.get(y as usize * self.width + x as usize).copied().unwrap_or(0)
    }
}

/// The up to eight neighbours of pixel `i`.
pub fn neighbours(i: usize, width: usize, height: usize) -> impl Iterator<Item = usize> {
    let (x, y) = ((i % width) as isize, (i / width) as isize);
    let offsets = [(-1, -1), (0, -1), (1, -1), (-1, 0), (1, 0), (-1, 1), (0, 1), (1, 1)];
    offsets.into_iter().filter_map(move |(dx, dy)| {
        let (x, y) = (x + dx, y + dy);
        let within = x >= 0 && y >= 0 && x < width as isize && y < height as isize;
        within.then_some(y as usize * width + x as usize)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_touch_at_corners_and_are_counted_in_reading_order() {
        #[rustfmt::skip]
        let mask = Plane::from_vec(5, 3, vec![
            0., 1., 0., 0., 1.,
            1., 0., 0., 0., 1.,
            0., 0., 1., 0., 0.,
        ]);
        let parts = Components::above(&mask, 0.5);
        assert_eq!(parts.labels, [0, 1, 0, 0, 2, 1, 0, 0, 0, 2, 0, 0, 3, 0, 0]);
        assert_eq!(parts.sizes, [2, 2, 1]);
        assert_eq!((parts.at(1.9, 0.1), parts.at(4.5, 1.5), parts.at(5.5, 0.5), parts.at(0.5, 9.0)), (1, 2, 0, 0));
        assert_eq!(Components::above(&Plane::default(), 0.5), Components::default());
    }
}
