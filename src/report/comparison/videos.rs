//! The videos of a scene: references, methods, and sweeps as a matrix; and the wipe between two.

use maud::{Markup, html};

use super::colours::Palette;
use super::sweeps::{Sweep, sweeps};
use super::table::swatch;
use super::{Row, SceneRows, Sort};

/// All videos of a scene.
pub fn videos(scene: &SceneRows, palette: &Palette) -> Markup {
    let figure = |row: &Row| video(scene, row, palette);
    let (references, rest): (Vec<&Row>, Vec<&Row>) = scene.rows.iter().partition(|row| row.is_reference());
    html! {
        div.videos {
            @if !references.is_empty() {
                div.references { @for row in references { (figure(row)) } }
            }
            @let plain: Vec<&Row> = rest.into_iter().filter(|row| row.point.is_empty()).collect();
            @if !plain.is_empty() { div.side { @for row in plain { (figure(row)) } } }
            @for sweep in sweeps(scene) { (swept(&sweep, &figure)) }
        }
    }
}

/// The points of a sweep: those of two options in rows and columns.
fn swept(sweep: &Sweep, figure: &dyn Fn(&Row) -> Markup) -> Markup {
    html! {
        @match &sweep.options[..] {
            [down, across] if down.1.len() > 1 && across.1.len() > 1 => {
                div.scroll tabindex="0" role="region" aria-label=(format!("{} by {} and {}", sweep.method, down.0, across.0)) {
                    div.matrix style=(format!("--columns:{}", across.1.len())) {
                        span.corner { (sweep.method) }
                        @for value in &across.1 { span.across { (across.0) " = " (value) } }
                        @for a in &down.1 {
                            span.down { (down.0) " = " (a) }
                            @for b in &across.1 { @if let Some(row) = sweep.row(&[a, b]) { (figure(row)) } @else { span {} } }
                        }
                    }
                }
            },
            _ => div.side { @for row in &sweep.rows { (figure(row)) } },
        }
    }
}

fn video(scene: &SceneRows, row: &Row, palette: &Palette) -> Markup {
    html! {
        figure.row {
            @match (&row.video, &row.failed) {
                (Some(address), _) => div.view tabindex="0" role="group" aria-label=(format!("{}, arrow keys move all zoomed videos", row.name)) {
                    video src=(address) muted playsinline preload="auto" aria-label=(row.name) {}
                },
                (None, Some(failed)) => p.failed { "Not made: " (failed) },
                (None, None) => p.failed.waits { "Still to be made." },
            }
            figcaption {
                (swatch(scene, row, palette)) strong { (row.name) }
                @match row.sort {
                    Sort::Frozen => " the picture held still: what standing still is worth",
                    Sort::Real => " the real clip, its second half measured against its first: the ceiling",
                    Sort::Shuffled => " planted: a method's frames, shuffled",
                    Sort::Method => {
                        @if row.baseline { " the picture carried along the asked motion: what needs neither library nor exemplar" }
                        @else if let Some(seconds) = row.seconds { " " (format!("{seconds:.1} s")) }
                    },
                }
                @if let Some(page) = &row.page { " · " a href=(page) aria-label=(format!("The run of {}", row.name)) { "run" } }
                @if let Some(motion) = &row.motion { " · " a href=(motion) aria-label=(format!("The motion that {} aimed at", row.name)) { "motion" } }
            }
        }
    }
}

/// Two videos over each other, with a border between them that can be moved.
pub fn wipe(scene: &SceneRows) -> Markup {
    let made: Vec<&Row> = scene.rows.iter().filter(|row| row.is_made()).collect();
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
