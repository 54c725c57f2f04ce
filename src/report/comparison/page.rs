//! The page of a comparison: videos in step, tables, plots; one file that fetches nothing but the videos beside it.

use maud::{Markup, PreEscaped, html};

use super::reading::cautions;
use super::slices::slices;
use super::{Comparison, Row, SceneRows, Sort, blind};
use crate::base::text::counted;
use crate::measure::over_time::Along;
use crate::measure::{Better, Measure};
use crate::report::page;
use crate::report::plot;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");
/// Classes of lines in plots, one after the other.
const COLOURS: usize = 8;

/// The page.
pub fn page(comparison: &Comparison) -> Markup {
    let body = html! {
        header {
            h1 { "Comparison" }
            p {
                (counted(comparison.scenes.len() as u64, "scene")) ", " (comparison.program)
                ". The tables as " a href="results.csv" { "CSV" } " and " a href="results.json" { "JSON" }
                ". To repeat it, in this folder:"
            }
            pre { (comparison.command) }
            @let missing = comparison.to_make();
            @if missing > 0 {
                p.unfinished role="status" {
                    (counted(missing as u64, "video")) " still to be made: this page was written while the work was going on, or it was stopped. The same command goes on with it."
                }
            }
            p.keys {
                "Space plays and pauses the scene in view, " kbd { "," } " and " kbd { "." } " step a frame; drag a zoomed video to move all of them."
            }
            @if comparison.scenes.len() > 1 {
                nav aria-label="scenes" { @for scene in &comparison.scenes { a href=(format!("#{}", anchor(scene))) { (scene.name) } } }
            }
        }
        main {
            @if let Some(test) = &comparison.blind { (blind::section(test)) }
            @for scene in &comparison.scenes { (section(scene)) }
        }
        script { (PreEscaped(SCRIPT)) }
    };
    page::page("Comparison", STYLE, &body)
}

fn anchor(scene: &SceneRows) -> String {
    format!("scene-{}", scene.name)
}

fn section(scene: &SceneRows) -> Markup {
    let (width, height) = scene.size;
    html! {
        section.scene id=(anchor(scene)) data-frames=(scene.frames) data-fps=(scene.fps) aria-label=(scene.name) {
            h2 { (scene.name) }
            p { (counted(scene.frames as u64, "frame")) " of " (width) " × " (height) " at " (scene.fps) " per second" }
            @if !scene.pictures.is_empty() {
                div.pictures {
                    @for (file, caption) in &scene.pictures {
                        figure { img src=(file) alt=(caption) loading="lazy"; figcaption { (caption) } }
                    }
                }
            }
            (controls(scene))
            div.videos { @for row in &scene.rows { (video(row)) } }
            (wipe(scene))
            (slices(scene))
            (table(scene))
            @let told = cautions(scene);
            @if !told.is_empty() { ul.cautions { @for line in &told { li { (line) } } } }
            (plots(scene))
        }
    }
}

fn controls(scene: &SceneRows) -> Markup {
    let last = scene.frames.saturating_sub(1);
    html! {
        div.controls role="group" aria-label=(format!("Play {}", scene.name)) {
            button.play type="button" aria-pressed="false" { "Play" }
            input.scrub type="range" min="0" max=(last) value="0" step="1" aria-label="Frame";
            output.frame { "0 / " (last) }
            label { "Speed " select.speed { option value="1" selected { "1 ×" } option value="0.5" { "½ ×" } option value="0.25" { "¼ ×" } } }
            label { input.loop type="checkbox" checked; " Loop" }
            label { "Zoom " input.zoom type="range" min="1" max="6" step="0.5" value="1"; }
        }
    }
}

fn video(row: &Row) -> Markup {
    html! {
        figure.row {
            @match (&row.video, &row.failed) {
                (Some(address), _) => div.view tabindex="0" role="group" aria-label=(format!("{}, arrow keys move all zoomed videos", row.name)) {
                    video src=(address) muted playsinline preload="auto" aria-label=(row.name) {}
                },
                (None, Some(failed)) => p.failed { "Not made: " (failed) },
                (None, None) => p.failed { "Still to be made." },
            }
            figcaption {
                strong { (row.name) }
                @match row.sort {
                    Sort::Frozen => " the picture held still",
                    Sort::Real => " the real clip",
                    Sort::Shuffled => " planted: a method's frames, shuffled",
                    Sort::Method => @if let Some(seconds) = row.seconds { " " (format!("{seconds:.1} s")) },
                }
                @if let Some(page) = &row.page { " · " a href=(page) { "run" } }
                @if let Some(motion) = &row.motion { " · " a href=(motion) { "motion" } }
            }
        }
    }
}

/// Two videos over each other, with a border between them that can be moved.
fn wipe(scene: &SceneRows) -> Markup {
    let made: Vec<&Row> = scene.rows.iter().filter(|row| row.video.is_some()).collect();
    let chooser = |label: &str, chosen: usize| {
        html! {
            label {
                (label) " "
                select.choice {
                    @for (i, row) in made.iter().enumerate() {
                        option value=[row.video.as_deref()] selected[i == chosen] { (row.name) }
                    }
                }
            }
        }
    };
    html! {
        @if made.len() > 1 {
            details.wipe {
                summary { "Wipe between two" }
                div.choices { (chooser("Left", made.len() - 2)) (chooser("Right", made.len() - 1)) }
                input.border type="range" min="0" max="100" step="0.5" value="50" aria-label="Border between left and right, per cent";
                div.stage {
                    video.right muted playsinline preload="auto" aria-label="right" {}
                    div.over { video.left muted playsinline preload="auto" aria-label="left" {} }
                }
            }
        }
    }
}

fn arrow(better: Better) -> (&'static str, &'static str) {
    match better {
        Better::Lower => ("↓", "lower is better"),
        Better::Higher => ("↑", "higher is better"),
        Better::Zero => ("→ 0", "near 0 is better"),
        Better::One => ("→ 1", "near 1 is better"),
    }
}

fn table(scene: &SceneRows) -> Markup {
    let rows: Vec<&Row> = scene.rows.iter().filter(|row| row.is_made()).collect();
    html! {
        div.scroll tabindex="0" role="region" aria-label=(format!("Measures of {}", scene.name)) {
            table {
                thead {
                    tr {
                        th scope="col" { "Measure" }
                        @for row in &rows { th.number scope="col" { (row.name) } }
                    }
                }
                tbody {
                    @for measure in scene.measures() {
                        @let (sign, words) = arrow(measure.better);
                        tr {
                            th scope="row" title=(measure.definition) {
                                (measure.name) " " span.arrow title=(words) { (sign) } span.hidden { " (" (words) ")" }
                                " " small { (measure.unit) }
                            }
                            @for row in &rows { (cell(scene, row, measure)) }
                        }
                    }
                }
            }
        }
    }
}

fn cell(scene: &SceneRows, row: &Row, measure: &Measure) -> Markup {
    let best = scene.best(measure).is_some_and(|best| std::ptr::eq(best, row));
    let worst = row.series.iter().find(|series| series.measure == measure.name).and_then(|s| s.worst_frame());
    html! {
        td.number.best[best] {
            @match row.value(measure) {
                None => span.none { "n/a" },
                Some(value) => {
                    @if best { strong { (shown(value)) } } @else { (shown(value)) }
                    @if let Some(frame) = worst {
                        " " button.worst type="button" data-frame=(frame) aria-label=(format!("Show frame {frame}, the worst of {}", row.name)) { (frame) }
                    }
                }
            }
        }
    }
}

/// Three digits that count.
fn shown(value: f64) -> String {
    let decimals = if value == 0.0 { 0.0 } else { (2.0 - value.abs().log10().floor()).clamp(0.0, 6.0) };
    format!("{value:.*}", decimals as usize)
}

fn plots(scene: &SceneRows) -> Markup {
    let mut kinds: Vec<(&str, Along)> = Vec::new();
    for series in scene.rows.iter().flat_map(|row| &row.series) {
        if !kinds.contains(&(&series.measure, series.along)) {
            kinds.push((&series.measure, series.along));
        }
    }
    html! {
        div.plots {
            @for (measure, along) in kinds { (plot(scene, measure, along)) }
        }
    }
}

fn plot(scene: &SceneRows, measure: &str, along: Along) -> Markup {
    let mut lines: Vec<(&str, String, &[f64])> = Vec::new();
    let (mut start, mut step) = (0.0, 1.0f64);
    for (i, row) in scene.rows.iter().enumerate() {
        if let Some(series) = row.series.iter().find(|series| series.measure == measure) {
            lines.push((&row.name, format!("row{}", i % COLOURS), &series.values));
            start = series.places.first().copied().unwrap_or(start);
            step = series.places.windows(2).map(|pair| pair[1] - pair[0]).next().unwrap_or(step);
        }
    }
    let lines: Vec<(&str, &str, &[f64])> = lines.iter().map(|(name, class, v)| (*name, class.as_str(), *v)).collect();
    let (title, along) = match along {
        Along::Frames => (format!("{measure} over time"), "frame"),
        Along::Hertz => (format!("{measure}: deviation of the mean luma by frequency"), "Hz"),
    };
    html! {
        figure.plot {
            figcaption { (title) }
            (plot::lines(&plot::Lines { title: &title, along, start, step, lines: &lines }))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::measure::over_time::Series;

    #[test]
    fn the_page_names_what_failed_marks_the_best_and_fetches_only_videos() {
        let row = |name: &str, sharp: f64| Row {
            name: name.into(),
            video: Some(format!("falls/{name}.mp4")),
            values: [("sharpness retention".to_owned(), sharp)].into(),
            series: vec![Series {
                measure: "sharpness retention".into(),
                along: Along::Frames,
                places: vec![0.0, 2.0, 4.0],
                values: vec![sharp, 0.1, sharp],
            }],
            ..Row::default()
        };
        let failed = Row { name: "c".into(), failed: Some("no <library>".into()), ..Row::default() };
        let rows = vec![row("a", 0.9), row("b", 0.5), failed];
        let scene = SceneRows { name: "falls".into(), frames: 5, fps: 25.0, rows, ..SceneRows::default() };
        let page = page(&Comparison { scenes: vec![scene], ..Comparison::default() }).into_string();
        assert!(page.contains("Not made: no &lt;library&gt;"));
        assert!(page.contains("<strong>0.900</strong>") && !page.contains("<strong>0.500</strong>"));
        assert!(page.contains("data-frame=\"2\""));
        assert!(!page.contains("://") && !page.contains("@import") && page.contains("src=\"falls/a.mp4\""));
        assert_eq!(page.matches("<table").count(), 1);
    }

    #[test]
    fn three_digits_count() {
        assert_eq!([0.0, 0.001_234, 1.5, 123.4, -20.0].map(shown), ["0", "0.00123", "1.50", "123", "-20.0"]);
    }
}
