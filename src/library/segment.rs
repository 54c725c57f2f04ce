//! One analysed clip on disk: what a build keeps of it, so that nothing is computed twice.
//!
//! A segment is a file in the container of [`super::format`], with sections of its own. It holds everything that does
//! not depend on other clips; descriptors are recomputed from the average image once the vocabulary is known.

use std::io::{Seek, Write};
use std::path::Path;
use std::sync::Arc;

use serde::{Deserialize, Serialize};

use super::format::{Parameters, Section, damaged, section};
use super::frames::Encoder;
use super::grid::{Cell, CellGrid};
use super::metadata;
use super::piece::ClipId;
use super::reader::FrameEntry;
use super::store::{Access, AlignedBytes, Store};
use super::tile::GridView;
use super::variant::{CELL, SCALES, level_size};
use super::writer::Writer;
use crate::base::error::Result;
use crate::raster::image::{Color, Plane, Rgb8, Srgb};

/// What a segment says of its clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct SegmentMeta {
    /// Identity of the clip.
    pub id: ClipId,
    /// Width in working pixels, a multiple of 16; 0 when refused.
    pub width: u32,
    /// Height in working pixels, a multiple of 16; 0 when refused.
    pub height: u32,
    /// Frames at the library rate; 0 when refused.
    pub frames: u32,
    /// Why the clip was refused, if it was.
    pub refusal: Option<String>,
    /// What the reader noticed (black bars cut, frames dropped), for people.
    pub notes: Vec<String>,
}

/// Writes a segment; frames come first, one at a time.
pub struct SegmentWriter<W: Write + Seek> {
    writer: Writer<W>,
    encoder: Encoder,
    index: Vec<FrameEntry>,
}

impl<W: Write + Seek> SegmentWriter<W> {
    /// Begins a segment for frames `width` pixels wide.
    ///
    /// # Errors
    /// When `out` cannot be written.
    pub fn new(out: W, path: &Path, parameters: Parameters, width: usize) -> Result<Self> {
        let mut writer = Writer::new(out, path, parameters)?;
        writer.begin(section::FRAMES, 1)?;
        Ok(Self { writer, encoder: Encoder::new(width)?, index: Vec::new() })
    }

    /// Adds a frame; all have the same size.
    ///
    /// # Errors
    /// When the disk is full.
    pub fn push(&mut self, frame: &Rgb8) -> Result<()> {
        let blob = self.encoder.push(frame)?;
        let offset = self.index.last().map_or(0, |e| e.offset + e.length);
        self.index.push(FrameEntry { offset, length: blob.len() as u64 });
        self.writer.write(&blob)
    }

    /// Number of frames so far.
    pub fn frames(&self) -> usize {
        self.index.len()
    }

    /// Completes the segment of an accepted clip.
    ///
    /// # Errors
    /// When the disk is full.
    pub fn finish(mut self, meta: &SegmentMeta, average: &[Vec<u16>; 3], grids: &[CellGrid; 3]) -> Result<W> {
        self.writer.begin(section::FRAME_INDEX, size_of::<FrameEntry>())?;
        self.writer.write(bytemuck::cast_slice(&self.index))?;
        self.writer.begin(section::AVERAGES, 2)?;
        for plane in average {
            self.writer.write(bytemuck::cast_slice(plane))?;
        }
        self.writer.begin(section::CELLS, size_of::<Cell>())?;
        for grid in grids {
            self.writer.write(bytemuck::cast_slice(&grid.cells))?;
        }
        self.writer.begin(section::SEGMENT, 1)?;
        self.writer.write(&metadata::encode("segment", meta)?)?;
        self.writer.finish()
    }
}

/// Writes the segment of a refused clip, which is only its reason.
///
/// # Errors
/// When the disk is full.
pub fn write_refusal<W: Write + Seek>(out: W, path: &Path, parameters: Parameters, meta: &SegmentMeta) -> Result<W> {
    let mut writer = Writer::new(out, path, parameters)?;
    writer.begin(section::SEGMENT, 1)?;
    writer.write(&metadata::encode("segment", meta)?)?;
    writer.finish()
}

/// An analysed clip, open for reading.
pub struct Segment {
    store: Store,
    /// What it says of its clip.
    pub meta: SegmentMeta,
    data: Option<[Section; 4]>,
}

impl Segment {
    /// Opens a segment file.
    ///
    /// # Errors
    /// When it is missing, damaged, or of another version.
    pub fn open(path: &Path) -> Result<Self> {
        Self::from_store(Store::open(path, Access::MapOnly)?)
    }

    /// A segment from bytes in memory.
    ///
    /// # Errors
    /// When it is damaged.
    pub fn from_bytes(bytes: Arc<AlignedBytes>) -> Result<Self> {
        Self::from_store(Store::from_bytes(bytes)?)
    }

    fn from_store(store: Store) -> Result<Self> {
        let subject = store.subject();
        let meta = store.section(&store.header.section(&subject, section::SEGMENT, 1)?)?;
        let meta: SegmentMeta = metadata::decode(&subject, meta)?;
        if meta.refusal.is_some() {
            return Ok(Self { store, meta, data: None });
        }
        let find = |id, row_bytes| store.header.section(&subject, id, row_bytes);
        let frame_index = find(section::FRAME_INDEX, size_of::<FrameEntry>())?;
        let averages = find(section::AVERAGES, 2)?;
        let cells = find(section::CELLS, size_of::<Cell>())?;
        let frames = find(section::FRAMES, 1)?;
        let (width, height) = (meta.width as usize, meta.height as usize);
        let cell_count: usize = (0..SCALES.len() as u8).map(|s| grid_len(width, height, s)).sum();
        let sound = frame_index.rows() == u64::from(meta.frames)
            && averages.rows() == 3 * (width * height) as u64
            && cells.rows() == cell_count as u64;
        if !sound {
            return Err(damaged(&subject, "its tables have other sizes than its clip"));
        }
        Ok(Self { store, meta, data: Some([frame_index, averages, cells, frames]) })
    }

    /// Compares every byte with its checksum.
    ///
    /// # Errors
    /// When one does not match.
    pub fn check_all(&self) -> Result<()> {
        self.store.check_all()
    }

    fn part(&self, which: usize) -> Result<&[u8]> {
        match &self.data {
            Some(sections) => self.store.section(&sections[which]),
            None => Err(damaged(&self.store.subject(), "holds a refused clip")),
        }
    }

    /// What its features were computed with.
    pub fn parameters(&self) -> &Parameters {
        &self.store.header.parameters
    }

    /// Where the frames lie in [`Segment::blobs`].
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn frame_index(&self) -> Result<&[FrameEntry]> {
        self.cast(self.part(0)?)
    }

    /// Average image, `u16` little-endian, three planes, as stored.
    ///
    /// # Errors
    /// When its section is damaged.
    pub fn average_bytes(&self) -> Result<&[u8]> {
        self.part(1)
    }

    /// Average image.
    ///
    /// # Errors
    /// When its section is damaged.
    pub fn average(&self) -> Result<Color<Srgb>> {
        let (width, height) = (self.meta.width as usize, self.meta.height as usize);
        let values: &[u16] = self.cast(self.part(1)?)?;
        let plane = |c: usize| {
            let plane = &values[c * width * height..(c + 1) * width * height];
            Plane::from_vec(width, height, plane.iter().map(|&v| f32::from(v) * (1.0 / 65535.0)).collect())
        };
        Ok(Color::from_planes([plane(0), plane(1), plane(2)]))
    }

    /// Cells of all scales, as stored.
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn cell_bytes(&self) -> Result<&[u8]> {
        self.part(2)
    }

    /// Cells of one scale.
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn grid(&self, scale: u8) -> Result<GridView<'_>> {
        let cells: &[Cell] = self.cast(self.part(2)?)?;
        let (width, height) = (self.meta.width as usize, self.meta.height as usize);
        let first: usize = (0..scale).map(|s| grid_len(width, height, s)).sum();
        let (w, h) = level_size(width, height, scale);
        let cells = &cells[first..first + grid_len(width, height, scale)];
        Ok(GridView { width: w / CELL, height: h / CELL, cells })
    }

    /// Bytes of all compressed frames.
    pub fn blob_bytes(&self) -> u64 {
        self.data.as_ref().map_or(0, |[_, _, _, frames]| frames.length)
    }

    /// Hands the compressed frames on in parts of at most `size` bytes. A file is mapped anew for it, so that what was
    /// read does not stay in this process's memory.
    ///
    /// # Errors
    /// When their section is damaged, and those of `take`.
    pub fn for_each_part(&self, size: usize, mut take: impl FnMut(&[u8]) -> Result<()>) -> Result<()> {
        let Some([_, _, _, frames]) = &self.data else { return Ok(()) };
        let again = if self.store.is_mapped() { Some(Self::open(self.store.path())?) } else { None };
        let store = again.as_ref().map_or(&self.store, |again| &again.store);
        for from in (0..frames.length).step_by(size.max(1)) {
            take(store.range(frames, from, (from + size as u64).min(frames.length))?)?;
        }
        Ok(())
    }

    fn cast<'a, T: bytemuck::Pod>(&self, bytes: &'a [u8]) -> Result<&'a [T]> {
        let subject = self.store.subject();
        bytemuck::try_cast_slice(bytes).map_err(|e| damaged(&subject, format!("a table is misaligned: {e}")))
    }
}

fn grid_len(width: usize, height: usize, scale: u8) -> usize {
    let (w, h) = level_size(width, height, scale);
    (w / CELL) * (h / CELL)
}
