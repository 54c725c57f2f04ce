//! `enliven simulate`: a fluid designed by hand, as the target of an exemplar method.

use std::path::PathBuf;

use crate::base::error::{Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::{counted, say};
use crate::simulate::output::{Summary, simulate};
use crate::simulate::setup::Setup;

/// Simulate smoke, fire or water: flow and opacity, frame by frame.
#[derive(Debug, Clone, clap::Args)]
pub struct Simulate {
    /// The simulation's file (TOML)
    file: PathBuf,
    /// Folder to write to
    #[arg(short, long)]
    output: PathBuf,
    /// Print the summary as JSON
    #[arg(long)]
    json: bool,
}

impl Simulate {
    /// Runs the command.
    ///
    /// # Errors
    /// A file that does not make sense, a folder that cannot be written to, a full disk, an interruption.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let setup = Setup::open(&self.file)?;
        let summary = simulate(&setup, &self.output, observer).map_err(|error| match error.kind() {
            Kind::Usage => error.within(&self.file),
            _ => error,
        })?;
        if self.json {
            say!("{}", serde_json::json!(summary));
        } else {
            self.print(&summary, observer);
        }
        Ok(())
    }

    fn print(&self, summary: &Summary, observer: &dyn Observer) {
        let frames = counted(summary.frames as u64, "frame");
        let divergence = summary.max_divergence.map_or(String::new(), |d| format!(", divergence up to {d:.1e}"));
        say!(
            "{}: {frames}, {:.1} steps a second, up to {:.1} pixels per frame{divergence}, mass drift {:.1e}",
            self.output.display(),
            summary.steps_per_second,
            summary.max_speed,
            summary.mass_drift
        );
        if let (Some(white), Some(clipped)) = (summary.height_white, summary.height_clipped)
            && clipped > 0.0
        {
            let share = 100.0 * clipped;
            observer.note(&format!(
                "{share:.2} % of the heights are above {white} pixels, cut to white; raise water.white"
            ));
        }
    }
}
