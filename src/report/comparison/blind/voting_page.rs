//! The page that people vote on: pairs of videos without names, in random order; one file that fetches nothing but the
//! videos beside it.

use std::collections::BTreeSet;
use std::path::Path;

use maud::{Markup, PreEscaped, html};
use serde::Serialize;

use super::key::{FOLDER, Key, PAGE, file};
use super::votes;
use crate::base::atomic_file;
use crate::base::error::{Error, Kind, Result};
use crate::report::comparison::{Comparison, SceneRows};
use crate::report::page;
use crate::video::read::source;

const STYLE: &str = include_str!("blind.css");
const SCRIPT: &str = include_str!("blind.js");
/// What voters are asked. It asks for looks and motion at once, as a still picture of fine looks is not what is wanted; the
/// picture is not shown beside, since then likeness to it would be judged.
const QUESTION: &str = "Which looks more like a film of real water, fire or smoke?";

/// What the page knows: no names.
#[derive(Serialize)]
struct Test<'a> {
    format: &'static str,
    comparison: &'a str,
    scenes: Vec<Pairs>,
}

/// The videos of a scene.
#[derive(Serialize)]
struct Pairs {
    /// Width over height that all are shown at.
    ratio: f64,
    /// Frames per second.
    fps: f32,
    /// How long each is played: as long as the shortest, so that none is known by its length.
    seconds: f64,
    /// The files, in the order of their names.
    videos: BTreeSet<String>,
}

/// Writes the page for the videos of `key` into `folder`.
///
/// # Errors
/// A video that cannot be opened; a folder that cannot be written to.
pub fn write(comparison: &Comparison, key: &Key, folder: &Path) -> Result<()> {
    let scenes = comparison.scenes.iter().map(|scene| pairs(scene, key, folder)).collect::<Result<Vec<_>>>()?;
    let scenes = scenes.into_iter().filter(|scene| scene.videos.len() > 1).collect();
    let test = Test { format: votes::FORMAT, comparison: &key.comparison, scenes };
    let json = serde_json::to_string(&test).map_err(|e| Error::new(Kind::Data, PAGE, e.to_string()))?;
    atomic_file::write(&folder.join(PAGE), self::page(&json).into_string().as_bytes())
}

fn pairs(scene: &SceneRows, key: &Key, folder: &Path) -> Result<Pairs> {
    let ids: Vec<&String> =
        key.videos.iter().filter(|(_, named)| named.scene == scene.name).map(|(id, _)| id).collect();
    let length =
        |id: &&String| Ok(source::open(&folder.join(FOLDER).join(file(id)))?.info().frames.unwrap_or(scene.frames));
    let lengths = ids.iter().map(length).collect::<Result<Vec<usize>>>()?;
    let frames = lengths.into_iter().min().unwrap_or(scene.frames);
    let (width, height) = scene.size;
    Ok(Pairs {
        ratio: width as f64 / height.max(1) as f64,
        fps: scene.fps,
        seconds: frames as f64 / f64::from(scene.fps),
        videos: ids.into_iter().map(|id| format!("{FOLDER}/{}", file(id))).collect(),
    })
}

fn page(test: &str) -> Markup {
    let body = html! {
        main {
            h1 id="question" { (QUESTION) }
            (start())
            (vote())
            section.screen id="end" hidden aria-labelledby="thanks" {
                h2 id="thanks" tabindex="-1" { "That was all. Thank you!" }
                p { "Now save your votes and send the file to whoever gave you this page." }
            }
            footer.tools id="tools" hidden {
                button id="undo" type="button" { "Undo" }
                div.progress { span id="count" {} progress id="progress" max="1" value="0" aria-labelledby="count" {} }
                button id="save" type="button" { "Save votes" }
            }
            p id="message" role="status" {}
        }
        script id="test" type="application/json" { (PreEscaped(test)) }
        script { (PreEscaped(SCRIPT)) }
    };
    page::page("Blind test", STYLE, &body)
}

fn start() -> Markup {
    html! {
        section.screen id="start" aria-label="Before you begin" {
            p {
                "You will see two videos beside each other, again and again; on a narrow screen one above the other. Watch both once to their "
                "end, then choose. Trust your first impression; some pairs come twice."
            }
            p.keys {
                "Keys: " kbd { "←" } " and " kbd { "→" } " choose, " kbd { "space" } " is “can’t tell”, " kbd { "backspace" } " takes the last choice back."
            }
            p { "You may stop at any time and go on later in the same browser. Your votes stay on this machine until you save them to a file." }
            p { label { "Your name, if you like: " input id="voter" type="text" maxlength="200" autocomplete="off"; } }
            p.row { button.main id="begin" type="button" { "Begin" } button id="anew" type="button" hidden { "Forget them and begin anew" } }
        }
    }
}

fn vote() -> Markup {
    let side = |id: &str, wide: &str, narrow: &str| {
        html! {
            figure {
                div.box { video id=(id) muted playsinline preload="auto" aria-labelledby=(format!("{id}-name")) {} }
                figcaption id=(format!("{id}-name")) { span.wide { (wide) } span.narrow { (narrow) } }
            }
        }
    };
    html! {
        section.screen id="vote" tabindex="-1" hidden aria-labelledby="question" {
            div.pair id="pair" { (side("left", "Left", "Upper")) (side("right", "Right", "Lower")) }
            p.status id="status" aria-live="polite" {}
            div.choices role="group" aria-labelledby="question" {
                button type="button" data-choice="left" { span.wide { "← Left" } span.narrow { "↑ Upper" } }
                button type="button" data-choice="tie" { "Can’t tell" }
                button type="button" data-choice="right" { span.wide { "Right →" } span.narrow { "↓ Lower" } }
            }
            button id="skip" type="button" hidden { "Skip this pair" }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_page_fetches_nothing_and_labels_everything() {
        let page = page("{\"scenes\":[]}").into_string();
        assert!(!page.contains("://") && !page.contains("@import") && !page.contains("fetch("), "{page}");
        assert!(page.contains(QUESTION) && page.contains("{\"scenes\":[]}"));
    }
}
