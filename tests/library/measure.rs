//! Measures against videos with planted defects: each defect moves its own measures and leaves the others.

use enliven::base::rng;
use enliven::flow::field::Field;
use enliven::measure::{self, Footage, Node, Subject, Usage};
use enliven::raster::filter::gaussian;
use enliven::raster::image::{Color, Plane, Rgb8};

const WIDTH: usize = 192;
const HEIGHT: usize = 144;
/// The texture repeats after so many pixels, and so does the video after so many frames.
const PERIOD: usize = 96;
const FPS: f32 = 25.0;
const SIDE: usize = 48;
const STRIDE: usize = 24;

/// Band-limited noise that repeats after [`PERIOD`] pixels both ways: plane waves 6 to 24 pixels long.
struct Texture(Vec<[f32; 4]>);

impl Texture {
    fn new(seed: u64) -> Self {
        let unit = |i: u64, c: u64| rng::unit(rng::hash(seed, &[i, c]));
        let wave = |i: u64| {
            let (angle, cycles) = (unit(i, 0) * std::f32::consts::TAU, 4.0 + 12.0 * unit(i, 1));
            let turn = std::f32::consts::TAU / PERIOD as f32;
            let k = [cycles * angle.cos(), cycles * angle.sin()].map(|k| k.round() * turn);
            [k[0], k[1], unit(i, 2) * std::f32::consts::TAU, 0.5 + unit(i, 3)]
        };
        Self((0..60).map(wave).collect())
    }

    /// One period, row by row, of zero mean and variance 1.
    fn tile(&self) -> Plane {
        let value = |x: usize, y: usize| {
            self.0.iter().map(|[kx, ky, p, a]| a * (kx * x as f32 + ky * y as f32 + p).sin()).sum::<f32>()
        };
        let tile = Plane::from_fn(PERIOD, PERIOD, value);
        let power = tile.data.iter().map(|v| v * v).sum::<f32>() / tile.data.len() as f32;
        tile.map(|v| v / power.sqrt())
    }
}

/// Speed to the right at row `y` of the healthy video, pixels per frame: 2 above, 1 below.
fn share_of_fast(y: usize) -> f32 {
    let s = ((y as f32 / HEIGHT as f32 - 0.3) / 0.4).clamp(0.0, 1.0);
    1.0 - s * s * (3.0 - 2.0 * s)
}

/// Frames of textures that move to the right, `fast` pixels per frame above and `slow` below.
fn waves(seed: u64, [fast, slow]: [usize; 2]) -> Vec<Color> {
    let tiles = [seed, seed + 1].map(|s| Texture::new(s).tile());
    let at = |tile: &Plane, x: usize, y: usize, speed: usize, t: usize| {
        tile.at((x + PERIOD * speed - speed * t) % PERIOD, y % PERIOD)
    };
    let frame = |t: usize| {
        let value = |x: usize, y: usize| {
            let s = share_of_fast(y);
            let sum = s * at(&tiles[0], x, y, fast, t) + (1.0 - s) * at(&tiles[1], x, y, slow, t);
            0.5 + 0.1 * sum / (s * s + (1.0 - s) * (1.0 - s)).sqrt()
        };
        let grey = Plane::from_fn(WIDTH, HEIGHT, value);
        Color::from_planes([grey.map(|v| 0.8 * v), grey.clone(), grey.map(|v| 0.2 + 0.8 * v)])
    };
    (0..PERIOD).map(frame).collect()
}

/// What is known of a video besides its frames.
struct Known {
    nodes: Vec<Node>,
    asked: Field,
    usage: Usage,
    picture: Footage,
    reference: Footage,
}

fn footage(frames: &[Color], loops: bool) -> Footage {
    Footage::new(frames.iter().map(Color::to_rgb8).collect::<Vec<Rgb8>>(), FPS, loops, None).unwrap()
}

fn known(frames: &[Color]) -> Known {
    let grid = |size: usize| (0..=(size - SIDE) / STRIDE).map(|i| (i * STRIDE) as f32);
    let node = |x: f32, y: f32| {
        let speed = 1.0 + share_of_fast(y as usize + SIDE / 2);
        Node { x, y, side: SIDE as f32, activity: speed }
    };
    let nodes: Vec<Node> = grid(HEIGHT).flat_map(|y| grid(WIDTH).map(move |x| node(x, y))).collect();
    let speed = Plane::from_fn(WIDTH, HEIGHT, |_, y| 1.0 + share_of_fast(y));
    Known {
        asked: Field { u: speed, v: Plane::zeros(WIDTH, HEIGHT) },
        usage: Usage { counts: vec![1; nodes.len()], sources: 10_000 },
        picture: Footage::still(frames[0].to_rgb8(), None).unwrap(),
        reference: footage(&waves(77, [2, 1]), true),
        nodes,
    }
}

fn measure_all(footage: &Footage, known: &Known) -> Vec<measure::Value> {
    measure::all(&Subject {
        picture: Some(&known.picture),
        reference: Some(&known.reference),
        asked: Some(&known.asked),
        nodes: &known.nodes,
        usage: Some(&known.usage),
        ..Subject::new(footage)
    })
}

/// A row of the table: a defect, the measures that must land in a range, and those that may move as well.
struct Defect {
    name: &'static str,
    plant: fn(&mut Vec<Color>, &mut Known),
    moves: &'static [(&'static str, f64, f64)],
    may_move: &'static [&'static str],
}

/// How far a measure may be from its value without defect before it counts as moved.
const TOLERANCE: &[(&str, f64)] = &[
    ("patch distance", 0.004),
    ("dynamics distance", 0.003),
    ("dynamics shape distance", 0.08),
    ("temporal spectrum distance", 1.0),
    ("deviation ratio", 0.05),
    ("colour distance", 0.3),
    ("detail lost", 0.1),
    ("detail added", 0.1),
    ("sharpness retention", 0.08),
    ("sharpness slope", 0.03),
    ("warp error", 0.003),
    ("flicker", 0.001),
    ("loop ratio", 0.05),
    ("largest step ratio", 0.15),
    ("contrast dip", 0.06),
    ("direction error", 3.0),
    ("speed correlation", 0.02),
    ("motion share", 0.05),
    ("seam ratio", 0.05),
    ("midline variance ratio", 0.03),
    ("usage entropy", 1e-9),
];

/// Measures of several things at once, which defects of each of them move; a test of their own plants what fools others.
const JOINT: &str = "likeness";

fn time_mean(frames: &[Color]) -> Color {
    let mut mean = Color::zeros(WIDTH, HEIGHT);
    for frame in frames {
        for (m, f) in mean.planes.iter_mut().zip(&frame.planes) {
            m.data.iter_mut().zip(&f.data).for_each(|(m, f)| *m += f / frames.len() as f32);
        }
    }
    mean
}

/// Scales each frame's difference from the mean frame by `gain(t, x, y)`.
fn scale_motion(frames: &mut [Color], gain: impl Fn(usize, usize, usize) -> f32) {
    let mean = time_mean(frames);
    for (t, frame) in frames.iter_mut().enumerate() {
        for (plane, mean) in frame.planes.iter_mut().zip(&mean.planes) {
            let values = plane.data.iter_mut().zip(&mean.data).enumerate();
            values.for_each(|(i, (v, m))| *v = m + gain(t, i % WIDTH, i / WIDTH) * (*v - m));
        }
    }
}

/// Distance in pixels from the nearest line where pieces hand over.
fn from_border(x: usize) -> f32 {
    let place = (x as f32 + 0.5 - STRIDE as f32 / 2.0).rem_euclid(STRIDE as f32);
    place.min(STRIDE as f32 - place)
}

const ANY: f64 = f64::INFINITY;

const DEFECTS: &[Defect] = &[
    Defect {
        name: "freeze",
        plant: |frames, _| *frames = vec![frames[0].clone(); frames.len()],
        moves: &[
            ("dynamics distance", 0.05, ANY),
            ("temporal spectrum distance", 10.0, ANY),
            ("motion share", 0.0, 0.01),
            ("direction error", 89.0, 91.0),
        ],
        may_move: &[
            "deviation ratio",
            "dynamics shape distance",
            "warp error",
            "loop ratio",
            "largest step ratio",
            "contrast dip",
            "speed correlation",
            "seam ratio",
            "midline variance ratio",
        ],
    },
    Defect {
        name: "blur",
        plant: |frames, _| frames.iter_mut().for_each(|f| *f = f.map_planes(|p| gaussian(p, 1.5))),
        moves: &[("sharpness retention", 0.0, 0.4), ("patch distance", 0.02, ANY), ("detail lost", 0.4, 0.8)],
        may_move: &[
            "deviation ratio",
            "dynamics distance",
            "temporal spectrum distance",
            "colour distance",
            "warp error",
        ],
    },
    Defect {
        name: "wash-out",
        plant: |frames, _| {
            let sigma = |t: usize| 1.2 * t as f32 / PERIOD as f32;
            frames.iter_mut().enumerate().for_each(|(t, f)| *f = f.map_planes(|p| gaussian(p, sigma(t))));
        },
        moves: &[("sharpness slope", -0.3, -0.1)],
        may_move: &[
            "deviation ratio",
            "detail lost",
            "patch distance",
            "temporal spectrum distance",
            "sharpness retention",
            "contrast dip",
        ],
    },
    Defect {
        name: "shuffle",
        plant: |frames, _| {
            let mut order: Vec<usize> = (0..frames.len()).collect();
            order.sort_by_key(|&t| rng::hash(5, &[t as u64]));
            *frames = order.into_iter().map(|t| frames[t].clone()).collect();
        },
        moves: &[
            ("dynamics distance", 0.012, ANY),
            ("dynamics shape distance", 0.15, ANY),
            ("temporal spectrum distance", 8.0, ANY),
            ("warp error", 0.03, ANY),
        ],
        may_move: &["direction error", "speed correlation", "motion share"],
    },
    Defect {
        name: "doubled seam frame",
        plant: |frames, _| {
            let last = frames.len() - 1;
            frames[last] = frames[0].clone();
        },
        moves: &[("loop ratio", 0.0, 0.01)],
        may_move: &["temporal spectrum distance", "largest step ratio"],
    },
    Defect {
        name: "jump",
        plant: |frames, _| drop(frames.drain(40..64)),
        moves: &[("largest step ratio", 1.3, ANY)],
        may_move: &["temporal spectrum distance", "warp error", "direction error", "motion share"],
    },
    Defect {
        name: "hue ramp",
        plant: |frames, _| {
            for (t, frame) in frames.iter_mut().enumerate() {
                let amount = 0.15 * (1.0 - (std::f32::consts::TAU * t as f32 / PERIOD as f32).cos()) / 2.0;
                // Along the plane of equal luma.
                frame.planes[0].data.iter_mut().for_each(|v| *v += amount);
                frame.planes[2].data.iter_mut().for_each(|v| *v -= amount * 0.2126 / 0.0722);
            }
        },
        moves: &[("colour distance", 5.0, ANY)],
        may_move: &["patch distance"],
    },
    Defect {
        name: "tremble",
        plant: |frames, _| {
            for (t, frame) in frames.iter_mut().enumerate() {
                let light = 0.02 * (std::f32::consts::TAU * 24.0 * t as f32 / PERIOD as f32).sin();
                frame.planes.iter_mut().flat_map(|p| &mut p.data).for_each(|v| *v += light);
            }
        },
        moves: &[("flicker", 0.012, 0.016)],
        may_move: &["temporal spectrum distance", "warp error"],
    },
    Defect {
        name: "tiled patch",
        plant: |frames, known| {
            known.usage.counts = vec![known.nodes.len() as u64];
            let tile = |p: &Plane| Plane::from_fn(WIDTH, HEIGHT, |x, y| p.at((x + 12) % 24 + 36, (y + 12) % 24 + 36));
            frames.iter_mut().for_each(|f| *f = f.map_planes(tile));
        },
        moves: &[("seam ratio", 2.0, ANY), ("usage entropy", 0.0, 0.0)],
        // One small patch has neither the colours nor the speeds of the whole, and its mean trembles.
        may_move: &[
            "patch distance",
            "dynamics distance",
            "temporal spectrum distance",
            "colour distance",
            "sharpness retention",
            "warp error",
            "flicker",
            "loop ratio",
            "largest step ratio",
            "contrast dip",
            "speed correlation",
            "motion share",
            "midline variance ratio",
        ],
    },
    Defect {
        name: "one source",
        plant: |_, known| known.usage.counts = vec![known.nodes.len() as u64],
        moves: &[("usage entropy", 0.0, 0.0)],
        may_move: &[],
    },
    Defect {
        name: "pieces out of step",
        plant: |frames, _| {
            let clean = frames.clone();
            let cell = |v: usize| ((v + STRIDE / 2) / STRIDE) as u64;
            let phase = |x: usize, y: usize| rng::below(rng::hash(3, &[cell(x), cell(y)]), PERIOD as u64) as usize;
            for (t, frame) in frames.iter_mut().enumerate() {
                for (c, plane) in frame.planes.iter_mut().enumerate() {
                    let value = |x: usize, y: usize| clean[(t + phase(x, y)) % PERIOD].planes[c].at(x, y);
                    *plane = Plane::from_fn(WIDTH, HEIGHT, value);
                }
            }
        },
        moves: &[("seam ratio", 2.0, ANY)],
        may_move: &[
            "patch distance",
            "dynamics distance",
            "sharpness retention",
            "warp error",
            "motion share",
            "speed correlation",
            "midline variance ratio",
        ],
    },
    Defect {
        name: "reversed flow",
        plant: |frames, _| frames.reverse(),
        moves: &[("direction error", 175.0, 180.0), ("dynamics shape distance", 0.2, ANY)],
        may_move: &["dynamics distance"],
    },
    Defect {
        name: "swapped speeds",
        plant: |frames, _| *frames = waves(1, [1, 2]),
        moves: &[("speed correlation", -1.0, -0.9)],
        may_move: &[],
    },
    Defect {
        name: "half of the motion",
        plant: |frames, _| *frames = (0..PERIOD).map(|t| frames[t / 2].clone()).collect(),
        moves: &[("motion share", 0.3, 0.6)],
        may_move: &[
            "dynamics distance",
            "dynamics shape distance",
            "temporal spectrum distance",
            "warp error",
            "loop ratio",
            "largest step ratio",
        ],
    },
    Defect {
        name: "contrast dip",
        plant: |frames, _| {
            let fade = |t: usize| 1.0 - 0.5 * (1.0 - (t as f32 - 48.0).abs() / 8.0).max(0.0);
            scale_motion(frames, |t, _, _| fade(t));
        },
        moves: &[("contrast dip", 0.45, 0.6)],
        may_move: &[],
    },
    Defect {
        name: "dull stripes",
        plant: |frames, _| {
            let dull = |x: usize| 1.0 - 0.5 * (1.0 - from_border(x) / 6.0).max(0.0);
            scale_motion(frames, |_, x, y| dull(x).min(dull(y)));
        },
        moves: &[("midline variance ratio", 0.2, 0.5)],
        may_move: &[
            "deviation ratio",
            "detail lost",
            "patch distance",
            "dynamics distance",
            "colour distance",
            "sharpness retention",
            "seam ratio",
        ],
    },
];

fn shown(values: &[measure::Value]) -> String {
    values.iter().map(|v| v.1.map_or("      n/a".into(), |v| format!("{v:9.4}"))).collect()
}

/// What is wrong with a row, measure by measure.
fn wrong(defect: &Defect, healthy: &[measure::Value], values: &[measure::Value]) -> Vec<String> {
    let say = |what: &str, value: Option<f64>| format!("{}: {what} is {value:?}", defect.name);
    let mut out = Vec::new();
    let single = values.iter().zip(healthy).filter(|((measure, _), _)| !measure.name.starts_with(JOINT));
    for ((measure, value), (_, before)) in single {
        let moves = defect.moves.iter().find(|m| m.0 == measure.name);
        let tolerance = TOLERANCE.iter().find(|t| t.0 == measure.name).expect("every measure has a tolerance").1;
        let good = match moves {
            Some((_, low, high)) => value.is_some_and(|v| (*low..=*high).contains(&v)),
            None if defect.may_move.contains(&measure.name) => true,
            None => value.zip(*before).is_some_and(|(v, b)| (v - b).abs() <= tolerance),
        };
        if !good {
            out.push(say(measure.name, *value));
        }
    }
    out
}

#[test]
fn each_defect_moves_its_own_measures_and_leaves_the_others() {
    let clean = waves(1, [2, 1]);
    let names: String = measure::ALL.iter().map(|m| format!("{:>9.8}", m.name.replace(' ', ""))).collect();
    let healthy = measure_all(&footage(&clean, true), &known(&clean));
    println!("{:20}{names}\n{:20}{}", "", "none", shown(&healthy));
    let mut all_wrong = Vec::new();
    for defect in DEFECTS {
        let (mut frames, mut known) = (clean.clone(), known(&clean));
        (defect.plant)(&mut frames, &mut known);
        let values = measure_all(&footage(&frames, true), &known);
        println!("{:20}{}", defect.name, shown(&values));
        all_wrong.extend(wrong(defect, &healthy, &values));
    }
    assert!(all_wrong.is_empty(), "{}", all_wrong.join("\n"));
}

/// A sea of plane waves, each of which travels at a speed of its own, so that its forms come and go: 64 frames from `start`
/// on, `pace` apart.
fn sea(seed: u64, start: f32, pace: f32) -> Vec<Plane> {
    let unit = |i: u64, c: u64| rng::unit(rng::hash(seed, &[i, c]));
    let wave = |i: u64| {
        let (angle, length) = (unit(i, 0) * std::f32::consts::TAU, 6.0 + 18.0 * unit(i, 1));
        let k = std::f32::consts::TAU / length;
        // About 2 pixels a frame to the right, and as much again this way and that.
        let turn = k * (2.0 * angle.cos() + 2.0 * (unit(i, 3) - 0.5));
        [k * angle.cos(), k * angle.sin(), unit(i, 2) * std::f32::consts::TAU, turn]
    };
    let waves: Vec<[f32; 4]> = (0..48).map(wave).collect();
    let frame = |t: usize| {
        let time = start + pace * t as f32;
        let sum = |x: usize, y: usize| {
            let at = |[kx, ky, phase, turn]: &[f32; 4]| (kx * x as f32 + ky * y as f32 + phase - turn * time).sin();
            0.5 + 0.02 * waves.iter().map(at).sum::<f32>()
        };
        Plane::from_fn(WIDTH, HEIGHT, sum)
    };
    (0..64).map(frame).collect()
}

/// How like the sea of `seed` some frames are that were made from its first one.
fn likeness(frames: &[Plane], reference: &Footage) -> f64 {
    let grey = |p: &Plane| Color::from_planes([p.clone(), p.clone(), p.clone()]);
    let video = footage(&frames.iter().map(grey).collect::<Vec<_>>(), false);
    let picture = Footage::still(reference.frames()[0].clone(), None).unwrap();
    let subject = Subject { picture: Some(&picture), reference: Some(reference), ..Subject::new(&video) };
    let values = measure::all(&subject);
    let parts: Vec<String> = values
        .iter()
        .filter(|v| v.0.name.starts_with(JOINT))
        .map(|v| format!("{:.2}", v.1.unwrap_or(f64::NAN)))
        .collect();
    println!("{}", parts.join(" "));
    measure::value(JOINT, &subject).unwrap()
}

#[test]
fn freezing_sliding_grain_and_blur_cannot_win_the_likeness() {
    let clip = sea(5, 0.0, 1.0);
    let grey = |p: &Plane| Color::from_planes([p.clone(), p.clone(), p.clone()]);
    let reference = footage(&clip.iter().map(grey).collect::<Vec<_>>(), false);
    let still = &clip[0];
    // Another stretch of the clip, and what an able method makes: a little softer, fainter and slower.
    let other = likeness(&sea(5, 500.0, 1.0), &reference);
    let fair = |frame: &Plane| gaussian(frame, 0.6).map(|v| 0.5 + 0.9 * (v - 0.5));
    let able = likeness(&sea(5, 500.0, 0.75).iter().map(fair).collect::<Vec<_>>(), &reference);
    assert!(other > 0.85 && able < other && able > 0.6, "{other} {able}");

    let frozen = vec![still.clone(); 64];
    let slide = |(u, v): (f32, f32)| -> Vec<Plane> {
        // Mirrored at its borders, so that there is always something to show.
        let fold = |p: f32, size: usize| {
            let (p, size) = (p.rem_euclid(2.0 * size as f32), size as f32);
            if p > size { 2.0 * size - p } else { p }
        };
        let at = |t: f32, x: usize, y: usize| {
            still.bilinear(fold(x as f32 + 0.5 - u * t, WIDTH), fold(y as f32 + 0.5 - v * t, HEIGHT))
        };
        (0..64).map(|t| Plane::from_fn(WIDTH, HEIGHT, |x, y| at(t as f32, x, y))).collect()
    };
    // Grain as strong as the clip changes: afresh in every frame, or held and blended over `hold` frames.
    let grain = |hold: usize| -> Vec<Plane> {
        let noise = |t: usize, i: usize| 2.0 * rng::unit(rng::hash(9, &[t as u64, i as u64])) - 1.0;
        let at = |t: usize, i: usize| {
            let share = (t % hold) as f32 / hold as f32;
            0.17 * ((1.0 - share) * noise(t / hold, i) + share * noise(t / hold + 1, i))
        };
        (0..64).map(|t| Plane::from_fn(WIDTH, HEIGHT, |x, y| still.at(x, y) + at(t, x + WIDTH * y))).collect()
    };
    let order = |t: usize| rng::hash(3, &[t as u64]) as usize % 64;
    let defects = [
        ("frozen", frozen),
        ("sliding where the mean motion goes", slide((2.0, 0.0))),
        ("sliding slowly", slide((0.5, 0.0))),
        ("sliding fast", slide((4.0, 0.0))),
        ("sliding across", slide((0.0, 2.0))),
        ("grain", grain(1)),
        ("slow grain", grain(4)),
        ("blur", clip.iter().map(|frame| gaussian(frame, 3.0)).collect()),
        ("shuffled", (0..64).map(|t| clip[order(t)].clone()).collect()),
    ];
    for (name, frames) in &defects {
        let value = likeness(frames, &reference);
        assert!(value < able - 0.05, "{name}: {value}, an able method {able}");
    }
}

#[test]
fn two_seeds_agree() {
    let (video, reference) = (footage(&waves(1, [2, 1]), true), footage(&waves(77, [3, 1]), true));
    let value = |name: &str, seed| {
        let subject = Subject { reference: Some(&reference), seed, ..Subject::new(&video) };
        measure::value(name, &subject).unwrap()
    };
    for (name, share) in [("dynamics distance", 0.03), ("patch distance", 0.06)] {
        let (a, b) = (value(name, 1), value(name, 2));
        assert!((a - b).abs() < share * a, "{name}: {a} {b}");
    }
}

#[test]
fn what_is_not_known_is_not_guessed() {
    let video = footage(&waves(1, [2, 1])[..3], false);
    let values = measure::all(&Subject::new(&video));
    let known: Vec<&str> = values.iter().filter(|v| v.1.is_some()).map(|v| v.0.name).collect();
    assert_eq!(known, ["warp error", "flicker", "loop ratio", "largest step ratio", "contrast dip"]);
    let one = footage(&waves(1, [2, 1])[..1], false);
    assert!(measure::all(&Subject::new(&one)).iter().all(|v| v.1.is_none()));
}

#[test]
fn only_the_matte_counts() {
    let healthy = waves(1, [2, 1]);
    let matte = Plane::from_fn(WIDTH, HEIGHT, |x, _| if x < 96 { 1.0 } else { 0.0 });
    let with = |frames: &[Color]| {
        let rgb = frames.iter().map(Color::to_rgb8).collect();
        Footage::new(rgb, FPS, true, Some(&matte)).unwrap()
    };
    let mut spoiled = healthy.clone();
    for (t, frame) in spoiled.iter_mut().enumerate() {
        // Far enough from the matte that the motion inside is the same.
        let bright = |x: usize| if x > 176 { rng::unit(rng::hash(1, &[t as u64, x as u64])) } else { 0.0 };
        frame.planes.iter_mut().for_each(|p| p.data.iter_mut().enumerate().for_each(|(i, v)| *v += bright(i % WIDTH)));
    }
    let known = known(&healthy);
    let (a, b) = (measure_all(&with(&healthy), &known), measure_all(&with(&spoiled), &known));
    for ((measure, a), (_, b)) in a.iter().zip(&b) {
        let (a, b) = (a.unwrap(), b.unwrap());
        // A thousandth of what is usual: one of most units, some tens of degrees.
        let least = if measure.unit == "degrees" { 0.03 } else { 1e-3 };
        assert!((a - b).abs() <= 0.02 * a.abs() + least, "{}: {a} {b}", measure.name);
    }
}

#[test]
fn threads_do_not_change_a_bit() {
    let clean = waves(1, [2, 1]);
    let known = known(&clean);
    let run = |threads| {
        enliven::base::par::with_threads(threads, || measure_all(&footage(&clean[..40], true), &known)).unwrap()
    };
    let bits = |values: &[measure::Value]| values.iter().map(|v| v.1.map(f64::to_bits)).collect::<Vec<_>>();
    assert_eq!(bits(&run(1)), bits(&run(3)));
}
