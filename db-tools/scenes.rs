//! `enliven-db scenes`: clips to scenes whose answer is known.

use std::path::PathBuf;

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Observer;
use enliven::say;
use enliven::scene::leave_one_out::{Options, Report, scenes};

/// Make scenes to measure by: a frame of each clip as the picture, what moves as the matte, strokes along its motion, the
/// clip's later frames as the reference. Each is animated with the library less its own clip.
#[derive(clap::Args)]
pub struct Scenes {
    /// Video files, or folders of them
    #[arg(required = true)]
    clips: Vec<PathBuf>,
    /// Library that the scenes borrow from, and in which their clips are left out; may be given more than once
    #[arg(long, value_name = "PACK")]
    library: Vec<PathBuf>,
    /// Draw no strokes along the clips' own motion
    #[arg(long)]
    no_strokes: bool,
    /// Let the strokes tell the clips' own speeds too
    #[arg(long, conflicts_with = "no_strokes")]
    speeds: bool,
    /// Folder for the scenes, one folder each
    #[arg(short, long)]
    output: PathBuf,
    /// Print the report as JSON
    #[arg(long)]
    json: bool,
}

impl Scenes {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let options = Options { libraries: self.library.clone(), unasked: self.no_strokes, speeds: self.speeds };
        let report = scenes(&self.clips, &options, &self.output, observer)?;
        if self.json {
            let text = serde_json::to_string_pretty(&report);
            say!("{}", text.map_err(|e| Error::new(Kind::Data, "report", e.to_string()))?);
        } else {
            print(&report);
        }
        Ok(())
    }
}

fn print(report: &Report) {
    say!(
        "{:24} {:>9} {:>6} {:>10} {:>6}  left out; the most like it of those used",
        "scene",
        "size",
        "frame",
        "reference",
        "fluid"
    );
    for scene in &report.written {
        let name = scene.scene.file_name().unwrap_or_default().to_string_lossy();
        let (width, height) = scene.size;
        let nearest = scene.nearest.as_ref().map(|(id, distance)| format!("; {id} at {distance:.2}"));
        say!(
            "{name:24} {:>9} {:>6} {:>10} {:>5.0}%  {}{}",
            format!("{width}x{height}"),
            scene.frame,
            format!("{}..{}", scene.reference.0, scene.reference.1),
            100.0 * scene.fluid,
            if scene.without.is_empty() { "none".to_owned() } else { scene.without.join(", ") },
            nearest.unwrap_or_default()
        );
    }
    for clip in &report.refused {
        say!("{:24} no scene: {}", clip.path.file_name().unwrap_or_default().to_string_lossy(), clip.reason);
    }
}
