//! `enliven demo`: the whole line on the embedded fixtures, clips to library to moving pictures.

use std::path::{Path, PathBuf};
use std::time::Instant;

use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::cli::common::{bytes, counted, duration, say};
use crate::library::build::build;
use crate::library::options::Options;
use crate::report::animate::animate;
use crate::scene::exemplar_file::ExemplarFile;
use crate::scene::file::SceneFile;
use crate::scene::scene;
use crate::simulate::output::simulate;
use crate::simulate::setup::Setup;

/// The fixtures, by their path below `fixtures/`, inside the program: the demo runs wherever the program is.
macro_rules! fixtures {
    ($($path:literal),* $(,)?) => {
        &[$(($path, include_bytes!(concat!(env!("CARGO_MANIFEST_DIR"), "/fixtures/", $path)))),*]
    };
}

const FIXTURES: &[(&str, &[u8])] = fixtures![
    "README.md",
    "clips/fire/flames.mp4",
    "clips/smoke/plume.mp4",
    "clips/water/rapids.mp4",
    "clips/water/waterfall.mp4",
    "exemplars/flames.png",
    "pictures/campfire.clean.png",
    "pictures/campfire.matte.png",
    "pictures/campfire.png",
    "pictures/falls.matte.png",
    "pictures/falls.png",
    "pictures/falls.strokes.json",
    "pictures/stream.jpg",
    "pictures/stream.matte.png",
    "pictures/stream.strokes.json",
    "scenes/falls/scene.toml",
    "scenes/fire/scene.toml",
    "scenes/stream/scene.toml",
    "simulate/fire.toml",
];

/// Libraries: name, folder of clips.
const LIBRARIES: [(&str, &str); 2] = [("water", "clips/water"), ("fire", "clips/fire")];
/// Scenes: name, library.
const SCENES: [(&str, &str); 3] = [("falls", "water"), ("stream", "water"), ("fire", "fire")];
/// A designed fire: name, simulation, what it is made to look like, method.
const DESIGNED: (&str, &str, &str, &str) = ("flames", "simulate/fire.toml", "exemplars/flames.png", "lazyfluids");
/// Distance of pieces in the demo's libraries: its clips are small.
const STRIDE: u32 = 12;

/// Build small libraries from the program's own clips, animate three pictures with them, and a fire designed by hand.
#[derive(Debug, Clone, clap::Args)]
pub struct Demo {
    /// Folder to write to
    #[arg(short, long, default_value = "enliven-demo")]
    output: PathBuf,
}

impl Demo {
    /// Runs the command.
    ///
    /// # Errors
    /// A folder that cannot be written to, a full disk, an interruption.
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let start = Instant::now();
        let input = self.output.join("input");
        let again = self.refuse_stranger(&input)?;
        unpack(&input, observer)?;
        for (name, clips) in LIBRARIES {
            let pack = self.output.join(name).with_extension("pack");
            let options = Options { tag: name.to_owned(), stride: STRIDE, replace: again, ..Options::default() };
            let report = build(&[input.join(clips)], &pack, &options, observer)?;
            say!(
                "{}: {}, {}, {}",
                pack.display(),
                counted(report.accepted.len() as u64, "clip"),
                counted(report.pieces, "piece"),
                bytes(report.bytes)
            );
        }
        for (name, library) in SCENES {
            let mut file = scene::open(&input.join("scenes").join(name))?;
            file.library = vec![self.output.join(library).with_extension("pack")];
            self.animate(name, file, observer)?;
        }
        self.design(&input, observer)?;
        say!(
            "all in {}; look at {}, and at index.html in the folders beside the videos",
            duration(start.elapsed().as_secs_f64()),
            self.output.join("falls.mp4").display()
        );
        Ok(())
    }
}

impl Demo {
    /// Whether the folder holds an earlier demo; one with anything else in it is not written into.
    fn refuse_stranger(&self, input: &Path) -> Result<bool> {
        let again = FIXTURES.iter().any(|(path, _)| input.join(path).exists());
        let filled = || std::fs::read_dir(&self.output).is_ok_and(|mut list| list.next().is_some());
        if !again && filled() {
            return Err(Error::file(Kind::Usage, &self.output, "holds other things than an earlier demo")
                .remedy("name a new folder with -o"));
        }
        Ok(again)
    }

    /// Animates one scene, with a page that explains it.
    fn animate(&self, name: &str, file: SceneFile, observer: &dyn Observer) -> Result<()> {
        let video = self.output.join(name).with_extension("mp4");
        let record = animate(file, &video, Some(&self.output.join(name)), observer)?;
        let frames = counted(record.scene.output.length() as u64, "frame");
        say!("{}: {frames} in {}", video.display(), duration(record.seconds));
        Ok(())
    }

    /// Simulates a fire and makes it look like flames.
    fn design(&self, input: &Path, observer: &dyn Observer) -> Result<()> {
        let (name, simulation, exemplar, method) = DESIGNED;
        let target = self.output.join(format!("{name}-target"));
        simulate(&Setup::open(&input.join(simulation))?, &target, observer)?;
        let mut file = scene::open(&target)?;
        (file.exemplars, file.method) = (vec![ExemplarFile::new(input.join(exemplar))], Some(method.to_owned()));
        self.animate(name, file, observer)
    }
}

/// Writes the fixtures into a folder; those that a person has changed there stay, and are told of.
fn unpack(folder: &Path, observer: &dyn Observer) -> Result<()> {
    for (path, content) in FIXTURES {
        let target = folder.join(path);
        let parent = target.parent().unwrap_or(folder);
        std::fs::create_dir_all(parent).map_err(|e| Error::io(parent, "make the folder", e))?;
        match std::fs::read(&target) {
            Ok(there) if there == *content => {}
            Ok(_) => observer.note(&format!("{}: is not the demo's own and is used as it is", target.display())),
            Err(_) => atomic_file::write(&target, content)?,
        }
    }
    Ok(())
}
