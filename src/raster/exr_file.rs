//! Channels of OpenEXR pictures, by name: motion and opacity that other programs rendered.

use std::path::Path;

use exr::error::Error as ExrError;
use exr::meta::MetaData;
use exr::meta::header::Header;
use exr::prelude::{FlatSamples, ReadChannels, ReadLayers, read as reader};

use super::image::Plane;
use super::picture_io::{MAX_PIXELS, MAX_SIDE};
use crate::base::error::{Error, Kind, Result};

/// Most bytes that the channels of a picture may hold, unpacked.
const MAX_BYTES: u64 = 4_000_000_000;

/// The channels of a picture.
#[derive(Debug, Clone, PartialEq)]
pub struct Channels {
    /// Full names, such as "R" or "ViewLayer.Vector.X"; a part's own name comes first.
    names: Vec<String>,
    planes: Vec<Plane>,
}

/// Width and height, from the file's first bytes.
///
/// # Errors
/// An unreadable or damaged file; one without pixels, larger than [`MAX_PIXELS`] or [`MAX_SIDE`], or whose pixels do not
/// fill its frame.
pub fn size(path: &Path) -> Result<(usize, usize)> {
    let headers = MetaData::read_from_file(path, false).map_err(|e| unreadable(path, e))?.headers;
    let Some(first) = headers.first() else { return Err(Error::file(Kind::Data, path, "has no pictures in it")) };
    let (width, height) = (first.layer_size.0, first.layer_size.1);
    let bytes = headers.iter().map(|h| 4 * h.channels.list.len() as u64 * (h.layer_size.0 * h.layer_size.1) as u64);
    let pixels = width as u64 * height as u64;
    if pixels == 0 || pixels > MAX_PIXELS || width.max(height) > MAX_SIDE as usize || bytes.sum::<u64>() > MAX_BYTES {
        return Err(Error::file(Kind::Limit, path, format!("{width} × {height} pixels"))
            .allowed(format!("1 to {MAX_SIDE} pixels a side, up to {} megapixels", MAX_PIXELS / 1_000_000))
            .remedy("render it smaller, or with fewer passes"));
    }
    headers.iter().try_for_each(|header| fills_its_frame(header, (width, height), path))?;
    Ok((width, height))
}

fn fills_its_frame(header: &Header, size: (usize, usize), path: &Path) -> Result<()> {
    let (at, window) = (header.own_attributes.layer_position, header.shared_attributes.display_window);
    let whole = (header.layer_size.0, header.layer_size.1) == size && header.layer_size == window.size;
    if whole
        && at == window.position
        && !header.deep
        && header.channels.list.iter().all(|c| c.sampling.0 * c.sampling.1 == 1)
    {
        return Ok(());
    }
    Err(Error::file(Kind::Unsupported, path, "holds only a part of its frame, or deep or subsampled pixels")
        .remedy("render the whole frame, without a crop or region"))
}

/// Reads the channels whose names pass `wanted`.
///
/// # Errors
/// Those of [`size`].
pub fn read(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Channels> {
    let (width, height) = size(path)?;
    let all = reader().no_deep_data().largest_resolution_level().all_channels().all_layers().all_attributes();
    let image = all.non_parallel().from_file(path).map_err(|e| unreadable(path, e))?;
    let (mut names, mut planes) = (Vec::new(), Vec::new());
    for layer in image.layer_data {
        let part = layer.attributes.layer_name.map(|name| format!("{name}.")).unwrap_or_default();
        for channel in layer.channel_data.list {
            let name = format!("{part}{}", channel.name);
            if !wanted(&name) {
                continue;
            }
            let data = match channel.sample_data {
                FlatSamples::F32(values) => values,
                other => other.values_as_f32().collect(),
            };
            if data.len() != width * height {
                return Err(Error::file(Kind::Data, path, format!("channel {name} is truncated")));
            }
            names.push(name);
            planes.push(Plane::from_vec(width, height, data));
        }
    }
    Ok(Channels { names, planes })
}

impl Channels {
    /// All names.
    pub fn names(&self) -> String {
        self.names.join(", ")
    }

    /// Groups of channels with these last names and one and the same beginning: the beginning, and the planes in the order
    /// of `last`.
    pub fn groups<const N: usize>(&self, last: [&str; N]) -> Vec<(&str, [&Plane; N])> {
        let of = |begin: &str, last: &str| {
            let at = self.names.iter().position(|name| name.strip_prefix(begin) == Some(last))?;
            self.planes.get(at)
        };
        let begins = self.names.iter().filter_map(|name| name.strip_suffix(last[0]));
        let begins = begins.filter(|begin| begin.is_empty() || begin.ends_with('.'));
        let group = |begin: &str| {
            let planes: Vec<&Plane> = last.iter().filter_map(|last| of(begin, last)).collect();
            planes.try_into().ok()
        };
        begins.filter_map(|begin| Some((begin, group(begin)?))).collect()
    }
}

fn unreadable(path: &Path, error: ExrError) -> Error {
    match error {
        ExrError::Io(e) if e.kind() != std::io::ErrorKind::UnexpectedEof => Error::io(path, "read", e),
        ExrError::NotSupported(what) => Error::file(Kind::Unsupported, path, format!("cannot be read: {what}"))
            .remedy("save it as OpenEXR with ZIP compression, half or full float"),
        other => Error::file(Kind::Data, path, format!("is damaged: {other}")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};

    /// Writes channels of 6 × 4 pixels; channel `n` is `n + x + 10 y`.
    fn write(path: &std::path::Path, names: &[&str]) {
        let channel = |n: usize, name: &str| {
            let values = (0..24).map(|i| (n + i % 6 + 10 * (i / 6)) as f32).collect();
            AnyChannel::new(name, FlatSamples::F32(values))
        };
        let list = names.iter().enumerate().map(|(n, name)| channel(n, name)).collect();
        Image::from_channels((6, 4), AnyChannels::sort(list)).write().to_file(path).unwrap();
    }

    #[test]
    fn channels_are_found_by_their_names() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write(&path, &["View.Vector.X", "View.Vector.Y", "View.Normal.X", "A", "ALPHA"]);
        assert_eq!(size(&path).unwrap(), (6, 4));
        let channels = read(&path, |name| name != "ALPHA").unwrap();
        let [(begin, [x, y])] = channels.groups(["X", "Y"])[..] else { panic!("{}", channels.names()) };
        assert_eq!((begin, x.at(3, 1), y.at(3, 1)), ("View.Vector.", 13.0, 14.0));
        assert_eq!(channels.groups(["A"]).len(), 1);
        assert!(channels.groups(["Z"]).is_empty() && !channels.names().contains("ALPHA"));
    }

    #[test]
    fn damaged_files_are_errors() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.exr");
        write(&path, &["R", "G"]);
        let whole = std::fs::read(&path).unwrap();
        for length in 0..whole.len() {
            std::fs::write(&path, &whole[..length]).unwrap();
            read(&path, |_| true).unwrap_err();
        }
        for at in 0..whole.len() {
            let mut bytes = whole.clone();
            bytes[at] ^= 0x81;
            std::fs::write(&path, bytes).unwrap();
            // Some bytes are pixels: then it reads, but never panics.
            let _ = read(&path, |_| true);
        }
        assert_eq!(size(&folder.path().join("none.exr")).unwrap_err().kind(), Kind::Io);
    }
}
