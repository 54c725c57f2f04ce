//! Frames from placed pieces: what must be exact is exact, variance is kept, and nothing outside the matte changes.

use enliven::base::rng::{hash, unit};
use enliven::flow::field::Field;
use enliven::library::variant::{PIECE_CELLS, Variant};
use enliven::raster::image::{Color, Plane, Rgb8};
use enliven::raster::pyramid::{collapse, laplacian};
use enliven::render::blend::{Bands, Blender, bands};
use enliven::render::composite::{Compositor, colour_of_luma};
use enliven::render::contrast::{Contrast, Strength, match_contrast};
use enliven::render::layers::Layers;
use enliven::render::layout::{BANDS, Layout, PlacedCell, Placement};
use enliven::render::recover::{AssignedMotion, Recovery, assigned_motion, make_room, recover};

const UPRIGHT: Variant = Variant { flip: false, scale: 0, rotation: 0 };
const MOVING: PlacedCell = PlacedCell { mean: (0.0, 2.0), activity: 2.0, significant: 1.0 };

fn noise(seed: u64, width: usize, height: usize) -> Plane {
    Plane::from_fn(width, height, |x, y| unit(hash(seed, &[x as u64, y as u64])) - 0.5)
}

fn deviation(plane: &Plane, x: std::ops::Range<usize>, y: std::ops::Range<usize>) -> f32 {
    let values: Vec<f32> = y.flat_map(|y| plane.row(y)[x.clone()].to_vec()).collect();
    let mean = values.iter().sum::<f32>() / values.len() as f32;
    (values.iter().map(|v| (v - mean).powi(2)).sum::<f32>() / values.len() as f32).sqrt()
}

/// A grid of nodes covering a canvas of 240 × 192; `source` and `piece` of each node from its corner.
fn layout(sources: usize, choose: impl Fn(usize, usize) -> (usize, (usize, usize), Variant)) -> Layout {
    let corners = (0..=144).step_by(24).flat_map(|y| (0..=192).step_by(24).map(move |x| (x, y)));
    let placements = corners.map(|node| {
        let (source, piece, variant) = choose(node.0, node.1);
        Placement { node, source, variant, piece, cells: vec![MOVING; PIECE_CELLS * PIECE_CELLS] }
    });
    Layout { canvas: (240, 192), sources: vec![(320, 240); sources], placements: placements.collect() }
}

fn ones(layout: &Layout) -> Vec<[f32; BANDS]> {
    vec![[1.0; BANDS]; layout.placements.len()]
}

#[test]
fn one_clip_in_place_comes_through_unchanged() {
    for flip in [false, true] {
        let variant = Variant { flip, ..UPRIGHT };
        let layout = layout(1, |x, y| (0, (x + 40, y + 24), variant));
        let clip = noise(1, 320, 240);
        let out = Blender::new(&layout, &ones(&layout)).frame(&[bands(&clip)]);
        // The band-pass part of the clip, where it lies; borders of the canvas see other neighbours.
        let (levels, _) = laplacian(&clip, BANDS);
        let expected = collapse(&levels, None);
        let worst = (40..150)
            .flat_map(|y| (40..200).map(move |x| (x, y)))
            .map(|(x, y)| {
                let sx = if flip { 320 - 1 - (x + 40) } else { x + 40 };
                (out.at(x, y) - expected.at(sx, y + 24)).abs()
            })
            .fold(0.0, f32::max);
        assert!(worst < 0.02, "flip {flip}: {worst}");
    }
}

#[test]
fn different_textures_keep_their_variance_across_seams() {
    let layout =
        layout(4, |x, y| ((x / 24 + 2 * (y / 24)) % 4, ((x * 7) % 200 / 4 * 4, (y * 5) % 150 / 4 * 4), UPRIGHT));
    let clips: Vec<Bands> = (0..4).map(|i| bands(&noise(i, 320, 240))).collect();
    let blender = Blender::new(&layout, &ones(&layout));
    let clips: Vec<Bands> = blender.levels().iter().map(|l| clips[l.source].clone()).collect();
    let out = blender.frame(&clips);
    // A node's own middle is 36..36+24 from its corner less the transitions; seams lie at 36 + 24 k.
    let strip = |offset: usize| {
        let columns = (1..6).map(|k| 36 + 24 * k + offset);
        columns.map(|x| deviation(&out, x - 1..x + 2, 24..160)).sum::<f32>() / 5.0
    };
    let (seam, middle) = (strip(0), strip(12));
    assert!((seam / middle - 1.0).abs() < 0.12, "seam {seam} middle {middle}");
}

#[test]
fn still_places_of_a_piece_give_way_to_its_neighbours() {
    let mut layout = layout(2, |x, _| (usize::from(x >= 96), (40, 40), UPRIGHT));
    for placement in layout.placements.iter_mut().filter(|p| p.source == 1) {
        placement.cells.fill(PlacedCell { significant: 0.0, ..MOVING });
    }
    let out =
        Blender::new(&layout, &ones(&layout)).frame(&[bands(&Plane::zeros(320, 240)), bands(&noise(3, 320, 240))]);
    let edge = deviation(&out, 100..106, 30..150);
    assert!(edge < 0.3 * deviation(&out, 150..200, 30..150), "{edge}");
}

#[test]
fn gains_match_the_picture_and_are_bounded() {
    let layout = layout(1, |_, _| (0, (40, 40), UPRIGHT));
    let clip = noise(1, 320, 240);
    let mut contrast = Contrast::default();
    contrast.add(&bands(&clip), &bands(&Plane::zeros(320, 240)));
    let matte = Plane::filled(240, 192, 1.0);
    let strength = Strength { strength: 1.0, max_gain: 3.0, bands: [1.0, 1.0, 0.5, 0.5, 0.5] };
    let at = |scale: f32| {
        match_contrast(&layout, &[&contrast], &noise(9, 240, 192).map(|v| 0.5 + scale * v), &matte, &strength).gains
    };
    let equal = at(1.0)[10];
    assert!((equal[0] - 1.0).abs() < 0.15 && (equal[3] - 0.5).abs() < 0.25, "{equal:?}");
    assert!((at(0.5)[10][0] - 0.5).abs() < 0.1);
    assert_eq!((at(100.0)[10][0], at(0.0)[10][0]), (3.0, 1.0 / 3.0));
}

#[test]
fn assigned_motion_is_that_of_the_pieces() {
    let motion = assigned_motion(&layout(1, |x, y| (0, (x, y), UPRIGHT)));
    assert!(motion.mean.u.data.iter().all(|u| u.abs() < 1e-4));
    assert!(motion.mean.v.data.iter().all(|v| (v - 2.0).abs() < 1e-3));
}

fn downwards(width: usize, height: usize, speed: f32) -> AssignedMotion {
    let (u, v) = (Plane::zeros(width / 4, height / 4), Plane::filled(width / 4, height / 4, speed));
    AssignedMotion { activity: v.clone(), mean: Field { u, v } }
}

#[test]
fn recovery_blurs_along_the_flow_inside_the_matte_only() {
    let columns = Plane::from_fn(64, 64, |x, _| (x / 4 % 2) as f32);
    let rows = Plane::from_fn(64, 64, |_, y| (y / 4 % 2) as f32);
    let picture = Color::from_planes([columns, rows, noise(2, 64, 64)]);
    let matte = Plane::from_fn(64, 64, |x, _| if x < 32 { 1.0 } else { 0.0 });
    let recovery = Recovery { shutter: 4.0, blur: 0.0, amount: 1.0 };
    let out = recover(&picture, &matte, &downwards(64, 64, 4.0), &recovery);
    for (a, b) in out.planes.iter().zip(&picture.planes) {
        assert!((0..64).all(|y| a.row(y)[32..] == b.row(y)[32..]));
    }
    assert!(deviation(&out.planes[0], 4..28, 16..48) > 0.49);
    assert!(deviation(&out.planes[1], 4..28, 16..48) < 0.1);
}

#[test]
fn what_stays_still_makes_room_for_what_moves() {
    let picture = Color::from_planes(std::array::from_fn(|_| noise(5, 96, 96).map(|v| 0.5 + 0.5 * v)));
    let matte = Plane::from_fn(96, 96, |x, _| if x < 64 { 1.0 } else { 0.0 });
    let shares = |share: f32| std::array::from_fn(|_| Plane::filled(24, 24, share));
    let contrast = |image: &Color| deviation(&image.planes[1], 8..56, 8..88);
    let all = contrast(&picture);
    // Variances add: what is left is √(1 − share) of the picture's contrast.
    let left = contrast(&make_room(&picture, &picture, &matte, &shares(0.64))) / all;
    assert!((left - 0.6).abs() < 0.03, "{left}");
    let out = make_room(&picture, &picture, &matte, &shares(1.0));
    assert!(contrast(&out) < 0.15 * all);
    assert!((0..96).all(|y| out.planes[0].row(y)[64..] == picture.planes[0].row(y)[64..]));
    assert!((contrast(&make_room(&picture, &picture, &matte, &shares(0.0))) / all - 1.0).abs() < 1e-3);
}

#[test]
fn frames_keep_every_byte_outside_the_matte_and_the_mean_luma_inside() {
    let data = (0..96 * 64 * 3).map(|i| 60 + (hash(4, &[i]) % 120) as u8).collect();
    let picture = Rgb8 { width: 96, height: 64, data };
    let working = enliven::raster::resample::resize_color(&picture.to_color(), 48, 32);
    let matte = |w: usize, h: usize| Plane::from_fn(w, h, |x, _| if x < w / 2 { 1.0 } else { 0.0 });
    let compositor = Compositor::new(picture.clone(), &matte(96, 64), &working, &matte(48, 32), &working);
    let quiet = compositor.frame(0, &Plane::zeros(48, 32), &matte(48, 32));
    assert_eq!(quiet, picture);
    let loud = compositor.frame(0, &Plane::filled(48, 32, 0.04), &matte(48, 32));
    for y in 0..64 {
        assert_eq!(loud.data[(y * 96 + 48) * 3..(y + 1) * 96 * 3], picture.data[(y * 96 + 48) * 3..(y + 1) * 96 * 3]);
    }
    let mean = |image: &Rgb8| image.luma().row(30)[..48].iter().sum::<f32>() / 48.0;
    assert!((mean(&loud) - mean(&picture) - 0.04).abs() < 0.006);
}

#[test]
fn differences_take_the_pictures_own_colours() {
    let luma = noise(7, 64, 64).map(|v| 0.5 + 0.4 * v);
    let orange = Color::from_planes([luma.map(|l| 1.2 * l), luma.map(|l| 0.98 * l), luma.map(|l| 0.5 * l)]);
    let slopes = colour_of_luma(&orange, &Plane::filled(64, 64, 1.0));
    let at = |c: usize| slopes.planes[c].at(32, 32);
    assert!(at(0) > at(1) && at(1) > at(2));
    assert!((0.2126 * at(0) + 0.7152 * at(1) + 0.0722 * at(2) - 1.0).abs() < 1e-3);
}

#[test]
fn what_the_fluid_has_left_shows_the_background_and_what_is_not_seen_has_no_colour() {
    let fill = |colour: [u8; 3]| Rgb8 { width: 96, height: 64, data: colour.repeat(96 * 64) };
    let (picture, background) = (fill([220, 200, 90]), fill([20, 30, 60]));
    let matte = Plane::from_fn(96, 64, |x, _| if x < 48 { 1.0 } else { 0.0 });
    let working = picture.to_color();
    let layers = Layers::split((&picture, &matte), (&working, &matte), (&background, &background.to_color()), true);
    let compositor = Compositor::layered(picture.clone(), &matte, &working, &layers, &layers.fluid);
    let (still, gone) = (Plane::zeros(96, 64), Plane::from_fn(96, 64, |x, _| if x < 24 { 1.0 } else { 0.0 }));
    let frame = compositor.frame(0, &still, &gone);
    let (fluid, opacity) = compositor.fluid(0, &still, &gone);
    // The colour of each pixel, whether the fluid covers it, and where the picture stays.
    for (x, covered, expected) in [(4, true, [220, 200, 90]), (36, false, [20, 30, 60]), (80, false, [220, 200, 90])] {
        assert_eq!(frame.pixel(x, 30), expected, "at {x}");
        assert_eq!(opacity[30 * 96 + x], if covered { 255 } else { 0 }, "at {x}");
        assert_eq!(fluid.pixel(x, 30), if covered { expected } else { [0; 3] }, "at {x}");
    }
}
