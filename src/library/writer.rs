//! Writes a pack front to back: sections one after the other, checksums on the way, the header last.

use std::io::{Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

use super::format::{
    BLOCK, Header, MAX_SECTIONS, MINOR, MUST_UNDERSTAND, Parameters, Section, SectionId, check_machine,
};
use crate::base::error::{Error, Kind, Result};

/// A pack being written to `W`, with bounded memory: four bytes per 64 KiB.
pub struct Writer<W: Write + Seek> {
    out: W,
    path: PathBuf,
    parameters: Parameters,
    minor: u16,
    sections: Vec<Section>,
    /// Checksums of the finished blocks after the header block.
    checks: Vec<u32>,
    hasher: crc32fast::Hasher,
    /// Bytes in the unfinished block.
    in_block: usize,
}

impl<W: Write + Seek> Writer<W> {
    /// Begins a pack at the start of `out`; `path` is its name in errors.
    ///
    /// # Errors
    /// On a big-endian machine, or when `out` cannot be written.
    pub fn new(out: W, path: &Path, parameters: Parameters) -> Result<Self> {
        check_machine(&path.display().to_string())?;
        let mut writer = Self {
            out,
            path: path.to_path_buf(),
            parameters,
            minor: MINOR,
            sections: Vec::new(),
            checks: Vec::new(),
            hasher: crc32fast::Hasher::new(),
            in_block: 0,
        };
        writer.put(&[0; BLOCK])?;
        Ok(writer)
    }

    /// Marks the pack as of a later minor version (what a later build would write).
    pub fn minor(&mut self, minor: u16) {
        self.minor = minor;
    }

    fn put(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| Error::io(&self.path, "write", e))
    }

    /// Begins the next section, a table of rows of `row_bytes` bytes, which every reader must know.
    ///
    /// # Errors
    /// When there are too many sections, or the disk is full.
    pub fn begin(&mut self, id: SectionId, row_bytes: usize) -> Result<()> {
        self.begin_with_flags(id, row_bytes, MUST_UNDERSTAND)
    }

    /// [`Writer::begin`] with the flags of the section table.
    ///
    /// # Errors
    /// When there are too many sections, or the disk is full.
    pub fn begin_with_flags(&mut self, id: SectionId, row_bytes: usize, flags: u32) -> Result<()> {
        self.pad()?;
        if self.sections.len() == MAX_SECTIONS {
            return Err(Error::file(Kind::Limit, &self.path, "too many sections"));
        }
        let offset = ((self.checks.len() + 1) * BLOCK) as u64;
        self.sections.push(Section { id, flags, row_bytes: row_bytes as u32, offset, length: 0 });
        Ok(())
    }

    /// Appends to the current section.
    ///
    /// # Errors
    /// When the disk is full.
    ///
    /// # Panics
    /// Before the first [`Writer::begin`].
    pub fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.put(bytes)?;
        self.sections.last_mut().expect("a section was begun").length += bytes.len() as u64;
        self.check(bytes);
        Ok(())
    }

    /// Runs bytes through the block checksums.
    fn check(&mut self, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            let n = bytes.len().min(BLOCK - self.in_block);
            self.hasher.update(&bytes[..n]);
            self.in_block += n;
            bytes = &bytes[n..];
            if self.in_block == BLOCK {
                self.checks.push(std::mem::take(&mut self.hasher).finalize());
                self.in_block = 0;
            }
        }
    }

    /// Fills the unfinished block with zeros.
    fn pad(&mut self) -> Result<()> {
        if self.in_block > 0 {
            let zeros = vec![0; BLOCK - self.in_block];
            self.put(&zeros)?;
            self.check(&zeros);
        }
        Ok(())
    }

    /// Writes checksums, end marker and header, and gives `out` back; the bytes are not synced yet.
    ///
    /// # Errors
    /// When the disk is full.
    pub fn finish(mut self) -> Result<W> {
        self.pad()?;
        let mut table: Vec<u8> = self.checks.iter().flat_map(|crc| crc.to_le_bytes()).collect();
        table.resize(table.len().next_multiple_of(BLOCK), 0);
        let checks_offset = ((self.checks.len() + 1) * BLOCK) as u64;
        let header = Header {
            minor: self.minor,
            length: checks_offset + (table.len() + super::format::TAIL) as u64,
            checks_offset,
            checks: self.checks.len() as u64,
            checks_crc: crc32fast::hash(&table),
            parameters: self.parameters,
            sections: std::mem::take(&mut self.sections),
        };
        let block = header.encode();
        self.put(&table)?;
        self.put(&header.encode_tail(&block))?;
        self.out.seek(SeekFrom::Start(0)).map_err(|e| Error::io(&self.path, "write", e))?;
        self.put(&block)?;
        self.out.flush().map_err(|e| Error::io(&self.path, "write", e))?;
        Ok(self.out)
    }
}
