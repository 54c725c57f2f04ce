//! The gallery of a library: a page with a looping thumbnail of every clip, its motion in colour, its share of pieces.

use std::fs;
use std::path::Path;

use maud::{Markup, html};

use super::page;
use crate::base::error::{Error, Result};
use crate::base::observe::{Observer, check, stage};
use crate::base::own_file;
use crate::base::text::counted;
use crate::flow::draw;
use crate::flow::field::Field;
use crate::library::names::Names;
use crate::library::reader::Pack;
use crate::library::variant::Variant;
use crate::raster::image::Plane;
use crate::raster::picture_io::write_own_png;
use crate::raster::resample::{resize_color, resize_rgb8};
use crate::video::write::options::{FrameRate, SinkOptions};
use crate::video::write::sink;

/// Long side of a thumbnail in pixels.
const THUMBNAIL: usize = 256;
/// Most frames of a thumbnail's loop.
const THUMBNAIL_FRAMES: usize = 150;

/// Writes the gallery of `pack` as `folder/index.html` with its videos and pictures beside it; `names` are those of its
/// clips, as far as there are any.
///
/// # Errors
/// A damaged pack, a page in the folder that is no gallery, or a folder that cannot be written to.
pub fn write(pack: &Pack, names: &Names, title: &str, folder: &Path, observer: &dyn Observer) -> Result<()> {
    let index = folder.join("index.html");
    own_file::check(&index)?;
    fs::create_dir_all(folder).map_err(|e| Error::io(folder, "make the folder", e))?;
    let clips = pack.clips().len() as u32;
    let cards = stage(observer, "gallery", u64::from(clips), || {
        (0..clips)
            .map(|clip| {
                check(observer)?;
                write_thumbnail(pack, clip, folder)?;
                write_pictures(pack, clip, folder)?;
                observer.advance("gallery", 1);
                Ok(card(pack, names, clip))
            })
            .collect::<Result<Vec<_>>>()
    })?;
    own_file::write(&index, page(pack, title, &cards).into_string().as_bytes())
}

fn name(pack: &Pack, clip: u32, what: &str) -> String {
    format!("{}.{what}", pack.clips()[clip as usize].id)
}

fn thumbnail_size(width: u32, height: u32) -> (usize, usize) {
    let long = width.max(height) as usize;
    let of = |side: u32| (side as usize * THUMBNAIL / long.max(1)).max(16) / 2 * 2;
    (of(width), of(height))
}

fn write_thumbnail(pack: &Pack, clip: u32, folder: &Path) -> Result<()> {
    let meta = &pack.clips()[clip as usize];
    let (width, height) = thumbnail_size(meta.width, meta.height);
    let rate = FrameRate::new(f64::from(pack.parameters().rate))?;
    let mut sink = sink::create(
        &folder.join(name(pack, clip, "mp4")),
        SinkOptions { width, height, rate, loops: true, alpha: false },
    )?;
    let mut frames = pack.frames(clip)?;
    for t in 0..(meta.frames as usize).min(THUMBNAIL_FRAMES) {
        sink.push(&resize_rgb8(&frames.at(t)?, width, height))?;
    }
    sink.finish()
}

/// The average image and the mean motion in colour, both as large as the thumbnail.
fn write_pictures(pack: &Pack, clip: u32, folder: &Path) -> Result<()> {
    let meta = &pack.clips()[clip as usize];
    let (width, height) = thumbnail_size(meta.width, meta.height);
    let average = resize_color(&pack.average(clip)?, width, height).to_rgb8();
    write_own_png(&folder.join(name(pack, clip, "average.png")), &average)?;
    let grid = pack.grid(clip, 0)?;
    let plane = |c: usize| {
        Plane::from_vec(grid.width, grid.height, grid.cells.iter().map(|cell| cell.mean[c].to_f32()).collect())
    };
    let field = Field { u: plane(0), v: plane(1) };
    write_own_png(&folder.join(name(pack, clip, "motion.png")), &resize_rgb8(&draw::colour(&field, 0.0), width, height))
}

fn card(pack: &Pack, names: &Names, clip: u32) -> Markup {
    let meta = &pack.clips()[clip as usize];
    let share = 100.0 * meta.pieces() as f64 / pack.piece_count().max(1) as f64;
    let seconds = f64::from(meta.frames) / f64::from(pack.parameters().rate);
    let still: u64 = meta.counts.iter().map(|c| u64::from(c.still)).sum();
    html! {
        article {
            h2 { @if let Some(name) = names.of(meta.id) { (name) " " } code { (meta.id) } @if !meta.tag.is_empty() { " " span.tag { (meta.tag) } } }
            div.views {
                figure {
                    video src=(name(pack, clip, "mp4")) autoplay loop muted playsinline aria-label="the clip" {}
                    figcaption { "clip" }
                }
                figure {
                    img src=(name(pack, clip, "average.png")) alt="average image" loading="lazy";
                    figcaption { "average" }
                }
                figure {
                    img src=(name(pack, clip, "motion.png")) alt="mean motion in colour" loading="lazy";
                    figcaption { "mean motion" }
                }
            }
            p { (meta.width) " × " (meta.height) " px, " (counted(meta.frames, "frame")) " (" (format!("{seconds:.1}")) " s)" }
            p {
                (counted(meta.pieces(), "piece")) ", " (format!("{share:.1}")) " % of the library; "
                (still) " left out because they stand still"
            }
            div.bar { div style=(format!("width:{share:.2}%")) {} }
        }
    }
}

const STYLE: &str = "\
:root{color-scheme:light dark}body{font:15px/1.4 system-ui,sans-serif;margin:1.5rem;max-width:90rem}\
main{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,26rem),1fr));gap:1.5rem}\
article{border:1px solid #8884;border-radius:8px;padding:1rem}h2{font:600 1rem system-ui,sans-serif;overflow-wrap:anywhere;margin:0 0 .5rem}\
.tag{background:#48a;color:#fff;border-radius:4px;padding:0 .4em}.views{display:flex;gap:.5rem}\
figure{margin:0;flex:1}figure>*{width:100%;display:block}figcaption{font-size:.8rem;opacity:.7}\
p{margin:.4rem 0}body>p{margin:0 0 1.2rem}.bar{background:#8883;height:6px;border-radius:3px}.bar div{background:#48a;height:100%;border-radius:3px}";

fn page(pack: &Pack, title: &str, cards: &[Markup]) -> Markup {
    let body = html! {
        h1 { "Library " (title) }
        p {
            (counted(pack.clips().len() as u64, "clip")) ", " (counted(pack.piece_count() as u64, "piece")) ", " (Variant::COUNT)
            " variants of each clip. In the motion pictures red is to the right, yellow-green down, cyan to the "
            "left, violet up; white is still."
        }
        main { @for card in cards { (card) } }
    };
    page::page(&format!("Library {title}"), STYLE, &body)
}
