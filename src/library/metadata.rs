//! The metadata section. The only file that names the metadata codec.

use serde::{Deserialize, Serialize};

use super::format::{MAX_CLIPS, MAX_FRAMES, MAX_META, MAX_SIDE, damaged};
use super::normalizers::Normalizers;
use super::piece::ClipId;
use super::variant::Variant;
use crate::base::error::{Error, Kind, Result};

/// What became of the places of one variant's grid.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
pub struct PieceCounts {
    /// Became pieces.
    pub kept: u32,
    /// Dropped: they reach over the border of the (rotated) level.
    pub outside: u32,
    /// Dropped: too small a share of their pixels moves significantly.
    pub still: u32,
}

/// One clip of a pack.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct ClipMeta {
    /// Its identity: hash of its content.
    pub id: ClipId,
    /// Tag given at the build ("water"); may be empty.
    pub tag: String,
    /// Width in working pixels, a multiple of 16.
    pub width: u32,
    /// Height in working pixels, a multiple of 16.
    pub height: u32,
    /// Number of frames, at the library rate.
    pub frames: u32,
    /// Number of its first piece; its pieces are consecutive.
    pub first_piece: u32,
    /// Pieces kept and dropped, by [`Variant::index`].
    pub counts: [PieceCounts; Variant::COUNT],
}

impl ClipMeta {
    /// Number of its pieces.
    pub fn pieces(&self) -> u64 {
        self.counts.iter().map(|c| u64::from(c.kept)).sum()
    }

    fn sound(&self) -> bool {
        let side = |v: u32| v > 0 && v.is_multiple_of(16) && v as usize <= MAX_SIDE;
        side(self.width) && side(self.height) && self.frames > 0 && self.frames as usize <= MAX_FRAMES
    }
}

/// Everything in the metadata section.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Metadata {
    /// The clips, by content hash.
    pub clips: Vec<ClipMeta>,
    /// Scales of the smoothness terms.
    pub normalizers: Normalizers,
}

fn codec() -> impl bincode::config::Config {
    bincode::config::standard().with_little_endian().with_fixed_int_encoding().with_limit::<MAX_META>()
}

impl Metadata {
    /// As bytes.
    ///
    /// # Errors
    /// [`Kind::Limit`] when there are too many clips for one pack.
    pub fn encode(&self) -> Result<Vec<u8>> {
        encode("pack metadata", self)
    }

    /// From bytes, checked: sizes, order, consecutive pieces.
    ///
    /// # Errors
    /// [`Kind::Data`] naming what does not hold.
    pub fn decode(subject: &str, bytes: &[u8]) -> Result<Self> {
        let metadata: Self = decode(subject, bytes)?;
        if metadata.clips.len() > MAX_CLIPS {
            return Err(damaged(subject, format!("{} clips", metadata.clips.len())));
        }
        let mut first = 0u64;
        for (i, clip) in metadata.clips.iter().enumerate() {
            if !clip.sound() {
                let problem = format!("clip {}: {} × {} × {} frames", clip.id, clip.width, clip.height, clip.frames);
                return Err(damaged(subject, problem));
            }
            if i > 0 && metadata.clips[i - 1].id >= clip.id || u64::from(clip.first_piece) != first {
                return Err(damaged(subject, format!("clip {} is out of order", clip.id)));
            }
            first += clip.pieces();
        }
        Ok(metadata)
    }
}

/// Any small record as bytes.
///
/// # Errors
/// [`Kind::Limit`] when it is larger than a metadata section may be.
pub fn encode<T: Serialize>(subject: &str, value: &T) -> Result<Vec<u8>> {
    bincode::serde::encode_to_vec(value, codec())
        .map_err(|e| Error::new(Kind::Limit, subject, format!("cannot be written: {e}")))
}

/// Any small record from bytes, all of which must be used.
///
/// # Errors
/// [`Kind::Data`] when the bytes are not such a record.
pub fn decode<T: serde::de::DeserializeOwned>(subject: &str, bytes: &[u8]) -> Result<T> {
    if bytes.len() > MAX_META {
        return Err(damaged(subject, format!("{} bytes of metadata", bytes.len())));
    }
    match bincode::serde::decode_from_slice(bytes, codec()) {
        Ok((value, used)) if used == bytes.len() => Ok(value),
        Ok(_) => Err(damaged(subject, "bytes follow its metadata")),
        Err(e) => Err(damaged(subject, format!("unreadable metadata: {e}"))),
    }
}
