//! Images with opacity, their colours multiplied by it, so that they may be moved, mixed and resized like any other.

use super::image::{Color, Plane, Rgb8};
use super::resample::resize;

/// Red, green and blue times alpha, and alpha; sRGB-encoded, all in [0, 1], no colour above its alpha.
#[derive(Debug, Clone, PartialEq)]
pub struct Premultiplied {
    /// Red, green, blue, alpha.
    pub planes: [Plane; 4],
}

impl Premultiplied {
    /// From colours that are not multiplied, and alpha of their size.
    pub fn new(colour: &Color, alpha: &Plane) -> Self {
        let times = |plane: &Plane| {
            let product = plane.data.iter().zip(&alpha.data).map(|(c, a)| c.clamp(0.0, 1.0) * a);
            Plane::from_vec(alpha.width, alpha.height, product.collect())
        };
        let [red, green, blue] = colour.planes.each_ref().map(times);
        Self { planes: [red, green, blue, alpha.clone()] }
    }

    /// From four planes as they are; values are clamped to [0, 1], and colours to their alpha.
    pub fn from_planes(mut planes: [Plane; 4]) -> Self {
        let [colours @ .., alpha] = &mut planes;
        alpha.data.iter_mut().for_each(|a| *a = a.clamp(0.0, 1.0));
        for plane in colours {
            plane.data.iter_mut().zip(&alpha.data).for_each(|(c, a)| *c = c.clamp(0.0, *a));
        }
        Self { planes }
    }

    /// Width and height in pixels.
    pub fn size(&self) -> (usize, usize) {
        (self.planes[3].width, self.planes[3].height)
    }

    /// Opacity.
    pub fn alpha(&self) -> &Plane {
        &self.planes[3]
    }

    /// Antialiased to another size.
    pub fn resized(&self, width: usize, height: usize) -> Self {
        Self::from_planes(self.planes.each_ref().map(|p| resize(p, width, height)))
    }

    /// Over black, for people.
    pub fn on_black(&self) -> Rgb8 {
        let [red, green, blue, _] = self.planes.clone();
        Color::from_planes([red, green, blue]).to_rgb8()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn colours_never_exceed_their_alpha() {
        let colour = Color::from_planes([0.5, 1.0, 0.0].map(|v| Plane::filled(9, 7, v)));
        let alpha = Plane::from_fn(9, 7, |x, _| if x < 4 { 0.0 } else { 1.0 });
        let image = Premultiplied::new(&colour, &alpha);
        assert_eq!((image.planes[0].at(8, 0), image.planes[1].at(0, 0), image.size()), (0.5, 0.0, (9, 7)));
        let larger = image.resized(31, 20);
        assert!((0..4).all(|c| larger.planes[c].data.iter().zip(&larger.alpha().data).all(|(v, a)| v <= a)));
    }
}
