//! `enliven-db verify`: reads every byte of a pack.

use std::path::PathBuf;

use enliven::base::error::Result;
use enliven::base::observe::Observer;
use enliven::cli::common::{bytes, counted};
use enliven::library::reader::Pack;
use enliven::library::verify::verify;
use enliven::say;

/// Check every byte of a library.
#[derive(clap::Args)]
pub struct Verify {
    /// The library
    pack: PathBuf,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

impl Verify {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let report = verify(&*Pack::open(&self.pack)?, observer)?;
        if self.json {
            say!(
                "{}",
                serde_json::json!({ "sound": true, "bytes": report.bytes, "clips": report.clips,
                "frames": report.frames, "pieces": report.pieces })
            );
        } else {
            say!(
                "{}: sound; {} read, {}, {}, {}",
                self.pack.display(),
                bytes(report.bytes),
                counted(report.clips as u64, "clip"),
                counted(report.frames as u64, "frame"),
                counted(report.pieces as u64, "piece")
            );
        }
        Ok(())
    }
}
