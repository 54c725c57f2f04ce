//! Seconds per stage of a clip's analysis on one thread and on two.
//!
//! `ENLIVEN_DATA=… cargo run --release --example analysis_time [CLIP]` (a path under the data folder; 113 frames of it)

use std::path::Path;
use std::time::Instant;

use enliven::base::error::Result;
use enliven::base::observe::Observer;
use enliven::base::par;
use enliven::library::analyse::analyse;
use enliven::video::conform::{ConformOptions, Conformed};

struct Print;

impl Observer for Print {
    fn end(&self, stage: &str, seconds: f64) {
        println!("  {stage}: {seconds:.2} s");
    }
}

fn main() -> Result<()> {
    let Some(root) = std::env::var_os("ENLIVEN_DATA") else {
        println!("set ENLIVEN_DATA to the folder that holds the clips");
        return Ok(());
    };
    let name = std::env::args().nth(1).unwrap_or_else(|| "clips/water/meditator_river.mp4".into());
    let mut clip = Conformed::open(&Path::new(&root).join(name), &ConformOptions::default())?;
    let size = clip.report().working;
    let mut frames = Vec::new();
    while frames.len() < 113
        && let Some(frame) = clip.next_frame()?
    {
        frames.push(frame);
    }
    println!("{} frames of {} × {} px, already decoded", frames.len(), size.0, size.1);
    for threads in [1, 2] {
        let mut left = frames.iter().cloned();
        let start = Instant::now();
        println!("{threads} thread(s)");
        par::with_threads(threads, || analyse(&mut || Ok(left.next()), size, None, &Print, &mut |_| Ok(())))??;
        println!("  all: {:.2} s", start.elapsed().as_secs_f64());
    }
    Ok(())
}
