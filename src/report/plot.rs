//! Plots as SVG: inline, in colours that serve a light and a dark page, or as files; no script, no network.

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

/// Height of a line of a file's title and legend, and width of a letter.
pub(super) const LETTER: (f64, f64) = (20.0, 7.0);
/// Looks of the parts of a drawing in a file of its own, which no page gives any.
const FILE_STYLE: &str = "text{fill:#222}.title{font-weight:bold}.grid{stroke:#ddd}.line{fill:none;stroke-width:2}\
    .level{stroke-width:1.5}.point{stroke-width:2;fill:#fff}.chosen{stroke:#222;stroke-width:2;fill:none}";

/// A plot, for a page or for a file of its own.
pub struct Drawing {
    pub(super) title: String,
    pub(super) size: (f64, f64),
    pub(super) body: Markup,
    pub(super) legend: Vec<Key>,
}

/// What a kind of line stands for.
#[derive(Debug, Clone, Default)]
pub struct Key {
    /// Its name.
    pub name: String,
    /// Class of the line, for the page's style sheet.
    pub class: &'static str,
    /// Style of the line by itself.
    pub style: String,
}

impl Drawing {
    /// Inline, with the legend as text below.
    pub fn on_page(&self) -> Markup {
        let (width, height) = self.size;
        html! {
            svg viewBox=(format!("0 0 {width} {height}")) role="img" aria-label=(self.title) { (self.body) }
            @if !self.legend.is_empty() {
                p.legend {
                    @for key in &self.legend {
                        span.key { svg viewBox="0 0 24 8" aria-hidden="true" { (stroke(key, "0,4 24,4")) } (key.name) }
                    }
                }
            }
        }
    }

    /// As the text of an SVG file, with title and legend in it and colours for white paper.
    pub fn file(&self) -> String {
        let (width, height) = self.size;
        let mut places: Vec<(f64, f64)> = Vec::new();
        let (mut x, mut y) = (8.0, LETTER.0 + height + 8.0);
        for key in &self.legend {
            let room = 40.0 + LETTER.1 * key.name.chars().count() as f64;
            if x > 8.0 && x + room > width {
                (x, y) = (8.0, y + LETTER.0);
            }
            places.push((x, y));
            x += room;
        }
        let whole = y + if self.legend.is_empty() { 0.0 } else { LETTER.0 };
        let drawn = html! {
            svg xmlns="http://www.w3.org/2000/svg" viewBox=(format!("0 0 {width} {whole}")) width=(width) height=(whole)
                font-family="sans-serif" font-size="12" role="img" {
                title { (self.title) }
                style { (FILE_STYLE) }
                rect width=(width) height=(whole) fill="#fff" {}
                text.title x="8" y="14" { (self.title) }
                g transform=(format!("translate(0 {})", LETTER.0)) { (self.body) }
                @for (key, (x, y)) in self.legend.iter().zip(places) {
                    g transform=(format!("translate({x} {y})")) {
                        (stroke(key, "0,8 24,8"))
                        text x="29" y="12" { (key.name) }
                    }
                }
            }
        };
        drawn.into_string()
    }
}

/// A line through points, as a key says.
pub(super) fn stroke(key: &Key, points: &str) -> Markup {
    html! { polyline class=(format!("line {}", key.class).trim_end()) style=[given(&key.style)] points=(points) {} }
}

pub(super) fn given(style: &str) -> Option<&str> {
    (!style.is_empty()).then_some(style)
}

/// Lines that share both axes.
pub struct Lines<'a> {
    /// What it shows.
    pub title: &'a str,
    /// What is counted along the horizontal axis.
    pub along: &'a str,
    /// Where the first value lies.
    pub start: f64,
    /// How far each value is from the one before.
    pub step: f64,
    /// Key and values of every line; a single value is drawn all along.
    pub lines: &'a [(Key, &'a [f64])],
}

/// The vertical axis: its ends and the distance of its marks.
pub(super) struct Upright {
    pub(super) bottom: f64,
    pub(super) top: f64,
    step: f64,
}

impl Upright {
    /// With room for every value, and about so many marks.
    pub(super) fn of(values: impl Iterator<Item = f64> + Clone, marks: f64) -> Self {
        let low = values.clone().reduce(f64::min).unwrap_or(0.0);
        let high = values.reduce(f64::max).unwrap_or(0.0);
        let step = nice((high - low).max(high.abs().max(1e-9) * 1e-3) / marks);
        let bottom = (low / step).floor();
        Self { bottom: bottom * step, top: (high / step).ceil().max(bottom + 1.0) * step, step }
    }

    /// Marks with lines from `left` to `right`.
    pub(super) fn marks(&self, (left, right): (f64, f64), y: impl Fn(f64) -> f64) -> Markup {
        html! {
            @for k in 0..=((self.top - self.bottom) / self.step).round() as usize {
                @let v = self.bottom + k as f64 * self.step;
                line.grid x1=(left) x2=(right) y1=(px(y(v))) y2=(px(y(v))) {}
                text x=(left - 8.0) y=(px(y(v) + 4.0)) text-anchor="end" { (number(v, self.step)) }
            }
        }
    }
}

/// Draws lines, with axes; values that are no finite numbers are left out.
pub fn lines(plot: &Lines) -> Drawing {
    let axis = Upright::of(plot.lines.iter().flat_map(|l| l.1).copied().filter(|v| v.is_finite()), 4.0);
    let intervals = plot.lines.iter().map(|l| l.1.len()).max().unwrap_or(0).saturating_sub(1).max(1);
    let (start, end) = (plot.start, plot.start + intervals as f64 * plot.step);
    let [left, above, right, below] = MARGIN;
    let x = |at: f64| left + (at - start) / (end - start) * (WIDTH - left - right);
    let y = |v: f64| above + (axis.top - v) / (axis.top - axis.bottom) * (HEIGHT - above - below);
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
    let body = html! {
        (axis.marks((left, WIDTH - right), y))
        @for k in 0..=((end / across).floor() - first) as usize {
            @let at = (first + k as f64) * across;
            text x=(px(x(at))) y=(HEIGHT - below + 18.0) text-anchor="middle" { (number(at, across)) }
        }
        text x=(px((left + WIDTH - right) / 2.0)) y=(HEIGHT - 4.0) text-anchor="middle" { (plot.along) }
        @for (key, values) in plot.lines { (stroke(key, path(values).trim_end())) }
    };
    let legend = plot.lines.iter().map(|l| l.0.clone()).collect();
    Drawing { title: plot.title.to_owned(), size: (WIDTH, HEIGHT), body, legend }
}

/// A number with the three digits that count.
pub fn three_digits(value: f64) -> String {
    let value = if value.abs() < 5e-7 { 0.0 } else { value };
    let decimals = if value == 0.0 { 0.0 } else { (2.0 - value.abs().log10().floor()).clamp(0.0, 6.0) };
    format!("{value:.*}", decimals as usize)
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

pub(super) fn px(v: f64) -> String {
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
            let key = Key { name: "a".into(), class: "first", style: String::new() };
            let lines_of = [(key, values)];
            let plot = Lines { title: "t", along: "sweeps", start: 0.0, step: 1.0, lines: &lines_of };
            let svg = lines(&plot).on_page().into_string() + &lines(&plot).file();
            assert!(svg.contains("<svg") && !svg.contains("NaN") && !svg.contains("inf"), "{values:?}: {svg}");
        }
        for ends in [(0.0, 0.0), (-3.0, 1e9), (2.0, 2.5)] {
            let svg = intervals("t", "s", &[Interval { name: "a", value: ends.0, ends }]).into_string();
            assert!(svg.contains("circle") && svg.contains("class=\"zero\"") && !svg.contains("NaN"), "{svg}");
        }
        assert!(intervals("t", "s", &[]).into_string().contains("<svg"));
        assert!(bars("t", "s", &[]).into_string().contains("<svg"));
    }

    #[test]
    fn a_file_has_its_own_colours_title_and_legend() {
        let key = |name: &str| Key { name: name.into(), class: "", style: "stroke:#123456".into() };
        let values = [1.0, 2.0];
        let drawn = [(key("one & two"), &values[..]), (key("a long name, so that the next is below"), &values[..])];
        let svg = lines(&Lines { title: "a < b", along: "frame", start: 0.0, step: 1.0, lines: &drawn }).file();
        assert!(svg.starts_with("<svg xmlns=") && svg.contains("a &lt; b") && svg.contains("one &amp; two"), "{svg}");
        assert!(svg.contains("stroke:#123456") && !svg.contains("var(") && !svg.contains("currentColor"), "{svg}");
    }

    #[test]
    fn three_digits_count() {
        let shown = [0.0, 0.001_234, 1.5, 123.4, -20.0, 1e-8].map(three_digits);
        assert_eq!(shown, ["0", "0.00123", "1.50", "123", "-20.0", "0"]);
    }
}
