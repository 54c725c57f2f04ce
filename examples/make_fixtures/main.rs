//! Makes what a program can make of `fixtures/`: `cargo run --release --example make_fixtures -- OUTDIR [NAME…]`, with
//! names of [`JOBS`]; without names, all of them.
//!
//! The same bytes come out on every machine with the same version of the crate: the pictures are computed from
//! additions and multiplications only, and the randomness is a hash.

mod campfire;
mod canvas;
mod exemplar;
mod falls;
mod fire;
mod fluid;
mod land;
mod matte;
mod noise;
mod numeric;
mod paint;
mod river;
mod smoke;

use std::path::{Path, PathBuf};

use anyhow::{Context, Result, bail};
use enliven::raster::image::{Plane, Rgb8};
use enliven::video::write::options::{FrameRate, SinkOptions};
use enliven::video::write::sink;

type Job = fn(&Path) -> Result<()>;

/// What can be made, by name.
const JOBS: [(&str, Job); 8] = [
    ("waterfall", waterfall),
    ("rapids", rapids),
    ("flames", flames),
    ("plume", plume),
    ("exemplar", flames_exemplar),
    ("falls", falls_painting),
    ("campfire", campfire_painting),
    ("stream", stream_matte),
];

/// Frames of every clip.
const FRAMES: usize = 100;
const FPS: f64 = 25.0;

fn main() -> Result<()> {
    let mut arguments = std::env::args().skip(1);
    let Some(out) = arguments.next().map(PathBuf::from) else { bail!("give the folder to write into") };
    let names: Vec<String> = arguments.collect();
    if let Some(unknown) = names.iter().find(|n| JOBS.iter().all(|(job, _)| job != n)) {
        bail!("nothing is called {unknown}; there are {}", JOBS.map(|(name, _)| name).join(", "));
    }
    for (name, job) in JOBS {
        if names.is_empty() || names.iter().any(|n| n == name) {
            let start = std::time::Instant::now();
            job(&out).with_context(|| name.to_owned())?;
            println!("{name}: {:.1} s", start.elapsed().as_secs_f32());
        }
    }
    Ok(())
}

fn waterfall(out: &Path) -> Result<()> {
    let scene = falls::clip_scene();
    let renderer = falls::FallsRenderer::new(&scene);
    write_clip(&out.join("clips/water/waterfall.mp4"), |t| renderer.frame(t as f32 + 200.0))
}

fn rapids(out: &Path) -> Result<()> {
    let scene = river::clip_scene();
    let renderer = river::RiverRenderer::new(&scene);
    write_clip(&out.join("clips/water/rapids.mp4"), |t| renderer.frame(t + 100))
}

fn flames(out: &Path) -> Result<()> {
    let scene = fire::clip_scene();
    let ground = fire::hearth(&scene);
    let mut burning = fire::Burning::lit(&scene, 70);
    write_clip(&out.join("clips/fire/flames.mp4"), |_| {
        let mut canvas = ground.clone();
        burning.draw(&mut canvas);
        burning.advance();
        canvas.develop(1.3)
    })
}

fn plume(out: &Path) -> Result<()> {
    let scene = smoke::clip_scene();
    let rock = smoke::rock_face(&scene);
    let mut smoking = smoke::Smoking::started(&scene, 180);
    write_clip(&out.join("clips/smoke/plume.mp4"), |_| {
        let mut canvas = rock.clone();
        smoking.draw(&mut canvas);
        smoking.advance();
        canvas.develop(1.0)
    })
}

/// Flames alone, with their opacity, to borrow looks from.
fn flames_exemplar(out: &Path) -> Result<()> {
    let path = out.join("exemplars/flames.png");
    create_parent(&path)?;
    let (width, height) = (exemplar::SIZE.0 as u32, exemplar::SIZE.1 as u32);
    Ok(image::save_buffer(path, &exemplar::flames()?, width, height, image::ColorType::Rgba8)?)
}

/// A painting of other falls, with the renderer's own matte.
fn falls_painting(out: &Path) -> Result<()> {
    let scene = falls::picture_scene();
    let renderer = falls::FallsRenderer::new(&scene);
    let painting = paint::oil(&renderer.frame(300.0), 3, scene.seed);
    write_png(&out.join("pictures/falls.png"), &painting)?;
    write_matte(&out.join("pictures/falls.matte.png"), &renderer.matte())
}

/// A painting of a campfire, the same without flames, and the matte of the flames.
fn campfire_painting(out: &Path) -> Result<()> {
    let pictures = campfire::pictures();
    write_png(&out.join("pictures/campfire.png"), &paint::oil(&pictures.burning, 3, 1))?;
    write_png(&out.join("pictures/campfire.clean.png"), &paint::oil(&pictures.clean, 3, 1))?;
    write_matte(&out.join("pictures/campfire.matte.png"), &pictures.matte)
}

/// The matte of the photograph, from outlines drawn by hand.
fn stream_matte(out: &Path) -> Result<()> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/pictures");
    let (width, height) = image::image_dimensions(folder.join("stream.jpg"))?;
    let outlines = matte::Outlines::read(&folder.join("stream.matte.json"))?;
    write_matte(&out.join("pictures/stream.matte.png"), &outlines.fill(width as usize, height as usize))
}

fn write_png(path: &Path, picture: &Rgb8) -> Result<()> {
    create_parent(path)?;
    let (width, height) = (picture.width as u32, picture.height as u32);
    Ok(image::save_buffer(path, &picture.data, width, height, image::ColorType::Rgb8)?)
}

fn write_matte(path: &Path, matte: &Plane) -> Result<()> {
    create_parent(path)?;
    let bytes: Vec<u8> = matte.data.iter().map(|v| (v.clamp(0.0, 1.0) * 255.0).round() as u8).collect();
    Ok(image::save_buffer(path, &bytes, matte.width as u32, matte.height as u32, image::ColorType::L8)?)
}

fn write_clip(path: &Path, mut frame: impl FnMut(usize) -> Rgb8) -> Result<()> {
    create_parent(path)?;
    let first = frame(0);
    let options = SinkOptions {
        width: first.width,
        height: first.height,
        rate: FrameRate::new(FPS)?,
        loops: false,
        alpha: false,
    };
    let mut sink = sink::create(path, options)?;
    sink.push(&first)?;
    for t in 1..FRAMES {
        sink.push(&frame(t))?;
    }
    Ok(sink.finish()?)
}

fn create_parent(path: &Path) -> Result<()> {
    if let Some(folder) = path.parent() {
        std::fs::create_dir_all(folder).with_context(|| folder.display().to_string())?;
    }
    Ok(())
}
