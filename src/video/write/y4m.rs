//! Y4M: uncompressed 4:2:0 frames with one text line of header, to pipe into other programs.
//!
//! Y4M cannot name its colour matrix. Frames have the one that readers, ours among them, assume for their size
//! ([`Colour::resolve`]), in limited range (told by `XCOLORRANGE`), chroma sited left (`C420mpeg2`).

use std::io::{self, BufWriter, Write};
use std::path::{Path, PathBuf};

use super::options::{SinkOptions, check_frame};
use crate::base::atomic_file::AtomicFile;
use crate::base::error::{Error, Kind, Result};
use crate::raster::image::Rgb8;
use crate::video::clip::Sink;
use crate::video::read::h264::Colour;
use crate::video::yuv;

/// Writes Y4M to a file or to standard output.
#[derive(Debug)]
pub struct Y4mWriter {
    out: Output,
    path: PathBuf,
    options: SinkOptions,
    frames: usize,
}

#[derive(Debug)]
enum Output {
    File(BufWriter<AtomicFile>),
    Stdout(BufWriter<io::Stdout>),
}

impl Output {
    fn write_all(&mut self, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::File(file) => file.write_all(bytes),
            Self::Stdout(out) => out.write_all(bytes),
        }
    }
}

impl Y4mWriter {
    /// Opens a file.
    ///
    /// # Errors
    /// When it cannot be written.
    pub fn create(path: &Path, options: SinkOptions) -> Result<Self> {
        Self::start(Output::File(BufWriter::new(AtomicFile::create(path)?)), path, options)
    }

    /// Writes to standard output.
    ///
    /// # Errors
    /// When it is closed.
    pub fn to_stdout(options: SinkOptions) -> Result<Self> {
        Self::start(Output::Stdout(BufWriter::new(io::stdout())), Path::new("standard output"), options)
    }

    fn start(out: Output, path: &Path, options: SinkOptions) -> Result<Self> {
        let mut writer = Self { out, path: path.to_path_buf(), options, frames: 0 };
        let (n, d) = (options.rate.numerator(), options.rate.denominator());
        let (width, height) = (options.width, options.height);
        let header = format!("YUV4MPEG2 W{width} H{height} F{n}:{d} Ip A1:1 C420mpeg2 XCOLORRANGE=LIMITED\n");
        writer.write(header.as_bytes())?;
        Ok(writer)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.out.write_all(bytes).map_err(|e| Error::io(&self.path, "write", e))
    }
}

impl Sink for Y4mWriter {
    fn push(&mut self, frame: &Rgb8) -> Result<()> {
        check_frame(&self.path, frame, self.options)?;
        let (matrix, range) = Colour::default().resolve(frame.width, frame.height);
        self.write(b"FRAME\n")?;
        for plane in yuv::from_rgb8(frame, matrix, range) {
            self.write(&plane)?;
        }
        self.frames += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        if self.frames == 0 {
            return Err(Error::file(Kind::Unusable, &self.path, "no frame was written"));
        }
        let refused = |e| Error::io(&self.path, "write", e);
        match self.out {
            Output::File(file) => file.into_inner().map_err(|e| refused(e.into_error()))?.commit(),
            Output::Stdout(mut out) => out.flush().map_err(refused),
        }
    }
}
