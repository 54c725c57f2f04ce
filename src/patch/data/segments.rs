//! Which pixels are centres of patches, and in which segment they lie (LazyFluids §4.2).

use crate::raster::image::Plane;

/// Label of a pixel that is no patch centre: nearly transparent, or so near the border that its patch would leave the image.
pub const NO_PATCH: u8 = 0;
/// Label of patches on the outline: blurred alpha above the lower threshold and below the upper one.
pub const BOUNDARY: u8 = 1;
/// Label of patches inside, and of all patches where there are no segments.
pub const INTERIOR: u8 = 2;
/// The segments in order.
pub const SEGMENTS: [u8; 2] = [BOUNDARY, INTERIOR];

/// Where the outline lies in blurred alpha: `l` and `u` of LazyFluids §4.2.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Thresholds {
    /// What is not above has no patch.
    pub lower: f32,
    /// What is not below is interior.
    pub upper: f32,
}

impl Default for Thresholds {
    /// The paper's `l = 0.1`, `u = 0.9`.
    fn default() -> Self {
        Self { lower: 0.1, upper: 0.9 }
    }
}

impl Thresholds {
    fn label(self, blurred: f32) -> u8 {
        match blurred {
            b if b >= self.upper => INTERIOR,
            b if b > self.lower => BOUNDARY,
            _ => NO_PATCH,
        }
    }
}

/// The label of every pixel of an image of `width` × `height` pixels. Without blurred alpha everything is interior.
pub fn labels(size: (usize, usize), radius: usize, blurred: Option<&Plane>, thresholds: Thresholds) -> Vec<u8> {
    let (width, height) = size;
    let mut labels = vec![NO_PATCH; width * height];
    for y in radius..height.saturating_sub(radius) {
        for x in radius..width.saturating_sub(radius) {
            labels[y * width + x] = blurred.map_or(INTERIOR, |b| thresholds.label(b.at(x, y)));
        }
    }
    labels
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_follow_the_thresholds_and_keep_off_the_border() {
        let ramp = Plane::from_fn(21, 9, |x, _| x as f32 / 20.0);
        let labels = labels((21, 9), 2, Some(&ramp), Thresholds::default());
        let row = |y: usize| &labels[y * 21..(y + 1) * 21];
        assert!(row(1).iter().all(|&l| l == NO_PATCH));
        assert_eq!(
            (row(4)[2], row(4)[3], row(4)[17], row(4)[18], row(4)[19]),
            (NO_PATCH, BOUNDARY, BOUNDARY, INTERIOR, NO_PATCH)
        );
        assert_eq!([BOUNDARY, INTERIOR].map(|s| labels.iter().filter(|&&l| l == s).count()), [75, 5]);
    }

    #[test]
    fn images_smaller_than_a_patch_have_none() {
        assert!(labels((3, 9), 2, None, Thresholds::default()).iter().all(|&l| l == NO_PATCH));
    }
}
