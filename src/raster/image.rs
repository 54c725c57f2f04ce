//! Image types: one `f32` plane, three planes with their colour space in the type, and packed 8-bit RGB.
//!
//! Linear index is `y * width + x`. Pixel `(x, y)` covers the unit square whose centre is `(x + ½, y + ½)`.

use std::marker::PhantomData;

/// One channel of `f32`, row by row without padding.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Plane {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height` values.
    pub data: Vec<f32>,
}

impl Plane {
    /// A plane filled with `value`.
    pub fn filled(width: usize, height: usize, value: f32) -> Self {
        Self { width, height, data: vec![value; width * height] }
    }

    /// A plane of zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self::filled(width, height, 0.0)
    }

    /// A plane from its values.
    ///
    /// # Panics
    /// When `data` has not `width * height` values.
    pub fn from_vec(width: usize, height: usize, data: Vec<f32>) -> Self {
        assert_eq!(data.len(), width * height);
        Self { width, height, data }
    }

    /// A plane from a function of `(x, y)`.
    pub fn from_fn(width: usize, height: usize, mut f: impl FnMut(usize, usize) -> f32) -> Self {
        let data = (0..height).flat_map(|y| (0..width).map(move |x| (x, y))).map(|(x, y)| f(x, y)).collect();
        Self { width, height, data }
    }

    /// The value at `(x, y)`.
    #[inline]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        self.data[y * self.width + x]
    }

    /// The value at `(x, y)`, to write.
    #[inline]
    pub fn at_mut(&mut self, x: usize, y: usize) -> &mut f32 {
        &mut self.data[y * self.width + x]
    }

    /// Row `y`.
    #[inline]
    pub fn row(&self, y: usize) -> &[f32] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// Row `y`, to write.
    #[inline]
    pub fn row_mut(&mut self, y: usize) -> &mut [f32] {
        &mut self.data[y * self.width..(y + 1) * self.width]
    }

    /// The value at integer position with coordinates clamped to the border.
    #[inline]
    pub fn clamped(&self, x: isize, y: isize) -> f32 {
        let x = x.clamp(0, self.width as isize - 1) as usize;
        let y = y.clamp(0, self.height as isize - 1) as usize;
        self.at(x, y)
    }

    /// Bilinear value at the continuous position `(x, y)` (pixel centres at ½), clamped to the border.
    #[inline]
    pub fn bilinear(&self, x: f32, y: f32) -> f32 {
        let (fx, fy) = (x - 0.5, y - 0.5);
        let (x0, y0) = (fx.floor(), fy.floor());
        let (ax, ay) = (fx - x0, fy - y0);
        let (x0, y0) = (x0 as isize, y0 as isize);
        let top = self.clamped(x0, y0) * (1.0 - ax) + self.clamped(x0 + 1, y0) * ax;
        let bottom = self.clamped(x0, y0 + 1) * (1.0 - ax) + self.clamped(x0 + 1, y0 + 1) * ax;
        top * (1.0 - ay) + bottom * ay
    }

    /// Each value through `f`.
    pub fn map(&self, f: impl FnMut(f32) -> f32) -> Self {
        Self { width: self.width, height: self.height, data: self.data.iter().copied().map(f).collect() }
    }
}

/// A colour space; only a name in the type.
pub trait Space: Clone + Copy + Default + std::fmt::Debug + PartialEq + Send + Sync + 'static {}

/// sRGB-encoded red, green, blue in [0, 1]: the crate's working space unless said otherwise.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Srgb;
/// Signed differences of sRGB-encoded values, in [-1, 1].
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Difference;

impl Space for Srgb {}
impl Space for Difference {}

/// Luma of encoded red, green and blue, Rec. 709 weights.
#[inline(always)]
pub fn luma([red, green, blue]: [f32; 3]) -> f32 {
    0.2126 * red + 0.7152 * green + 0.0722 * blue
}

/// Three planes of equal size in colour space `S`.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Color<S: Space = Srgb> {
    /// The three channels.
    pub planes: [Plane; 3],
    space: PhantomData<S>,
}

impl<S: Space> Color<S> {
    /// From three planes.
    ///
    /// # Panics
    /// When their sizes differ.
    pub fn from_planes(planes: [Plane; 3]) -> Self {
        let size = (planes[0].width, planes[0].height);
        assert!(planes.iter().all(|p| (p.width, p.height) == size));
        Self { planes, space: PhantomData }
    }

    /// All zeros.
    pub fn zeros(width: usize, height: usize) -> Self {
        Self::from_planes(std::array::from_fn(|_| Plane::zeros(width, height)))
    }

    /// Width in pixels.
    pub fn width(&self) -> usize {
        self.planes[0].width
    }

    /// Height in pixels.
    pub fn height(&self) -> usize {
        self.planes[0].height
    }

    /// Each plane through `f`, in the same space.
    pub fn map_planes(&self, f: impl FnMut(&Plane) -> Plane) -> Self {
        Self::from_planes(self.planes.each_ref().map(f))
    }
}

impl Color<Srgb> {
    /// Luma of the sRGB-encoded values, Rec. 709 weights, in [0, 1].
    pub fn luma(&self) -> Plane {
        let [r, g, b] = &self.planes;
        let data = r.data.iter().zip(&g.data).zip(&b.data);
        Plane::from_vec(r.width, r.height, data.map(|((r, g), b)| luma([*r, *g, *b])).collect())
    }

    /// Rounded to 8 bits, clamped to [0, 1] first.
    pub fn to_rgb8(&self) -> Rgb8 {
        let mut out = Rgb8::black(self.width(), self.height());
        for (c, plane) in self.planes.iter().enumerate() {
            for (pixel, &value) in out.data.chunks_exact_mut(3).zip(&plane.data) {
                pixel[c] = (value.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
            }
        }
        out
    }
}

/// Packed 8-bit sRGB, three bytes a pixel, rows without padding.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Rgb8 {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// `width * height * 3` bytes.
    pub data: Vec<u8>,
}

impl Rgb8 {
    /// All black.
    pub fn black(width: usize, height: usize) -> Self {
        Self { width, height, data: vec![0; width * height * 3] }
    }

    /// The pixel at `(x, y)`.
    pub fn pixel(&self, x: usize, y: usize) -> [u8; 3] {
        let i = (y * self.width + x) * 3;
        [self.data[i], self.data[i + 1], self.data[i + 2]]
    }

    /// As `f32` planes in [0, 1].
    pub fn to_color(&self) -> Color<Srgb> {
        let plane = |c: usize| {
            let data = self.data.chunks_exact(3).map(|p| f32::from(p[c]) * (1.0 / 255.0)).collect();
            Plane::from_vec(self.width, self.height, data)
        };
        Color::from_planes([plane(0), plane(1), plane(2)])
    }

    /// Luma in [0, 1], Rec. 709 weights on the encoded values.
    pub fn luma(&self) -> Plane {
        let luma = |p: &[u8]| luma([p[0], p[1], p[2]].map(f32::from)) / 255.0;
        Plane::from_vec(self.width, self.height, self.data.chunks_exact(3).map(luma).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn eight_bit_round_trip_is_exact() {
        let data = (0..=255u8).flat_map(|v| [v, 255 - v, v / 2]).collect();
        let image = Rgb8 { width: 256, height: 1, data };
        assert_eq!(image.to_color().to_rgb8(), image);
    }

    #[test]
    fn bilinear_reads_pixels_at_their_centres() {
        let plane = Plane::from_fn(4, 3, |x, y| (x + 10 * y) as f32);
        assert_eq!(plane.bilinear(2.5, 1.5), 12.0);
        assert_eq!(plane.bilinear(3.0, 1.5), 12.5);
        assert_eq!(plane.bilinear(-5.0, -5.0), 0.0);
    }
}
