//! The blind test's part of the comparison's page.

use maud::{Markup, html};

use super::findings::{BlindTest, Judged, Standing};
use super::key::PAGE;
use super::words::{percent, strength};
use crate::report::comparison::Sort;
use crate::report::plot;

/// The section.
pub fn section(test: &BlindTest) -> Markup {
    html! {
        section.blind id="blind" aria-label="Blind test" {
            h2 { "Blind test" }
            p {
                "On " a href=(PAGE) { "this page" } " people choose between two videos without knowing which is which: "
                (test.summary()) "."
                @if test.voters == 0 {
                    " Give away " code { "blind.html" } " with the folder " code { "blind" } "; read the files of votes that come back with "
                    code { "enliven compare --votes FILE… -o ." }
                }
            }
            @if !test.pooled.rows.is_empty() {
                p { strong { (test.verdict()) } }
                (standing(&test.pooled, "all scenes"))
                ul { @for remark in test.remarks() { li { (remark) } } }
                @if test.scenes.len() > 1 {
                    @for (scene, found) in &test.scenes { details { summary { "Only " (scene) } (standing(found, scene)) } }
                }
                p.small {
                    "Won: a tie is half a win for each; 95 % interval by Wilson. Strength: Bradley–Terry, the natural log of the odds against an "
                    "average row, 95 % interval; a row stronger by 1 is preferred in 73 % of votes, by 2 in 88 %. Every vote as "
                    a href="votes.csv" { "CSV" } "."
                }
            } @else {
                @for remark in test.remarks() { p { (remark) } }
            }
        }
    }
}

fn standing(standing: &Standing, of: &str) -> Markup {
    let bars: Vec<plot::Interval> = standing
        .rows
        .iter()
        .map(|row| plot::Interval {
            name: &row.name,
            value: row.strength.value,
            ends: (row.strength.low, row.strength.high),
        })
        .collect();
    let title = format!("Strength in the blind test, {of}");
    html! {
        div.standing {
            figure.plot { figcaption { (title) } (plot::intervals(&title, "strength", &bars)) }
            div.scroll tabindex="0" role="region" aria-label=(format!("Blind test of {of}")) {
                table {
                    thead {
                        tr {
                            th scope="col" { "Row" } th.number scope="col" { "Votes" } th.number scope="col" { "Won" }
                            th.number scope="col" { "Strength" }
                        }
                    }
                    tbody {
                        @for row in &standing.rows {
                            tr {
                                (name(row))
                                td.number { (row.votes) }
                                td.number { (percent(row.won)) }
                                td.number { (strength(row.strength)) }
                            }
                        }
                    }
                }
            }
        }
        (pairs(standing, of))
    }
}

fn name(row: &Judged) -> Markup {
    let what = match row.sort {
        Sort::Frozen | Sort::Shuffled => Some("planted"),
        Sort::Real => Some("real clip"),
        Sort::Method => None,
    };
    html! { th scope="row" { (row.name) @if let Some(what) = what { " " small { (what) } } } }
}

/// How often every row was preferred to every other.
fn pairs(standing: &Standing, of: &str) -> Markup {
    let rows = &standing.rows;
    html! {
        details.pairs {
            summary { "Who was preferred to whom, " (of) }
            div.scroll tabindex="0" role="region" aria-label=(format!("Votes pair by pair, {of}")) {
                table {
                    thead {
                        tr { th scope="col" { "Preferred" } @for row in rows { th.number scope="col" { "to " (row.name) } } }
                    }
                    tbody {
                        @for (i, row) in rows.iter().enumerate() {
                            tr {
                                (name(row))
                                @for (j, won) in row.over.iter().enumerate() {
                                    @let met = won + rows[j].over[i];
                                    td.number { @if met > 0.0 { (won) " of " (met) } @else { span.none { "–" } } }
                                }
                            }
                        }
                    }
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn without_votes_it_says_how_to_get_some() {
        let section = section(&BlindTest::default()).into_string();
        assert!(section.contains("nobody has voted yet") && section.contains("--votes FILE"), "{section}");
        assert!(!section.contains("<table") && !section.contains("mean"), "{section}");
    }
}
