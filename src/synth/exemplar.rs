//! What looks are borrowed from: a picture, a clip, or the picture's own fluid.

use std::borrow::Cow;
use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Plane;
use crate::raster::picture_io::{Picture, read_grey, read_picture};
use crate::raster::premultiplied::Premultiplied;
use crate::scene::file::LUMINANCE;
use crate::scene::scene::{Scene, Still};

/// Brightness below which footage on black is taken for its noise, in [0, 1].
const DARK: f32 = 0.03;
/// Brightness from which it is opaque: flames are bright long before they are white.
const BRIGHT: f32 = 0.5;
/// Alpha below which nothing is seen.
const UNSEEN: f32 = 0.5 / 255.0;

/// Frames to borrow from.
#[derive(Debug, Clone, PartialEq)]
pub struct Exemplar {
    frames: Vec<Premultiplied>,
    /// Whether it is the picture's own fluid.
    pub own: bool,
}

impl Exemplar {
    /// The exemplar of a scene, its long side at most `long_side` pixels (0: that of the working image); it is never enlarged.
    ///
    /// # Errors
    /// A designed target without an exemplar; a file that cannot be read; opacity of another size, or none anywhere; an exemplar smaller than a patch of `side`.
    pub fn of(scene: &Scene, still: &Still, long_side: usize, side: usize) -> Result<Self> {
        let Some(path) = &scene.settings().exemplar else {
            if scene.designed().is_some() {
                return Err(Error::new(Kind::Usage, "exemplar", "a designed target has no fluid of its own")
                    .remedy("name a picture or a clip whose looks are borrowed, with --exemplar"));
            }
            return Ok(Self { frames: vec![Premultiplied::new(&still.working, &still.working_matte)], own: true });
        };
        let long_side = if long_side == 0 { still.map.working.0.max(still.map.working.1) } else { long_side };
        let frame = shrunk(still_frame(path, scene.settings().exemplar_alpha.as_deref())?, long_side);
        let exemplar = Self { frames: vec![frame], own: false };
        exemplar.check(path, side)?;
        Ok(exemplar)
    }

    /// Frame `t`; negative ones come before the first.
    pub fn at(&self, _t: i64) -> Cow<'_, Premultiplied> {
        Cow::Borrowed(&self.frames[0])
    }

    /// Whether all frames are the same.
    pub fn is_still(&self) -> bool {
        self.frames.len() == 1
    }

    /// Whether there is no outline to borrow.
    pub fn is_opaque(&self) -> bool {
        self.frames.iter().all(|f| f.alpha().data.iter().all(|&a| a > 1.0 - UNSEEN))
    }

    fn check(&self, path: &Path, side: usize) -> Result<()> {
        let (width, height) = self.frames[0].size();
        if width.min(height) < side {
            return Err(Error::file(Kind::Unusable, path, format!("an exemplar of {width} × {height} pixels"))
                .allowed(format!("at least {side} × {side}, one patch")));
        }
        if self.frames.iter().all(|f| f.alpha().data.iter().all(|&a| a < UNSEEN)) {
            return Err(Error::file(Kind::Unusable, path, "the exemplar is transparent all over")
                .remedy("give its opacity with --exemplar-alpha: a grey picture, white where the fluid is"));
        }
        Ok(())
    }
}

fn shrunk(frame: Premultiplied, long_side: usize) -> Premultiplied {
    let (width, height) = frame.size();
    let ratio = long_side as f64 / width.max(height) as f64;
    let of = |v: usize| ((v as f64 * ratio).round() as usize).max(1);
    if ratio >= 1.0 { frame } else { frame.resized(of(width), of(height)) }
}

fn still_frame(path: &Path, alpha: Option<&Path>) -> Result<Premultiplied> {
    let picture = read_picture(path)?;
    match alpha {
        Some(alpha) if alpha.as_os_str() == LUMINANCE => Ok(on_black(&picture)),
        Some(alpha) => {
            let plane = read_grey(alpha)?;
            let size = (picture.rgb.width, picture.rgb.height);
            if (plane.width, plane.height) != size {
                let problem =
                    format!("is {} × {} pixels, the exemplar {} × {}", plane.width, plane.height, size.0, size.1);
                return Err(Error::file(Kind::Unusable, alpha, problem).remedy("make it the exemplar's size"));
            }
            Ok(Premultiplied::new(&picture.rgb.to_color(), &plane))
        }
        None => Ok(with_own_alpha(&picture)),
    }
}

fn with_own_alpha(Picture { rgb, alpha }: &Picture) -> Premultiplied {
    let (width, height) = (rgb.width, rgb.height);
    let alpha = alpha.as_ref().map_or_else(
        || Plane::filled(width, height, 1.0),
        |alpha| Plane::from_vec(width, height, alpha.iter().map(|&a| f32::from(a) / 255.0).collect()),
    );
    Premultiplied::new(&rgb.to_color(), &alpha)
}

/// Footage on black: opaque where its brightest channel is bright. What the camera saw is colour times opacity already.
fn on_black(picture: &Picture) -> Premultiplied {
    let [red, green, blue] = picture.rgb.to_color().planes;
    let brightest = |i: usize| red.data[i].max(green.data[i]).max(blue.data[i]);
    let alpha = (0..red.data.len()).map(|i| ((brightest(i) - DARK) / (BRIGHT - DARK)).clamp(0.0, 1.0));
    let alpha = Plane::from_vec(red.width, red.height, alpha.collect());
    Premultiplied::from_planes([red, green, blue, alpha])
}

/// Means of the fluid's colours around every pixel, not multiplied by alpha.
pub fn surroundings(frame: &Premultiplied, sigma: f32) -> [Plane; 3] {
    let small = |p: &Plane| crate::raster::filter::gaussian(p, sigma);
    let weight = small(frame.alpha());
    let [colours @ .., _] = &frame.planes;
    colours.each_ref().map(|plane| {
        let mut mean = small(plane);
        mean.data.iter_mut().zip(&weight.data).for_each(|(m, w)| *m = if *w > 1e-4 { *m / w } else { 0.0 });
        mean
    })
}
