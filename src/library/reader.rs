//! An open pack.

use std::path::Path;
use std::sync::Arc;

use bytemuck::{Pod, Zeroable};

use super::format::{FEATURES, Parameters, Section, SectionId, damaged, section};
use super::frames::Decoder;
use super::grid::Cell;
use super::metadata::{ClipMeta, Metadata};
use super::normalizers::Normalizers;
use super::piece::{PieceIx, PieceRef};
use super::store::{Access, AlignedBytes, Store};
use super::tile::{GridView, Tile};
use super::variant::{CELL, PIECE, SCALES, Variant, level_size};
use crate::base::error::{Error, Kind, Result};
use crate::descriptor::dense_sift::DIMENSIONS;
use crate::descriptor::vocabulary::{PIECE_WORDS, Vocabulary};
use crate::raster::image::{Color, Plane, Rgb8, Srgb};

/// A piece as the pack stores it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct Piece {
    /// Number of the clip within the pack.
    pub clip: u32,
    /// Left edge on the variant's canvas, pixels.
    pub x: u16,
    /// Top edge on the variant's canvas, pixels.
    pub y: u16,
    variant: u8,
    /// Zero.
    pub(super) reserved: [u8; 7],
}

impl Piece {
    /// A piece of clip number `clip`.
    pub fn new(clip: u32, variant: Variant, x: u16, y: u16) -> Self {
        Self { clip, x, y, variant: variant.index(), reserved: [0; 7] }
    }

    /// The variant it is cut from.
    pub fn variant(&self) -> Variant {
        Variant::from_index(self.variant).unwrap_or(Variant { flip: false, scale: 0, rotation: 0 })
    }

    /// Number of its variant as stored.
    pub fn variant_index(&self) -> u8 {
        self.variant
    }
}

/// Where a frame's blob lies in the section of frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Pod, Zeroable)]
#[repr(C)]
pub struct FrameEntry {
    /// First byte.
    pub offset: u64,
    /// Bytes.
    pub length: u64,
}

/// First rows of a clip in the tables that have no rows of their own for it.
#[derive(Debug, Clone, Copy)]
struct ClipPlace {
    average: u64,
    cells: [u64; SCALES.len()],
    frames: u64,
}

/// The sections of a pack, found once.
struct Sections {
    vocabulary: Section,
    pieces: Section,
    words: Section,
    averages: Section,
    cells: Section,
    frame_index: Section,
    frames: Section,
}

/// An open pack: cheap to open, everything else is read and checked on first touch. Share it as `Arc<Pack>`; keep
/// [`PieceIx`] and ask again rather than keep views.
pub struct Pack {
    store: Store,
    metadata: Metadata,
    places: Vec<ClipPlace>,
    sections: Sections,
}

impl Pack {
    /// Opens a pack, memory-mapped. Header, section table, checksum table, end marker and metadata are checked now,
    /// every other 64 KiB block when it is first touched.
    ///
    /// # Errors
    /// A named one for a missing, foreign, truncated, damaged or newer file.
    pub fn open(path: &Path) -> Result<Arc<Self>> {
        Self::open_with(path, Access::Map)
    }

    /// Opens a pack mapped or read into memory.
    ///
    /// # Errors
    /// As [`Pack::open`]; [`Kind::Limit`] when it does not fit into memory.
    pub fn open_with(path: &Path, access: Access) -> Result<Arc<Self>> {
        Self::from_store(Store::open(path, access)?)
    }

    /// A pack from bytes in memory.
    ///
    /// # Errors
    /// As [`Pack::open`].
    pub fn from_bytes(bytes: Arc<AlignedBytes>) -> Result<Arc<Self>> {
        Self::from_store(Store::from_bytes(bytes)?)
    }

    fn from_store(store: Store) -> Result<Arc<Self>> {
        let subject = store.subject();
        let find = |id: SectionId, row_bytes: usize| store.header.section(&subject, id, row_bytes);
        check_parameters(&subject, &store.header.parameters)?;
        let metadata = Metadata::decode(&subject, store.section(&find(section::META, 1)?)?)?;
        let sections = Sections {
            vocabulary: find(section::VOCABULARY, DIMENSIONS)?,
            pieces: find(section::PIECES, size_of::<Piece>())?,
            words: find(section::WORDS, PIECE_WORDS)?,
            averages: find(section::AVERAGES, 2)?,
            cells: find(section::CELLS, size_of::<Cell>())?,
            frame_index: find(section::FRAME_INDEX, size_of::<FrameEntry>())?,
            frames: find(section::FRAMES, 1)?,
        };
        let places = sections.check(&subject, &metadata, &store.header.parameters)?;
        Ok(Arc::new(Self { store, metadata, places, sections }))
    }

    /// Name of the pack in errors: its path.
    pub fn subject(&self) -> String {
        self.store.subject()
    }

    /// What the features were computed with.
    pub fn parameters(&self) -> &Parameters {
        &self.store.header.parameters
    }

    /// The sections, with their sizes.
    pub fn sections(&self) -> &[Section] {
        &self.store.header.sections
    }

    /// The clips, ordered by content hash; a piece's `clip` is an index into them.
    pub fn clips(&self) -> &[ClipMeta] {
        &self.metadata.clips
    }

    /// Scales of the three smoothness distances, to divide them by.
    pub fn normalizers(&self) -> &Normalizers {
        &self.metadata.normalizers
    }

    /// Number of pieces.
    pub fn piece_count(&self) -> usize {
        self.sections.pieces.rows() as usize
    }

    /// All pieces, ordered by [`PieceRef`].
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn pieces(&self) -> Result<&[Piece]> {
        self.table(&self.sections.pieces)
    }

    /// A piece.
    ///
    /// # Errors
    /// When there is no such piece, or its record is damaged.
    pub fn piece(&self, ix: PieceIx) -> Result<Piece> {
        let row = u64::from(ix.0);
        let size = size_of::<Piece>() as u64;
        let bytes = self.store.range(&self.sections.pieces, row * size, (row + 1) * size)?;
        let piece: Piece = bytemuck::pod_read_unaligned(bytes);
        let fits = self.clips().get(piece.clip as usize).is_some_and(|clip| {
            let geometry = piece.variant().geometry(clip.width as usize, clip.height as usize);
            let (x, y) = (piece.x as usize, piece.y as usize);
            x % CELL == 0 && y % CELL == 0 && x + PIECE <= geometry.width && y + PIECE <= geometry.height
        });
        if !fits || piece.variant as usize >= Variant::COUNT {
            return Err(damaged(&self.subject(), format!("piece {} lies nowhere", ix.0)));
        }
        Ok(piece)
    }

    /// The stable name of a piece.
    ///
    /// # Errors
    /// As [`Pack::piece`].
    pub fn piece_ref(&self, ix: PieceIx) -> Result<PieceRef> {
        let piece = self.piece(ix)?;
        let clip = self.clips()[piece.clip as usize].id;
        Ok(PieceRef { clip, variant: piece.variant(), x: piece.x, y: piece.y })
    }

    /// Word numbers of the 9 × 9 points, row by row, one row of 81 per piece.
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn words(&self) -> Result<&[[u8; PIECE_WORDS]]> {
        self.table(&self.sections.words)
    }

    /// The visual words.
    ///
    /// # Errors
    /// When their section is damaged.
    pub fn vocabulary(&self) -> Result<Vocabulary> {
        Vocabulary::from_centers(self.store.section(&self.sections.vocabulary)?.to_vec())
    }

    /// Cells of clip number `clip` at scale number `scale`.
    ///
    /// # Errors
    /// When there is no such clip or scale, or their section is damaged.
    pub fn grid(&self, clip: u32, scale: u8) -> Result<GridView<'_>> {
        let (meta, place) = self.clip(clip)?;
        let Some(&first) = place.cells.get(scale as usize) else {
            return Err(Error::new(Kind::Usage, self.subject(), format!("has no scale number {scale}")));
        };
        let (width, height) = grid_size(meta, scale);
        let size = size_of::<Cell>() as u64;
        let to = first + (width * height) as u64;
        let bytes = self.store.range(&self.sections.cells, first * size, to * size)?;
        Ok(GridView { width, height, cells: self.cast(bytes)? })
    }

    /// The 12 × 12 cells of a piece, in its own coordinates.
    ///
    /// # Errors
    /// As [`Pack::piece`] and [`Pack::grid`].
    pub fn tile(&self, ix: PieceIx) -> Result<Tile> {
        let piece = self.piece(ix)?;
        let meta = &self.clips()[piece.clip as usize];
        let variant = piece.variant();
        let geometry = variant.geometry(meta.width as usize, meta.height as usize);
        let grid = self.grid(piece.clip, variant.scale)?;
        Ok(Tile::sample(&grid, &geometry, piece.x as usize, piece.y as usize))
    }

    /// Average image of a clip at working size.
    ///
    /// # Errors
    /// When there is no such clip, or its section is damaged.
    pub fn average(&self, clip: u32) -> Result<Color<Srgb>> {
        let (meta, place) = self.clip(clip)?;
        let (width, height) = (meta.width as usize, meta.height as usize);
        let plane = |c: u64| -> Result<Plane> {
            let from = (place.average + c * (width * height) as u64) * 2;
            let bytes = self.store.range(&self.sections.averages, from, from + (width * height * 2) as u64)?;
            let values: &[u16] = self.cast(bytes)?;
            Ok(Plane::from_vec(width, height, values.iter().map(|&v| f32::from(v) * (1.0 / 65535.0)).collect()))
        };
        Ok(Color::from_planes([plane(0)?, plane(1)?, plane(2)?]))
    }

    /// One frame at working size. Decodes from the last keyframe on: up to 16 frames' work; use [`Pack::frames`] to
    /// read several.
    ///
    /// # Errors
    /// When there is no such clip or frame, or it is damaged.
    pub fn frame(&self, clip: u32, t: usize) -> Result<Rgb8> {
        self.frames(clip)?.at(t)
    }

    /// A reader of one clip's frames that decodes each only once when they are asked for in order.
    ///
    /// # Errors
    /// When there is no such clip.
    pub fn frames(&self, clip: u32) -> Result<FrameReader<'_>> {
        let (meta, place) = self.clip(clip)?;
        let decoder = Decoder::new(meta.width as usize, meta.height as usize)?;
        Ok(FrameReader { pack: self, clip, first: place.frames, count: meta.frames as usize, next: 0, decoder })
    }

    /// Checks that nobody cut the file off under the map; call it at the start of every stage that reads the pack.
    ///
    /// # Errors
    /// [`Kind::Data`] when the file's length changed.
    pub fn check_length(&self) -> Result<()> {
        self.store.check_length()
    }

    pub(super) fn store(&self) -> &Store {
        &self.store
    }

    pub(super) fn metadata(&self) -> &Metadata {
        &self.metadata
    }

    fn clip(&self, clip: u32) -> Result<(&ClipMeta, &ClipPlace)> {
        match (self.metadata.clips.get(clip as usize), self.places.get(clip as usize)) {
            (Some(meta), Some(place)) => Ok((meta, place)),
            _ => {
                let problem = format!("has no clip number {clip}");
                let allowed = format!("0 to {}", self.metadata.clips.len().saturating_sub(1));
                Err(Error::new(Kind::Usage, self.subject(), problem).allowed(allowed))
            }
        }
    }

    fn table<T: Pod>(&self, section: &Section) -> Result<&[T]> {
        self.cast(self.store.section(section)?)
    }

    fn cast<'a, T: Pod>(&self, bytes: &'a [u8]) -> Result<&'a [T]> {
        bytemuck::try_cast_slice(bytes).map_err(|e| damaged(&self.subject(), format!("a table is misaligned: {e}")))
    }

    /// Checks that the blobs follow each other without gaps and fill their section.
    pub(super) fn check_blobs(&self) -> Result<()> {
        let mut end = 0;
        for (i, entry) in self.table::<FrameEntry>(&self.sections.frame_index)?.iter().enumerate() {
            if entry.offset != end {
                return Err(damaged(&self.subject(), format!("frame {i} of its frame index lies out of place")));
            }
            end = end.saturating_add(entry.length);
        }
        if end != self.sections.frames.length {
            return Err(damaged(&self.subject(), "bytes lie between its frames"));
        }
        Ok(())
    }

    /// Blob of frame `t` of the clip whose frames begin at row `first` of the frame index.
    fn blob(&self, first: u64, t: usize) -> Result<&[u8]> {
        let row = first + t as u64;
        let size = size_of::<FrameEntry>() as u64;
        let bytes = self.store.range(&self.sections.frame_index, row * size, (row + 1) * size)?;
        let entry: FrameEntry = bytemuck::pod_read_unaligned(bytes);
        self.store.range(&self.sections.frames, entry.offset, entry.offset.saturating_add(entry.length))
    }
}

/// Refuses packs whose features this build computes differently: they could not be compared with a picture's.
fn check_parameters(subject: &str, parameters: &Parameters) -> Result<()> {
    let ours = [PIECE, CELL, size_of::<Cell>(), FEATURES as usize];
    let theirs = [parameters.piece, parameters.cell, parameters.cell_bytes, parameters.features];
    if theirs.map(|v| v as usize) != ours {
        let problem = format!("its features are of another kind ({theirs:?} instead of {ours:?})");
        return Err(Error::new(Kind::Unsupported, subject, problem)
            .remedy("build the library again with this Enliven, or use the one that built it"));
    }
    Ok(())
}

fn grid_size(meta: &ClipMeta, scale: u8) -> (usize, usize) {
    let (w, h) = level_size(meta.width as usize, meta.height as usize, scale);
    (w / CELL, h / CELL)
}

impl Sections {
    /// Compares the sizes of the tables with the metadata; gives the place of each clip in them.
    fn check(&self, subject: &str, metadata: &Metadata, parameters: &Parameters) -> Result<Vec<ClipPlace>> {
        let (mut average, mut cell, mut frame, mut pieces) = (0u64, 0u64, 0u64, 0u64);
        let mut places = Vec::with_capacity(metadata.clips.len());
        for clip in &metadata.clips {
            let mut cells = [0; SCALES.len()];
            for (scale, first) in cells.iter_mut().enumerate() {
                let (w, h) = grid_size(clip, scale as u8);
                *first = cell;
                cell += (w * h) as u64;
            }
            places.push(ClipPlace { average, cells, frames: frame });
            average += 3 * u64::from(clip.width) * u64::from(clip.height);
            frame += u64::from(clip.frames);
            pieces += clip.pieces();
        }
        let expected = [
            (&self.vocabulary, u64::from(parameters.words)),
            (&self.pieces, pieces),
            (&self.words, pieces),
            (&self.averages, average),
            (&self.cells, cell),
            (&self.frame_index, frame),
        ];
        for (section, rows) in expected {
            if section.rows() != rows || rows > u64::from(u32::MAX) && section.id != section::AVERAGES {
                let problem = format!("its section \"{}\" has {} rows", section.name(), section.rows());
                return Err(damaged(subject, problem).allowed(rows.to_string()));
            }
        }
        Ok(places)
    }
}

/// Reads the frames of one clip; cheapest in order.
pub struct FrameReader<'a> {
    pack: &'a Pack,
    clip: u32,
    first: u64,
    count: usize,
    next: usize,
    decoder: Decoder,
}

impl FrameReader<'_> {
    /// Number of frames of the clip.
    pub fn count(&self) -> usize {
        self.count
    }

    /// Frame `t`. Asking for the frame after the last one asked for costs one frame's work.
    ///
    /// # Errors
    /// When there is no such frame, or it is damaged.
    pub fn at(&mut self, t: usize) -> Result<Rgb8> {
        self.seek(t)?;
        Ok(self.decoder.frame())
    }

    /// Luma in [0, 1] of frame `t`, equal to that of [`FrameReader::at`] and cheaper.
    ///
    /// # Errors
    /// As [`FrameReader::at`].
    pub fn luma_at(&mut self, t: usize) -> Result<Plane> {
        self.seek(t)?;
        Ok(self.decoder.luma())
    }

    fn seek(&mut self, t: usize) -> Result<()> {
        if t >= self.count {
            let problem = format!("clip {} has no frame {t}", self.pack.clips()[self.clip as usize].id);
            return Err(
                Error::new(Kind::Usage, self.pack.subject(), problem).allowed(format!("0 to {}", self.count - 1))
            );
        }
        let (pack, first) = (self.pack, self.first);
        self.decoder.seek(&pack.store.subject(), t, |i| pack.blob(first, i))?;
        self.next = t + 1;
        Ok(())
    }
}

impl Iterator for FrameReader<'_> {
    type Item = Result<Rgb8>;

    fn next(&mut self) -> Option<Self::Item> {
        let t = self.next;
        (t < self.count).then(|| {
            let frame = self.at(t);
            self.next = t + 1;
            frame
        })
    }
}
