//! Checks all of a pack: every checksum first, then everything the tables say about each other.

use serde::Serialize;

use super::format::damaged;
use super::piece::PieceIx;
use super::reader::Pack;
use super::variant::Variant;
use crate::base::error::Result;
use crate::base::observe::{self, Observer};

/// What [`verify`] looked at.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct VerifyReport {
    /// Bytes of the file, all of them under a checksum.
    pub bytes: u64,
    /// Clips.
    pub clips: usize,
    /// Frames decoded.
    pub frames: u64,
    /// Pieces.
    pub pieces: usize,
}

/// Checks every byte of a pack and every relation between its tables, and decodes every frame.
///
/// # Errors
/// [`crate::base::error::Kind::Data`] naming the first thing that is wrong; interrupted after a cancel.
pub fn verify(pack: &Pack, observer: &dyn Observer) -> Result<VerifyReport> {
    pack.store().check_all()?;
    canonical(pack)?;
    pieces(pack)?;
    let frames: u64 = pack.clips().iter().map(|c| u64::from(c.frames)).sum();
    observe::stage(observer, "verify frames", frames, || every_frame(pack, observer))?;
    let bytes = pack.store().header.length;
    Ok(VerifyReport { bytes, clips: pack.clips().len(), frames, pieces: pack.piece_count() })
}

/// Padding is zero, and numbers are numbers.
fn canonical(pack: &Pack) -> Result<()> {
    let subject = pack.subject();
    for section in &pack.store().header.sections {
        if pack.store().padding(section).iter().any(|&b| b != 0) {
            return Err(damaged(&subject, format!("bytes follow its section \"{}\"", section.name())));
        }
    }
    let n = pack.metadata().normalizers;
    if ![n.dc, n.ac, n.texture].iter().all(|v| v.is_finite() && *v > 0.0) {
        return Err(damaged(&subject, "its normalisers are not positive numbers"));
    }
    pack.vocabulary().map(|_| ())
}

/// Pieces are in order, inside their clips, as many as counted, and their words exist.
fn pieces(pack: &Pack) -> Result<()> {
    let subject = pack.subject();
    let mut counts = vec![[0u32; Variant::COUNT]; pack.clips().len()];
    let mut previous = None;
    for (i, record) in pack.pieces()?.iter().enumerate() {
        let ix = PieceIx(i as u32);
        let name = pack.piece_ref(ix)?;
        if previous.is_some_and(|p| p >= name) || record.reserved != [0; 7] {
            return Err(damaged(&subject, format!("piece {i} is out of order")));
        }
        counts[record.clip as usize][record.variant().index() as usize] += 1;
        previous = Some(name);
    }
    for (clip, counted) in pack.clips().iter().zip(counts) {
        if clip.counts.iter().zip(counted).any(|(c, n)| c.kept != n) {
            return Err(damaged(&subject, format!("clip {} has another number of pieces than it says", clip.id)));
        }
    }
    // The word after the last is the flat one.
    let words = pack.parameters().words;
    if let Some(i) = pack.words()?.iter().position(|row| row.iter().any(|&w| u32::from(w) > words)) {
        return Err(damaged(&subject, format!("piece {i} has a visual word above {words}")));
    }
    Ok(())
}

/// Blobs follow each other without gaps, and every frame decodes.
fn every_frame(pack: &Pack, observer: &dyn Observer) -> Result<()> {
    pack.check_blobs()?;
    for clip in 0..pack.clips().len() as u32 {
        for frame in pack.frames(clip)? {
            frame?;
            observer.advance("verify frames", 1);
            observe::check(observer)?;
        }
    }
    Ok(())
}
