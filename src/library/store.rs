//! The bytes of an open pack, mapped or in memory, checked block by block on first touch.

use std::fs::File;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use super::format::{BLOCK, Header, Section, TAIL, check_machine, damaged};
use crate::base::error::{Error, Kind, Result};
use crate::base::par;

/// Bytes aligned for the tables of a pack.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct AlignedBytes {
    words: Vec<u64>,
    length: usize,
}

impl AlignedBytes {
    /// `length` zeros.
    pub fn zeros(length: usize) -> Self {
        Self { words: vec![0; length.div_ceil(8)], length }
    }

    /// A copy of `bytes`.
    pub fn copy_of(bytes: &[u8]) -> Self {
        let mut aligned = Self::zeros(bytes.len());
        aligned.as_mut().copy_from_slice(bytes);
        aligned
    }
}

impl AsRef<[u8]> for AlignedBytes {
    fn as_ref(&self) -> &[u8] {
        &bytemuck::cast_slice(&self.words)[..self.length]
    }
}

impl AsMut<[u8]> for AlignedBytes {
    fn as_mut(&mut self) -> &mut [u8] {
        &mut bytemuck::cast_slice_mut(&mut self.words)[..self.length]
    }
}

/// How a pack's bytes are reached.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Access {
    /// Memory-mapped: pages come and go as the system likes.
    #[default]
    Map,
    /// Read into memory as a whole: safe on file systems where files change under a map.
    Read,
    /// Memory-mapped without keeping the file open or locked: for files in a folder that is locked itself.
    MapOnly,
}

enum Backing {
    Map(memmap2::Mmap, Option<File>),
    Memory(Arc<AlignedBytes>),
}

/// The bytes of a pack whose header, checksum table and end marker are sound.
pub struct Store {
    backing: Backing,
    path: PathBuf,
    /// The header.
    pub header: Header,
    /// Checksums of the blocks from the second on.
    checks: Vec<u32>,
    /// One bit per block: its checksum was compared and right.
    sound: Vec<AtomicU64>,
}

impl Store {
    /// Opens a file. A shared lock is held as long as the store lives.
    ///
    /// # Errors
    /// When the file cannot be read, is locked by a writer, or is no sound pack.
    pub fn open(path: &Path, access: Access) -> Result<Self> {
        let file = File::open(path).map_err(|e| open_error(path, e))?;
        let info = file.metadata().map_err(|e| Error::io(path, "read", e))?;
        if info.is_dir() {
            return Err(Error::file(Kind::Data, path, "is a folder, not a pack").remedy("give the .pack file"));
        }
        if info.len() == 0 {
            return Err(Error::file(Kind::Data, path, "is empty, not an Enliven pack")
                .remedy("give a file made by `enliven-db build`"));
        }
        lock_shared(&file, path)?;
        let backing = match access {
            Access::Map | Access::MapOnly => {
                // SAFETY: the map is read-only and private to this store; packs are immutable files that writers
                // replace by rename and never change in place, a shared lock tells other programs so, every block is
                // compared with its checksum before use, and only plain-old-data types are viewed through the map.
                let map = unsafe { memmap2::Mmap::map(&file) };
                let map = map.map_err(|e| Error::io(path, "map", e))?;
                Backing::Map(map, (access == Access::Map).then_some(file))
            }
            Access::Read => Backing::Memory(Arc::new(read_all(&file, path, info.len())?)),
        };
        Self::new(backing, path)
    }

    /// From bytes in memory, under the name "pack in memory".
    ///
    /// # Errors
    /// When they are no sound pack.
    pub fn from_bytes(bytes: Arc<AlignedBytes>) -> Result<Self> {
        Self::new(Backing::Memory(bytes), Path::new("pack in memory"))
    }

    fn new(backing: Backing, path: &Path) -> Result<Self> {
        let subject = path.display().to_string();
        check_machine(&subject)?;
        let bytes = backing.bytes();
        let block = &bytes[..bytes.len().min(BLOCK)];
        let header = Header::parse(&subject, block, bytes.len() as u64)?;
        // `parse` has shown that the parts cover the file exactly, so these ranges are inside it.
        let tail_at = bytes.len() - TAIL;
        header.check_tail(&subject, &bytes[tail_at..], block)?;
        let table = &bytes[header.checks_offset as usize..tail_at];
        if crc32fast::hash(table) != header.checks_crc {
            return Err(damaged(&subject, "its checksum table does not match its checksum"));
        }
        let entries = table.chunks_exact(4).take(header.checks as usize);
        let checks: Vec<u32> = entries.map(|b| u32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect();
        let sound = (0..checks.len().div_ceil(64)).map(|_| AtomicU64::new(0)).collect();
        Ok(Self { backing, path: path.to_path_buf(), header, checks, sound })
    }

    /// Name of the pack in errors.
    pub fn subject(&self) -> String {
        self.path.display().to_string()
    }

    /// True when the bytes are a file's, seen through a map.
    pub fn is_mapped(&self) -> bool {
        matches!(self.backing, Backing::Map(..))
    }

    /// Where the pack lies.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Checks that nobody cut the file off under the map; call it at the start of every stage.
    ///
    /// # Errors
    /// [`Kind::Data`] when the file's length changed.
    pub fn check_length(&self) -> Result<()> {
        if let Backing::Map(_, Some(file)) = &self.backing {
            let length = file.metadata().map_err(|e| Error::io(&self.path, "read", e))?.len();
            if length != self.header.length {
                let problem = format!("was changed while in use: {length} bytes instead of {}", self.header.length);
                return Err(damaged(&self.subject(), problem));
            }
        }
        Ok(())
    }

    /// Bytes `from..to` of a section, their blocks checked.
    ///
    /// # Errors
    /// [`Kind::Data`] when the range leaves the section or a block does not match its checksum.
    pub fn range(&self, section: &Section, from: u64, to: u64) -> Result<&[u8]> {
        if from > to || to > section.length {
            let problem = format!("refers to bytes {from} to {to} of its section \"{}\"", section.name());
            return Err(damaged(&self.subject(), problem).allowed(format!("0 to {}", section.length)));
        }
        let (from, to) = ((section.offset + from) as usize, (section.offset + to) as usize);
        self.touch(from, to)?;
        Ok(&self.backing.bytes()[from..to])
    }

    /// A whole section, its blocks checked.
    ///
    /// # Errors
    /// [`Kind::Data`] when a block does not match its checksum.
    pub fn section(&self, section: &Section) -> Result<&[u8]> {
        self.range(section, 0, section.length)
    }

    /// Checks those blocks of bytes `from..to` of the file that were not checked yet.
    fn touch(&self, from: usize, to: usize) -> Result<()> {
        if from == to {
            return Ok(());
        }
        let fresh: Vec<usize> = (from / BLOCK..to.div_ceil(BLOCK)).filter(|&b| !self.is_sound(b - 1)).collect();
        if fresh.is_empty() {
            return Ok(());
        }
        self.check_length()?;
        self.check_blocks(&fresh)
    }

    /// Checks blocks, on all threads when there are many.
    fn check_blocks(&self, blocks: &[usize]) -> Result<()> {
        if blocks.len() < 64 {
            return blocks.iter().try_for_each(|&b| self.check_block(b));
        }
        par::try_map(blocks.len(), |i| self.check_block(blocks[i])).map(|_| ())
    }

    fn is_sound(&self, check: usize) -> bool {
        self.sound[check / 64].load(Ordering::Acquire) >> (check % 64) & 1 == 1
    }

    /// Compares block `block` (1 is the first after the header) with its checksum.
    fn check_block(&self, block: usize) -> Result<()> {
        let at = block * BLOCK;
        if crc32fast::hash(&self.backing.bytes()[at..at + BLOCK]) != self.checks[block - 1] {
            let problem = format!("bytes {at} to {} do not match their checksum", at + BLOCK);
            return Err(damaged(&self.subject(), problem));
        }
        self.sound[(block - 1) / 64].fetch_or(1 << ((block - 1) % 64), Ordering::AcqRel);
        Ok(())
    }

    /// Checks every block, also those checked before.
    ///
    /// # Errors
    /// [`Kind::Data`] naming the first block that does not match.
    pub fn check_all(&self) -> Result<()> {
        self.check_length()?;
        self.check_blocks(&(1..=self.checks.len()).collect::<Vec<_>>())
    }

    /// The padding of a section, to its next block.
    pub fn padding(&self, section: &Section) -> &[u8] {
        let end = (section.offset + section.length) as usize;
        &self.backing.bytes()[end..end.next_multiple_of(BLOCK)]
    }
}

impl Backing {
    fn bytes(&self) -> &[u8] {
        match self {
            Self::Map(map, _) => map,
            Self::Memory(bytes) => bytes.as_ref().as_ref(),
        }
    }
}

fn open_error(path: &Path, error: std::io::Error) -> Error {
    if error.kind() == std::io::ErrorKind::NotFound {
        return Error::file(Kind::Io, path, "no such library")
            .remedy("build one with `enliven-db build CLIPS -o NAME.pack`, or name an existing one");
    }
    Error::io(path, "open", error)
}

fn lock_shared(file: &File, path: &Path) -> Result<()> {
    match file.try_lock_shared() {
        // File systems without locks are used without.
        Ok(()) | Err(std::fs::TryLockError::Error(_)) => Ok(()),
        Err(std::fs::TryLockError::WouldBlock) => {
            Err(Error::file(Kind::Io, path, "another program is changing it").remedy("wait until it is done"))
        }
    }
}

fn read_all(mut file: &File, path: &Path, length: u64) -> Result<AlignedBytes> {
    use std::io::Read;
    let too_large = || Error::file(Kind::Limit, path, "too large for this machine's memory");
    let length = usize::try_from(length).map_err(|_| too_large())?;
    let mut words = Vec::new();
    words.try_reserve_exact(length.div_ceil(8)).map_err(|_| too_large())?;
    words.resize(length.div_ceil(8), 0u64);
    let mut bytes = AlignedBytes { words, length };
    file.read_exact(bytes.as_mut()).map_err(|e| Error::io(path, "read", e))?;
    Ok(bytes)
}
