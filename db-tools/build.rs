//! `enliven-db build`: clips to a library.

use std::path::PathBuf;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Observer;
use enliven::cli::common::{bytes, counted, duration};
use enliven::library::build::{BuildReport, build};
use enliven::library::options::Options;
use enliven::say;

/// Build a library from clips. What is finished is kept when it is interrupted; run it again to go on.
#[derive(clap::Args)]
pub struct Build {
    /// Video files, or folders of them. NAME.mask.png beside NAME.mp4 leaves out what is black in it
    #[arg(required = true)]
    clips: Vec<PathBuf>,
    /// The library to write (.pack)
    #[arg(short, long)]
    output: PathBuf,
    /// Tag of the clips, for enliven animate --use
    #[arg(long, default_value = "")]
    tag: String,
    /// Distance of neighbouring pieces in pixels; 12 or 8 for small fluids
    #[arg(long, default_value_t = Options::default().stride)]
    stride: u32,
    /// Long side that clips are brought to, in pixels
    #[arg(long, default_value_t = Options::default().working)]
    working_size: u32,
    /// Replace a library that holds clips which are not given this time
    #[arg(long)]
    replace: bool,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

impl Build {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let options =
            Options { tag: self.tag.clone(), stride: self.stride, working: self.working_size, ..Options::default() };
        let report = build(&self.clips, &self.output, &options, observer)?;
        if self.json {
            let text = serde_json::to_string_pretty(&report);
            say!("{}", text.map_err(|e| Error::new(Kind::Data, "report", e.to_string()))?);
        } else {
            self.print(&report);
        }
        Ok(())
    }

    fn print(&self, report: &BuildReport) {
        say!("{:28} {:16} {:>9} {:>7} {:>8}", "clip", "named in reports", "size", "frames", "pieces");
        for clip in &report.accepted {
            let name = clip.path.file_name().unwrap_or_default().to_string_lossy();
            let size = format!("{}x{}", clip.width, clip.height);
            say!("{name:28} {:16} {size:>9} {:>7} {:>8}  {}", clip.id, clip.frames, clip.pieces, clip.notes.join("; "));
        }
        for clip in &report.refused {
            say!("{:28} left out: {}", clip.path.file_name().unwrap_or_default().to_string_lossy(), clip.reason);
        }
        let [analyse, features, write] = report.seconds;
        say!(
            "{}: {}, {}, {}; clips {}, features {}, writing {}",
            self.output.display(),
            counted(report.accepted.len() as u64, "clip"),
            counted(report.pieces, "piece"),
            bytes(report.bytes),
            duration(analyse),
            duration(features),
            duration(write)
        );
    }
}
