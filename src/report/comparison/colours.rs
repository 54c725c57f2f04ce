//! One colour for each method, wherever it is drawn; swept values are shades of it, references are dashed or grey.

use super::{Comparison, Row, SceneRows, Sort};
use crate::report::plot::Key;

/// What a drawing is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Medium {
    /// The page, light or dark: variables of its style sheet.
    Page,
    /// A file on white paper: colours by their numbers.
    File,
}

/// Colours on white and on black, distinct for most colour-blind eyes too.
const HUES: [(u32, u32); 8] = [
    (0x1668b8, 0x6db3f2),
    (0xb84a00, 0xf0a05a),
    (0x0a7a3d, 0x5fd08d),
    (0x9a2fb0, 0xd58be6),
    (0xa88400, 0xe0c040),
    (0xc2185b, 0xf48fb1),
    (0x008391, 0x4dd0e1),
    (0x5d4037, 0xbcaaa4),
];
/// Those of what no method made, and of the real clip.
const PLAIN: [(&str, (u32, u32)); 2] = [("grey", (0x777777, 0x999999)), ("real", (0x111111, 0xf4f4f4))];
/// Share of its colour that the last swept value of a method has, the rest being paper.
const FAINTEST: f64 = 0.38;

/// Which method has which colour.
pub struct Palette(Vec<String>);

impl Palette {
    /// Of all methods, in the order in which they first come.
    pub fn new(comparison: &Comparison) -> Self {
        let mut methods: Vec<String> = Vec::new();
        let rows = comparison.scenes.iter().flat_map(|scene| &scene.rows);
        for row in rows.filter(|row| !row.method.is_empty()) {
            if !methods.contains(&row.method) {
                methods.push(row.method.clone());
            }
        }
        Self(methods)
    }

    /// The variables that [`Medium::Page`] takes.
    pub fn css() -> String {
        let names = (0..HUES.len()).map(|i| format!("row{i}")).chain(PLAIN.iter().map(|p| p.0.to_owned()));
        let pairs: Vec<_> = names.zip(HUES.iter().chain(PLAIN.iter().map(|p| &p.1))).collect();
        let list = |of: fn(&(u32, u32)) -> u32| {
            pairs.iter().map(|(name, pair)| format!("--{name}:#{:06x};", of(pair))).collect::<String>()
        };
        let (light, dark) = (list(|p| p.0), list(|p| p.1));
        format!(":root{{{light}}}@media(prefers-color-scheme:dark){{:root{{{dark}}}}}")
    }

    /// A row's colour.
    pub fn colour(&self, scene: &SceneRows, row: &Row, medium: Medium) -> String {
        let (name, on_white) = match row.sort {
            Sort::Real => ("real".to_owned(), PLAIN[1].1.0),
            Sort::Method => {
                let hue = self.0.iter().position(|name| *name == row.method).unwrap_or(0) % HUES.len();
                (format!("row{hue}"), HUES[hue].0)
            }
            _ => ("grey".to_owned(), PLAIN[0].1.0),
        };
        let share = share(scene, row);
        match medium {
            Medium::Page if share >= 1.0 => format!("var(--{name})"),
            Medium::Page => format!("color-mix(in oklab,var(--{name}) {:.0}%,Canvas)", 100.0 * share),
            Medium::File => {
                let mixed = |byte: u32| (f64::from(byte & 255) * share + 255.0 * (1.0 - share)).round() as u32;
                format!("#{:02x}{:02x}{:02x}", mixed(on_white >> 16), mixed(on_white >> 8), mixed(on_white))
            }
        }
    }

    /// A row's line, by the row's name.
    pub fn key(&self, scene: &SceneRows, row: &Row, medium: Medium) -> Key {
        let dashes = match row.sort {
            Sort::Method if row.baseline => ";stroke-dasharray:7 4",
            Sort::Method | Sort::Real => "",
            _ => ";stroke-dasharray:3 3",
        };
        let style = format!("stroke:{}{dashes}", self.colour(scene, row, medium));
        Key { name: row.name.clone(), class: "", style }
    }
}

/// How much of its method's colour a row has: all, but for swept values after the first.
fn share(scene: &SceneRows, row: &Row) -> f64 {
    let same: Vec<&Row> = scene.rows.iter().filter(|other| is_swept(other) && other.method == row.method).collect();
    let place = same.iter().position(|other| other.name == row.name).filter(|_| is_swept(row)).unwrap_or(0);
    1.0 - (1.0 - FAINTEST) * place as f64 / same.len().saturating_sub(1).max(1) as f64
}

fn is_swept(row: &Row) -> bool {
    row.sort == Sort::Method && !row.point.is_empty()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_method_keeps_its_colour_and_sweeps_are_shades_of_it() {
        let row = |name: &str, method: &str, point: &[(&str, &str)]| Row {
            name: name.into(),
            method: method.into(),
            point: point.iter().map(|(k, v)| ((*k).into(), (*v).into())).collect(),
            ..Row::default()
        };
        let scene = |rows| SceneRows { rows, ..SceneRows::default() };
        let frozen = Row { name: "frozen".into(), sort: Sort::Frozen, ..Row::default() };
        let swept = ["1", "2", "3"].map(|v| row(&format!("b x={v}"), "b", &[("x", v)]));
        let one = scene([vec![frozen, row("a", "a", &[])], swept.to_vec()].concat());
        let two = scene(vec![row("b", "b", &[])]);
        let palette = Palette::new(&Comparison { scenes: vec![one.clone(), two.clone()], ..Comparison::default() });
        assert_eq!(palette.colour(&two, &two.rows[0], Medium::Page), "var(--row1)");
        let shades: Vec<String> = one.rows[1..].iter().map(|r| palette.colour(&one, r, Medium::Page)).collect();
        let mixed = |percent: u8| format!("color-mix(in oklab,var(--row1) {percent}%,Canvas)");
        assert_eq!(shades, ["var(--row0)".to_owned(), "var(--row1)".to_owned(), mixed(69), mixed(38)]);
        assert_eq!(palette.colour(&one, &one.rows[2], Medium::File), "#b84a00");
        assert_eq!(palette.key(&one, &one.rows[0], Medium::File).style, "stroke:#777777;stroke-dasharray:3 3");
        assert!(Palette::css().contains("--row7:#5d4037;--grey:#777777;"));
    }
}
