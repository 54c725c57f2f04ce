//! The tables as comma-separated values.

use super::blind::findings::{BlindTest, Cast, Use};
use super::overall::Overall;
use super::{Comparison, Row, Sort};
use crate::measure::ALL;

/// A line for every row of every scene; empty where there is no value.
pub fn csv(comparison: &Comparison) -> String {
    let names = ALL.iter().map(|measure| measure.name);
    let head: Vec<&str> = ["scene", "row", "sort", "failed", "seconds"].into_iter().chain(names).collect();
    let rows = comparison.scenes.iter().flat_map(|scene| scene.rows.iter().map(|row| line(&scene.name, row)));
    let lines = [line_of(head.into_iter().map(str::to_owned))].into_iter().chain(rows);
    lines.collect()
}

/// A line for every row and every measure that it has values of, over all scenes.
pub fn summary(all: &[Overall]) -> String {
    let head = ["row", "sort", "made", "failed", "measure", "scenes", "mean", "mean place", "best in"];
    let lines = all.iter().flat_map(|row| {
        let measures = ALL.iter().filter_map(|measure| Some((measure.name, row.measures.get(measure.name)?)));
        measures.map(|(name, mean)| {
            let first = [row.name.clone(), sort(row.sort).to_owned(), row.made.to_string(), row.failed.to_string()];
            let rest = [mean.mean.to_string(), number(mean.rank), mean.best.to_string()];
            line_of(first.into_iter().chain([name.to_owned(), mean.scenes.to_string()]).chain(rest))
        })
    });
    [line_of(head.into_iter().map(str::to_owned))].into_iter().chain(lines).collect()
}

fn sort(sort: Sort) -> &'static str {
    match sort {
        Sort::Frozen => "frozen",
        Sort::Real => "real",
        Sort::Shuffled => "shuffled",
        Sort::Method => "method",
    }
}

fn number(value: Option<f64>) -> String {
    value.map_or(String::new(), |v| v.to_string())
}

fn line(scene: &str, row: &Row) -> String {
    let failed = row.failed.clone().unwrap_or_default();
    let first = [scene.to_owned(), row.name.clone(), sort(row.sort).to_owned(), failed];
    let values = ALL.iter().map(|measure| number(row.value(measure)));
    line_of(first.into_iter().chain([number(row.seconds)]).chain(values))
}

/// A line for every vote of a blind test, in the order they count in.
pub fn votes(test: &BlindTest) -> String {
    let head = ["voter", "session", "order", "scene", "left", "right", "choice", "seconds", "used"];
    let line = |cast: &Cast| {
        let used = match cast.used {
            Use::Counted => "counted",
            Use::Repeat => "repeat",
            Use::Outdated => "outdated",
        };
        let fields = [&cast.voter, &cast.session, &cast.order.to_string(), &cast.scene, &cast.left, &cast.right];
        let rest = [cast.choice.word().to_owned(), cast.seconds.to_string(), used.to_owned()];
        line_of(fields.into_iter().cloned().chain(rest))
    };
    [line_of(head.into_iter().map(str::to_owned))].into_iter().chain(test.cast.iter().map(line)).collect()
}

/// Fields with a comma, a quote or a line's end are quoted (RFC 4180).
fn line_of(fields: impl Iterator<Item = String>) -> String {
    let quoted = |field: String| match field.contains([',', '"', '\n', '\r']) {
        true => format!("\"{}\"", field.replace('"', "\"\"")),
        false => field,
    };
    fields.map(quoted).collect::<Vec<_>>().join(",") + "\r\n"
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::comparison::SceneRows;

    #[test]
    fn names_with_commas_and_quotes_stay_one_field() {
        let row = Row { name: "a, \"b\"".into(), failed: Some("no\nlibrary".into()), ..Row::default() };
        let scenes = vec![SceneRows { name: "falls".into(), rows: vec![row], ..SceneRows::default() }];
        let text = csv(&Comparison { scenes, ..Comparison::default() });
        assert!(text.contains("\r\nfalls,\"a, \"\"b\"\"\",method,\"no\nlibrary\",,"), "{text}");
        let columns = |line: &str| line.split(',').count();
        assert_eq!(columns(text.lines().next().unwrap()), 5 + ALL.len());
    }
}
