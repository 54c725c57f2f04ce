//! The motion that a person asks for, from everything that may say it, on the working image.

use super::file::Motion;
use super::frame_map::{FrameMap, PicturePoint, WorkingPoint};
use crate::base::error::Result;
use crate::base::observe::Observer;
use crate::flow::field::Field;
use crate::flow::strokes::{self, MAX_SPEED, Stroke, StrokeField};
use crate::flow::{orientation, stroke_files};
use crate::raster::components::Components;
use crate::raster::image::Plane;
use crate::raster::picture_io::{read_grey, read_picture};
use crate::raster::resample::resize;

/// More matte than this is fluid that may move.
pub const FLUID: f32 = 0.02;
/// A direction less sure than this is not asked: strokes that disagree cancel between them.
const LEAST_STRENGTH: f32 = 0.25;

/// What a person asks of the motion at every pixel of the working image.
#[derive(Debug, Clone, PartialEq)]
pub struct Asked {
    /// Direction, as vectors of length 0 (nothing asked) to 1.
    pub direction: Field,
    /// Speed in pixels of the working image per output frame; negative where none is asked.
    pub speed: Plane,
}

/// What is asked of one place.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Wish {
    /// Direction, a unit vector (u right, v down).
    pub direction: Option<(f32, f32)>,
    /// Speed in pixels of the working image per output frame, 0 or more.
    pub speed: Option<f32>,
}

impl Asked {
    /// Reads and joins what `motion` names; `None` when it names nothing. `matte` is the one at working size.
    ///
    /// Where several things speak of one place, the one painted there holds: the orientation map where it is coloured,
    /// else the strokes on their part of the matte, else the direction. A speed map holds everywhere; without one, the
    /// strokes' speeds do.
    ///
    /// # Errors
    /// Those of [`stroke_files::read`] and of unreadable maps.
    pub fn read(motion: &Motion, map: &FrameMap, matte: &Plane, observer: &dyn Observer) -> Result<Option<Self>> {
        let Motion { direction, strokes, orientation, speed, max_speed } = motion;
        if direction.is_none() && strokes.is_none() && orientation.is_none() && speed.is_none() {
            return Ok(None);
        }
        let (width, height) = map.working;
        let mut asked = Self::everywhere(*direction, (width, height));
        if let Some(path) = strokes {
            let drawn = stroke_files::read(path, map.picture)?;
            asked.follow(&drawn, motion, map, matte, observer);
        }
        if let Some(path) = orientation {
            let picture = read_picture(path)?;
            let painted = orientation::decode(&picture.rgb, picture.alpha.as_deref());
            asked.paint(&Field { u: resize(&painted.u, width, height), v: resize(&painted.v, width, height) });
        }
        if let Some(path) = speed {
            let white = max_speed.unwrap_or(MAX_SPEED) * map.working_scale();
            asked.speed = resize(&read_grey(path)?, width, height).map(|grey| grey.max(0.0) * white);
        }
        Ok(Some(asked))
    }

    /// One direction, in degrees, for all of an image, and no speed.
    fn everywhere(degrees: Option<f32>, (width, height): (usize, usize)) -> Self {
        let (v, u) = degrees.map_or((0.0, 0.0), |d| d.to_radians().sin_cos());
        let direction = Field { u: Plane::filled(width, height, u), v: Plane::filled(width, height, v) };
        Self { direction, speed: Plane::filled(width, height, -1.0) }
    }

    /// Lays the strokes' field over the parts of the matte that have strokes, and tells what strokes cannot say.
    fn follow(&mut self, drawn: &[Stroke], motion: &Motion, map: &FrameMap, matte: &Plane, observer: &dyn Observer) {
        let scale = map.working_scale();
        let working = |stroke: &Stroke| {
            let point = |&(x, y): &(f32, f32)| {
                let WorkingPoint(x, y) = map.to_working(PicturePoint(x, y));
                (x, y)
            };
            Stroke { points: stroke.points.iter().map(point).collect(), speed: stroke.speed.map(|s| s * scale) }
        };
        let parts = Components::above(matte, FLUID);
        let field = strokes::interpolate(&drawn.iter().map(working).collect::<Vec<_>>(), &parts);
        for (i, _) in parts.labels.iter().enumerate().filter(|(_, l)| **l > 0 && field.reached[**l as usize - 1]) {
            (self.direction.u.data[i], self.direction.v.data[i]) =
                (field.direction.u.data[i], field.direction.v.data[i]);
            self.speed.data[i] = field.speed.data[i];
        }
        note_strokes(&field, &parts, motion, drawn, observer);
    }

    /// Lays a painted direction over what is asked, where there is paint.
    fn paint(&mut self, painted: &Field) {
        let Field { u, v } = &mut self.direction;
        let over = u.data.iter_mut().zip(&mut v.data).zip(painted.u.data.iter().zip(&painted.v.data));
        for ((u, v), (&pu, &pv)) in over.filter(|(_, (pu, pv))| pu.hypot(**pv) >= LEAST_STRENGTH / 4.0) {
            (*u, *v) = (pu, pv);
        }
    }

    /// What is asked of the fluid in the square of `side` pixels at `(x, y)`: means over it, weighted by the matte.
    pub fn square(&self, matte: &Plane, x: usize, y: usize, side: usize) -> Wish {
        let (mut u, mut v, mut fluid, mut speed, mut timed) = (0.0, 0.0, 0.0f32, 0.0, 0.0f32);
        for y in y..(y + side).min(matte.height) {
            for i in y * matte.width + x..y * matte.width + (x + side).min(matte.width) {
                let weight = matte.data[i];
                (u, v, fluid) =
                    (u + weight * self.direction.u.data[i], v + weight * self.direction.v.data[i], fluid + weight);
                if self.speed.data[i] >= 0.0 {
                    (speed, timed) = (speed + weight * self.speed.data[i], timed + weight);
                }
            }
        }
        let norm = u.hypot(v);
        Wish {
            direction: (norm > 0.0 && norm >= LEAST_STRENGTH * fluid).then(|| (u / norm, v / norm)),
            speed: (timed > 0.0).then(|| speed / timed),
        }
    }
}

fn note_strokes(field: &StrokeField, parts: &Components, motion: &Motion, drawn: &[Stroke], observer: &dyn Observer) {
    for number in &field.outside {
        observer.note(&format!("stroke {number} lies outside the matte and says nothing"));
    }
    let missed = || field.reached.iter().zip(&parts.sizes).filter(|(reached, _)| !**reached).map(|(_, size)| size);
    let share = 100.0 * missed().sum::<usize>() as f32 / parts.sizes.iter().sum::<usize>().max(1) as f32;
    if share >= 1.0 {
        let there = match (&motion.orientation, motion.direction) {
            (Some(_), _) => "there the orientation map holds, where it is painted".to_owned(),
            (None, Some(degrees)) => format!("there the direction of {degrees}° holds"),
            (None, None) => "no direction is asked for there".to_owned(),
        };
        let count = missed().count();
        let (parts, have) = if count == 1 { ("part", "has") } else { ("parts", "have") };
        observer.note(&format!("{count} {parts} of the matte ({share:.0} % of it) {have} no stroke: {there}"));
    } else if motion.direction.is_some() {
        observer.note("strokes are given, so the direction is left aside");
    }
    if motion.speed.is_some() && drawn.iter().any(|s| s.speed.is_some()) {
        observer.note("a speed map is given, so the speeds of the strokes are left aside");
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::base::observe::testing::Notes;
    use crate::raster::picture_io::write_png;

    /// A picture of 200 × 120, worked on at 100 × 60, its matte in two parts.
    fn place() -> (FrameMap, Plane) {
        let map = FrameMap { picture: (200, 120), working: (100, 60), output: (200, 120) };
        (map, Plane::from_fn(100, 60, |x, _| if (45..55).contains(&x) { 0.0 } else { 1.0 }))
    }

    fn read(motion: &Motion) -> (Asked, Vec<String>) {
        let (map, matte) = place();
        let notes = Notes::default();
        let asked = Asked::read(motion, &map, &matte, &notes).unwrap().unwrap();
        (asked, notes.0.into_inner().unwrap())
    }

    fn write_strokes(folder: &Path) -> std::path::PathBuf {
        let path = folder.join("s.json");
        let text = r#"{"strokes": [{"points": [[40, 20], [40, 100]], "speed": 4}, {"points": [[98, 1], [102, 9]]}]}"#;
        std::fs::write(&path, text).unwrap();
        path
    }

    #[test]
    fn nothing_named_asks_nothing() {
        let (map, matte) = place();
        assert_eq!(Asked::read(&Motion::default(), &map, &matte, &Notes::default()).unwrap(), None);
    }

    #[test]
    fn strokes_hold_on_their_part_and_the_direction_on_the_rest() {
        let folder = tempfile::tempdir().unwrap();
        let strokes = Some(write_strokes(folder.path()));
        let (_, matte) = place();
        let (asked, notes) = read(&Motion { strokes: strokes.clone(), ..Motion::default() });
        // 4 pixels of the picture are 2 of the working image.
        let wish = asked.square(&matte, 0, 0, 48);
        assert!((wish.speed.unwrap() - 2.0).abs() < 1e-4 && wish.direction.unwrap().1 > 0.999, "{wish:?}");
        assert_eq!(asked.square(&matte, 52, 0, 48), Wish::default());
        assert_eq!(notes.len(), 2, "{notes:?}");
        assert!(notes[0].contains("stroke 2 lies outside the matte"), "{notes:?}");
        assert!(notes[1].contains("1 part of the matte (50 % of it) has no stroke: no direction is asked for there"));
        let (asked, notes) = read(&Motion { strokes, direction: Some(180.0), ..Motion::default() });
        assert!(asked.square(&matte, 52, 0, 48).direction.unwrap().0 < -0.999);
        assert!(asked.square(&matte, 0, 0, 48).direction.unwrap().1 > 0.999);
        assert!(notes[1].contains("there the direction of 180° holds"), "{notes:?}");
    }

    #[test]
    fn written_maps_ask_for_what_they_show() {
        let folder = tempfile::tempdir().unwrap();
        let (asked, _) = read(&Motion { strokes: Some(write_strokes(folder.path())), ..Motion::default() });
        let (map, matte) = place();
        let full = |p: &Plane| resize(p, map.picture.0, map.picture.1);
        let field = Field { u: full(&asked.direction.u), v: full(&asked.direction.v) };
        let speed = full(&asked.speed.map(|s| s.max(0.0) / map.working_scale()));
        let (orientation, speeds) = (folder.path().join("orientation.png"), folder.path().join("speed.png"));
        write_png(&orientation, &orientation::encode(&field)).unwrap();
        write_png(&speeds, &orientation::speed_picture(&speed, 5.0)).unwrap();
        let motion =
            Motion { orientation: Some(orientation), speed: Some(speeds), max_speed: Some(5.0), ..Motion::default() };
        let (again, _) = read(&motion);
        let (first, second) = (asked.square(&matte, 0, 0, 36), again.square(&matte, 0, 0, 36));
        let ((u, v), (x, y)) = (first.direction.unwrap(), second.direction.unwrap());
        assert!((u * x + v * y).acos().to_degrees() < 1.0, "{first:?} {second:?}");
        assert!((first.speed.unwrap() - second.speed.unwrap()).abs() < 5.0 / 255.0, "{first:?} {second:?}");
        assert_eq!(again.square(&matte, 60, 0, 36).direction, None);
    }
}
