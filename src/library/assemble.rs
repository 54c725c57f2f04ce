//! Writes the pack from analysed clips and the tables that depend on all of them.

use std::io::{Seek, Write};
use std::path::Path;

use super::format::{Parameters, section};
use super::grid::Cell;
use super::metadata::Metadata;
use super::reader::{FrameEntry, Piece};
use super::segment::Segment;
use super::writer::Writer;
use crate::base::error::Result;
use crate::base::observe::{self, Observer};
use crate::descriptor::dense_sift::DIMENSIONS;
use crate::descriptor::vocabulary::{PIECE_WORDS, Vocabulary};

/// The part of a pack that is known only after all clips.
#[derive(Debug, Clone, PartialEq)]
pub struct Tables {
    /// What the features were computed with.
    pub parameters: Parameters,
    /// Clips (by content hash) and normalisers.
    pub metadata: Metadata,
    /// The visual words.
    pub vocabulary: Vocabulary,
    /// Pieces, ordered by their stable names.
    pub pieces: Vec<Piece>,
    /// Word numbers, by piece.
    pub words: Vec<[u8; PIECE_WORDS]>,
}

/// Bytes copied between two looks at the observer.
const COPY: usize = 4 << 20;

/// Writes a pack to `out`; `segments` are those of `tables.metadata.clips`, in that order. Progress: stage "write", in
/// bytes of frames.
///
/// # Errors
/// When the disk is full, a segment is damaged, or the run was cancelled.
pub fn assemble<W: Write + Seek>(
    out: W,
    path: &Path,
    tables: &Tables,
    segments: &[Segment],
    observer: &dyn Observer,
) -> Result<W> {
    let mut writer = Writer::new(out, path, tables.parameters)?;
    writer.begin(section::META, 1)?;
    writer.write(&tables.metadata.encode()?)?;
    writer.begin(section::VOCABULARY, DIMENSIONS)?;
    writer.write(tables.vocabulary.centers())?;
    writer.begin(section::PIECES, size_of::<Piece>())?;
    writer.write(bytemuck::cast_slice(&tables.pieces))?;
    writer.begin(section::WORDS, PIECE_WORDS)?;
    writer.write(bytemuck::cast_slice(&tables.words))?;
    writer.begin(section::AVERAGES, 2)?;
    for segment in segments {
        writer.write(segment.average_bytes()?)?;
    }
    writer.begin(section::CELLS, size_of::<Cell>())?;
    for segment in segments {
        writer.write(segment.cell_bytes()?)?;
    }
    writer.begin(section::FRAME_INDEX, size_of::<FrameEntry>())?;
    let mut offset = 0;
    for segment in segments {
        for entry in segment.frame_index()? {
            let moved = FrameEntry { offset, length: entry.length };
            writer.write(bytemuck::bytes_of(&moved))?;
            offset += entry.length;
        }
    }
    writer.begin(section::FRAMES, 1)?;
    for segment in segments {
        segment.for_each_part(COPY, |part| {
            observe::check(observer)?;
            writer.write(part)?;
            observer.advance("write", part.len() as u64);
            Ok(())
        })?;
    }
    writer.finish()
}
