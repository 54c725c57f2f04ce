//! Patches of one image, or of many: the frames of a clip, several exemplars, turned copies. All lie in one array, one below
//! the other, so that a patch is one number wherever it lies. What is how far from where is worked out here and nowhere
//! else.

use super::channels::{MAX_SIDE, Stack};
use super::pose::Matrix;
use super::segments::{INTERIOR, NO_PATCH, SEGMENTS};
use crate::base::rng;

/// A patch: the pixel number of its centre in its [`Patches`].
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Place(pub(in crate::patch) u32);

impl Place {
    /// No patch.
    pub const NONE: Self = Self(u32::MAX);

    /// The pixel number, to index arrays over all pixels.
    #[inline]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

/// How far one place is from another: pixels across and down, and frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Offset {
    /// Pixels to the right.
    pub x: isize,
    /// Pixels down.
    pub y: isize,
    /// Frames onwards.
    pub t: isize,
}

/// Where an image lies in the array: at the left edge, from this row on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(in crate::patch) struct Extent {
    pub top: usize,
    pub width: usize,
    pub height: usize,
}

/// Images and their patches.
#[derive(Debug, Clone)]
pub struct Patches {
    /// The channels.
    pub stack: Stack,
    labels: Vec<u8>,
    /// Patches of each segment in all rows before each row, and in all.
    before: [Vec<u32>; 2],
    images: Vec<Extent>,
    /// Whether the images are frames that follow each other, all of one size.
    timed: bool,
    /// A matrix a pixel, where what is laid on a site is turned or stretched by the site itself.
    pub(in crate::patch) frames: Option<Vec<Matrix>>,
}

impl Patches {
    /// The patches of one image with a label a pixel, as [`super::segments::labels`] gives them.
    pub fn new(stack: Stack, labels: Vec<u8>) -> Self {
        let mut all = Self::none(stack.channels);
        all.push(&stack, labels);
        all
    }

    /// No image yet, for images of so many channels.
    pub(in crate::patch) fn none(channels: usize) -> Self {
        let stack = Stack::zeros(0, 0, channels);
        Self { stack, labels: Vec::new(), before: [vec![0], vec![0]], images: Vec::new(), timed: false, frames: None }
    }

    /// Adds an image with a label a pixel.
    pub(in crate::patch) fn push(&mut self, image: &Stack, labels: Vec<u8>) {
        if image.width > self.stack.width {
            self.widen(image.width);
        }
        self.images.push(Extent { top: self.stack.height, width: image.width, height: image.height });
        self.stack.append(image);
        for row in labels.chunks_exact(image.width.max(1)) {
            self.labels.extend_from_slice(row);
            self.labels.resize(self.labels.len() + self.stack.width - row.len(), NO_PATCH);
            for (before, segment) in self.before.iter_mut().zip(SEGMENTS) {
                let here = row.iter().filter(|&&label| label == segment).count() as u32;
                before.push(before[before.len() - 1] + here);
            }
        }
    }

    fn widen(&mut self, width: usize) {
        let mut wider = Stack::zeros(width, 0, self.stack.channels);
        wider.append(&self.stack);
        let labels = self.labels.chunks_exact(self.stack.width.max(1));
        self.labels = labels
            .flat_map(|row| row.iter().copied().chain(std::iter::repeat_n(NO_PATCH, width - row.len())))
            .collect();
        self.stack = wider;
    }

    /// Counts the images as frames of one clip: searches go from frame to frame too.
    pub(in crate::patch) fn in_time(mut self) -> Self {
        self.timed = self.images.len() > 1 && self.images.iter().all(|e| (e.width, e.height) == self.size(0));
        self
    }

    /// The label of every pixel.
    pub fn labels(&self) -> &[u8] {
        &self.labels
    }

    /// Pixel numbers of the patch centres in a segment, in order.
    pub fn centres(&self, segment: u8) -> impl Iterator<Item = u32> {
        self.labels.iter().zip(0..).filter(move |&(&label, _)| label == segment).map(|(_, i)| i)
    }

    /// Number of patches of a segment.
    pub fn count_in(&self, segment: u8) -> usize {
        self.before[usize::from(segment) - 1].last().map_or(0, |&n| n as usize)
    }

    /// Number of patches.
    pub fn count(&self) -> usize {
        SEGMENTS.iter().map(|&s| self.count_in(s)).sum()
    }

    /// Bytes that a pixel of so many channels takes, with its label and its share of what is known of every row.
    pub(in crate::patch) fn bytes_a_pixel(channels: usize) -> usize {
        channels + 2
    }

    /// A patch of the segment, by chance; `None` where there is none.
    pub(in crate::patch) fn any(&self, segment: u8, chance: u64) -> Option<u32> {
        let before = &self.before[usize::from(segment) - 1];
        let count = self.count_in(segment);
        if count == 0 {
            return None;
        }
        let wanted = rng::below(chance, count as u64) as u32;
        let row = before.partition_point(|&n| n <= wanted) - 1;
        let start = row * self.stack.width;
        let labels = self.labels[start..start + self.stack.width].iter().enumerate();
        let column = labels.filter(|&(_, &label)| label == segment).nth((wanted - before[row]) as usize)?.0;
        Some((start + column) as u32)
    }

    /// The patch at pixel number `at`, if it is of the segment.
    #[inline]
    pub(in crate::patch) fn in_segment(&self, at: isize, segment: u8) -> Option<u32> {
        (usize::try_from(at).ok().and_then(|i| self.labels.get(i)) == Some(&segment)).then_some(at as u32)
    }

    /// The patch so many pixels beside a patch, no more than one reaches: beyond the side of an image no patch is centred.
    #[inline]
    pub(in crate::patch) fn beside(&self, place: u32, (x, y): (isize, isize), segment: u8) -> Option<u32> {
        self.in_segment(place as isize + y * self.stack.width as isize + x, segment)
    }

    /// The pixel so many beside another; a few beyond the side of an image lie pixels that centre no patch.
    #[inline]
    pub(in crate::patch) fn pixel_beside(&self, at: usize, (x, y): (isize, isize)) -> Option<usize> {
        at.checked_add_signed(y * self.stack.width as isize + x).filter(|&i| i < self.labels.len())
    }

    /// The patch that is so far from another, in whichever frame, if it is of the segment.
    pub(in crate::patch) fn moved(&self, place: Place, offset: Offset, segment: u8) -> Option<Place> {
        let (image, x, y) = self.locate(place);
        let image = image.checked_add_signed(offset.t).filter(|_| offset.t == 0 || self.timed)?;
        self.at(image, x.checked_add_signed(offset.x)?, y.checked_add_signed(offset.y)?, segment)
    }

    /// The image in which a patch lies, and the coordinates of its centre there.
    pub fn locate(&self, place: Place) -> (usize, usize, usize) {
        let (x, y) = (place.index() % self.stack.width, place.index() / self.stack.width);
        let image = self.image_of_row(y);
        (image, x, y - self.images[image].top)
    }

    #[inline]
    fn image_of_row(&self, y: usize) -> usize {
        if self.timed { y / self.images[0].height } else { self.images.partition_point(|e| e.top <= y) - 1 }
    }

    /// The image in which a patch lies.
    #[inline]
    pub(in crate::patch) fn extent(&self, place: Place) -> Extent {
        self.images[self.image_of_row(place.index() / self.stack.width)]
    }

    /// The patch at `(x, y)` of an image, if there is one in that segment.
    pub(in crate::patch) fn at(&self, image: usize, x: usize, y: usize, segment: u8) -> Option<Place> {
        let extent = self.images.get(image).filter(|e| x < e.width && y < e.height)?;
        let at = (extent.top + y) * self.stack.width + x;
        self.in_segment(at as isize, segment).map(Place)
    }

    /// Number of images.
    pub fn images(&self) -> usize {
        self.images.len()
    }

    /// Number of frames that follow each other; 1 where the images are no clip.
    pub fn frames(&self) -> usize {
        if self.timed { self.images.len() } else { 1 }
    }

    /// Width and height of an image in pixels.
    pub fn size(&self, image: usize) -> (usize, usize) {
        (self.images[image].width, self.images[image].height)
    }

    /// The largest side of an image in pixels: how far apart two patches of one may lie.
    pub(in crate::patch) fn reach(&self) -> usize {
        self.images.iter().map(|e| e.width.max(e.height)).max().unwrap_or(0)
    }

    /// The same with the outline counted as interior.
    pub(in crate::patch) fn merged(&self) -> Self {
        let mut merged = self.clone();
        merged.labels.iter_mut().filter(|label| **label != NO_PATCH).for_each(|label| *label = INTERIOR);
        let [boundary, interior] = &mut merged.before;
        interior.iter_mut().zip(boundary.iter_mut()).for_each(|(all, outline)| *all += std::mem::take(outline));
        merged
    }

    /// Whether `other` has patches for every segment of this.
    pub(in crate::patch) fn is_served_by(&self, other: &Self) -> bool {
        SEGMENTS.iter().all(|&s| self.count_in(s) == 0 || other.count_in(s) > 0)
    }
}

/// The pixels that a patch covers of its frame; a turned one may cover one twice.
#[derive(Debug, Clone, Copy)]
pub(in crate::patch) struct Footprint {
    pixels: [u32; MAX_SIDE * MAX_SIDE],
    count: usize,
    image: usize,
    /// First pixel of the image.
    start: u32,
}

impl Footprint {
    /// Their numbers in the array of all images.
    pub fn pixels(&self) -> impl Iterator<Item = usize> {
        self.pixels[..self.count].iter().map(|&pixel| pixel as usize)
    }
}

impl Patches {
    /// What the patch at `place`, seen through a matrix, covers: the pixels nearest to its samples.
    pub(in crate::patch) fn footprint(&self, place: Place, matrix: Matrix, radius: usize) -> Footprint {
        let (image, x, y) = self.locate(place);
        let (extent, radius, width) = (self.images[image], radius as i32, self.stack.width);
        let start = (extent.top * width) as u32;
        let mut footprint = Footprint { pixels: [0; MAX_SIDE * MAX_SIDE], count: 0, image, start };
        for (dx, dy) in (-radius..=radius).flat_map(|dy| (-radius..=radius).map(move |dx| (dx, dy))) {
            let (sx, sy) = matrix.step(dx, dy);
            let column = (x as isize + sx).clamp(0, extent.width as isize - 1) as usize;
            let row = (y as isize + sy).clamp(0, extent.height as isize - 1) as usize;
            footprint.pixels[footprint.count] = ((extent.top + row) * width + column) as u32;
            footprint.count += 1;
        }
        footprint
    }

    /// A pixel, and the same of so many frames before and after.
    pub(in crate::patch) fn through_time(&self, pixel: usize, frames: usize) -> impl Iterator<Item = usize> {
        let step = if self.timed { self.images[0].height * self.stack.width } else { self.labels.len().max(1) };
        let here = pixel / step;
        let last = (self.labels.len() / step).saturating_sub(1);
        (here.saturating_sub(frames)..=(here + frames).min(last)).map(move |t| t * step + pixel % step)
    }

    /// How many of the pixels of `a` the other covers, which reaches so many frames before and after its own.
    pub(in crate::patch) fn overlap(&self, a: &Footprint, b: &Footprint, frames: usize) -> u64 {
        let near = if self.timed { a.image.abs_diff(b.image) <= frames } else { a.image == b.image };
        if !near {
            return 0;
        }
        let same = |pixel: u32| b.pixels[..b.count].iter().filter(|&&p| p - b.start == pixel - a.start).count() as u64;
        a.pixels[..a.count].iter().map(|&pixel| same(pixel)).sum()
    }
}

/// Places by chance in windows round a patch, each half as large as the one before.
#[derive(Debug)]
pub(in crate::patch) struct Windows {
    centre: isize,
    width: isize,
    /// Pixels of a frame, where there are others.
    frame: isize,
    reach: u64,
    /// Frames.
    span: u64,
    chance: u64,
}

impl Windows {
    /// Round `centre` of `patches`; `reach` is half the side of the first window. Through the frames of a clip the first
    /// window reaches to all of them.
    pub fn new(centre: Place, patches: &Patches, reach: usize, chance: u64) -> Self {
        let span = patches.frames() as u64 - 1;
        let frame = if span > 0 { (patches.images[0].height * patches.stack.width) as isize } else { 0 };
        let (centre, width) = (centre.0 as isize, patches.stack.width as isize);
        Self { centre, width, frame, reach: reach as u64, span, chance }
    }
}

impl Iterator for Windows {
    type Item = isize;

    fn next(&mut self) -> Option<isize> {
        while self.reach > 0 || self.span > 0 {
            self.chance = rng::mix(self.chance);
            let shift =
                |bits: u64, reach: u64| (((bits & 0xffff_ffff) * (2 * reach + 1)) >> 32) as isize - reach as isize;
            let (dx, dy) = (shift(self.chance, self.reach), shift(self.chance >> 32, self.reach));
            let frames = if self.span > 0 { shift(rng::mix(self.chance ^ self.span), self.span) } else { 0 };
            (self.reach, self.span) = (self.reach / 2, self.span / 2);
            if (0..self.width).contains(&(self.centre % self.width + dx)) {
                return Some(self.centre + dy * self.width + dx + frames * self.frame);
            }
        }
        None
    }
}

/// Samples a patch of `patches` round `place` through a matrix, between pixels, into rows of `row` bytes; beyond the image
/// its edge goes on.
pub(in crate::patch) fn gather(
    patches: &Patches,
    place: Place,
    matrix: Matrix,
    (radius, row): (usize, usize),
    out: &mut [u8],
) {
    let sampler = Sampler::new(patches, place, matrix);
    let radius = radius as i32;
    for (dy, out) in (-radius..=radius).zip(out.chunks_exact_mut(row)) {
        sampler.row((radius, dy), patches.stack.channels, out);
    }
}

/// A source patch, seen through a matrix.
pub(in crate::patch) struct Sampler<'a> {
    stack: &'a Stack,
    extent: Extent,
    centre: (i32, i32),
    matrix: Matrix,
}

impl<'a> Sampler<'a> {
    /// The patch at `place`.
    pub fn new(patches: &'a Patches, place: Place, matrix: Matrix) -> Self {
        let stack = &patches.stack;
        let centre = ((place.index() % stack.width) as i32, (place.index() / stack.width) as i32);
        Self { stack, extent: patches.extent(place), centre, matrix }
    }

    /// The row `dy` pixels below the middle of a patch of `radius`: the first `count` channels of its pixels.
    #[inline]
    pub fn row(&self, (radius, dy): (i32, i32), count: usize, out: &mut [u8]) {
        let (stack, extent, (x, y)) = (self.stack, self.extent, self.centre);
        let (last_x, top) = (extent.width as i32 - 1, extent.top as i32);
        let last_y = (extent.top + extent.height) as i32 - 1;
        let at = |x: i32, y: i32| &stack.bytes()[(y as usize * stack.width + x as usize) * stack.channels..][..count];
        for (dx, out) in (-radius..=radius).zip(out.chunks_exact_mut(count)) {
            let (ox, oy) = self.matrix.apply(dx, dy);
            let across = |step: i32| (x + (ox >> 16) + step).clamp(0, last_x);
            let downwards = |step: i32| (y + (oy >> 16) + step).clamp(top, last_y);
            let (left, right, up, down) = (across(0), across(1), downwards(0), downwards(1));
            let (fx, fy) = (((ox >> 9) & 127) as u32, ((oy >> 9) & 127) as u32);
            let weights = [(128 - fx) * (128 - fy), fx * (128 - fy), (128 - fx) * fy, fx * fy];
            let taps = [at(left, up), at(right, up), at(left, down), at(right, down)];
            for (c, out) in out.iter_mut().enumerate() {
                let sum: u32 = (0..4).map(|k| weights[k] * u32::from(taps[k][c])).sum();
                *out = ((sum + (1 << 13)) >> 14) as u8;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::pose::{Pose, Turn};
    use super::super::segments::{BOUNDARY, Thresholds, labels};
    use super::*;
    use crate::raster::image::Plane;

    fn image(w: usize, h: usize, offset: f32) -> (Stack, Vec<u8>) {
        let plane = Plane::from_fn(w, h, |x, y| offset + (x + 7 * y) as f32 / 255.0);
        (Stack::from_planes(&[plane]), labels((w, h), 2, None, Thresholds::default()))
    }

    fn patches(images: &[(usize, usize, f32)]) -> Patches {
        let mut all = Patches::none(1);
        for &(w, h, offset) in images {
            let (stack, labels) = image(w, h, offset);
            all.push(&stack, labels);
        }
        all
    }

    #[test]
    fn every_patch_is_found_where_it_lies() {
        // The second is wider, the third narrower than what stands there before.
        let all = patches(&[(6, 9, 0.25), (9, 6, 0.0), (7, 7, 0.5)]);
        assert_eq!((all.images(), all.count(), all.size(1)), (3, 2 * 5 + 5 * 2 + 3 * 3, (9, 6)));
        assert_eq!(all.centres(INTERIOR).count(), all.count());
        for centre in all.centres(INTERIOR) {
            let (i, x, y) = all.locate(Place(centre));
            let value = (x + 7 * y) as f32 + [63.75, 0.0, 127.5][i];
            assert!((f32::from(all.stack.pixel(centre as usize)[0]) - value).abs() <= 0.5);
            assert_eq!(all.at(i, x, y, INTERIOR), Some(Place(centre)));
        }
        assert_eq!((all.at(0, 7, 3, INTERIOR), all.at(1, 1, 3, INTERIOR)), (None, None));
        assert!(!all.clone().in_time().timed, "images of several sizes are no clip");
    }

    #[test]
    fn every_patch_is_met_by_chance_and_no_other() {
        let ramp = Plane::from_fn(21, 9, |x, _| x as f32 / 20.0);
        let labels = labels((21, 9), 2, Some(&ramp), Thresholds::default());
        let all = Patches::new(Stack::zeros(21, 9, 1), labels);
        assert_eq!((all.count_in(BOUNDARY), all.count_in(INTERIOR)), (75, 5));
        for segment in SEGMENTS {
            let met: std::collections::BTreeSet<u32> =
                (0..4000).filter_map(|k| all.any(segment, rng::mix(k))).collect();
            assert_eq!(met.into_iter().collect::<Vec<_>>(), all.centres(segment).collect::<Vec<_>>());
        }
        assert_eq!((all.merged().count_in(INTERIOR), all.merged().any(BOUNDARY, 1)), (80, None));
        assert!(!all.is_served_by(&all.merged()) && all.merged().is_served_by(&all));
    }

    #[test]
    fn places_are_moved_through_space_and_time_and_never_past_an_edge() {
        let all = patches(&[(9, 8, 0.0), (9, 8, 0.0), (9, 8, 0.0)]).in_time();
        let from = all.at(1, 4, 4, INTERIOR).unwrap();
        let moved = |x, y, t| all.moved(from, Offset { x, y, t }, INTERIOR).map(|place| all.locate(place));
        assert_eq!(moved(2, -2, 1), Some((2, 6, 2)));
        assert_eq!(moved(0, 0, -1), Some((0, 4, 4)));
        assert_eq!([moved(3, 0, 0), moved(0, 2, 0), moved(0, 0, 2), moved(9, 0, 0), moved(-5, 0, 0)], [None; 5]);
        let met: std::collections::BTreeSet<usize> = (0..200)
            .flat_map(|k| Windows::new(from, &all, 4, rng::mix(k)))
            .filter_map(|at| all.in_segment(at, INTERIOR))
            .map(|at| all.locate(Place(at)).0)
            .collect();
        assert_eq!(met.len(), 3, "other frames are met by chance");
        let still = patches(&[(9, 8, 0.0), (9, 7, 0.0)]);
        assert_eq!(still.moved(Place(4 * 9 + 4), Offset { t: 1, ..Offset::default() }, INTERIOR), None);
    }

    #[test]
    fn upright_patches_are_gathered_as_they_lie_and_turned_ones_as_a_ramp_turns() {
        let plane = Plane::from_fn(15, 13, |x, y| (40 + 5 * x + 3 * y) as f32 / 255.0);
        let all = Patches::new(Stack::from_planes(&[plane]), labels((15, 13), 2, None, Thresholds::default()));
        let at = |x: usize, y: usize| Place((y * 15 + x) as u32);
        let mut out = [0; 5 * 32];
        gather(&all, at(7, 6), Matrix::IDENTITY, (2, 32), &mut out);
        for (k, (dx, dy)) in (0..25).map(|k| (k, (k % 5, k / 5))) {
            assert_eq!(out[dy * 32 + dx], all.stack.pixel((6 + dy - 2) * 15 + 7 + dx - 2)[0], "{k}");
        }
        for degrees in (0..360).step_by(17) {
            gather(&all, at(7, 6), Turn::degrees(degrees as f32).matrix(), (2, 32), &mut out);
            let (sin, cos) = (degrees as f32).to_radians().sin_cos();
            for (dx, dy) in (0..25).map(|k| (k % 5, k / 5)) {
                let (x, y) = (dx as f32 - 2.0, dy as f32 - 2.0);
                let right = 40.0 + 5.0 * (7.0 + cos * x + sin * y) + 3.0 * (6.0 - sin * x + cos * y);
                assert!((f32::from(out[dy * 32 + dx]) - right).abs() <= 0.6, "{degrees}");
            }
        }
        // At a corner the edge goes on.
        gather(&all, at(2, 2), Turn::degrees(45.0).matrix(), (2, 32), &mut out);
        assert!(out.chunks_exact(32).all(|row| row[..5].iter().all(|&v| v >= 40)));
    }
}
