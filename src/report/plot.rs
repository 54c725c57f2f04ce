//! Plots as inline SVG: no script, no network, colours that serve a light and a dark page.

use maud::{Markup, html};

/// Size of a plot in its own units.
const WIDTH: f64 = 720.0;
/// Height of a plot of lines.
const HEIGHT: f64 = 260.0;
/// Room for the labels at the left, top, right and bottom.
const MARGIN: [f64; 4] = [70.0, 12.0, 16.0, 40.0];
/// Height of a bar with its gap.
const BAR: f64 = 24.0;
/// Room for the names beside bars.
const NAMES: f64 = 190.0;

/// Lines that share both axes.
pub struct Lines<'a> {
    /// What it shows, for those who do not see it.
    pub title: &'a str,
    /// What is counted along the horizontal axis.
    pub along: &'a str,
    /// Where the first value lies.
    pub start: f64,
    /// How far each value is from the one before.
    pub step: f64,
    /// Name, class and values of every line; a single value is drawn all along.
    pub lines: &'a [(&'a str, &'a str, &'a [f64])],
}

/// Draws lines, with axes and a legend; values that are no finite numbers are left out.
pub fn lines(plot: &Lines) -> Markup {
    let finite = || plot.lines.iter().flat_map(|l| l.2).copied().filter(|v| v.is_finite());
    let (low, high) = (finite().reduce(f64::min).unwrap_or(0.0), finite().reduce(f64::max).unwrap_or(0.0));
    let intervals = plot.lines.iter().map(|l| l.2.len()).max().unwrap_or(0).saturating_sub(1).max(1);
    let (start, end) = (plot.start, plot.start + intervals as f64 * plot.step);
    let step = nice((high - low).max(high.abs().max(1e-9) * 1e-3) / 4.0);
    let (bottom, top) = ((low / step).floor() * step, (high / step).ceil().max((low / step).floor() + 1.0) * step);
    let [left, above, right, below] = MARGIN;
    let x = |at: f64| left + (at - start) / (end - start) * (WIDTH - left - right);
    let y = |v: f64| above + (top - v) / (top - bottom) * (HEIGHT - above - below);
    let across = nice((end - start) / 6.0).max(plot.step);
    let first = (start / across).ceil();
    let path = |values: &[f64]| -> String {
        let held = [values.first().copied().unwrap_or(f64::NAN); 2];
        let ends = [start, end];
        let single = values.len() == 1;
        let points: Vec<(f64, f64)> = if single {
            ends.into_iter().zip(held).collect()
        } else {
            values.iter().enumerate().map(|(i, &v)| (start + i as f64 * plot.step, v)).collect()
        };
        let points = points.iter().filter(|p| p.1.is_finite());
        points.map(|&(i, v)| format!("{:.1},{:.1} ", x(i), y(v))).collect()
    };
    html! {
        svg viewBox=(format!("0 0 {WIDTH} {HEIGHT}")) role="img" aria-label=(plot.title) {
            @for k in 0..=((top - bottom) / step).round() as usize {
                @let v = bottom + k as f64 * step;
                line.grid x1=(left) x2=(WIDTH - right) y1=(px(y(v))) y2=(px(y(v))) {}
                text x=(left - 8.0) y=(px(y(v) + 4.0)) text-anchor="end" { (number(v, step)) }
            }
            @for k in 0..=((end / across).floor() - first) as usize {
                @let at = (first + k as f64) * across;
                text x=(px(x(at))) y=(HEIGHT - below + 18.0) text-anchor="middle" { (number(at, across)) }
            }
            text x=(px((left + WIDTH - right) / 2.0)) y=(HEIGHT - 4.0) text-anchor="middle" { (plot.along) }
            @for (_, class, values) in plot.lines {
                polyline.line.(class) points=(path(values).trim_end()) {}
            }
        }
        p.legend {
            @for (name, class, _) in plot.lines {
                span.key { svg viewBox="0 0 24 8" aria-hidden="true" { polyline.line.(class) points="0,4 24,4" {} } (name) }
            }
        }
    }
}

/// Draws bars, one below the other, each with its name and value.
pub fn bars(title: &str, unit: &str, values: &[(&str, f64)]) -> Markup {
    let most = values.iter().map(|v| v.1).fold(1e-9, f64::max);
    let room = WIDTH - NAMES - 90.0;
    html! {
        svg viewBox=(format!("0 0 {WIDTH} {}", BAR * values.len() as f64)) role="img" aria-label=(title) {
            @for (i, (name, value)) in values.iter().enumerate() {
                @let top = BAR * i as f64;
                text x=(NAMES - 8.0) y=(top + 16.0) text-anchor="end" { (name) }
                rect.bar x=(NAMES) y=(top + 4.0) width=(px((value / most * room).max(1.0))) height=(BAR - 8.0) {}
                text x=(px(NAMES + value / most * room + 8.0)) y=(top + 16.0) { (format!("{value:.2} {unit}")) }
            }
        }
    }
}

/// A value and the ends of its interval.
pub struct Interval<'a> {
    /// Whose it is.
    pub name: &'a str,
    /// The value.
    pub value: f64,
    /// Lower and upper end.
    pub ends: (f64, f64),
}

/// Draws values as dots on lines from end to end of their intervals, one below the other, on one axis with a line at 0.
pub fn intervals(title: &str, along: &str, values: &[Interval]) -> Markup {
    let ends = || values.iter().flat_map(|v| [v.ends.0, v.ends.1]).filter(|v| v.is_finite()).chain([0.0]);
    let (low, high) = (ends().fold(f64::MAX, f64::min), ends().fold(f64::MIN, f64::max));
    let step = nice((high - low).max(1e-9) / 6.0);
    let (start, end) = ((low / step).floor() * step, (high / step).ceil().max((low / step).floor() + 1.0) * step);
    let [_, _, right, below] = MARGIN;
    let bottom = BAR * values.len() as f64;
    let x = |v: f64| NAMES + (v - start) / (end - start) * (WIDTH - NAMES - right);
    html! {
        svg viewBox=(format!("0 0 {WIDTH} {}", bottom + below)) role="img" aria-label=(title) {
            @for k in 0..=((end - start) / step).round() as usize {
                @let at = start + k as f64 * step;
                @let zero = at.abs() < step / 2.0;
                line.(if zero { "zero" } else { "grid" }) x1=(px(x(at))) x2=(px(x(at))) y1="0" y2=(bottom) {}
                text x=(px(x(at))) y=(bottom + 18.0) text-anchor="middle" { (number(at, step)) }
            }
            text x=(px((NAMES + WIDTH - right) / 2.0)) y=(bottom + below - 4.0) text-anchor="middle" { (along) }
            @for (i, value) in values.iter().enumerate() {
                @let middle = BAR * (i as f64 + 0.5);
                text x=(NAMES - 8.0) y=(middle + 4.0) text-anchor="end" { (value.name) }
                line.interval x1=(px(x(value.ends.0))) x2=(px(x(value.ends.1))) y1=(middle) y2=(middle) {}
                circle.dot cx=(px(x(value.value))) cy=(middle) r="5" {}
            }
        }
    }
}

fn px(v: f64) -> String {
    format!("{v:.1}")
}

/// The least of 1, 2 and 5 times a power of ten that is not below `step`.
fn nice(step: f64) -> f64 {
    let power = 10f64.powf(step.max(1e-12).log10().floor());
    [1.0, 2.0, 5.0, 10.0].into_iter().map(|m| m * power).find(|s| *s >= step * 0.999).unwrap_or(10.0 * power)
}

/// A number with as many decimals as steps of `step` need.
fn number(v: f64, step: f64) -> String {
    let decimals = (-step.log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{v:.decimals$}");
    if text.trim_start_matches(['-', '0', '.']).is_empty() { text.trim_start_matches('-').to_owned() } else { text }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_round_numbers() {
        for (step, expected) in [(0.9, 1.0), (1.0, 1.0), (1.1, 2.0), (30.0, 50.0), (0.06, 0.1)] {
            assert!((nice(step) - expected).abs() < 1e-9, "{step}: {}", nice(step));
        }
        assert_eq!(
            (number(1.5, 0.5), number(-0.0, 1.0), number(200.0, 50.0)),
            ("1.5".into(), "0".into(), "200".into())
        );
    }

    #[test]
    fn odd_values_still_give_a_plot() {
        for values in [&[][..], &[1.0], &[2.0, 2.0, 2.0], &[f64::NAN, 1.0], &[-3.0, 1e9]] {
            let svg =
                lines(&Lines { title: "t", along: "sweeps", start: 0.0, step: 1.0, lines: &[("a", "first", values)] })
                    .into_string();
            assert!(svg.contains("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{values:?}: {svg}");
        }
        for ends in [(0.0, 0.0), (-3.0, 1e9), (2.0, 2.5)] {
            let svg = intervals("t", "s", &[Interval { name: "a", value: ends.0, ends }]).into_string();
            assert!(svg.contains("circle") && svg.contains("class=\"zero\"") && !svg.contains("NaN"), "{svg}");
        }
        assert!(intervals("t", "s", &[]).into_string().contains("<svg"));
        assert!(bars("t", "s", &[]).into_string().contains("<svg"));
    }
}
