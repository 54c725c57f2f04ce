//! What swept options do to each measure, as small plots: points along one option, a map of two, lines for more.

use super::colours::{Medium, Palette};
use super::groups::slug;
use super::scene_plot::Plot;
use super::{Row, SceneRows, Sort};
use crate::measure::{ALL, Measure};
use crate::report::plot::{Key, three_digits};
use crate::report::small_plot::{self, Dots, Field, Map, Point};

/// Largest of an axis' values over its least from which the axis counts factors, where no values lie between.
const DECADE: f64 = 10.0;

/// A method's rows that differ in swept options.
pub struct Sweep<'a> {
    /// The method.
    pub method: &'a str,
    /// The options, each with its values in the order they were given in.
    pub options: Vec<(&'a str, Vec<&'a str>)>,
    /// The rows.
    pub rows: Vec<&'a Row>,
}

/// The sweeps of a scene.
pub fn sweeps(scene: &SceneRows) -> Vec<Sweep<'_>> {
    let mut sweeps: Vec<Sweep> = Vec::new();
    for row in scene.rows.iter().filter(|row| row.sort == Sort::Method && !row.point.is_empty()) {
        let at = sweeps.iter().position(|sweep| sweep.method == row.method).unwrap_or_else(|| {
            let options = row.point.iter().map(|(key, _)| (key.as_str(), Vec::new())).collect();
            sweeps.push(Sweep { method: &row.method, options, rows: Vec::new() });
            sweeps.len() - 1
        });
        let sweep = &mut sweeps[at];
        sweep.rows.push(row);
        for (option, (_, value)) in sweep.options.iter_mut().zip(&row.point) {
            if !option.1.contains(&value.as_str()) {
                option.1.push(value);
            }
        }
    }
    sweeps
}

impl<'a> Sweep<'a> {
    /// The row at values of the options, in their order.
    pub fn row(&self, values: &[&str]) -> Option<&'a Row> {
        self.rows.iter().find(|row| row.point.iter().map(|p| p.1.as_str()).eq(values.iter().copied())).copied()
    }

    /// Its rows' best by a measure, where they differ.
    fn best(&self, measure: &Measure) -> Option<f64> {
        let values = || self.rows.iter().filter_map(|row| row.value(measure)).filter(|v| v.is_finite());
        let first = values().next()?;
        let differ = values().any(|v| (v - first).abs() > 1e-12);
        let badness = |v: &f64| measure.better.badness(*v);
        values().min_by(|a, b| badness(a).total_cmp(&badness(b))).filter(|_| differ)
    }

    /// A small plot of every measure in which its rows differ.
    pub fn plots(&self, scene: &SceneRows, palette: &Palette, medium: Medium) -> Vec<Plot> {
        let plot = |measure: &'static Measure| {
            let best = self.best(measure)?;
            let title = format!("{}: {} of {}", self.method, measure.name, scene.name);
            let drawing = match &self.options[..] {
                [down, across] if down.1.len() > 1 && across.1.len() > 1 => {
                    small_plot::map(&self.map(measure, best, &title, palette, (scene, medium)).as_plot())
                }
                _ => self.dots(measure, best, &title, palette, (scene, medium)),
            };
            let file = format!("sweep-{}-{}.svg", self.method, slug(measure.name));
            Some(Plot { file, measure: Some(measure), caption: measure.name.to_owned(), drawing })
        };
        ALL.iter().filter_map(plot).collect()
    }

    /// The option that plots go along: of those with most values the first whose values are numbers, or the first.
    fn along(&self) -> usize {
        let most = |i: &usize| (self.options[*i].1.len(), numbers(&self.options[*i].1).is_some());
        (0..self.options.len()).rev().max_by_key(most).unwrap_or(0)
    }

    fn dots(
        &self,
        measure: &Measure,
        best: f64,
        title: &str,
        palette: &Palette,
        (scene, medium): (&SceneRows, Medium),
    ) -> crate::report::plot::Drawing {
        let along = self.along();
        let (option, values) = &self.options[along];
        let (places, scale) = places(values);
        let mut lines: Vec<(Key, Vec<Point>)> = Vec::new();
        for row in &self.rows {
            let others = row.point.iter().enumerate().filter(|(i, _)| *i != along);
            let name = others.map(|(_, (key, value))| format!("{key}={value}")).collect::<Vec<_>>().join(" ");
            let place = values.iter().position(|value| *value == row.point[along].1);
            if let Some((y, place)) = row.value(measure).zip(place) {
                let point = Point { x: places[place], y, chosen: y == best };
                match lines.iter_mut().find(|line| line.0.name == name) {
                    Some(line) => line.1.push(point),
                    None => lines.push((Key { name, ..palette.key(scene, row, medium) }, vec![point])),
                }
            }
        }
        lines.iter_mut().for_each(|line| line.1.sort_by(|a, b| a.x.total_cmp(&b.x)));
        let levels = scene.rows.iter().filter(|row| row.is_reference());
        let levels: Vec<_> =
            levels.filter_map(|row| Some((palette.key(scene, row, medium), row.value(measure)?))).collect();
        let named: Vec<(f64, &str)> = places.iter().copied().zip(values.iter().copied()).collect();
        let along = format!("{option}{scale}");
        small_plot::dots(&Dots { title, along: &along, places: &named, lines: &lines, levels: &levels })
    }

    fn map<'t>(
        &'t self,
        measure: &Measure,
        best: f64,
        title: &'t str,
        palette: &Palette,
        (scene, medium): (&SceneRows, Medium),
    ) -> OwnedMap<'t> {
        let (down, across) = (&self.options[0], &self.options[1]);
        let badness = |row: &Row| row.value(measure).map(|v| measure.better.badness(v));
        let worst = self.rows.iter().filter_map(|row| badness(row)).fold(f64::MIN, f64::max);
        let least = measure.better.badness(best);
        let field = |row: &Row| {
            let value = row.value(measure)?;
            let shade = (worst - badness(row)?) / (worst - least).max(f64::MIN_POSITIVE);
            Some(Field { shade, text: three_digits(value), chosen: value == best })
        };
        let fields =
            down.1.iter().map(|a| across.1.iter().map(|b| self.row(&[a, b]).and_then(field)).collect()).collect();
        let style = format!("fill:{}", palette.colour(scene, self.rows[0], medium));
        OwnedMap { title, style, down, across, fields }
    }
}

/// A map with what it is drawn from.
struct OwnedMap<'a> {
    title: &'a str,
    style: String,
    down: &'a (&'a str, Vec<&'a str>),
    across: &'a (&'a str, Vec<&'a str>),
    fields: Vec<Vec<Option<Field>>>,
}

impl OwnedMap<'_> {
    fn as_plot(&self) -> Map<'_> {
        let Self { title, style, down, across, fields } = self;
        Map { title, style, columns: (across.0, &across.1), rows: (down.0, &down.1), fields }
    }
}

/// The values as numbers, where all are.
fn numbers(values: &[&str]) -> Option<Vec<f64>> {
    values.iter().map(|value| value.parse().ok().filter(|v: &f64| v.is_finite())).collect()
}

/// Where values lie along an axis from 0 to 1, and what the axis' name says of it: words at equal distances, numbers by
/// their size, or by factors where those are more even.
fn places(values: &[&str]) -> (Vec<f64>, &'static str) {
    let even = |count: usize| (0..count).map(|i| (i as f64 + 0.5) / count as f64).collect();
    let Some(numbers) = numbers(values).filter(|numbers| numbers.len() > 1) else { return (even(values.len()), "") };
    let logs: Vec<f64> = numbers.iter().map(|v| v.ln()).collect();
    let (low, high) = (numbers.iter().copied().fold(f64::MAX, f64::min), numbers.iter().copied().fold(0.0, f64::max));
    let by_factors = low > 0.0
        && match numbers.len() {
            2 => high / low >= DECADE,
            _ => unevenness(&logs) < unevenness(&numbers),
        };
    if by_factors { (stretched(&logs), ", logarithmic") } else { (stretched(&numbers), "") }
}

/// Deviation of the gaps between sorted values, over their mean.
fn unevenness(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    let gaps: Vec<f64> = sorted.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mean = gaps.iter().sum::<f64>() / gaps.len() as f64;
    (gaps.iter().map(|gap| (gap - mean).powi(2)).sum::<f64>() / gaps.len() as f64).sqrt() / mean.max(f64::MIN_POSITIVE)
}

/// Values brought to 0 to 1.
fn stretched(values: &[f64]) -> Vec<f64> {
    let (low, high) = values.iter().fold((f64::MAX, f64::MIN), |(low, high), v| (low.min(*v), high.max(*v)));
    values.iter().map(|v| if high > low { (v - low) / (high - low) } else { 0.5 }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::comparison::Comparison;

    fn scene(points: &[(&[(&str, &str)], f64)]) -> SceneRows {
        let row = |(point, value): &(&[(&str, &str)], f64)| Row {
            name: format!("m {point:?}"),
            method: "m".into(),
            point: point.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect(),
            values: [("warp error".to_owned(), *value), ("flicker".to_owned(), 1.0)].into(),
            video: Some(String::new()),
            ..Row::default()
        };
        let frozen = Row {
            name: "frozen".into(),
            sort: Sort::Frozen,
            baseline: true,
            values: [("warp error".to_owned(), 0.02)].into(),
            ..Row::default()
        };
        SceneRows { rows: [frozen].into_iter().chain(points.iter().map(row)).collect(), ..SceneRows::default() }
    }

    fn drawn(scene: &SceneRows) -> Vec<String> {
        let palette = Palette::new(&Comparison { scenes: vec![scene.clone()], ..Comparison::default() });
        let sweeps = sweeps(scene);
        let plots = sweeps.iter().flat_map(|sweep| sweep.plots(scene, &palette, Medium::File));
        plots.map(|plot| plot.drawing.file()).collect()
    }

    #[test]
    fn one_option_gives_points_and_two_a_map_and_more_give_lines() {
        let one = drawn(&scene(&[(&[("a", "1")], 0.03), (&[("a", "3")], 0.01), (&[("a", "2")], 0.02)]));
        // Flicker is the same for all: no plot.
        assert_eq!((one.len(), one[0].matches("<circle class=\"point\"").count()), (1, 3));
        assert_eq!((one[0].matches("class=\"chosen\"").count(), one[0].matches("class=\"level\"").count()), (1, 1));
        let grid: Vec<[(&str, &str); 2]> =
            ["1", "2"].iter().flat_map(|a| ["x", "y", "z"].map(|b| [("a", *a), ("b", b)])).collect();
        let points: Vec<(&[(&str, &str)], f64)> =
            grid.iter().enumerate().map(|(i, p)| (&p[..], 0.1 + i as f64 / 100.0)).collect();
        let two = drawn(&scene(&points));
        assert_eq!((two[0].matches("class=\"field\"").count(), two[0].matches("class=\"chosen\"").count()), (6, 1));
        let three: Vec<Vec<(&str, &str)>> = grid.iter().map(|p| [&p[..], &[("c", "0")]].concat()).collect();
        let points: Vec<(&[(&str, &str)], f64)> =
            three.iter().zip([0.1, 0.2, 0.3, 0.4, 0.5, 0.6]).map(|(p, v)| (&p[..], v)).collect();
        let lines = drawn(&scene(&points));
        assert!(lines[0].contains("a=1 c=0") && lines[0].contains("a=2 c=0"), "{}", lines[0]);
    }

    #[test]
    fn axes_are_of_words_numbers_or_factors() {
        assert_eq!(places(&["plain", "fair"]), (vec![0.25, 0.75], ""));
        assert_eq!(places(&["0", "4", "2"]), (vec![0.0, 1.0, 0.5], ""));
        let (at, name) = places(&["0.1", "1", "10"]);
        assert!(name == ", logarithmic" && (at[1] - 0.5).abs() < 1e-9, "{at:?}");
        assert_eq!(places(&["1", "2"]).1, "");
        assert_eq!(places(&["1", "100"]).1, ", logarithmic");
        assert_eq!(places(&["7"]).0, [0.5]);
        assert_eq!(places(&["7", "7.0"]).0, [0.5, 0.5]);
    }
}
