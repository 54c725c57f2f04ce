//! How near to the least energy each solver's labels are, and what they cost.
//!
//! `ENLIVEN_DATA=… cargo run --release --example energy_gap -- LIBRARY.pack` animates two frames of each picture that has a
//! matte, as `enliven animate` does, with every solver, at the default λ and at ten times it.

use std::path::Path;
use std::sync::Mutex;
use std::time::Duration;

use enliven::assign::solve::Solver;
use enliven::base::error::Result;
use enliven::base::observe::Observer;
use enliven::base::options::Words;
use enliven::raster::image::Rgb8;
use enliven::scene::file::{Output, SceneFile, set};
use enliven::scene::scene::Scene;
use enliven::synth::methods::database;
use enliven::synth::pieces::options;
use enliven::synth::run::run;
use enliven::video::clip::Sink;

const PICTURES: [&str; 4] = ["forest-waterfall", "sunset-rapids", "painted-waterfall", "mill-stream"];

/// Throws frames away.
struct Nowhere;

impl Sink for Nowhere {
    fn push(&mut self, _: &Rgb8) -> Result<()> {
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

/// CPU time of the stage that finds the labels.
#[derive(Default)]
struct Labelling(Mutex<Duration>);

impl Labelling {
    fn seconds(&self) -> f64 {
        self.0.lock().map(|t| t.as_secs_f64()).unwrap_or_default()
    }
}

impl Observer for Labelling {
    fn begin(&self, stage: &str, _total: u64) {
        if let ("labels", Ok(mut time)) = (stage, self.0.lock()) {
            *time = cpu();
        }
    }

    fn end(&self, stage: &str, _seconds: f64) {
        if let ("labels", Ok(mut time)) = (stage, self.0.lock()) {
            *time = cpu() - *time;
        }
    }
}

/// CPU time of this process.
fn cpu() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ProcessCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

fn scene(root: &Path, picture: &str, library: &str, solver: &str, lambda: f32) -> Result<Scene> {
    let folder = root.join("pictures");
    let mut file = SceneFile {
        picture: folder.join(format!("{picture}.png")),
        matte: Some(folder.join(format!("{picture}.matte.png"))),
        library: vec![library.into()],
        method: Some(database::ENTRY.name.to_owned()),
        output: Output { frames: Some(2), ..Output::default() },
        ..SceneFile::default()
    };
    set(&mut file, &format!("database.solver={solver}"))?;
    set(&mut file, &format!("database.lambda={lambda}"))?;
    Scene::new(file)
}

fn main() -> Result<()> {
    let (Some(root), Some(library)) = (std::env::var_os("ENLIVEN_DATA"), std::env::args().nth(1)) else {
        println!("set ENLIVEN_DATA to the folder that holds the pictures, and name a library");
        return Ok(());
    };
    let default = options::Options::default().lambda;
    for picture in PICTURES {
        for (lambda, &(name, _)) in
            [default, 10.0 * default].iter().flat_map(|l| Solver::ALL.iter().map(move |s| (l, s)))
        {
            let labelling = Labelling::default();
            let scene = scene(Path::new(&root), picture, &library, name, *lambda)?;
            let record = run(&scene, &mut Nowhere, &labelling)?.record;
            let Some(a) = record.assignment else { continue };
            println!(
                "{picture}, {} nodes, λ {lambda}, {name}: energy {:.3}, bound {:.3}, gap {:.4} %, {:.3} s of CPU, {} steps",
                a.nodes.len(),
                a.energy,
                a.bound,
                100.0 * a.gap,
                labelling.seconds(),
                a.history.len() - 1
            );
        }
    }
    Ok(())
}
