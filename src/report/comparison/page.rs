//! The page of a comparison: videos in step, tables, plots; one file that fetches nothing but what lies beside it.

use maud::{Markup, PreEscaped, html};

use super::colours::Palette;
use super::overall::Overall;
use super::reading::cautions;
use super::{Comparison, SceneRows, blind, groups, plots, slices, table, videos};
use crate::base::text::counted;
use crate::report::page;

const STYLE: &str = include_str!("page.css");
const SCRIPT: &str = include_str!("page.js");

/// The page.
pub fn page(comparison: &Comparison, all: &[Overall]) -> Markup {
    let palette = Palette::new(comparison);
    let body = html! {
        (header(comparison))
        main {
            @if let Some(test) = &comparison.blind { (blind::section(test)) }
            (table::of_all(comparison, all, &palette))
            @for scene in &comparison.scenes { (section(scene, &palette)) }
            (groups::glossary())
        }
        script { (PreEscaped(SCRIPT)) }
    };
    page::page("Comparison", &(Palette::css() + STYLE), &body)
}

fn header(comparison: &Comparison) -> Markup {
    let scenes = &comparison.scenes;
    let mut methods: Vec<&str> = Vec::new();
    for row in scenes.iter().flat_map(|scene| &scene.rows).filter(|row| !row.is_reference()) {
        if !methods.contains(&row.method.as_str()) {
            methods.push(&row.method);
        }
    }
    let (methods, missing) = (counted(methods.len() as u64, "method"), comparison.to_make());
    html! {
        header {
            h1 { (methods) " on " (counted(scenes.len() as u64, "scene")) }
            p.lead {
                "Each scene shows what it is made from, the videos of all methods in step, and what was measured. What stands on grey is no "
                "competitor: it gives meaning to the numbers. Look first, then read: every measure can be fooled, and the page says where one was."
            }
            @if missing > 0 {
                p.unfinished role="status" {
                    (counted(missing as u64, "video")) " still to be made: this page was written while the work was going on, or it was stopped. The same command goes on with it."
                }
            }
            p {
                "Tables: " a href="results.csv" { "CSV" } ", " a href="results.json" { "JSON" }
                @if scenes.len() > 1 { ", " a href="summary.csv" { "summary" } }
                ". " a href="#measures" { "What the measures are" } ". " (comparison.program) "."
            }
            p.keys {
                kbd { "Space" } " plays and pauses the scene in view, " kbd { "," } " and " kbd { "." } " step a frame; drag a zoomed video to move all of them."
            }
            details.repeat { summary { "The command that repeats it, in this folder" } pre { (comparison.command) } }
            @if scenes.len() > 1 {
                nav aria-label="scenes" {
                    @if comparison.blind.is_some() { a href="#blind" { "Blind test" } }
                    a href="#overall" { "All together" }
                    @for scene in scenes { a href=(format!("#{}", anchor(scene))) { (scene.name) } }
                }
            }
        }
    }
}

fn anchor(scene: &SceneRows) -> String {
    format!("scene-{}", scene.name)
}

fn section(scene: &SceneRows, palette: &Palette) -> Markup {
    let (width, height) = scene.size;
    html! {
        section.scene id=(anchor(scene)) data-frames=(scene.frames) data-fps=(scene.fps) aria-label=(scene.name) {
            h2 { (scene.name) }
            p.small { (counted(scene.frames as u64, "frame")) " of " (width) " × " (height) " at " (scene.fps) " per second" }
            @if !scene.pictures.is_empty() {
                div.pictures {
                    @for (file, caption) in &scene.pictures {
                        figure { a href=(file) { img src=(file) alt=(caption) loading="lazy"; } figcaption { (caption) } }
                    }
                }
            }
            (controls(scene))
            (videos::videos(scene, palette))
            (videos::wipe(scene))
            (slices::slices(scene))
            h3 { "Measured" }
            (table::of_scene(scene, palette))
            @let told = cautions(scene);
            @if !told.is_empty() {
                ul.cautions aria-label="What to be careful with" { @for line in &told { li { (line) } } }
            }
            (plots::swept(scene, palette))
            (plots::section(scene, palette))
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

#[cfg(test)]
mod tests {
    use super::super::Row;
    use super::super::overall::overall;
    use super::*;
    use crate::measure::over_time::{Along, Series};

    #[test]
    fn the_page_names_what_failed_marks_the_best_and_fetches_only_videos() {
        let row = |name: &str, sharp: f64| Row {
            name: name.into(),
            method: name.into(),
            video: Some(format!("falls/{name}.mp4")),
            values: [("sharpness retention".to_owned(), sharp)].into(),
            worst: [("sharpness retention".to_owned(), 2)].into(),
            series: vec![Series {
                measure: "sharpness retention".into(),
                along: Along::Frames,
                places: vec![0.0, 2.0, 4.0],
                values: vec![sharp, 0.1, sharp],
            }],
            ..Row::default()
        };
        let failed = Row { name: "c".into(), failed: Some("no <library>".into()), ..Row::default() };
        let waits = Row { name: "d".into(), ..Row::default() };
        let rows = vec![row("a", 0.9), row("b", 0.5), failed, waits];
        let scene = SceneRows { name: "falls".into(), frames: 5, fps: 25.0, rows, ..SceneRows::default() };
        let mut comparison = Comparison { scenes: vec![scene], ..Comparison::default() };
        let written = |comparison: &Comparison| page(comparison, &overall(comparison)).into_string();
        let text = written(&comparison);
        assert!(text.contains("Not made: no &lt;library&gt;"));
        assert!(text.contains("<strong>0.900</strong>") && !text.contains("<strong>0.500</strong>"));
        assert!(text.contains("data-frame=\"2\""));
        assert!(!text.contains("://") && !text.contains("@import") && text.contains("src=\"falls/a.mp4\""));
        assert_eq!(text.matches("<table").count(), 1);
        assert!(text.contains("1 video still to be made") && text.contains("Still to be made."));
        // Files of plots are there only once a scene is finished.
        assert!(!text.contains(".svg"));
        comparison.scenes[0].rows.pop();
        let text = written(&comparison);
        assert!(text.contains("falls/plots/over-time-sharpness-retention.svg") && !text.contains("to be made"));
        comparison.scenes.push(comparison.scenes[0].clone());
        assert_eq!(written(&comparison).matches("<table").count(), 3);
    }
}
