//! Small plots, to stand in numbers side by side: values at few places, and maps of values.

use maud::html;

use super::plot::{Drawing, Key, LETTER, Upright, given, px, stroke, three_digits};

/// Size of a small plot.
const SMALL: (f64, f64) = (300.0, 190.0);
/// Room for its labels at the left, top, right and bottom.
const SMALL_MARGIN: [f64; 4] = [52.0, 10.0, 16.0, 36.0];
/// Room for the names of a map's rows, and height of a row.
const MAP: (f64, f64) = (76.0, 34.0);

/// A point of a small plot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Point {
    /// Place along the horizontal axis, 0 to 1.
    pub x: f64,
    /// Value.
    pub y: f64,
    /// Whether it is ringed.
    pub chosen: bool,
}

/// A small plot: values at few places, and levels to compare them with.
pub struct Dots<'a> {
    /// What it shows.
    pub title: &'a str,
    /// What lies along the horizontal axis.
    pub along: &'a str,
    /// Places along it, 0 to 1, with their names.
    pub places: &'a [(f64, &'a str)],
    /// Points joined by lines, in the order of their places.
    pub lines: &'a [(Key, Vec<Point>)],
    /// Values drawn all across; one too far from the points to be shown with them is told in the legend.
    pub levels: &'a [(Key, f64)],
}

/// Draws points joined by lines.
pub fn dots(plot: &Dots) -> Drawing {
    let points = || plot.lines.iter().flat_map(|l| &l.1).map(|p| p.y).filter(|v| v.is_finite());
    let (low, high) = (points().fold(f64::MAX, f64::min), points().fold(f64::MIN, f64::max));
    let reach = 2.0 * (high - low).max(high.abs() * 0.05);
    let near = |level: f64| level >= low - reach && level <= high + reach;
    let axis = Upright::of(points().chain(plot.levels.iter().map(|l| l.1).filter(|l| near(*l))), 3.0);
    let ((width, height), [left, above, right, below]) = (SMALL, SMALL_MARGIN);
    // The outermost points stand free of the axis.
    let x = |at: f64| left + (0.06 + 0.88 * at) * (width - left - right);
    let y = |v: f64| above + (axis.top - v) / (axis.top - axis.bottom) * (height - above - below);
    let path = |points: &[Point]| -> String {
        points.iter().filter(|p| p.y.is_finite()).map(|p| format!("{:.1},{:.1} ", x(p.x), y(p.y))).collect()
    };
    let body = html! {
        (axis.marks((left, width - right), y))
        @for (at, name) in plot.places {
            text x=(px(x(*at))) y=(height - below + 16.0) text-anchor="middle" { (name) }
        }
        text x=(px((left + width - right) / 2.0)) y=(height - 4.0) text-anchor="middle" { (plot.along) }
        @for (key, level) in plot.levels.iter().filter(|l| near(l.1)) {
            line.level style=[given(&key.style)] x1=(left) x2=(width - right) y1=(px(y(*level))) y2=(px(y(*level))) {}
        }
        @for (key, points) in plot.lines {
            (stroke(key, path(points).trim_end()))
            @for point in points.iter().filter(|p| p.y.is_finite()) {
                circle.point style=[given(&key.style)] cx=(px(x(point.x))) cy=(px(y(point.y))) r="2.5" {}
                @if point.chosen { circle.chosen cx=(px(x(point.x))) cy=(px(y(point.y))) r="6.5" {} }
            }
        }
    };
    let away = |(key, level): &(Key, f64)| match near(*level) {
        true => key.clone(),
        false => Key { name: format!("{} {}, off the plot", key.name, three_digits(*level)), ..key.clone() },
    };
    let several = plot.lines.iter().filter(|_| plot.lines.len() > 1).map(|l| l.0.clone());
    let legend = several.chain(plot.levels.iter().map(away)).collect();
    Drawing { title: plot.title.to_owned(), size: SMALL, body, legend }
}

/// A field of a map.
#[derive(Debug, Clone, PartialEq)]
pub struct Field {
    /// How dark it is, 0 to 1.
    pub shade: f64,
    /// What is written in it.
    pub text: String,
    /// Whether it is framed.
    pub chosen: bool,
}

/// A map of values: columns and rows with their names.
pub struct Map<'a> {
    /// What it shows.
    pub title: &'a str,
    /// Style of a field that is as dark as can be.
    pub style: &'a str,
    /// What the columns are, and each of them.
    pub columns: (&'a str, &'a [&'a str]),
    /// What the rows are, and each of them.
    pub rows: (&'a str, &'a [&'a str]),
    /// Row by row, as many fields as there are columns; none is left empty.
    pub fields: &'a [Vec<Option<Field>>],
}

/// Draws a map.
pub fn map(plot: &Map) -> Drawing {
    let ((names, line), width) = (MAP, SMALL.0);
    let cell = (width - names - 4.0) / plot.columns.1.len().max(1) as f64;
    let top = 2.0 * LETTER.0;
    let body = html! {
        text x=(names - 8.0) y="34" text-anchor="end" { (plot.rows.0) " ↓" }
        text x=(px(names + cell * plot.columns.1.len() as f64 / 2.0)) y="14" text-anchor="middle" { (plot.columns.0) }
        @for (i, name) in plot.columns.1.iter().enumerate() {
            text x=(px(names + cell * (i as f64 + 0.5))) y="34" text-anchor="middle" { (name) }
        }
        @for (j, (name, fields)) in plot.rows.1.iter().zip(plot.fields).enumerate() {
            @let y = top + line * j as f64;
            text x=(names - 8.0) y=(px(y + 0.5 * line + 4.0)) text-anchor="end" { (name) }
            @for (i, field) in fields.iter().enumerate() {
                @if let Some(field) = field {
                    @let x = names + cell * i as f64;
                    rect.field style=(plot.style) fill-opacity=(format!("{:.2}", 0.06 + 0.5 * field.shade.clamp(0.0, 1.0)))
                        x=(px(x + 1.0)) y=(px(y + 1.0)) width=(px(cell - 2.0)) height=(px(line - 2.0)) {}
                    @if field.chosen { rect.chosen x=(px(x + 2.0)) y=(px(y + 2.0)) width=(px(cell - 4.0)) height=(px(line - 4.0)) {} }
                    text x=(px(x + 0.5 * cell)) y=(px(y + 0.5 * line + 4.0)) text-anchor="middle" { (field.text) }
                }
            }
        }
    };
    let height = top + line * plot.rows.1.len() as f64 + 4.0;
    Drawing { title: plot.title.to_owned(), size: (width, height), body, legend: Vec::new() }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odd_values_still_give_a_plot() {
        for values in [&[][..], &[1.0], &[2.0, 2.0, 2.0], &[f64::NAN, 1.0], &[-3.0, 1e9]] {
            let key = Key { name: "a".into(), ..Key::default() };
            let points = values.iter().map(|&y| Point { x: 0.5, y, chosen: true }).collect();
            let levels = [(key.clone(), 0.0), (key.clone(), 1e12)];
            let plot = Dots { title: "t", along: "o", places: &[(0.5, "x")], lines: &[(key, points)], levels: &levels };
            let svg = dots(&plot).file();
            assert!(!svg.contains("NaN") && !svg.contains("inf"), "{values:?}: {svg}");
        }
    }

    #[test]
    fn a_level_far_away_does_not_flatten_the_points() {
        let key = |name: &str| Key { name: name.into(), ..Key::default() };
        let points = [1.0, 1.2].map(|y| Point { x: y - 1.0, y, chosen: false }).to_vec();
        let levels = [(key("near"), 1.1), (key("far"), 90.0)];
        let plot = Dots { title: "t", along: "o", places: &[], lines: &[(key("a"), points)], levels: &levels };
        let svg = dots(&plot).on_page().into_string();
        assert!(svg.contains("far 90.0, off the plot") && svg.matches("class=\"level\"").count() == 1, "{svg}");
    }

    #[test]
    fn a_map_has_a_field_for_every_value() {
        let field = |shade| Some(Field { shade, text: "1.0".into(), chosen: shade == 1.0 });
        let fields = [vec![field(0.0), None], vec![field(1.0), field(0.5)]];
        let plot = Map {
            title: "t",
            style: "fill:#123",
            columns: ("a", &["1", "2"]),
            rows: ("b", &["x", "y"]),
            fields: &fields,
        };
        let svg = map(&plot).file();
        assert_eq!((svg.matches("class=\"field\"").count(), svg.matches("class=\"chosen\"").count()), (3, 1));
    }
}
