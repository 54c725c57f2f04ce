//! The tables of measures: of a scene, and of all scenes together.

use maud::{Markup, html};

use super::colours::{Medium, Palette};
use super::groups::{GROUPS, term};
use super::overall::{Mean, Overall};
use super::{Comparison, Row, SceneRows, Sort};
use crate::base::text::counted;
use crate::measure::Measure;
use crate::report::plot::three_digits;

/// A column: a row of the comparison.
struct Column {
    head: Markup,
    reference: bool,
}

/// The measures of a scene's rows that were made.
pub fn of_scene(scene: &SceneRows, palette: &Palette) -> Markup {
    let mut rows: Vec<&Row> = scene.rows.iter().filter(|row| row.is_made()).collect();
    rows.sort_by_key(|row| !row.is_reference());
    let columns: Vec<Column> =
        rows.iter().map(|row| Column { head: head(scene, row, palette), reference: row.is_reference() }).collect();
    let has = |measure: &Measure| rows.iter().any(|row| row.value(measure).is_some());
    let last = rows.iter().any(|row| row.seconds.is_some()).then(|| {
        let cells = rows
            .iter()
            .map(|row| html! { @match row.seconds { Some(s) => (three_digits(s)), None => span.none { "–" } } });
        ("time to make, s", cells.collect())
    });
    let cells = |measure: &Measure| rows.iter().map(|row| cell(scene, row, measure)).collect();
    html! {
        (table(&format!("Measures of {}", scene.name), &columns, &has, &cells, last))
        p.small {
            "Best method in bold, columns on grey only give meaning to the numbers. A small number goes to the frame in which a measure is worst."
        }
    }
}

/// A table with a row for every measure that `has` values, group by group.
fn table(
    label: &str,
    columns: &[Column],
    has: &dyn Fn(&Measure) -> bool,
    cells: &dyn Fn(&Measure) -> Vec<(bool, Markup)>,
    last: Option<(&str, Vec<Markup>)>,
) -> Markup {
    let class = |i: usize, best: bool| match (columns[i].reference, best) {
        (true, _) => "number reference",
        (_, true) => "number best",
        _ => "number",
    };
    html! {
        div.scroll tabindex="0" role="region" aria-label=(label) {
            table {
                thead {
                    tr {
                        td {}
                        @for (i, column) in columns.iter().enumerate() { th class=(class(i, false)) scope="col" { (column.head) } }
                    }
                }
                @for group in GROUPS.iter().filter(|group| group.measures().any(has)) {
                    tbody {
                        tr.group { th colspan=(columns.len() + 1) scope="rowgroup" { span.pinned { (group.name) " " small { (group.about) } } } }
                        @for measure in group.measures().filter(|m| has(m)) {
                            tr {
                                th scope="row" { (term(measure)) " " small { (measure.unit) } }
                                @for (i, (best, cell)) in cells(measure).into_iter().enumerate() { td class=(class(i, best)) { (cell) } }
                            }
                        }
                    }
                }
                @if let Some((name, cells)) = last {
                    tbody {
                        tr.last {
                            th scope="row" { (name) }
                            @for (i, cell) in cells.into_iter().enumerate() { td class=(class(i, false)) { (cell) } }
                        }
                    }
                }
            }
        }
    }
}

/// A row's name with its colour, the swept values below.
fn head(scene: &SceneRows, row: &Row, palette: &Palette) -> Markup {
    html! {
        (swatch(scene, row, palette))
        @if row.point.is_empty() { (row.name) } @else {
            (row.method)
            @for (key, value) in &row.point { br; small { (key) " = " (value) } }
        }
    }
}

/// A row's line, as plots draw it.
pub fn swatch(scene: &SceneRows, row: &Row, palette: &Palette) -> Markup {
    let style = palette.key(scene, row, Medium::Page).style;
    html! { svg.swatch viewBox="0 0 24 8" aria-hidden="true" { line.line style=(style) x1="0" x2="24" y1="4" y2="4" {} } }
}

fn cell(scene: &SceneRows, row: &Row, measure: &Measure) -> (bool, Markup) {
    let best = scene.is_best(row, measure);
    // Nothing is to be seen in any frame of what stands still.
    let worst = row.worst.get(measure.name).filter(|_| row.sort != Sort::Frozen);
    let shown = html! {
        @match row.value(measure) {
            None => span.none title="no value: its inputs are missing" { "n/a" },
            Some(value) => {
                (emphasised(best, &three_digits(value)))
                @if let Some(frame) = worst {
                    " " button.worst type="button" data-frame=(frame) aria-label=(format!("Show frame {frame}, where {} of {} is worst", measure.name, row.name)) { (frame) }
                }
            }
        }
    };
    (best, shown)
}

fn emphasised(best: bool, text: &str) -> Markup {
    html! { @if best { strong { (text) } } @else { (text) } }
}

/// All scenes together; nothing where there is only one.
pub fn of_all(comparison: &Comparison, all: &[Overall], palette: &Palette) -> Markup {
    let scenes = comparison.scenes.len();
    let columns: Vec<Column> = all
        .iter()
        .map(|row| Column { head: overall_head(comparison, row, palette), reference: row.reference })
        .collect();
    let has = |measure: &Measure| all.iter().any(|row| row.measures.contains_key(measure.name));
    let cells = |measure: &Measure| all.iter().map(|row| overall_cell(all, row, measure)).collect();
    let seconds =
        all.iter().map(|row| html! { @match row.seconds { Some(s) => (three_digits(s)), None => span.none { "–" } } });
    html! {
        @if scenes > 1 {
            section.overall id="overall" aria-label="All scenes together" {
                h2 { "All scenes together" }
                p.small {
                    "Means over the scenes that have a value; below, the mean place among the methods, and in how many scenes it is the best of them. "
                    "Scenes differ more than methods do: read the places first. Who failed where it is hard has an easier mean, so only means over the most scenes are bold. "
                    "The same as " a href="summary.csv" { "CSV" } "."
                }
                (table("Means over all scenes", &columns, &has, &cells, Some(("mean time to make, s", seconds.collect()))))
            }
        }
    }
}

fn overall_head(comparison: &Comparison, row: &Overall, palette: &Palette) -> Markup {
    let found = comparison.scenes.iter().find_map(|s| Some((s, s.rows.iter().find(|r| r.name == row.name)?)));
    let all = row.made + row.failed + row.to_make;
    html! {
        @if let Some((scene, first)) = found { (head(scene, first, palette)) }
        br; small { (row.made) " of " (counted(all as u64, "scene")) }
        @if row.failed > 0 { br; small.bad { (row.failed) " failed" } }
    }
}

fn overall_cell(all: &[Overall], row: &Overall, measure: &Measure) -> (bool, Markup) {
    let of = |row: &Overall| row.measures.get(measure.name).copied();
    let Some(mean) = of(row) else { return (false, html! { span.none { "n/a" } }) };
    let methods: Vec<Mean> = all.iter().filter(|row| !row.reference).filter_map(of).collect();
    let most = methods.iter().map(|m| m.scenes).max().unwrap_or(0);
    let rivals = methods.iter().filter(|m| m.scenes == most).map(|m| measure.better.badness(m.mean));
    let best = !row.reference
        && methods.len() > 1
        && mean.scenes == most
        && rivals.fold(f64::INFINITY, f64::min) == measure.better.badness(mean.mean);
    let shown = html! {
        (emphasised(best, &three_digits(mean.mean)))
        @if let Some(rank) = mean.rank {
            br; small { "place " (format!("{rank:.1}")) ", best in " (mean.best) }
        }
    };
    (best, shown)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::comparison::overall::overall;

    #[test]
    fn the_best_mean_is_of_those_with_most_scenes() {
        let row = |name: &str, value: Option<f64>| Row {
            name: name.into(),
            method: name.into(),
            video: value.map(|_| String::new()),
            failed: value.is_none().then(|| "no".to_owned()),
            values: value.map(|v| ("flicker".to_owned(), v)).into_iter().collect(),
            ..Row::default()
        };
        let scene = |rows| SceneRows { rows, ..SceneRows::default() };
        let scenes = vec![
            scene(vec![row("a", Some(0.4)), row("b", Some(0.2)), row("c", Some(0.1))]),
            scene(vec![row("a", Some(0.4)), row("b", Some(0.6)), row("c", None)]),
        ];
        let comparison = Comparison { scenes, ..Comparison::default() };
        let text = of_all(&comparison, &overall(&comparison), &Palette::new(&comparison)).into_string();
        assert!(text.contains("1 failed") && text.contains("place 2.0, best in 1"), "{text}");
        assert_eq!(text.matches("<strong>0.400</strong>").count(), 2, "{text}");
        assert!(!text.contains("<strong>0.100"), "{text}");
    }
}
