//! The patch-optimization engine from outside: frames, rules, sequences, errors.

use enliven::base::observe::{Observer, Silent};
use enliven::base::options::Words;
use enliven::base::{par, rng};
use enliven::patch::data::channels::{Channel, Layout, Role};
use enliven::patch::engine::{Engine, Image, Settings, Target};
use enliven::patch::rules::Rule;
use enliven::patch::vote::Anchor;
use enliven::raster::filter::gaussian;
use enliven::raster::image::Plane;

/// One synthesised channel of weight 1.
fn grey_layout(radius: usize) -> Layout {
    Layout::new(radius, vec![Channel::new("grey", 1.0, Role::Synthesised)]).unwrap()
}

/// Soft blobs on two scales with fine grain, seen from `(offset, offset)` on.
fn texture(width: usize, height: usize, offset: u64) -> Plane {
    let noise = |seed: u64| {
        let at = |v: usize| v as u64 + offset;
        Plane::from_fn(width + 8, height + 8, |x, y| rng::unit(rng::hash(seed, &[at(x), at(y)])) - 0.5)
    };
    let (coarse, fine, grain) = (gaussian(&noise(1), 4.0), gaussian(&noise(2), 1.2), noise(3));
    let value = |x: usize, y: usize| 0.5 + 3.5 * coarse.at(x, y) + 0.8 * fine.at(x, y) + 0.05 * grain.at(x, y);
    Plane::from_fn(width, height, |x, y| value(x + 4, y + 4).clamp(0.0, 1.0))
}

fn image(planes: Vec<Plane>) -> Image {
    Image { planes, blurred: None }
}

fn target(planes: Vec<Plane>) -> Target {
    Target::new(image(planes))
}

fn noise(width: usize, height: usize) -> Plane {
    Plane::from_fn(width, height, |x, y| rng::unit(rng::hash(77, &[x as u64, y as u64])))
}

#[test]
fn a_texture_is_made_from_noise_and_the_energy_falls() {
    let settings = Settings { iterations: (8, 8), tolerance: 0.0, ..Settings::default() };
    let engine = Engine::new(grey_layout(2), settings);
    let source = engine.source(&[image(vec![texture(64, 64, 0)])]).unwrap();
    let frame = engine.frame(&source, &target(vec![noise(90, 70)]), &Silent).unwrap();
    for level in &frame.levels {
        let patches = level.patches.1 as f64;
        // A vote rounds each of the 25 pixels of a patch to a byte.
        let rounding = patches * 25.0 / 12.0 / 65025.0;
        assert!(level.energies.windows(2).all(|e| e[1] <= e[0] + rounding), "{:?}", level.energies);
    }
    let last = frame.levels.last().unwrap();
    // Within 3 % of the range per pixel.
    assert!(last.energies.last().unwrap() / (last.patches.1 as f64 * 25.0) < 0.03f64.powi(2), "{last:?}");
    let deviation = |p: &Plane| {
        let mean = p.data.iter().sum::<f32>() / p.data.len() as f32;
        (p.data.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / p.data.len() as f32).sqrt()
    };
    let (made, given) = (deviation(&frame.planes[0]), deviation(&texture(64, 64, 0)));
    assert!((0.5..1.5).contains(&(made / given)), "{made} {given}");
}

#[test]
fn an_anchor_holds_the_frame_and_the_energy_still_falls() {
    let settings = Settings { iterations: (6, 6), tolerance: 0.0, ..Settings::default() };
    let engine = Engine::new(grey_layout(2), settings);
    let source = engine.source(&[image(vec![texture(64, 64, 0)])]).unwrap();
    let before = texture(72, 66, 90);
    let made = |weight: f32| {
        let anchor = Anchor { planes: vec![before.clone()], weight: Plane::filled(72, 66, weight) };
        let target = Target { anchor: Some(anchor), ..target(vec![before.clone()]) };
        let frame = engine.frame(&source, &target, &Silent).unwrap();
        for level in &frame.levels {
            let rounding = level.patches.1 as f64 * (25.0 + f64::from(weight)) / 12.0 / 65025.0;
            assert!(level.energies.windows(2).all(|e| e[1] <= e[0] + rounding), "{:?}", level.energies);
        }
        let difference = |(a, b): (&f32, &f32)| f64::from((a - b).powi(2));
        frame.planes[0].data.iter().zip(&before.data).map(difference).sum::<f64>()
    };
    let (free, held, fixed) = (made(0.0), made(25.0), made(1e5));
    assert!(held < 0.6 * free && fixed < 1e-3 * free, "{free} {held} {fixed}");
}

#[test]
fn guides_say_what_goes_where() {
    let layout =
        Layout::new(2, vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("guide", 1.0, Role::Guide)]);
    let engine = Engine::new(layout.unwrap(), Settings::default());
    let half =
        |w: usize, h: usize, dark: bool| Plane::from_fn(w, h, |x, _| if (x < w / 2) == dark { 0.2 } else { 0.8 });
    let exemplar = half(60, 40, true);
    let source = engine.source(&[image(vec![exemplar.clone(), exemplar])]).unwrap();
    let frame = engine.frame(&source, &target(vec![noise(80, 50), half(80, 50, false)]), &Silent).unwrap();
    assert!((frame.planes[0].at(20, 25) - 0.8).abs() < 0.05 && (frame.planes[0].at(60, 25) - 0.2).abs() < 0.05);
}

#[test]
fn where_alpha_is_nothing_nothing_is_made_and_edges_are_soft() {
    let engine = Engine::new(grey_layout(2), Settings::default());
    let alpha = |w: usize, h: usize| {
        Plane::from_fn(w, h, |x, y| {
            let r = (x as f32 - w as f32 / 2.0).hypot(y as f32 - h as f32 / 2.0);
            ((h as f32 / 3.0 - r) / 6.0 + 0.5).clamp(0.0, 1.0)
        })
    };
    let with = |w: usize, h: usize| Image { planes: vec![alpha(w, h)], blurred: Some(alpha(w, h)) };
    let source = engine.source(&[with(60, 60)]).unwrap();
    let all = Target::new(with(90, 72));
    let frame = engine.frame(&source, &all, &Silent).unwrap();
    assert_eq!(frame.planes[0].at(3, 3), 0.0);
    assert!(frame.planes[0].at(45, 36) > 0.95);
    let empty =
        Target { image: Image { planes: vec![noise(40, 40)], blurred: Some(Plane::zeros(40, 40)) }, ..all.clone() };
    let frame = engine.frame(&source, &empty, &Silent).unwrap();
    assert!(frame.planes[0].data.iter().all(|&v| v == 0.0));
    // An opaque exemplar has no outline: the target's whole fluid is one segment.
    let opaque = engine.source(&[image(vec![texture(50, 50, 0)])]).unwrap();
    let frame = engine.frame(&opaque, &all, &Silent).unwrap();
    assert!(frame.nnf.assigned().count() > 1000 && frame.planes[0].at(45, 12) > 0.0);
}

#[test]
fn the_same_frame_on_any_number_of_threads() {
    let engine = Engine::new(grey_layout(2), Settings::default());
    let source = engine.source(&image(vec![texture(50, 40, 0)]).quarter_turns()).unwrap();
    let run = |threads| {
        par::with_threads(threads, || engine.frame(&source, &target(vec![noise(70, 60)]), &Silent).unwrap()).unwrap()
    };
    let (one, two, three) = (run(1), run(2), run(3));
    assert!(one.planes == two.planes && one.planes == three.planes && one.nnf == two.nnf && one.nnf == three.nnf);
}

/// Mean squared Laplacian away from the border.
fn sharpness(p: &Plane) -> f32 {
    let inside = (8..p.height - 8).flat_map(|y| (8..p.width - 8).map(move |x| (x, y)));
    let squares = inside.map(|(x, y)| {
        let around = p.at(x - 1, y) + p.at(x + 1, y) + p.at(x, y - 1) + p.at(x, y + 1);
        (around - 4.0 * p.at(x, y)).powi(2)
    });
    let (sum, n) = squares.fold((0.0, 0.0), |(s, n), v| (s + v, n + 1.0));
    sum / n
}

/// Colour now, and before.
fn chained(rule: Rule, lambda: f32) -> Engine {
    let layout =
        vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("grey before", lambda, Role::Modulated)];
    Engine::new(Layout::new(2, layout).unwrap(), Settings { rule, ..Settings::default() })
}

/// Frames of a texture that turns by `angle` a frame; the last one.
fn turned(engine: &Engine, exemplar: &Plane, size: usize, frames: usize, angle: f32) -> Plane {
    let source = engine.source(&[image(vec![exemplar.clone(), exemplar.clone()])]).unwrap();
    let mut last = noise(size, size);
    for number in 0..frames {
        let (sin, cos) = if number > 0 { angle.sin_cos() } else { (0.0, 1.0) };
        let middle = size as f32 / 2.0;
        let before = Plane::from_fn(size, size, |x, y| {
            let (x, y) = (x as f32 + 0.5 - middle, y as f32 + 0.5 - middle);
            last.bilinear(middle + cos * x + sin * y, middle + cos * y - sin * x)
        });
        let modulation = (number == 0).then(|| Plane::zeros(size, size));
        let kept = (number > 0).then(|| Plane::filled(size, size, 1.0));
        let target = Target { modulation, kept, ..target(vec![before.clone(), before]) };
        last = engine.frame(&source, &target, &Silent).unwrap().planes.remove(0);
    }
    last
}

#[test]
fn a_repetitive_exemplar_under_rotation_stays_sharp_with_plain() {
    // Dots a patch apart (LazyFluids, Fig. 2a and b).
    let dots = Plane::from_fn(60, 60, |x, y| {
        let d = ((x % 6) as f32 - 2.5).hypot((y % 6) as f32 - 2.5);
        (2.6 - d).clamp(0.0, 1.0)
    });
    let share = sharpness(&turned(&chained(Rule::Plain, 0.2), &dots, 72, 20, 0.02)) / sharpness(&dots);
    assert!(share > 0.7, "{share}");
}

#[test]
fn where_the_exemplar_has_smooth_parts_plain_washes_out_and_uniform_does_not() {
    let exemplar = Plane::from_fn(64, 64, |x, y| {
        let grain = rng::unit(rng::hash(4, &[x as u64 / 2, y as u64 / 2])) - 0.5;
        0.5 + 0.8 * grain * (x as f32 / 63.0)
    });
    let share = |rule| sharpness(&turned(&chained(rule, 0.5), &exemplar, 80, 8, 0.03)) / sharpness(&exemplar);
    let uniform = share(Rule::Uniform);
    assert!(uniform > 0.4, "{uniform}");
    for rule in [Rule::Plain, Rule::Coherent, Rule::Bidirectional, Rule::Occurrence] {
        assert!(share(rule) < 0.6 * uniform, "{rule:?}");
    }
}

#[test]
fn a_field_carried_on_starts_the_next_frame_near_its_end() {
    let engine = chained(Rule::Uniform, 0.5);
    let exemplar = texture(48, 48, 0);
    let source = engine.source(&[image(vec![exemplar.clone(), exemplar])]).unwrap();
    let first = Target { modulation: Some(Plane::zeros(64, 64)), ..target(vec![noise(64, 64); 2]) };
    let first = engine.frame(&source, &first, &Silent).unwrap();
    let before = &first.planes[0];
    let moved = Plane::from_fn(64, 64, |x, y| before.at(x.saturating_sub(1), y));
    let field = first.nnf.carried(|x, y| (x as f32 - 0.5, y as f32 + 0.5));
    let start = |previous| {
        let second = Target { previous, ..target(vec![moved.clone(); 2]) };
        engine.frame(&source, &second, &Silent).unwrap().levels[0].energies[0]
    };
    assert!(start(Some(field)) < 0.8 * start(None));
}

#[test]
fn what_is_shown_follows_the_flow() {
    // Round the middle, about a pixel a frame.
    let was = |x: usize, y: usize| {
        let (dx, dy) = (x as f32 + 0.5 - 48.0, y as f32 + 0.5 - 48.0);
        let (sin, cos) = 0.04f32.sin_cos();
        (48.0 + dx * cos + dy * sin, 48.0 + dy * cos - dx * sin)
    };
    let exemplar = texture(60, 60, 0);
    for rule in [Rule::Plain, Rule::Uniform] {
        let engine = chained(rule, 0.2);
        let source = engine.source(&[image(vec![exemplar.clone(), exemplar.clone()])]).unwrap();
        let first = Target { modulation: Some(Plane::zeros(96, 96)), ..target(vec![noise(96, 96); 2]) };
        let mut last = engine.frame(&source, &first, &Silent).unwrap();
        let (mut followed, mut stayed) = (0.0, 0.0);
        for _ in 0..5 {
            let shown = last.planes[0].clone();
            let before = Plane::from_fn(96, 96, |x, y| {
                let (x, y) = was(x, y);
                shown.bilinear(x, y)
            });
            let (kept, previous) = (Some(Plane::filled(96, 96, 1.0)), Some(last.nnf.carried(was)));
            let next = Target { kept, previous, ..target(vec![before.clone(); 2]) };
            last = engine.frame(&source, &next, &Silent).unwrap();
            let error = |other: &Plane| {
                let squares = last.planes[0].data.iter().zip(&other.data).map(|(a, b)| (a - b).powi(2));
                squares.sum::<f32>()
            };
            followed += error(&before);
            stayed += error(&shown);
        }
        assert!(followed < 0.15 * stayed, "{rule:?}: {followed} {stayed}");
    }
}

#[test]
fn pictures_are_shown_to_whoever_wants_them() {
    #[derive(Default)]
    struct Names(std::sync::Mutex<Vec<String>>);
    impl Observer for Names {
        fn wants_pictures(&self) -> bool {
            true
        }
        fn picture(&self, name: &str, (width, height): (usize, usize), rgb: &[u8]) {
            assert_eq!(rgb.len(), width * height * 3);
            assert!(rgb.iter().any(|&v| v > 0), "{name}");
            self.0.lock().unwrap().push(name.to_owned());
        }
    }
    let engine = Engine::new(grey_layout(2), Settings { rule: Rule::Uniform, ..Settings::default() });
    let source = engine.source(&[image(vec![texture(30, 30, 0)])]).unwrap();
    let names = Names::default();
    engine.frame(&source, &target(vec![noise(44, 40)]), &names).unwrap();
    assert_eq!(names.0.into_inner().unwrap(), ["level 0 field", "level 0 usage", "level 0 channel grey"]);
}

#[test]
fn every_rule_makes_a_frame_the_same_on_any_number_of_threads() {
    let source_image = image(vec![texture(44, 40, 0)]);
    for &(name, rule) in <Rule as Words>::ALL {
        let settings = Settings { rule, iterations: (3, 2), ..Settings::default() };
        let engine = Engine::new(grey_layout(2), settings);
        let source = engine.source(std::slice::from_ref(&source_image)).unwrap();
        let made = |threads| {
            let frame = || engine.frame(&source, &target(vec![noise(60, 56)]), &Silent).unwrap();
            par::with_threads(threads, frame).unwrap()
        };
        let (one, two, three) = (made(1), made(2), made(3));
        assert!(one.planes == two.planes && one.planes == three.planes && one.nnf == three.nnf, "{name}");
        assert!(sharpness(&one.planes[0]) > 0.0, "{name}");
    }
}

#[test]
fn turned_copies_are_sources_like_others() {
    let layout =
        Layout::new(1, vec![Channel::new("grey", 1.0, Role::Synthesised), Channel::new("guide", 1.0, Role::Guide)]);
    let engine = Engine::new(layout.unwrap(), Settings { rule: Rule::Uniform, ..Settings::default() });
    let picture = Image { planes: vec![noise(14, 11), noise(14, 11)], blurred: Some(Plane::filled(14, 11, 1.0)) };
    let turns = picture.quarter_turns();
    for (k, turn) in turns.iter().enumerate() {
        let at = [(3, 1), (9, 3), (10, 9), (1, 10)][k];
        assert!(turn.planes.iter().chain(&turn.blurred).all(|p| p.width == [14, 11, 14, 11][k]));
        assert_eq!(turn.planes[1].at(at.0, at.1), picture.planes[1].at(3, 1), "turned {k} times");
    }
    let source = engine.source(&turns).unwrap();
    assert_eq!((source.finest().images(), source.finest().count()), (4, 4 * 12 * 9));
    // More source than target patches: each is used once or not at all.
    let frame = engine.frame(&source, &Target::new(turns[1].clone()), &Silent).unwrap();
    let usage = frame.nnf.usage(source.finest());
    assert!(usage.iter().all(|&n| n <= 1) && usage.iter().sum::<u32>() == 12 * 9);
}

#[test]
fn bad_images_are_named() {
    let engine = Engine::new(grey_layout(2), Settings::default());
    let message = |images: &[Image]| engine.source(images).unwrap_err().to_string();
    assert!(message(&[]).contains("no image"));
    assert!(message(&[image(vec![noise(9, 9), noise(9, 9)])]).contains("one a channel"));
    assert!(message(&[image(vec![noise(9, 4)])]).contains("at least 5 × 5"));
    let clear = Image { planes: vec![noise(9, 9)], blurred: Some(Plane::zeros(9, 9)) };
    assert!(message(std::slice::from_ref(&clear)).contains("opaque enough"));
    assert!(message(&[Image { blurred: Some(Plane::zeros(9, 8)), ..clear }]).contains("differ in size"));
    let source = engine.source(&[image(vec![noise(9, 9)])]).unwrap();
    let message = |target: Target| engine.frame(&source, &target, &Silent).unwrap_err().to_string();
    let good = target(vec![noise(12, 9)]);
    assert!(message(Target { modulation: Some(noise(9, 12)), ..good.clone() }).contains("9 × 12"));
    let anchor = Anchor { planes: Vec::new(), weight: noise(12, 9) };
    assert!(message(Target { anchor: Some(anchor), ..good }).contains("one a synthesised channel"));
}
