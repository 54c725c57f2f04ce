//! The source of a level: all exemplar images in one array, so that a patch is one number wherever it lies.

use super::channels::Stack;
use super::segments::{Patches, Thresholds, labels};
use crate::raster::image::Plane;

/// A source patch: the pixel number of its centre in the [`Atlas`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place(pub(super) u32);

impl Place {
    /// No patch.
    pub const NONE: Self = Self(u32::MAX);

    /// The pixel number, to index arrays over the atlas.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// Exemplar images (frames, exemplars, right-angle rotations) one below the other, each at the left edge.
#[derive(Debug, Clone)]
pub struct Atlas {
    /// Pixels and patches of all images.
    pub patches: Patches,
    images: Vec<Extent>,
}

/// Where an image lies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Extent {
    top: usize,
    width: usize,
    height: usize,
}

/// One image of a level: the planes of all channels, and blurred alpha where there are segments.
pub(super) type Layers = (Vec<Plane>, Option<Plane>);

impl Atlas {
    /// All `images` with patches of `radius`.
    pub(super) fn new(images: &[Layers], radius: usize, thresholds: Thresholds) -> Self {
        let mut extents = Vec::with_capacity(images.len());
        let mut top = 0;
        for (planes, _) in images {
            extents.push(Extent { top, width: planes[0].width, height: planes[0].height });
            top += planes[0].height;
        }
        let width = extents.iter().map(|e| e.width).max().unwrap_or(0);
        let channels = images.first().map_or(0, |(planes, _)| planes.len());
        let mut stack = Stack::zeros(width, top, channels);
        let mut all_labels = vec![0; width * top];
        for ((planes, blurred), extent) in images.iter().zip(&extents) {
            let image = Stack::from_planes(planes);
            let labels = labels((extent.width, extent.height), radius, blurred.as_ref(), thresholds);
            for y in 0..extent.height {
                let to = (extent.top + y) * width;
                all_labels[to..to + extent.width].copy_from_slice(&labels[y * extent.width..(y + 1) * extent.width]);
                let row = &image.bytes()[y * image.stride()..(y + 1) * image.stride()];
                stack.bytes_mut()[to * channels..to * channels + row.len()].copy_from_slice(row);
            }
        }
        Self { patches: Patches::new(stack, all_labels), images: extents }
    }

    /// Number of images.
    pub fn images(&self) -> usize {
        self.images.len()
    }

    /// The image in which a patch lies, and the coordinates of its centre there.
    pub fn locate(&self, place: Place) -> (usize, usize, usize) {
        let (x, y) = (place.index() % self.patches.stack.width, place.index() / self.patches.stack.width);
        let image = self.images.partition_point(|e| e.top <= y) - 1;
        (image, x, y - self.images[image].top)
    }

    /// The patch at `(x, y)` of an image, if there is one in that segment.
    pub(super) fn at(&self, image: usize, x: usize, y: usize, segment: u8) -> Option<Place> {
        let extent = self.images.get(image).filter(|e| x < e.width && y < e.height)?;
        let at = (extent.top + y) * self.patches.stack.width + x;
        self.patches.in_segment(at as isize, segment).map(Place)
    }

    /// Width and height of an image in pixels.
    pub fn size(&self, image: usize) -> (usize, usize) {
        (self.images[image].width, self.images[image].height)
    }

    /// The same with the outline counted as interior.
    pub(super) fn merged(&self) -> Self {
        Self { patches: self.patches.merged(), images: self.images.clone() }
    }
}

#[cfg(test)]
mod tests {
    use super::super::segments::INTERIOR;
    use super::*;

    #[test]
    fn every_patch_is_found_where_it_lies() {
        let image =
            |w: usize, h: usize, o: f32| (vec![Plane::from_fn(w, h, |x, y| o + (x + 7 * y) as f32 / 255.0)], None);
        let atlas = Atlas::new(&[image(9, 6, 0.0), image(6, 9, 0.25)], 2, Thresholds::default());
        assert_eq!((atlas.images(), atlas.patches.count(), atlas.size(1)), (2, 5 * 2 + 2 * 5, (6, 9)));
        for &centre in atlas.patches.centres(INTERIOR) {
            let (i, x, y) = atlas.locate(Place(centre));
            let value = (x + 7 * y) as f32 + [0.0, 63.75][i];
            assert!((f32::from(atlas.patches.stack.pixel(centre as usize)[0]) - value).abs() <= 0.5);
            assert_eq!(atlas.at(i, x, y, INTERIOR), Some(Place(centre)));
        }
        assert_eq!(atlas.at(1, 7, 3, INTERIOR), None);
        assert_eq!(atlas.at(0, 1, 3, INTERIOR), None);
    }
}
