//! `enliven-db gallery`: a page that shows every clip of a pack.

use std::path::PathBuf;

use enliven::base::error::Result;
use enliven::base::observe::Observer;
use enliven::library::names::Names;
use enliven::library::reader::Pack;
use enliven::report::gallery;
use enliven::say;

/// Make a page with a looping thumbnail of every clip, its motion in colour and its share of pieces.
#[derive(clap::Args)]
pub struct Gallery {
    /// The library
    pack: PathBuf,
    /// Folder for the page [default: the library's name with .gallery]
    #[arg(short, long)]
    output: Option<PathBuf>,
}

impl Gallery {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let folder = self.output.clone().unwrap_or_else(|| self.pack.with_extension("gallery"));
        let title = self.pack.file_stem().unwrap_or_default().to_string_lossy();
        let pack = Pack::open(&self.pack)?;
        let names = Names::read(&self.pack, pack.clips(), observer);
        gallery::write(&pack, &names, &title, &folder, observer)?;
        say!("{}", folder.join("index.html").display());
        Ok(())
    }
}
