//! Pictures of a scene for its part of the page: what it is made from, and the motion asked for.

use std::borrow::Cow;
use std::path::Path;

use super::plan::PlannedScene;
use crate::base::error::{Error, Result};
use crate::base::observe::{Observer, Silent};
use crate::flow::draw::{arrows, strokes};
use crate::flow::field::Field;
use crate::flow::stroke_files;
use crate::raster::image::{Plane, Rgb8};
use crate::raster::picture_io::write_png;
use crate::raster::resample::{resize, resize_rgb8};
use crate::scene::designed::Designed;
use crate::scene::exemplar_file::ExemplarFile;
use crate::scene::scene::{Scene, Still};
use crate::synth::exemplar::files::{self, Frames, Reading};
use crate::video::conform::{ConformOptions, Conformed};

/// Folder of the pictures, in that of the scene.
const FOLDER: &str = "pictures";
/// Longest side of a picture, pixels.
const LONG_SIDE: usize = 640;
/// Brightness of black, and how much more white has, under arrows.
const DIMMED: (f32, f32) = (0.12, 0.4);

/// A picture: its name, what it shows, and its pixels.
type Captioned = (Cow<'static, str>, String, Rgb8);

/// Writes the scene's pictures into its folder, and tells where each is, as seen from the page, and what it shows. What
/// cannot be read is noted: the rows that need it tell the rest.
///
/// # Errors
/// A folder that cannot be written to, a full disk.
pub fn write(planned: &PlannedScene, output: &Path, observer: &dyn Observer) -> Result<Vec<(String, String)>> {
    let folder = output.join(&planned.name).join(FOLDER);
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
    let mut written = Vec::new();
    for pictures in [scene(planned), exemplar(planned), real(planned)] {
        match pictures {
            Ok(pictures) => {
                for (name, caption, picture) in pictures {
                    write_png(&folder.join(format!("{name}.png")), &picture)?;
                    written.push((format!("{}/{FOLDER}/{name}.png", planned.name), caption));
                }
            }
            Err(error) => observer.note(&format!("{}: {error}", planned.name)),
        }
    }
    Ok(written)
}

fn scene(planned: &PlannedScene) -> Result<Vec<Captioned>> {
    let scene = Scene::new(planned.file.clone())?;
    let still = scene.still(&Silent)?;
    let settings = scene.settings();
    let mut shown = match scene.designed() {
        Some(target) => designed(target, settings.output.length())?,
        None => pictured(&scene, &still)?,
    };
    if settings.background.is_some() {
        let behind = still.background.as_ref().unwrap_or(&still.picture);
        shown.push(("background".into(), "What is behind the fluid.".into(), small(behind)));
    }
    Ok(shown)
}

/// The picture, its matte, and the motion asked for.
fn pictured(scene: &Scene, still: &Still) -> Result<Vec<Captioned>> {
    let picture = small(&still.picture);
    let moves = motion_asked(scene, still, &picture)?;
    let mut caption = "The picture.".to_owned();
    if scene.settings().matte.is_none() {
        caption += " It has no matte: all of it may move.";
    }
    if moves.is_none() {
        caption += " No direction is asked for.";
    }
    let matte = scene.settings().matte.is_some().then(|| {
        let matte = resize(&still.matte, picture.width, picture.height);
        ("matte".into(), "Its matte: what is white may move.".to_owned(), grey(&matte))
    });
    let moves = moves.map(|(caption, picture)| ("motion".into(), caption, picture));
    Ok([Some(("picture".into(), caption, picture)), matte, moves].into_iter().flatten().collect())
}

/// What is asked, drawn over the picture.
fn motion_asked(scene: &Scene, still: &Still, picture: &Rgb8) -> Result<Option<(String, Rgb8)>> {
    let Some(asked) = &still.asked else { return Ok(None) };
    let timed = asked.speed.data.iter().any(|&s| s > 0.0);
    let length = |i: usize, part: f32| match asked.speed.data[i] {
        s if s >= 0.0 && timed => part * s,
        _ => part,
    };
    let inside = |plane: &Plane| {
        let parts = plane.data.iter().zip(&still.working_matte.data).enumerate();
        let data = parts.map(|(i, (&part, &matte))| if matte >= 0.5 { length(i, part) } else { 0.0 });
        resize(&Plane::from_vec(plane.width, plane.height, data.collect()), picture.width, picture.height)
    };
    let field = Field { u: inside(&asked.direction.u), v: inside(&asked.direction.v) };
    if field.u.data.iter().chain(&field.v.data).all(|&v| v == 0.0) {
        return Ok(None);
    }
    let mut drawn = dimmed(&picture.luma());
    arrows(&mut drawn, &field);
    let mut caption = "The motion asked for".to_owned();
    if let Some(path) = &scene.settings().motion.strokes {
        let size = still.map.picture;
        let scale = picture.width as f32 / size.0 as f32;
        let lines: Vec<_> = stroke_files::read(path, size)?.into_iter().map(|stroke| stroke.points).collect();
        strokes(&mut drawn, &lines, scale);
        caption += ", with the strokes that ask for it in white";
    }
    Ok(Some((caption + if timed { "; longer is faster." } else { "." }, drawn)))
}

/// A target's opacity and motion in the middle of its frames.
fn designed(target: &Designed, frames: usize) -> Result<Vec<Captioned>> {
    let t = frames / 2;
    // A small one is enlarged, so that there is room for arrows.
    let (width, height) = sized_to(target.size, f32::INFINITY);
    let sized = |plane: &Plane| resize(plane, width, height);
    let alpha = sized(&target.alpha(t)?);
    let mut shown = vec![("alpha".into(), format!("The target's opacity, frame {t}."), grey(&alpha))];
    if target.has_flow() {
        let (flow, mut drawn) = (target.flow(t)?, dimmed(&alpha));
        arrows(&mut drawn, &Field { u: sized(&flow.u), v: sized(&flow.v) });
        shown.push(("motion".into(), format!("The target's motion, frame {t}; longer is faster."), drawn));
    }
    Ok(shown)
}

fn exemplar(planned: &PlannedScene) -> Result<Vec<Captioned>> {
    let fps = planned.file.output.fps;
    let reading = Reading { long_side: LONG_SIDE, picture_side: LONG_SIDE, limit: 2, fps, fade: 0, room: None };
    let exemplars = &planned.file.exemplars;
    let which = |n: usize| if exemplars.len() > 1 { format!("Exemplar {n}") } else { "The exemplar".to_owned() };
    let shown = |(exemplar, n): (&ExemplarFile, usize)| {
        let (picture, frame) = match files::read(exemplar, &reading, &Silent)? {
            Frames::Still(frame) => (frame.on_black(), ""),
            Frames::Clip(frames) => (frames[0].unpacked().on_black(), ", its first frame"),
        };
        let caption = format!("{}{frame}: what the looks are borrowed from, over black.", which(n));
        let name = if n > 1 { Cow::Owned(format!("exemplar-{n}")) } else { "exemplar".into() };
        Ok((name, caption, small(&picture)))
    };
    exemplars.iter().zip(1..).map(shown).collect()
}

fn real(planned: &PlannedScene) -> Result<Vec<Captioned>> {
    let Some(path) = &planned.file.reference else { return Ok(Vec::new()) };
    let rate = f64::from(planned.file.output.fps);
    let first = Conformed::open(path, &ConformOptions { rate, long_side: LONG_SIDE, ..ConformOptions::default() })?
        .next_frame()?;
    Ok(first.into_iter().map(|frame| ("real".into(), "The real clip, its first frame.".to_owned(), frame)).collect())
}

/// The size with a long side of [`LONG_SIDE`], enlarged by at most `largest`.
fn sized_to((width, height): (usize, usize), largest: f32) -> (usize, usize) {
    let scale = (LONG_SIDE as f32 / width.max(height).max(1) as f32).min(largest);
    let side = |v: usize| ((v as f32 * scale).round() as usize).max(1);
    (side(width), side(height))
}

fn small(picture: &Rgb8) -> Rgb8 {
    let (width, height) = sized_to((picture.width, picture.height), 1.0);
    resize_rgb8(picture, width, height)
}

fn grey(plane: &Plane) -> Rgb8 {
    let bytes = plane.data.iter().flat_map(|v| [(v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8; 3]);
    Rgb8 { width: plane.width, height: plane.height, data: bytes.collect() }
}

/// Dark enough for colours to be seen on it.
fn dimmed(luma: &Plane) -> Rgb8 {
    grey(&luma.map(|v| DIMMED.0 + DIMMED.1 * v))
}
