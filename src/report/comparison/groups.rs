//! The measures in groups, and what each is, for those who read the page.

use maud::{Markup, html};

use crate::measure::{ALL, Better, Measure};

/// Measures that tell of one thing.
pub struct Group {
    /// Its name.
    pub name: &'static str,
    /// What it tells.
    pub about: &'static str,
    /// Names of its measures in [`ALL`].
    measures: &'static [&'static str],
}

/// All groups.
pub const GROUPS: [Group; 5] = [
    Group {
        name: "Likeness",
        about: "all in all, how far is it like the real clip?",
        measures: &[
            "likeness",
            "likeness of dynamics",
            "likeness of spectrum",
            "likeness of deviation",
            "likeness of renewal",
            "likeness of detail",
        ],
    },
    Group {
        name: "Motion",
        about: "does it move like the real thing, and where it was asked to?",
        measures: &[
            "dynamics distance",
            "dynamics shape distance",
            "temporal spectrum distance",
            "deviation ratio",
            "direction error",
            "speed correlation",
            "motion share",
        ],
    },
    Group {
        name: "Looks",
        about: "does each frame look like the picture, and stay sharp?",
        measures: &[
            "patch distance",
            "colour distance",
            "detail lost",
            "detail added",
            "sharpness retention",
            "sharpness slope",
        ],
    },
    Group {
        name: "Continuity",
        about: "do frames follow each other without trembling, jumps or fades?",
        measures: &["warp error", "flicker", "loop ratio", "largest step ratio", "contrast dip"],
    },
    Group {
        name: "Pieces",
        about: "can one see what it was put together from?",
        measures: &["seam ratio", "midline variance ratio", "usage entropy"],
    },
];

impl Group {
    /// Its measures, in the order of reports.
    pub fn measures(&self) -> impl Iterator<Item = &'static Measure> {
        ALL.iter().filter(|measure| self.measures.contains(&measure.name))
    }
}

/// A measure's name as a part of addresses and names of files.
pub fn slug(measure: &str) -> String {
    measure.replace(' ', "-")
}

/// Which way a measure is better, as a sign and in words.
pub fn arrow(better: Better) -> (&'static str, &'static str) {
    match better {
        Better::Lower => ("↓", "lower is better"),
        Better::Higher => ("↑", "higher is better"),
        Better::Zero => ("→ 0", "near 0 is better"),
        Better::One => ("→ 1", "near 1 is better"),
    }
}

/// A measure's name, which explains itself to who points at it or comes to it by keyboard.
pub fn term(measure: &Measure) -> Markup {
    let (sign, words) = arrow(measure.better);
    html! {
        button.term type="button" aria-describedby=(format!("what-{}", slug(measure.name))) { (measure.name) }
        " " span.arrow aria-hidden="true" { (sign) } span.hidden { " (" (words) ")" }
    }
}

/// What all measures are.
pub fn glossary() -> Markup {
    html! {
        section.glossary id="measures" aria-label="Measures" {
            h2 { "What the measures are" }
            p.small {
                "All look only at what lies inside the matte, and each can be fooled: never take one alone. Those that are "
                "of frames, or of steps between them, have a worst frame to go to; distances between whole videos, mean "
                "motion and the use of pieces have none."
            }
            @for group in &GROUPS {
                h3 { (group.name) }
                dl {
                    @for measure in group.measures() {
                        dt { (measure.name) }
                        dd id=(format!("what-{}", slug(measure.name))) {
                            (sentence(measure.definition)) ". In " (measure.unit) "; " (arrow(measure.better).1) "."
                            @if !measure.needs.is_empty() { " Needs: " (measure.needs) "." }
                        }
                    }
                }
            }
        }
    }
}

fn sentence(text: &str) -> String {
    let mut letters = text.chars();
    letters.next().map_or(String::new(), |first| first.to_uppercase().chain(letters).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_measure_is_in_one_group() {
        let grouped: Vec<&str> = GROUPS.iter().flat_map(|group| group.measures).copied().collect();
        for measure in ALL {
            assert_eq!(grouped.iter().filter(|name| **name == measure.name).count(), 1, "{}", measure.name);
        }
        assert_eq!(grouped.len(), ALL.len());
        let text = glossary().into_string();
        assert!(ALL.iter().all(|measure| text.contains(&format!("id=\"what-{}\"", slug(measure.name)))));
    }
}
