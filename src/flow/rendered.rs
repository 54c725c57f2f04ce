//! Motion fields of any sort of file: `.flo`, OpenEXR from a renderer, 16-bit PNG.

use std::path::Path;

use crate::base::error::{Error, Kind, Result};
use crate::flow::field::Field;
use crate::flow::io;
use crate::raster::exr_file;
use crate::raster::image::Plane;
use crate::raster::picture_io::{picture_size, read_deep};

/// Extensions of the files that are read.
pub const EXTENSIONS: [&str; 3] = ["flo", "exr", "png"];

/// Which two frames the motion in a file joins.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Joins {
    /// This frame and the next: where what is here goes.
    Next,
    /// The frame before and this one: where what is here came from.
    Previous,
}

/// A field and what it joins; pixels per frame in time's own direction, `v` downwards, either way.
#[derive(Debug, Clone, PartialEq)]
pub struct Rendered {
    /// The motion.
    pub field: Field,
    /// Between which frames.
    pub joins: Joins,
}

/// Reads a motion field, told by the file's extension.
///
/// - `.flo` (Middlebury, Baker et al. 2011): motion to the next frame.
/// - `.exr` with channels X, Y, Z and W of one layer, as Blender's Vector pass has: X and Y hold where the surface was in
///   the frame before, less where it is, with y upwards (Cycles, `primitive_motion_vector`); so the motion from the frame
///   before is (−X, Y).
/// - `.exr` with channels R and G: motion to the next frame, v downwards.
/// - `.png` of 16-bit colours, as in KITTI (Menze & Geiger 2015): u = (R − 32768) / 64, v = (G − 32768) / 64, known where
///   B is not 0; motion to the next frame.
///
/// # Errors
/// An unreadable file, one without such channels, a PNG that is not of 16 bits, motion that is not a number or not known.
pub fn read(path: &Path) -> Result<Rendered> {
    let (field, joins) = match extension(path).as_str() {
        "exr" => from_exr(path)?,
        "png" => (from_png(path)?, Joins::Next),
        _ => (io::read(path)?, Joins::Next),
    };
    let known = |(u, v): (&f32, &f32)| u.is_finite() && v.is_finite() && io::is_known(*u, *v);
    match field.u.data.iter().zip(&field.v.data).position(|vector| !known(vector)) {
        None => Ok(Rendered { field, joins }),
        Some(at) => {
            let (x, y) = (at % field.width(), at / field.width());
            Err(Error::file(Kind::Data, path, format!("the motion at pixel ({x}, {y}) is not a number, or not known"))
                .remedy("write 0 where nothing moves"))
        }
    }
}

/// Width and height of a field, from its file's first bytes.
///
/// # Errors
/// An unreadable or foreign file.
pub fn size(path: &Path) -> Result<(usize, usize)> {
    match extension(path).as_str() {
        "exr" => exr_file::size(path),
        "png" => picture_size(path),
        _ => io::size(path),
    }
}

fn extension(path: &Path) -> String {
    path.extension().unwrap_or_default().to_string_lossy().to_ascii_lowercase()
}

fn from_exr(path: &Path) -> Result<(Field, Joins)> {
    let last = |name: &str| name.rsplit('.').next().is_some_and(|name| ["X", "Y", "Z", "W", "R", "G"].contains(&name));
    let channels = exr_file::read(path, last)?;
    // Normals and positions have X, Y and Z too; only motion has a W.
    let vectors = channels.groups(["X", "Y", "Z", "W"]);
    let plain = channels.groups(["R", "G"]);
    match (&vectors[..], &plain[..]) {
        (&[(_, [x, y, ..])], _) => Ok((Field { u: x.map(|x| 0.0 - x), v: y.clone() }, Joins::Previous)),
        (&[], &[(_, [u, v])]) => Ok((Field { u: u.clone(), v: v.clone() }, Joins::Next)),
        (&[], &[]) => Err(motionless(path, format!("has no motion among its channels: {}", channels.names()))),
        (several, others) => {
            let begins = several.iter().map(|(begin, _)| begin).chain(others.iter().map(|(begin, _)| begin));
            let begins: Vec<_> = begins.map(|begin| format!("{begin:?}")).collect();
            Err(motionless(path, format!("has motion in several layers: {}", begins.join(", "))))
        }
    }
}

fn motionless(path: &Path, problem: String) -> Error {
    Error::file(Kind::Data, path, problem)
        .allowed("one layer with X, Y, Z and W (Blender's Vector pass) or with R and G (u and v)")
        .remedy("render the Vector pass as OpenEXR MultiLayer")
}

fn from_png(path: &Path) -> Result<Field> {
    let [red, green, blue] = read_deep(path)?.ok_or_else(|| {
        Error::file(Kind::Data, path, "is not a PNG of 16-bit colours, so it holds no motion")
            .allowed("u = (R − 32768) / 64, v = (G − 32768) / 64, B not 0 where it is known")
    })?;
    let part = |channel: Plane| {
        let values = channel.data.iter().zip(&blue.data);
        let known = values.map(|(&value, &known)| if known == 0.0 { f32::NAN } else { (value - 32768.0) / 64.0 });
        Plane::from_vec(channel.width, channel.height, known.collect())
    };
    Ok(Field { u: part(red), v: part(green) })
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage, f16};

    fn exr(path: &std::path::Path, channels: &[(&str, f32)]) {
        let channel =
            |&(name, value): &(&str, f32)| AnyChannel::new(name, FlatSamples::F16(vec![f16::from_f32(value); 24]));
        let list = channels.iter().map(channel).collect();
        Image::from_channels((6, 4), AnyChannels::sort(list)).write().to_file(path).unwrap();
    }

    fn vector(path: &std::path::Path) -> (f32, f32, Joins) {
        let Rendered { field, joins } = read(path).unwrap();
        assert_eq!((size(path).unwrap(), (field.width(), field.height())), ((6, 4), (6, 4)));
        (field.u.at(5, 3), field.v.at(5, 3), joins)
    }

    #[test]
    fn a_file_of_blender_says_which_way_a_ball_went() {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/blender/ball.exr");
        let Rendered { field, joins } = read(&path).unwrap();
        assert_eq!((size(&path).unwrap(), joins), ((32, 24), Joins::Previous));
        let at = |x: usize, y: usize| (field.u.at(x, y), field.v.at(x, y));
        assert!((at(16, 12).0 - 2.0).abs() < 1e-3 && (at(16, 12).1 + 1.0).abs() < 1e-3, "{:?}", at(16, 12));
        assert_eq!(at(1, 1), (0.0, 0.0));
    }

    #[test]
    fn every_sort_of_file_says_the_same_motion() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        // 1.5 to the right and 2 down.
        io::write(&path("a.flo"), &Field { u: Plane::filled(6, 4, 1.5), v: Plane::filled(6, 4, 2.0) }).unwrap();
        assert_eq!(vector(&path("a.flo")), (1.5, 2.0, Joins::Next));
        exr(&path("b.exr"), &[("R", 1.5), ("G", 2.0), ("B", 0.0)]);
        assert_eq!(vector(&path("b.exr")), (1.5, 2.0, Joins::Next));
        let pixel = image::Rgb([32768 + 96, 32768 + 128, 1u16]);
        image::ImageBuffer::from_pixel(6, 4, pixel).save(path("c.png")).unwrap();
        assert_eq!(vector(&path("c.png")), (1.5, 2.0, Joins::Next));
        // It was 1.5 to the left of here, and 2 above, y being upwards; its picture and its normals do not matter.
        let layer = ["Vector.X", "Vector.Y", "Vector.Z", "Vector.W", "Normal.X", "Normal.Y", "Normal.Z", "Combined.R"];
        let values = [-1.5, 2.0, 9.0, 9.0, 1.0, 1.0, 1.0, 0.5].into_iter();
        let names: Vec<String> = layer.iter().map(|name| format!("ViewLayer.{name}")).collect();
        exr(&path("d.exr"), &names.iter().map(String::as_str).zip(values).collect::<Vec<_>>());
        assert_eq!(vector(&path("d.exr")), (1.5, 2.0, Joins::Previous));
    }

    #[test]
    fn what_holds_no_motion_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        let refuse = |path: &std::path::Path, word: &str| {
            let message = read(path).unwrap_err().to_string();
            assert!(message.contains(word), "{message} lacks {word}");
        };
        exr(&path, &[("Y", 1.0)]);
        refuse(&path, "no motion among its channels: Y");
        let two = ["A.X", "A.Y", "A.Z", "A.W", "B.X", "B.Y", "B.Z", "B.W"].map(|name| (name, 0.0));
        exr(&path, &two);
        refuse(&path, r#"several layers: "A.", "B.""#);
        exr(&path, &[("R", f32::INFINITY), ("G", 0.0)]);
        refuse(&path, "pixel (0, 0) is not a number");
        let path = folder.path().join("a.png");
        image::RgbImage::new(6, 4).save(&path).unwrap();
        refuse(&path, "not a PNG of 16-bit colours");
        image::ImageBuffer::from_pixel(6, 4, image::Rgb([32768u16, 32768, 0])).save(&path).unwrap();
        refuse(&path, "not known");
    }
}
