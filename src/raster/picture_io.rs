//! Single pictures from and to files.
//!
//! Reads PNG, JPEG, WebP and GIF (its first frame), told by content, not by name. Colours are taken as sRGB; embedded
//! colour profiles are ignored. Writes PNG, whole or not at all.

use std::fs::File;
use std::io::BufReader;
use std::path::Path;

use image::{DynamicImage, ImageDecoder, ImageError, ImageReader, metadata::Orientation};

use super::image::{Plane, Rgb8, luma};
use crate::base::error::{Error, Kind, Result};
use crate::base::{atomic_file, own_file};

/// Most pixels of a picture that is read.
pub const MAX_PIXELS: u64 = 64_000_000;
/// Longest side of a picture that is read, in pixels.
pub const MAX_SIDE: u32 = 32_767;

/// A colour picture, with its alpha where the file has one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Picture {
    /// Colours, not premultiplied.
    pub rgb: Rgb8,
    /// `width * height` values, 255 opaque.
    pub alpha: Option<Vec<u8>>,
}

/// Reads a colour picture; a JPEG is turned as its EXIF orientation says, 16-bit channels are rounded to 8.
///
/// # Errors
/// A file that is missing, is no picture, is damaged, or is larger than [`MAX_PIXELS`] or [`MAX_SIDE`].
pub fn read_picture(path: &Path) -> Result<Picture> {
    let image = decode(path)?;
    let alpha = image.color().has_alpha().then(|| image.to_rgba8().pixels().map(|p| p[3]).collect());
    let rgb = image.into_rgb8();
    let (width, height) = (rgb.width() as usize, rgb.height() as usize);
    Ok(Picture { rgb: Rgb8 { width, height, data: rgb.into_raw() }, alpha })
}

/// Reads a picture as grey in [0, 1] (Rec. 709 luma of the encoded values) with the precision of the file, times its
/// alpha where it has one, so that white paint on transparency is a matte.
///
/// # Errors
/// Those of [`read_picture`]; a picture in colour, since what a colour would stand for is a guess.
pub fn read_grey(path: &Path) -> Result<Plane> {
    let image = decode(path)?;
    if is_coloured(&image) {
        return Err(Error::file(Kind::Unusable, path, "is in colour, where white, black and greys are meant")
            .remedy("paint it in white on black, or turn it to grey"));
    }
    Ok(grey(image))
}

/// Whether more than one in a hundred of the pixels that are not black have a colour that cannot be a tint of paper or the
/// noise of a JPEG: a saturation above 0.3.
fn is_coloured(image: &DynamicImage) -> bool {
    if !image.color().has_color() {
        return false;
    }
    let is_painted = |[r, g, b, a]: [u8; 4]| u32::from(r.max(g).max(b)) * u32::from(a) > 26 * 255;
    let is_coloured = |[r, g, b, _]: [u8; 4]| {
        let most = r.max(g).max(b);
        10 * u32::from(most - r.min(g).min(b)) > 3 * u32::from(most)
    };
    let (mut painted, mut coloured) = (0_usize, 0);
    let mut count = |pixel: [u8; 4]| {
        painted += usize::from(is_painted(pixel));
        coloured += usize::from(is_painted(pixel) && is_coloured(pixel));
    };
    match image {
        DynamicImage::ImageRgb8(pixels) => pixels.pixels().for_each(|p| count([p[0], p[1], p[2], 255])),
        DynamicImage::ImageRgba8(pixels) => pixels.pixels().for_each(|p| count(p.0)),
        deep => deep.to_rgba8().pixels().for_each(|p| count(p.0)),
    }
    100 * coloured > painted
}

/// Reads a matte: grey in [0, 1], 1 where the fluid is.
///
/// # Errors
/// Those of [`read_grey`]; a matte that is all black, or so dark that its numbers must mean something else (0 and 1 for
/// no and yes, or 8-bit values in a file of 16 bits).
pub fn read_matte(path: &Path) -> Result<Plane> {
    let matte = read_grey(path)?;
    let most = matte.data.iter().copied().fold(0.0, f32::max);
    if most < 0.1 {
        let problem = if most == 0.0 {
            "is all black: nothing is marked as fluid".to_owned()
        } else {
            format!("almost nothing is marked as fluid: its brightest pixel has {:.1} % of white", most * 100.0)
        };
        return Err(Error::file(Kind::Unusable, path, problem).remedy("paint white (255, or 65535) where the fluid is"));
    }
    Ok(matte)
}

fn grey(image: DynamicImage) -> Plane {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let unit = |v: u16| f32::from(v) / 65535.0;
    let data = match image {
        DynamicImage::ImageLuma8(grey) => grey.into_raw().into_iter().map(|v| f32::from(v) / 255.0).collect(),
        DynamicImage::ImageLuma16(grey) => grey.into_raw().into_iter().map(unit).collect(),
        colour => {
            let grey = |[r, g, b, a]: [f32; 4]| luma([r, g, b]) * a;
            colour.into_rgba16().pixels().map(|p| grey(p.0.map(unit)).clamp(0.0, 1.0)).collect()
        }
    };
    Plane::from_vec(width, height, data)
}

/// Reads opacity in [0, 1] with the precision of the file: the picture's own, or grey where it has none.
///
/// # Errors
/// Those of [`read_picture`].
pub fn read_opacity(path: &Path) -> Result<Plane> {
    let image = decode(path)?;
    if !image.color().has_alpha() {
        return Ok(grey(image));
    }
    let (width, height) = (image.width() as usize, image.height() as usize);
    let data = image.into_rgba16().pixels().map(|p| f32::from(p[3]) / 65535.0).collect();
    Ok(Plane::from_vec(width, height, data))
}

/// Red, green and blue of a picture with 16 bits a channel and without opacity, 0 to 65535; none of any other picture.
///
/// # Errors
/// Those of [`read_picture`].
pub fn read_deep(path: &Path) -> Result<Option<[Plane; 3]>> {
    let DynamicImage::ImageRgb16(image) = decode(path)? else { return Ok(None) };
    let (width, height) = (image.width() as usize, image.height() as usize);
    let channel = |c: usize| image.pixels().map(|pixel| f32::from(pixel.0[c])).collect();
    Ok(Some(std::array::from_fn(|c| Plane::from_vec(width, height, channel(c)))))
}

/// Width and height of a picture as [`read_picture`] would give them, without decoding it.
///
/// # Errors
/// Those of [`read_picture`], as far as the header tells.
pub fn picture_size(path: &Path) -> Result<(usize, usize)> {
    let mut decoder = open(path)?;
    let (width, height) = decoder.dimensions();
    let (width, height) = (width as usize, height as usize);
    let turned = matches!(
        decoder.orientation().unwrap_or(Orientation::NoTransforms),
        Orientation::Rotate90 | Orientation::Rotate270 | Orientation::Rotate90FlipH | Orientation::Rotate270FlipH
    );
    Ok(if turned { (height, width) } else { (width, height) })
}

/// Writes an 8-bit RGB PNG.
///
/// # Errors
/// When the folder is missing or the disk is full.
pub fn write_png(path: &Path, picture: &Rgb8) -> Result<()> {
    let bytes = encode_png(picture, png::Compression::Balanced).map_err(|e| failed(path, e))?;
    atomic_file::write(path, &bytes)
}

/// [`write_png`] for a picture of the program's own beside what was asked for ([`own_file::write`]).
///
/// # Errors
/// Those of [`write_png`]; a file of that name that a person made or changed.
pub fn write_own_png(path: &Path, picture: &Rgb8) -> Result<()> {
    let bytes = encode_png(picture, png::Compression::Balanced).map_err(|e| failed(path, e))?;
    own_file::write(path, &bytes)
}

/// Writes a plane of values in [0, 1], clamped, as an 8-bit grey PNG.
///
/// # Errors
/// Those of [`write_png`].
pub fn write_grey_png(path: &Path, plane: &Plane) -> Result<()> {
    let data: Vec<u8> = plane.data.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
    let (size, grey) = ((plane.width, plane.height), png::ColorType::Grayscale);
    let bytes = encode(size, grey, &data, png::Compression::Balanced).map_err(|e| failed(path, e))?;
    atomic_file::write(path, &bytes)
}

/// A 16-bit grey PNG in memory of values in [0, 1], clamped; plain numbers, without a colour space.
///
/// # Errors
/// A plane without pixels.
pub fn encode_deep_grey_png(plane: &Plane) -> Result<Vec<u8>, png::EncodingError> {
    let data: Vec<u8> =
        plane.data.iter().flat_map(|v| ((v.clamp(0.0, 1.0) * 65535.0 + 0.5) as u16).to_be_bytes()).collect();
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, plane.width as u32, plane.height as u32);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Sixteen);
    encoder.set_compression(png::Compression::Fast);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(&data)?;
    writer.finish()?;
    Ok(bytes)
}

/// An 8-bit RGB PNG in memory, tagged sRGB.
///
/// # Errors
/// A picture without pixels.
pub fn encode_png(picture: &Rgb8, compression: png::Compression) -> Result<Vec<u8>, png::EncodingError> {
    encode((picture.width, picture.height), png::ColorType::Rgb, &picture.data, compression)
}

/// An 8-bit PNG with opacity in memory, tagged sRGB: `size` is width and height, `data` packed red, green, blue and
/// opacity, colours not multiplied by it.
///
/// # Errors
/// A picture without pixels, or with fewer than its size says.
pub fn encode_rgba_png(
    size: (usize, usize),
    data: &[u8],
    compression: png::Compression,
) -> Result<Vec<u8>, png::EncodingError> {
    encode(size, png::ColorType::Rgba, data, compression)
}

fn encode(
    (width, height): (usize, usize),
    color: png::ColorType,
    data: &[u8],
    compression: png::Compression,
) -> Result<Vec<u8>, png::EncodingError> {
    let mut bytes = Vec::new();
    let mut encoder = png::Encoder::new(&mut bytes, width as u32, height as u32);
    encoder.set_color(color);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_compression(compression);
    encoder.set_source_srgb(png::SrgbRenderingIntent::Perceptual);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(data)?;
    writer.finish()?;
    Ok(bytes)
}

fn failed(path: &Path, error: png::EncodingError) -> Error {
    Error::file(Kind::Io, path, format!("cannot encode PNG: {error}")).source(error)
}

fn decode(path: &Path) -> Result<DynamicImage> {
    let mut decoder = open(path)?;
    // A damaged EXIF block only costs the turn, not the picture.
    let orientation = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| unreadable(path, e))?;
    image.apply_orientation(orientation);
    Ok(image)
}

/// A decoder whose size was checked, before anything of that size is allocated.
fn open(path: &Path) -> Result<impl ImageDecoder> {
    let file = File::open(path).map_err(|e| Error::io(path, "open", e))?;
    let reader =
        ImageReader::new(BufReader::new(file)).with_guessed_format().map_err(|e| Error::io(path, "read", e))?;
    if reader.format().is_none() {
        return Err(Error::file(Kind::Data, path, "is not a picture this program reads")
            .allowed("PNG, JPEG, WebP, GIF")
            .remedy("convert it to PNG"));
    }
    let decoder = reader.into_decoder().map_err(|e| unreadable(path, e))?;
    let (width, height) = decoder.dimensions();
    if width == 0 || height == 0 {
        return Err(Error::file(Kind::Data, path, "has no pixels"));
    }
    if u64::from(width) * u64::from(height) > MAX_PIXELS || width.max(height) > MAX_SIDE {
        let megapixels = u64::from(width) * u64::from(height) / 1_000_000;
        return Err(Error::file(
            Kind::Limit,
            path,
            format!("{width} × {height} is too large ({megapixels} megapixels)"),
        )
        .allowed(format!("up to {} megapixels, {MAX_SIDE} pixels a side", MAX_PIXELS / 1_000_000))
        .remedy("make it smaller first"));
    }
    Ok(decoder)
}

fn unreadable(path: &Path, error: ImageError) -> Error {
    match error {
        ImageError::IoError(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path, "read", e),
        ImageError::Unsupported(e) => Error::file(Kind::Unsupported, path, format!("cannot be read: {e}"))
            .allowed("PNG, JPEG, WebP, GIF")
            .remedy("convert it to PNG"),
        ImageError::Limits(e) => Error::file(Kind::Limit, path, format!("is too large: {e}")),
        other => Error::file(Kind::Data, path, format!("is damaged: {other}")).source(other),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gradient(width: usize, height: usize) -> Rgb8 {
        let data = (0..width * height).flat_map(|i| [i as u8, (i * 3) as u8, (i * 7) as u8]).collect();
        Rgb8 { width, height, data }
    }

    #[test]
    fn png_round_trip_is_exact() {
        let folder = tempfile::tempdir().unwrap();
        let (path, grey) = (folder.path().join("a.png"), folder.path().join("g.png"));
        let picture = gradient(17, 5);
        write_png(&path, &picture).unwrap();
        assert_eq!(read_picture(&path).unwrap(), Picture { rgb: picture, alpha: None });
        assert_eq!(picture_size(&path).unwrap(), (17, 5));
        let plane = Plane::from_fn(4, 3, |x, y| (x + 4 * y) as f32 / 255.0);
        write_grey_png(&grey, &plane).unwrap();
        assert_eq!(read_grey(&grey).unwrap(), plane);
        let deep = Plane::from_fn(5, 3, |x, y| (x * 4099 + y * 257) as f32 / 65535.0);
        std::fs::write(&grey, encode_deep_grey_png(&deep).unwrap()).unwrap();
        assert_eq!(read_grey(&grey).unwrap(), deep);
    }

    #[test]
    fn grey_keeps_sixteen_bits_and_counts_alpha() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let deep = image::ImageBuffer::from_fn(3, 1, |x, _| image::Luma([x as u16 * 300 + 1]));
        DynamicImage::ImageLuma16(deep).save(&path).unwrap();
        assert_eq!(read_grey(&path).unwrap().data, [1, 301, 601].map(|v| v as f32 / 65535.0));
        assert_eq!(read_opacity(&path).unwrap(), read_grey(&path).unwrap());
        let paint = image::ImageBuffer::from_fn(2, 1, |x, _| image::Rgba([9, 0, 0, 20 + x as u8]));
        DynamicImage::ImageRgba8(paint).save(&path).unwrap();
        assert_eq!(read_opacity(&path).unwrap().data, [20.0 / 255.0, 21.0 / 255.0]);
        let paint = image::ImageBuffer::from_fn(2, 1, |x, _| image::Rgba([255, 255, 255, x as u8 * 255]));
        DynamicImage::ImageRgba8(paint).save(&path).unwrap();
        let grey = read_grey(&path).unwrap().data;
        assert!(grey[0] == 0.0 && grey[1] > 0.9999);
        assert_eq!(read_picture(&path).unwrap().alpha, Some(vec![0, 255]));
    }

    #[test]
    fn a_matte_in_colour_or_of_small_numbers_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let refused = |image: DynamicImage, part: &str| {
            image.save(&path).unwrap();
            let error = read_matte(&path).unwrap_err().to_string();
            assert!(error.contains(part), "{error}");
        };
        let red = |x: u32, _| image::Rgb(if x < 4 { [0; 3] } else { [220, 20, 15_u8] });
        refused(image::ImageBuffer::from_fn(8, 8, red).into(), "is in colour");
        let paint = |x: u32, _| image::Rgba([40, 200, 30, if x < 4 { 0 } else { 255_u8 }]);
        refused(image::ImageBuffer::from_fn(8, 8, paint).into(), "is in colour");
        refused(image::ImageBuffer::from_fn(8, 8, |x, _| image::Luma([(x / 4) as u8])).into(), "0.4 % of white");
        refused(image::ImageBuffer::from_fn(8, 8, |x, _| image::Luma([(x / 4) as u16 * 255])).into(), "0.4 % of white");
        refused(image::ImageBuffer::from_pixel(8, 8, image::Luma([0_u8])).into(), "is all black");
        // Clear pixels have any colour; a tint of paper is grey.
        let clear = |x: u32, _| image::Rgba(if x < 4 { [255, 0, 0, 0] } else { [250, 240, 200, 255_u8] });
        DynamicImage::from(image::ImageBuffer::from_fn(8, 8, clear)).save(&path).unwrap();
        let matte = read_matte(&path).unwrap();
        assert!(matte.at(3, 0) == 0.0 && matte.at(4, 0) > 0.9);
    }

    #[test]
    fn exif_orientation_turns_a_jpeg() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.jpg");
        let half = image::RgbImage::from_fn(32, 16, |x, _| image::Rgb(if x < 16 { [250; 3] } else { [5; 3] }));
        half.save(&path).unwrap();
        let plain = std::fs::read(&path).unwrap();
        // APP1: TIFF header, one entry, orientation 6 (turn right to show).
        let exif = b"Exif\0\0MM\0\x2a\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";
        let length = (exif.len() as u16 + 2).to_be_bytes();
        std::fs::write(&path, [&plain[..2], &[0xff, 0xe1], &length, exif, &plain[2..]].concat()).unwrap();
        let turned = read_picture(&path).unwrap().rgb;
        assert_eq!((turned.width, turned.height), (16, 32));
        assert_eq!(picture_size(&path).unwrap(), (16, 32));
        assert!(turned.pixel(8, 4)[0] > 200 && turned.pixel(8, 28)[0] < 50);
    }

    #[test]
    fn bad_pictures_are_named_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        assert_eq!(read_picture(&path).unwrap_err().kind(), Kind::Io);
        std::fs::write(&path, "some text").unwrap();
        assert_eq!(read_picture(&path).unwrap_err().kind(), Kind::Data);
        let whole = encode_png(&gradient(64, 64), png::Compression::Fast).unwrap();
        for length in (1..whole.len()).step_by(37) {
            std::fs::write(&path, &whole[..length]).unwrap();
            read_picture(&path).unwrap_err();
            read_grey(&path).unwrap_err();
        }
    }

    #[test]
    fn a_hundred_megapixels_are_refused_from_the_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let mut bytes = encode_png(&gradient(1, 1), png::Compression::Fast).unwrap();
        bytes[16..24].copy_from_slice(&[0, 0, 0x27, 0x10, 0, 0, 0x27, 0x10]);
        let crc = crc32fast::hash(&bytes[12..29]);
        bytes[29..33].copy_from_slice(&crc.to_be_bytes());
        std::fs::write(&path, bytes).unwrap();
        let error = read_picture(&path).unwrap_err();
        assert_eq!(error.kind(), Kind::Limit);
        assert!(error.to_string().contains("64 megapixels"), "{error}");
    }
}
