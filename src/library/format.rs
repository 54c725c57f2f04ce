//! The bytes of a pack: constants, header, section table, end marker. `docs/pack-format.md` draws them.
//!
//! Everything is little-endian and read field by field here, so that nothing outside this file knows an offset.

use crate::base::error::{Error, Kind, Result};

/// First eight bytes of every pack.
pub const MAGIC: [u8; 8] = *b"\x89ENLPCK\n";
/// First eight bytes of the end marker.
pub const END_MAGIC: [u8; 8] = *b"ENLEND\r\n";
/// Major version: a reader refuses any other.
pub const MAJOR: u16 = 1;
/// Minor version: a newer one only adds sections.
pub const MINOR: u16 = 0;
/// Version of the feature computations; raised whenever any of them gives other numbers.
pub const FEATURES: u32 = 1;
/// Unit of alignment of sections and of checksums, bytes.
pub const BLOCK: usize = 64 * 1024;
/// Length of the end marker, bytes.
pub const TAIL: usize = 64;
/// Where the section table begins in the header block.
const TABLE_AT: usize = 256;
/// Bytes of one entry of the section table.
const ENTRY: usize = 64;
/// Where the header block keeps its own checksum.
const HEADER_CRC_AT: usize = 248;
/// Largest number of sections.
pub const MAX_SECTIONS: usize = 256;
/// Largest metadata section, bytes.
pub const MAX_META: usize = 64 << 20;
/// Largest number of clips.
pub const MAX_CLIPS: usize = 100_000;
/// Largest side of a clip, working pixels.
pub const MAX_SIDE: usize = 8192;
/// Largest number of frames of a clip.
pub const MAX_FRAMES: usize = 1_000_000;
/// Section flag: a reader that does not know this section must refuse the pack.
pub const MUST_UNDERSTAND: u32 = 1;

/// Name of a section: eight ASCII bytes, padded with zeros.
pub type SectionId = [u8; 8];

/// The sections of version 1.
pub mod section {
    use super::SectionId;
    /// Metadata (bincode).
    pub const META: SectionId = *b"meta\0\0\0\0";
    /// Centres of the visual words, rows of 128 bytes.
    pub const VOCABULARY: SectionId = *b"vocab\0\0\0";
    /// Piece records, rows of 16 bytes.
    pub const PIECES: SectionId = *b"pieces\0\0";
    /// Word numbers, rows of 81 bytes.
    pub const WORDS: SectionId = *b"words\0\0\0";
    /// Average images, `u16`, three planes a clip.
    pub const AVERAGES: SectionId = *b"average\0";
    /// Cells of the descriptor grids, rows of 48 bytes.
    pub const CELLS: SectionId = *b"cells\0\0\0";
    /// Where each frame lies, rows of 16 bytes.
    pub const FRAME_INDEX: SectionId = *b"frameidx";
    /// Compressed frames.
    pub const FRAMES: SectionId = *b"frames\0\0";
    /// What an unfinished build keeps of a clip; only in segments, never in a pack.
    pub const SEGMENT: SectionId = *b"segment\0";
    /// Those of a pack, in the order they are written.
    pub const ALL: [SectionId; 8] = [META, VOCABULARY, PIECES, WORDS, AVERAGES, CELLS, FRAME_INDEX, FRAMES];
}

/// What the features of a pack were computed with; two packs with different parameters do not mix.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub struct Parameters {
    /// Library frame rate, frames per second.
    pub rate: u32,
    /// Distance of neighbouring pieces, pixels of the variant, a multiple of 4.
    pub stride: u32,
    /// Visual words without the flat one (k).
    pub words: u32,
    /// Side of a piece, pixels of the variant.
    pub piece: u32,
    /// Side of a cell, pixels of the level.
    pub cell: u32,
    /// Bytes of a cell.
    pub cell_bytes: u32,
    /// Longest side of a working frame, pixels.
    pub working: u32,
    /// Least share of moving pixels of a piece, thousandths.
    pub moving_permille: u32,
    /// Version of the feature computations; a change of any of them makes packs incomparable.
    pub features: u32,
}

impl Parameters {
    const COUNT: usize = 9;

    fn to_array(self) -> [u32; Self::COUNT] {
        [
            self.rate,
            self.stride,
            self.words,
            self.piece,
            self.cell,
            self.cell_bytes,
            self.working,
            self.moving_permille,
            self.features,
        ]
    }

    fn from_array(v: [u32; Self::COUNT]) -> Self {
        let [rate, stride, words, piece, cell, cell_bytes, working, moving_permille, features] = v;
        Self { rate, stride, words, piece, cell, cell_bytes, working, moving_permille, features }
    }
}

/// One entry of the section table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Section {
    /// Its name.
    pub id: SectionId,
    /// Bit 0: [`MUST_UNDERSTAND`].
    pub flags: u32,
    /// Bytes of a row; 1 where the section is not a table.
    pub row_bytes: u32,
    /// Where it begins, a multiple of [`BLOCK`].
    pub offset: u64,
    /// Bytes without padding.
    pub length: u64,
}

impl Section {
    /// Name for people.
    pub fn name(&self) -> String {
        self.id.iter().take_while(|&&b| b != 0).map(|&b| if b.is_ascii_graphic() { b as char } else { '?' }).collect()
    }

    /// Number of rows.
    pub fn rows(&self) -> u64 {
        self.length / u64::from(self.row_bytes.max(1))
    }
}

/// Everything in the header block.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    /// Minor version of the writer.
    pub minor: u16,
    /// Bytes of the whole file.
    pub length: u64,
    /// Where the block checksums begin.
    pub checks_offset: u64,
    /// Number of checksummed blocks: all from the second to the one before `checks_offset`.
    pub checks: u64,
    /// CRC-32 of the (padded) block checksums.
    pub checks_crc: u32,
    /// What the features were computed with.
    pub parameters: Parameters,
    /// The sections.
    pub sections: Vec<Section>,
}

fn put_u16(bytes: &mut [u8], at: usize, value: u16) {
    bytes[at..at + 2].copy_from_slice(&value.to_le_bytes());
}
fn put_u32(bytes: &mut [u8], at: usize, value: u32) {
    bytes[at..at + 4].copy_from_slice(&value.to_le_bytes());
}
fn put_u64(bytes: &mut [u8], at: usize, value: u64) {
    bytes[at..at + 8].copy_from_slice(&value.to_le_bytes());
}
fn array<const N: usize>(bytes: &[u8], at: usize) -> [u8; N] {
    std::array::from_fn(|i| bytes[at + i])
}
fn get_u16(bytes: &[u8], at: usize) -> u16 {
    u16::from_le_bytes(array(bytes, at))
}
fn get_u32(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(array(bytes, at))
}
fn get_u64(bytes: &[u8], at: usize) -> u64 {
    u64::from_le_bytes(array(bytes, at))
}

/// CRC-32 of a header block, its own four bytes taken as zero.
fn header_crc(block: &[u8]) -> u32 {
    let mut hasher = crc32fast::Hasher::new();
    hasher.update(&block[..HEADER_CRC_AT]);
    hasher.update(&[0; 4]);
    hasher.update(&block[HEADER_CRC_AT + 4..]);
    hasher.finalize()
}

/// A damaged pack, by name.
pub fn damaged(subject: &str, problem: impl Into<String>) -> Error {
    Error::new(Kind::Data, subject, problem.into())
        .remedy("the pack is damaged: restore it from a copy, or build it again with `enliven-db build`")
}

/// Refuses machines on which the tables would be read backwards.
///
/// # Errors
/// [`Kind::Unsupported`] on a big-endian machine.
pub fn check_machine(subject: &str) -> Result<()> {
    if cfg!(target_endian = "big") {
        return Err(Error::new(Kind::Unsupported, subject, "packs are little-endian and this machine is big-endian")
            .remedy("use the library on a little-endian machine (x86-64, ARM64)"));
    }
    Ok(())
}

impl Header {
    /// The header block, [`BLOCK`] bytes with its checksum.
    pub fn encode(&self) -> Vec<u8> {
        let mut block = vec![0u8; BLOCK];
        block[..8].copy_from_slice(&MAGIC);
        put_u16(&mut block, 8, MAJOR);
        put_u16(&mut block, 10, self.minor);
        put_u32(&mut block, 12, self.sections.len() as u32);
        put_u64(&mut block, 16, self.length);
        put_u64(&mut block, 24, self.checks_offset);
        put_u64(&mut block, 32, self.checks);
        put_u32(&mut block, 40, self.checks_crc);
        for (i, value) in self.parameters.to_array().into_iter().enumerate() {
            put_u32(&mut block, 64 + 4 * i, value);
        }
        for (i, section) in self.sections.iter().enumerate() {
            let at = TABLE_AT + i * ENTRY;
            block[at..at + 8].copy_from_slice(&section.id);
            put_u32(&mut block, at + 8, section.flags);
            put_u32(&mut block, at + 12, section.row_bytes);
            put_u64(&mut block, at + 16, section.offset);
            put_u64(&mut block, at + 24, section.length);
        }
        let crc = header_crc(&block);
        put_u32(&mut block, HEADER_CRC_AT, crc);
        block
    }

    /// Reads and checks a header block against the `actual` length of the file. `subject` names the file in errors.
    ///
    /// # Errors
    /// [`Kind::Data`] when it is no pack or a damaged one, [`Kind::Unsupported`] when it is of another major version
    /// or needs a section this build does not know.
    pub fn parse(subject: &str, block: &[u8], actual: u64) -> Result<Self> {
        if block.len() < 8 || block[..8] != MAGIC {
            return Err(Error::new(Kind::Data, subject, "not an Enliven pack (its first bytes are something else)")
                .remedy("give a file made by `enliven-db build`"));
        }
        if block.len() < BLOCK {
            return Err(damaged(subject, format!("cut off after {actual} bytes")));
        }
        // The version is judged before the checksum: another major version may keep its checksum elsewhere.
        let major = get_u16(block, 8);
        if major != MAJOR {
            let known = format!("version {MAJOR}.x");
            let error = Error::new(Kind::Unsupported, subject, format!("pack of version {major}.x")).allowed(known);
            return Err(error.remedy(if major > MAJOR {
                "use a newer Enliven, or build the library again with this one"
            } else {
                "build the library again with this Enliven"
            }));
        }
        if header_crc(block) != get_u32(block, HEADER_CRC_AT) {
            return Err(damaged(subject, "its header does not match its checksum"));
        }
        let count = get_u32(block, 12) as usize;
        if count > MAX_SECTIONS {
            return Err(damaged(subject, format!("{count} sections")).allowed(format!("0 to {MAX_SECTIONS}")));
        }
        let header = Self {
            minor: get_u16(block, 10),
            length: get_u64(block, 16),
            checks_offset: get_u64(block, 24),
            checks: get_u64(block, 32),
            checks_crc: get_u32(block, 40),
            parameters: Parameters::from_array(std::array::from_fn(|i| get_u32(block, 64 + 4 * i))),
            sections: (0..count).map(|i| parse_section(&block[TABLE_AT + i * ENTRY..])).collect(),
        };
        header.check(subject, actual)?;
        Ok(header)
    }

    /// Checks lengths, offsets, overlaps and sections of a later minor version.
    fn check(&self, subject: &str, actual: u64) -> Result<()> {
        let block = BLOCK as u64;
        if self.length != actual {
            let problem = format!("{actual} bytes long, but its header says {}", self.length);
            return Err(damaged(subject, problem));
        }
        let tables = (self.checks.checked_mul(4)).and_then(|n| n.checked_next_multiple_of(block));
        let expected_end = tables.and_then(|n| self.checks_offset.checked_add(n)?.checked_add(TAIL as u64));
        let blocks_end = self.checks.checked_add(1).and_then(|n| n.checked_mul(block));
        if blocks_end != Some(self.checks_offset) || expected_end != Some(self.length) {
            return Err(damaged(subject, "its checksum table lies elsewhere than its header says"));
        }
        let mut end = block;
        for section in &self.sections {
            let next = section.offset.checked_add(section.length).and_then(|n| n.checked_next_multiple_of(block));
            let whole_rows = section.row_bytes > 0 && section.length % u64::from(section.row_bytes) == 0;
            match next {
                Some(next) if section.offset == end && next <= self.checks_offset && whole_rows => end = next,
                _ => return Err(damaged(subject, format!("its section \"{}\" lies out of place", section.name()))),
            }
            let known = section::ALL.contains(&section.id) || section.id == section::SEGMENT;
            if !known && section.flags & MUST_UNDERSTAND != 0 {
                let problem = format!("needs the section \"{}\", which this build does not know", section.name());
                return Err(Error::new(Kind::Unsupported, subject, problem)
                    .allowed(format!("version {MAJOR}.{MINOR}"))
                    .remedy("use a newer Enliven, or build the library again with this one"));
            }
        }
        if end != self.checks_offset {
            return Err(damaged(subject, "bytes lie between its sections and its checksum table"));
        }
        Ok(())
    }

    /// The end marker, [`TAIL`] bytes with its checksum.
    pub fn encode_tail(&self, header_block: &[u8]) -> Vec<u8> {
        let mut tail = vec![0u8; TAIL];
        tail[..8].copy_from_slice(&END_MAGIC);
        put_u64(&mut tail, 8, self.length);
        put_u32(&mut tail, 16, get_u32(header_block, HEADER_CRC_AT));
        let crc = crc32fast::hash(&tail[..TAIL - 4]);
        put_u32(&mut tail, TAIL - 4, crc);
        tail
    }

    /// Checks an end marker.
    ///
    /// # Errors
    /// [`Kind::Data`] when it is damaged or belongs to another header.
    pub fn check_tail(&self, subject: &str, tail: &[u8], header_block: &[u8]) -> Result<()> {
        if tail != self.encode_tail(header_block) {
            return Err(damaged(subject, "its end marker is missing or damaged"));
        }
        Ok(())
    }

    /// The section of that name.
    ///
    /// # Errors
    /// [`Kind::Data`] when it is missing, or when there are two, or its rows have another width than `row_bytes`.
    pub fn section(&self, subject: &str, id: SectionId, row_bytes: usize) -> Result<Section> {
        let mut found = self.sections.iter().filter(|s| s.id == id);
        match (found.next(), found.next()) {
            (Some(section), None) if section.row_bytes as usize == row_bytes => Ok(*section),
            (None, _) => Err(damaged(subject, format!("lacks its section \"{}\"", String::from_utf8_lossy(&id)))),
            (Some(section), _) => {
                Err(damaged(subject, format!("its section \"{}\" is doubled or has other rows", section.name())))
            }
        }
    }
}

fn parse_section(entry: &[u8]) -> Section {
    Section {
        id: array(entry, 0),
        flags: get_u32(entry, 8),
        row_bytes: get_u32(entry, 12),
        offset: get_u64(entry, 16),
        length: get_u64(entry, 24),
    }
}
