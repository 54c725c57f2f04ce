//! Slices through time beside each other: the motion of all rows in one picture each.

use maud::{Markup, html};

use super::{Row, SceneRows};

/// The slices of the rows that have one.
pub fn slices(scene: &SceneRows) -> Markup {
    let all: Vec<(&Row, String, &str)> =
        scene.rows.iter().filter_map(|row| row.slice().map(|(address, line)| (row, address, line))).collect();
    let Some((_, _, line)) = all.first() else { return html! {} };
    html! {
        h3 { "Slices through time" }
        p {
            "One line of every frame, from left to right (" (line) "). Motion along it is slanted, what stands still is level; "
            "a loop is shown twice, its end in the middle."
        }
        div.slices {
            @for (row, address, _) in &all {
                figure {
                    img src=(address) alt=(format!("Slice through time of {}", row.name)) loading="lazy";
                    figcaption { (row.name) }
                }
            }
        }
    }
}
