//! All scenes together: means, ranks, and how often each row is best.

use std::collections::BTreeMap;

use serde::Serialize;

use super::{Comparison, Row, SceneRows, Sort};
use crate::measure::{ALL, Measure};

/// A row over all scenes that have it.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Overall {
    /// Its name.
    pub name: String,
    /// What it is.
    pub sort: Sort,
    /// Whether it gives meaning to the numbers of others.
    pub reference: bool,
    /// Scenes on which there is a video.
    pub made: usize,
    /// Scenes on which it failed.
    pub failed: usize,
    /// Scenes on which it still has to be made.
    pub to_make: usize,
    /// Mean of the seconds it took.
    pub seconds: Option<f64>,
    /// By the names of measures.
    pub measures: BTreeMap<&'static str, Mean>,
}

/// A measure of a row over the scenes where it has a value.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mean {
    /// How many they are.
    pub scenes: usize,
    /// Mean of the values.
    pub mean: f64,
    /// Mean of its places among the methods, 1 the best, equal ones sharing theirs; over scenes with two or more.
    pub rank: Option<f64>,
    /// On how many it is the best method.
    pub best: usize,
}

/// Every row that any scene has, by name, in the order of the scenes.
pub fn overall(comparison: &Comparison) -> Vec<Overall> {
    let mut names: Vec<&str> = Vec::new();
    for row in comparison.scenes.iter().flat_map(|scene| &scene.rows) {
        if !names.contains(&row.name.as_str()) {
            names.push(&row.name);
        }
    }
    // References first, wherever a scene brings them in.
    let is_reference = |name: &&str| rows(comparison, name).all(|(_, row)| row.is_reference());
    let (references, others): (Vec<&str>, Vec<&str>) = names.into_iter().partition(is_reference);
    references.into_iter().chain(others).map(|name| one(comparison, name)).collect()
}

fn rows<'a>(comparison: &'a Comparison, name: &str) -> impl Iterator<Item = (&'a SceneRows, &'a Row)> {
    let found = move |scene: &'a SceneRows| Some((scene, scene.rows.iter().find(|row| row.name == name)?));
    comparison.scenes.iter().filter_map(found).collect::<Vec<_>>().into_iter()
}

fn one(comparison: &Comparison, name: &str) -> Overall {
    let count = |is: fn(&Row) -> bool| rows(comparison, name).filter(|(_, row)| is(row)).count();
    let seconds: Vec<f64> = rows(comparison, name).filter_map(|(_, row)| row.seconds).collect();
    Overall {
        name: name.to_owned(),
        sort: rows(comparison, name).next().map(|(_, row)| row.sort).unwrap_or_default(),
        reference: rows(comparison, name).all(|(_, row)| row.is_reference()),
        made: count(Row::is_made),
        failed: count(|row| row.failed.is_some()),
        to_make: count(Row::is_to_make),
        seconds: mean(&seconds),
        measures: ALL.iter().filter_map(|m| Some((m.name, of_measure(comparison, name, m)?))).collect(),
    }
}

fn of_measure(comparison: &Comparison, name: &str, measure: &Measure) -> Option<Mean> {
    let with = || rows(comparison, name).filter_map(|(scene, row)| Some((scene, row, row.value(measure)?)));
    let values: Vec<f64> = with().map(|w| w.2).collect();
    let ranks: Vec<f64> = with().filter_map(|(scene, row, _)| rank(scene, row, measure)).collect();
    let best = with().filter(|(scene, row, _)| scene.is_best(row, measure)).count();
    Some(Mean { scenes: values.len(), mean: mean(&values)?, rank: mean(&ranks), best })
}

/// A method's place among those that have a value, 1 the best; equal ones share the mean of theirs.
fn rank(scene: &SceneRows, row: &Row, measure: &Measure) -> Option<f64> {
    let own = measure.better.badness(row.value(measure)?);
    let others: Vec<f64> = scene.methods().filter_map(|r| Some(measure.better.badness(r.value(measure)?))).collect();
    let (before, same) = (others.iter().filter(|v| **v < own).count(), others.iter().filter(|v| **v == own).count());
    let counts = !row.is_reference() && row.is_made() && others.len() > 1;
    counts.then(|| 1.0 + before as f64 + (same as f64 - 1.0) / 2.0)
}

fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn means_ranks_and_failures_are_of_the_scenes_that_have_them() {
        let row = |name: &str, value: Option<f64>| Row {
            name: name.into(),
            video: value.map(|_| String::new()),
            failed: value.is_none().then(|| "no library".to_owned()),
            values: value.map(|v| ("warp error".to_owned(), v)).into_iter().collect(),
            ..Row::default()
        };
        let scene = |rows| SceneRows { rows, ..SceneRows::default() };
        let first = scene(vec![row("a", Some(0.1)), row("b", Some(0.2)), row("c", Some(0.2))]);
        let second = scene(vec![row("a", Some(0.3)), row("b", Some(0.2)), row("c", None)]);
        let found = overall(&Comparison { scenes: vec![first, second], ..Comparison::default() });
        let of = |i: usize| found[i].measures["warp error"];
        assert!((of(0).mean - 0.2).abs() < 1e-12);
        assert_eq!((of(0).rank, of(1).rank, of(2).rank), (Some(1.5), Some(1.75), Some(2.5)));
        assert_eq!((of(0).best, of(1).best, of(2).best), (1, 1, 0));
        assert_eq!((of(2).scenes, found[2].made, found[2].failed, found[1].failed), (1, 1, 1, 0));
    }
}
