//! Strokes along the flow, as a person draws them, and the smooth field between them (Okabe et al. 2011, §5).

use std::path::Path;

use serde_json::{Map, Value};

use super::radial_basis::RadialBasis;
use crate::base::error::{Error, Kind, Result};
use crate::base::options::unknown;
use crate::base::par;
use crate::raster::components::Components;
use crate::raster::image::Plane;

/// Fastest motion that may be asked for, pixels per frame.
pub const MAX_SPEED: f32 = 1000.0;
/// Most bytes of a JSON file of strokes.
const MAX_BYTES: u64 = 16 << 20;
/// Distance of the samples along a stroke, pixels.
const SPACING: f32 = 4.0;
/// Most samples in all; beyond, they are wider apart.
const MAX_SAMPLES: f32 = 800.0;
/// Most strokes of a file.
const MAX_STROKES: usize = 400;
/// Samples nearer than this are averaged, pixels.
const RIDGE: f32 = 2.0;

/// A line along the flow, from where the fluid comes to where it goes.
#[derive(Debug, Clone, PartialEq)]
pub struct Stroke {
    /// At least two different points (x, y), pixels; pixel centres at ½.
    pub points: Vec<(f32, f32)>,
    /// Speed along it in pixels per frame, above 0 and at most [`MAX_SPEED`].
    pub speed: Option<f32>,
}

impl Stroke {
    /// Length, pixels.
    pub fn length(&self) -> f32 {
        self.points.windows(2).map(|p| distance(p[0], p[1])).sum()
    }
}

/// Reads strokes for a picture of `size` pixels from JSON,
/// `{"strokes": [{"points": [[x, y], …], "speed": px_per_frame}]}` with `speed` optional.
///
/// # Errors
/// An unreadable file or one without strokes; unknown keys (naming the nearest); a stroke with fewer than two different
/// points, with a point outside the picture, or with a speed that is no number above 0.
pub fn read(path: &Path, size: (usize, usize)) -> Result<Vec<Stroke>> {
    let length = std::fs::metadata(path).map_err(|e| Error::io(path, "read the strokes", e))?.len();
    if length > MAX_BYTES {
        return Err(Error::file(Kind::Limit, path, format!("{length} bytes are too many for strokes"))
            .allowed(format!("up to {MAX_BYTES} bytes")));
    }
    let text = std::fs::read_to_string(path).map_err(|e| Error::io(path, "read the strokes", e))?;
    parse(&text, path, size)
}

/// Strokes as JSON that [`read`] takes, coordinates and speeds to a tenth.
pub fn to_json(strokes: &[Stroke]) -> String {
    let line = |stroke: &Stroke| {
        let points: Vec<String> = stroke.points.iter().map(|(x, y)| format!("[{x:.1}, {y:.1}]")).collect();
        let speed = stroke.speed.map_or(String::new(), |speed| format!(", \"speed\": {speed:.1}"));
        format!("    {{\"points\": [{}]{speed}}}", points.join(", "))
    };
    format!("{{\"strokes\": [\n{}\n]}}\n", strokes.iter().map(line).collect::<Vec<_>>().join(",\n"))
}

/// [`read`] for JSON in memory; `path` names the file in errors.
///
/// # Errors
/// As for [`read`].
pub fn parse(text: &str, path: &Path, size: (usize, usize)) -> Result<Vec<Stroke>> {
    let shape = r#"{"strokes": [{"points": [[x, y], [x, y]], "speed": 4.0}]}, speed optional"#;
    let bad = |problem: String| Error::file(Kind::Data, path, problem).allowed(shape);
    if text.trim().is_empty() {
        return Err(bad("is empty".into()).remedy("draw at least one stroke along the flow"));
    }
    let value: Value = serde_json::from_str(text).map_err(|e| bad(format!("is not JSON: {e}")).source(e))?;
    let file = value.as_object().ok_or_else(|| bad("is not a JSON object".into()))?;
    known_keys(file, &["strokes"], path, "the file")?;
    let strokes = file.get("strokes").and_then(Value::as_array).ok_or_else(|| bad("has no list \"strokes\"".into()))?;
    if strokes.is_empty() {
        return Err(bad("holds no strokes".into()).remedy("draw at least one stroke along the flow"));
    }
    check_count(strokes.len(), path)?;
    strokes.iter().enumerate().map(|(i, value)| stroke(value, i + 1, path, size)).collect()
}

/// Refuses more strokes than anyone draws: interpolating costs the cube of their number.
pub(super) fn check_count(count: usize, path: &Path) -> Result<()> {
    if count <= MAX_STROKES {
        return Ok(());
    }
    Err(Error::file(Kind::Limit, path, format!("holds {count} strokes"))
        .allowed(format!("up to {MAX_STROKES}"))
        .remedy("draw fewer, longer strokes"))
}

/// Reads stroke number `number`, counted from 1.
fn stroke(value: &Value, number: usize, path: &Path, size: (usize, usize)) -> Result<Stroke> {
    let bad = |problem: String| Error::file(Kind::Data, path, format!("stroke {number} {problem}"));
    let stroke = value.as_object().ok_or_else(|| bad("is not a JSON object".into()))?;
    known_keys(stroke, &["points", "speed"], path, &format!("stroke {number}"))?;
    let points = stroke.get("points").and_then(Value::as_array);
    let points = points.ok_or_else(|| bad("has no list \"points\"".into()).allowed("[[x, y], [x, y]]"))?;
    let point = |p: &Value| {
        let [x, y] = p.as_array()?.as_slice() else { return None };
        Some((x.as_f64()? as f32, y.as_f64()? as f32))
    };
    let points: Option<Vec<(f32, f32)>> = points.iter().map(point).collect();
    let points = points.ok_or_else(|| bad("has a point that is not two numbers".into()).allowed("[[x, y], [x, y]]"))?;
    let speed = match stroke.get("speed") {
        None | Some(Value::Null) => None,
        Some(value) => Some(value.as_f64().filter(|s| *s > 0.0 && *s <= f64::from(MAX_SPEED)).ok_or_else(|| {
            bad(format!("has a speed of {value}"))
                .allowed(format!("above 0, at most {MAX_SPEED} pixels of the picture per frame"))
                .remedy("leave speed out to ask for none; to turn the direction, list the points the other way round")
        })? as f32),
    };
    let stroke = Stroke { points, speed };
    check(&stroke, number, path, size)?;
    Ok(stroke)
}

/// Refuses strokes without a direction and strokes that leave the picture.
fn check(stroke: &Stroke, number: usize, path: &Path, (width, height): (usize, usize)) -> Result<()> {
    let bad = |problem: String| Error::file(Kind::Data, path, format!("stroke {number} {problem}"));
    let within = |&&(x, y): &&(f32, f32)| (0.0..=width as f32).contains(&x) && (0.0..=height as f32).contains(&y);
    if let Some((x, y)) = stroke.points.iter().find(|p| !within(p)) {
        return Err(bad(format!("has a point outside the picture: ({x}, {y})"))
            .allowed(format!("x from 0 to {width}, y from 0 to {height} (pixels of the picture)")));
    }
    if stroke.length() < 1.0 {
        let count = stroke.points.len();
        let problem = if count < 2 {
            format!("has {count} {}", if count == 1 { "point" } else { "points" })
        } else {
            "is shorter than a pixel".to_owned()
        };
        return Err(bad(problem).allowed("at least two different points").remedy("draw it along the flow"));
    }
    Ok(())
}

fn known_keys(object: &Map<String, Value>, known: &[&str], path: &Path, place: &str) -> Result<()> {
    match object.keys().find(|key| !known.contains(&key.as_str())) {
        None => Ok(()),
        Some(key) => Err(unknown("", key, known).about(format!("{}: {place}: {key}", path.display()))),
    }
}

/// What strokes say of every pixel of an image.
#[derive(Debug, Clone, PartialEq)]
pub struct StrokeField {
    /// Horizontal and vertical part of the direction: a unit vector near a stroke, shorter between strokes that
    /// disagree, 0 where no stroke says anything.
    pub direction: super::field::Field,
    /// Speed in pixels per frame; negative where no stroke says any.
    pub speed: Plane,
    /// Numbers, from 1, of the strokes that lie wholly outside of all parts.
    pub outside: Vec<usize>,
    /// Per part: whether a stroke lies on it.
    pub reached: Vec<bool>,
}

/// Interpolates strokes (in pixels of the image that `parts` are of), within each part by itself: fluid on the other
/// side of a rock may run another way. Radial basis functions carry the direction *vector*, not the angle, and the
/// speed; a stroke counts in every part it lies on.
pub fn interpolate(strokes: &[Stroke], parts: &Components) -> StrokeField {
    let (width, height) = (parts.width, parts.labels.len() / parts.width.max(1));
    let spacing = SPACING.max(strokes.iter().map(Stroke::length).sum::<f32>() / MAX_SAMPLES);
    let samples: Vec<Vec<Sample>> = strokes.iter().map(|s| samples(s, spacing)).collect();
    let mut out = StrokeField {
        direction: super::field::Field::zeros(width, height),
        speed: Plane::filled(width, height, -1.0),
        outside: (0..strokes.len())
            .filter(|&i| samples[i].iter().all(|s| parts.at(s.at.0, s.at.1) == 0))
            .map(|i| i + 1)
            .collect(),
        reached: vec![false; parts.sizes.len()],
    };
    for part in 1..=parts.sizes.len() as u32 {
        let here = samples.iter().flatten().filter(|s| parts.at(s.at.0, s.at.1) == part);
        let here: Vec<Sample> = here.copied().collect();
        out.reached[part as usize - 1] = !here.is_empty();
        fill(&mut out, parts, part, &here);
    }
    out
}

/// A place on a stroke.
#[derive(Debug, Clone, Copy)]
struct Sample {
    at: (f32, f32),
    tangent: (f32, f32),
    speed: Option<f32>,
}

/// Places along a stroke with unit tangents, `spacing` apart, the first half a step from its beginning.
fn samples(stroke: &Stroke, spacing: f32) -> Vec<Sample> {
    let length = stroke.length();
    let count = (length / spacing).round().max(1.0) as usize;
    let step = length / count as f32;
    let sample = |i: usize| {
        let place = (i as f32 + 0.5) * step;
        // A chord as long as the spacing rounds the corners off.
        let (from, to) = (along(stroke, place - 0.5 * step), along(stroke, place + 0.5 * step));
        let (dx, dy, chord) = (to.0 - from.0, to.1 - from.1, distance(from, to));
        let tangent = (dx / chord, dy / chord);
        (chord > 1e-3).then_some(Sample { at: along(stroke, place), tangent, speed: stroke.speed })
    };
    (0..count).filter_map(sample).collect()
}

/// The point `place` pixels along a stroke.
fn along(stroke: &Stroke, mut place: f32) -> (f32, f32) {
    for pair in stroke.points.windows(2) {
        let length = distance(pair[0], pair[1]);
        if place <= length && length > 0.0 {
            let share = (place / length).max(0.0);
            return (pair[0].0 + share * (pair[1].0 - pair[0].0), pair[0].1 + share * (pair[1].1 - pair[0].1));
        }
        place -= length;
    }
    stroke.points.last().copied().unwrap_or_default()
}

fn distance(a: (f32, f32), b: (f32, f32)) -> f32 {
    (a.0 - b.0).hypot(a.1 - b.1)
}

/// Writes what the samples say into the pixels of a part.
fn fill(out: &mut StrokeField, parts: &Components, part: u32, samples: &[Sample]) {
    if samples.is_empty() {
        return;
    }
    let (width, height) = (parts.width, out.speed.height);
    let rows: Vec<usize> = (0..height).filter(|y| parts.labels[y * width..(y + 1) * width].contains(&part)).collect();
    let centres: Vec<(f32, f32)> = samples.iter().map(|s| s.at).collect();
    let tangents: Vec<[f32; 2]> = samples.iter().map(|s| [s.tangent.0, s.tangent.1]).collect();
    let direction = RadialBasis::fit(&centres, &tangents, RIDGE);
    let (centres, speeds): (Vec<_>, Vec<_>) = samples.iter().filter_map(|s| Some((s.at, [s.speed?]))).unzip();
    let speed = (!speeds.is_empty()).then(|| RadialBasis::fit(&centres, &speeds, RIDGE));
    // Between strokes a sum of distances may overshoot: no speed beyond those that were typed.
    let range = speeds.iter().fold((f32::MAX, 0.0f32), |(low, high), s| (low.min(s[0]), high.max(s[0])));
    let values = par::map(rows.len(), |i| {
        let y = rows[i] as f32 + 0.5;
        (direction.row(y, width), speed.as_ref().map(|s| s.row(y, width)))
    });
    for (&y, ([u, v], speed)) in rows.iter().zip(&values) {
        for x in (0..width).filter(|x| parts.labels[y * width + x] == part) {
            let shrink = 1.0 / u[x].hypot(v[x]).max(1.0);
            (*out.direction.u.at_mut(x, y), *out.direction.v.at_mut(x, y)) = (u[x] * shrink, v[x] * shrink);
            if let Some([speed]) = speed {
                *out.speed.at_mut(x, y) = speed[x].clamp(range.0, range.1);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_text(text: &str) -> Result<Vec<Stroke>> {
        parse(text, Path::new("s.json"), (100, 60))
    }

    #[test]
    fn bad_strokes_are_named() {
        let refuse = |text: &str, words: &str| {
            let said = read_text(text).unwrap_err().to_string();
            assert!(said.contains("s.json") && said.contains(words), "{said:?} should contain {words:?}");
        };
        refuse("", "is empty");
        refuse("{", "is not JSON");
        refuse("[]", "is not a JSON object");
        refuse("{}", "has no list \"strokes\"");
        refuse(r#"{"strokes": []}"#, "holds no strokes");
        let many = vec![r#"{"points": [[1, 1], [9, 9]]}"#; MAX_STROKES + 1].join(",");
        refuse(&format!("{{\"strokes\": [{many}]}}"), "holds 401 strokes");
        refuse(r#"{"stroke": []}"#, "did you mean \"strokes\"?");
        let one = |stroke: &str| format!("{{\"strokes\": [{{\"points\": [[1, 1], [9, 9]]}}, {stroke}]}}");
        refuse(&one("3"), "stroke 2 is not a JSON object");
        refuse(&one("{}"), "stroke 2 has no list \"points\"");
        refuse(&one(r#"{"points": [[1, 1], [5, 5]], "sped": 3}"#), "stroke 2: sped: no such key");
        refuse(&one(r#"{"points": [[1, 1], [5, 5]], "sped": 3}"#), "did you mean \"speed\"?");
        refuse(&one(r#"{"points": [[1, 1]]}"#), "stroke 2 has 1 point");
        refuse(&one(r#"{"points": [[1, 1], [1, 1]]}"#), "stroke 2 is shorter than a pixel");
        refuse(&one(r#"{"points": [[1, 1], [1]]}"#), "stroke 2 has a point that is not two numbers");
        refuse(&one(r#"{"points": [[1, 1], [1, NaN]]}"#), "is not JSON");
        refuse(&one(r#"{"points": [[1, 1], [101, 1]]}"#), "x from 0 to 100, y from 0 to 60");
        refuse(&one(r#"{"points": [[1, 1], [1e300, 1]]}"#), "stroke 2 has a point outside the picture");
        for speed in ["0", "-2", "2000", "\"fast\""] {
            let text = one(&format!(r#"{{"points": [[1, 1], [5, 5]], "speed": {speed}}}"#));
            refuse(&text, &format!("stroke 2 has a speed of {speed}"));
        }
        assert_eq!(read_text(&one(r#"{"points": [[0, 0], [100, 60]], "speed": 2}"#)).unwrap()[1].speed, Some(2.0));
    }

    fn stroke(points: &[(f32, f32)], speed: Option<f32>) -> Stroke {
        Stroke { points: points.to_vec(), speed }
    }

    /// Two parts, left and right of a still strip.
    fn two_parts() -> Components {
        Components::above(&Plane::from_fn(100, 60, |x, _| if (45..55).contains(&x) { 0.0 } else { 1.0 }), 0.5)
    }

    #[test]
    fn each_part_follows_its_own_strokes() {
        let strokes = [stroke(&[(20.0, 10.0), (20.0, 50.0)], Some(3.0)), stroke(&[(48.0, 9.0), (52.0, 20.0)], None)];
        let field = interpolate(&strokes, &two_parts());
        assert_eq!((field.reached, field.outside), (vec![true, false], vec![2]));
        let at = |x, y| (field.direction.u.at(x, y), field.direction.v.at(x, y), field.speed.at(x, y));
        for (x, y) in [(20, 30), (0, 0), (44, 59)] {
            let (u, v, speed) = at(x, y);
            assert!(u.abs() < 1e-3 && v > 0.99 && (speed - 3.0).abs() < 1e-3, "({x}, {y}): {u} {v} {speed}");
        }
        assert_eq!(at(70, 30), (0.0, 0.0, -1.0));
        assert_eq!(at(50, 15), (0.0, 0.0, -1.0));
    }

    #[test]
    fn directions_turn_smoothly_and_cancel_where_they_disagree() {
        let all = Components::above(&Plane::filled(100, 60, 1.0), 0.5);
        let right = stroke(&[(10.0, 10.0), (40.0, 10.0)], Some(2.0));
        let down = stroke(&[(90.0, 20.0), (90.0, 50.0)], Some(6.0));
        let field = interpolate(&[right.clone(), down], &all);
        let angle = |x, y| field.direction.v.at(x, y).atan2(field.direction.u.at(x, y)).to_degrees();
        assert!(angle(25, 10).abs() < 3.0 && (angle(90, 35) - 90.0).abs() < 3.0);
        assert!((20.0..70.0).contains(&angle(65, 22)), "{}", angle(65, 22));
        assert!(field.speed.at(25, 10) < 2.3 && field.speed.at(90, 35) > 5.7);
        assert!(field.speed.data.iter().all(|s| (2.0..=6.0).contains(s)));
        let left = stroke(&[(40.0, 50.0), (10.0, 50.0)], None);
        let against = interpolate(&[right, left], &all);
        assert!(against.direction.u.at(25, 30).abs() < 0.1);
        assert!(against.direction.u.at(25, 10) > 0.9 && against.direction.u.at(25, 50) < -0.9);
    }

    #[test]
    fn samples_stand_evenly_with_unit_tangents() {
        let bend = stroke(&[(0.0, 0.0), (40.0, 0.0), (40.0, 40.0)], None);
        let samples = samples(&bend, 4.0);
        assert_eq!(samples.len(), 20);
        assert_eq!((samples[0].at, samples[19].at), ((2.0, 0.0), (40.0, 38.0)));
        assert!(samples.iter().all(|s| (s.tangent.0.hypot(s.tangent.1) - 1.0).abs() < 1e-5));
    }
}
