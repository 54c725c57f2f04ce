//! A scene's plots over time, and where all of its plots lie as files.

use std::path::Path;

use maud::{Markup, html};

use super::SceneRows;
use super::colours::{Medium, Palette};
use super::groups::{arrow, slug};
use super::scene_plot::Plot;
use super::sweeps::{Sweep, sweeps};
use crate::base::atomic_file;
use crate::base::error::{Error, Result};
use crate::measure::over_time::Along;
use crate::report::plot::{self, Key};

/// Folder of the plots, in that of their scene.
const FOLDER: &str = "plots";

/// Writes all plots of a scene that is finished into its folder below `folder`; those that are there already stay.
///
/// # Errors
/// A folder that cannot be written to, a full disk.
pub fn write(scene: &SceneRows, palette: &Palette, folder: &Path) -> Result<()> {
    let folder = folder.join(&scene.name).join(FOLDER);
    if !scene.is_finished() {
        return Ok(());
    }
    std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
    let sweeps = sweeps(scene);
    let swept = sweeps.iter().flat_map(|sweep| sweep.plots(scene, palette, Medium::File));
    over_time(scene, palette, Medium::File).into_iter().chain(swept).try_for_each(|plot| {
        let (path, text) = (folder.join(&plot.file), plot.drawing.file());
        let there = std::fs::read(&path).is_ok_and(|before| before == text.as_bytes());
        if there { Ok(()) } else { atomic_file::write(&path, text.as_bytes()) }
    })
}

/// The plots over time of all measures that have them.
pub fn over_time(scene: &SceneRows, palette: &Palette, medium: Medium) -> Vec<Plot> {
    let mut kinds: Vec<(&str, Along)> = Vec::new();
    for series in scene.rows.iter().flat_map(|row| &row.series) {
        if !kinds.contains(&(&series.measure, series.along)) {
            kinds.push((&series.measure, series.along));
        }
    }
    kinds.into_iter().map(|(measure, along)| one_over_time(scene, palette, medium, (measure, along))).collect()
}

fn one_over_time(scene: &SceneRows, palette: &Palette, medium: Medium, (measure, along): (&str, Along)) -> Plot {
    let mut lines: Vec<(Key, &[f64])> = Vec::new();
    let (mut start, mut step) = (0.0, 1.0f64);
    for row in &scene.rows {
        if let Some(series) = row.series.iter().find(|series| series.measure == measure) {
            lines.push((palette.key(scene, row, medium), &series.values));
            start = series.places.first().copied().unwrap_or(start);
            step = series.places.windows(2).map(|pair| pair[1] - pair[0]).next().unwrap_or(step);
        }
    }
    let (caption, along) = match along {
        Along::Frames => (format!("{measure} over time"), "frame"),
        Along::Hertz => (format!("{measure}: deviation of the mean luma by frequency"), "Hz"),
    };
    let title = format!("{}: {caption}", scene.name);
    let drawing = plot::lines(&plot::Lines { title: &title, along, start, step, lines: &lines });
    Plot { file: format!("over-time-{}.svg", slug(measure)), measure: None, caption, drawing }
}

/// The plots over time, on the page.
pub fn section(scene: &SceneRows, palette: &Palette) -> Markup {
    let plots = over_time(scene, palette, Medium::Page);
    html! {
        @if !plots.is_empty() {
            h3 { "Over time" }
            div.plots { @for plot in &plots { (figure(scene, plot)) } }
        }
    }
}

/// What the sweeps did, on the page.
pub fn swept(scene: &SceneRows, palette: &Palette) -> Markup {
    html! {
        @for sweep in sweeps(scene) {
            @let plots = sweep.plots(scene, palette, Medium::Page);
            @if !plots.is_empty() {
                h3 { "What " (options(&sweep)) " of " (sweep.method) " " (if sweep.options.len() > 1 { "do" } else { "does" }) }
                p.small { (legend(&sweep)) " Measures that are the same for all values are left out." }
                div.multiples { @for plot in &plots { (figure(scene, plot)) } }
            }
        }
    }
}

fn options(sweep: &Sweep) -> String {
    sweep.options.iter().map(|option| option.0).collect::<Vec<_>>().join(" and ")
}

fn legend(sweep: &Sweep) -> &'static str {
    match sweep.options.len() {
        2 => "A field for every pair of values: darker is better, the best is framed.",
        _ => {
            "A point for every value, the best ringed; level lines are what numbers mean: the frozen picture, the real clip."
        }
    }
}

fn figure(scene: &SceneRows, plot: &Plot) -> Markup {
    html! {
        figure.plot {
            figcaption {
                (plot.caption)
                @if let Some(measure) = plot.measure {
                    @let (sign, words) = arrow(measure.better);
                    " " span.arrow aria-hidden="true" { (sign) } span.hidden { " (" (words) ")" }
                }
                @if scene.is_finished() {
                    " " a.file href=(format!("{}/{FOLDER}/{}", scene.name, plot.file)) aria-label=(format!("{} as an SVG file", plot.caption)) { "SVG" }
                }
            }
            (plot.drawing.on_page())
        }
    }
}
