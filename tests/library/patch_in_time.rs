//! The patch engine on a clip whose frames are all one source, with patches turned by any degree, a term of the method's own
//! and a price on repetition: against brute force that knows nothing of the engine.

use enliven::base::observe::Silent;
use enliven::base::{par, rng};
use enliven::patch::data::channels::{Channel, Layout, Role};
use enliven::patch::data::field::{Cell, Nnf};
use enliven::patch::data::patches::{Patches, Place};
use enliven::patch::data::pose::{Matrix, Pose, Turn, Upright};
use enliven::patch::engine::{Engine, Image, Settings, Source, Target};
use enliven::patch::rules::{Constraint, Occurrence, Penalty, Plain};
use enliven::patch::session::{MakeRule, Session};
use enliven::patch::terms::{Pass, Terms};
use enliven::raster::image::Plane;

/// Sides of the clip's frames and of the target, pixels.
const CLIP: usize = 13;
const TARGET: usize = 11;
/// Frames of the clip, and degrees between them.
const FRAMES: usize = 4;
const STEP: f32 = 12.0;
/// Reach of a patch, and pixels of it.
const RADIUS: usize = 2;
const PIXELS: usize = 25;
/// Degrees that the term leaves free, and what each more costs.
const FREE: i32 = 40;
const DEAR: f32 = 0.01;

/// A disc with a pattern of its own, turned clockwise by so many degrees.
fn disc(size: usize, degrees: f32, case: u64) -> Plane {
    let phase = |k: u64| rng::unit(rng::hash(case, &[k])) * std::f32::consts::TAU;
    let (sin, cos) = degrees.to_radians().sin_cos();
    let middle = (size as f32 - 1.0) / 2.0;
    Plane::from_fn(size, size, |x, y| {
        let (x, y) = (x as f32 - middle, y as f32 - middle);
        let (x, y) = (cos * x + sin * y, cos * y - sin * x);
        let (radius, angle) = (x.hypot(y), y.atan2(x));
        let wave = (angle + phase(1)).sin() + 0.7 * (2.0 * angle + phase(2) + 0.3 * radius).sin();
        let body = 0.5 + 0.2 * wave * (radius / 4.0).min(1.0) + 0.1 * (0.9 * radius + phase(3)).sin();
        body * (middle - radius + 1.0).clamp(0.0, 1.0)
    })
}

fn engine(levels: Option<usize>) -> Engine {
    seeded(levels, 5)
}

fn seeded(levels: Option<usize>, seed: u64) -> Engine {
    let layout = Layout::new(RADIUS, vec![Channel::new("grey", 1.0, Role::Synthesised)]).unwrap();
    Engine::new(layout, Settings { levels, seed, ..Settings::default() })
}

fn image(plane: Plane) -> Image {
    Image { planes: vec![plane], blurred: None }
}

fn clip(engine: &Engine, case: u64) -> Source {
    engine.clip(FRAMES, |t| Ok(image(disc(CLIP, STEP * t as f32, case)))).unwrap()
}

/// What the method adds: turns by more than so many degrees cost.
struct Upwards(Layout);

impl Terms<Turn> for Upwards {
    fn cost(&self, _: Pass, _: usize, _: Place, pose: Turn) -> u32 {
        self.0.to_distance(f64::from(dear(pose)))
    }
}

fn dear(pose: Turn) -> f32 {
    let degrees = i32::from(pose.in_degrees());
    DEAR * (degrees.min(360 - degrees) - FREE).max(0) as f32
}

/// A candidate as brute force sees it.
#[derive(Clone, Copy)]
struct Laid {
    frame: usize,
    pixels: [u8; PIXELS],
}

/// All that may be laid anywhere: every place of every frame in every turn, and what each costs every site.
struct Exhaustive {
    laid: Vec<Laid>,
    /// By site and candidate.
    costs: Vec<Vec<f32>>,
    price: f32,
    reach: usize,
}

impl Exhaustive {
    fn new(case: u64, target: &Plane, penalty: Penalty) -> Self {
        let frames: Vec<Plane> = (0..FRAMES).map(|t| disc(CLIP, STEP * t as f32, case)).collect();
        let inner = |size: usize| RADIUS..size - RADIUS;
        let mut laid = Vec::new();
        let mut samples: Vec<[f32; PIXELS]> = Vec::new();
        let mut terms = Vec::new();
        for (frame, plane) in frames.iter().enumerate() {
            for (x, y) in inner(CLIP).flat_map(|y| inner(CLIP).map(move |x| (x, y))) {
                for degrees in 0..360 {
                    let (sin, cos) = (degrees as f32).to_radians().sin_cos();
                    let at = |k: usize| {
                        let (dx, dy) = ((k % 5) as f32 - 2.0, (k / 5) as f32 - 2.0);
                        let side = CLIP as f32 - 1.0;
                        let (sx, sy) = (x as f32 + cos * dx + sin * dy, y as f32 - sin * dx + cos * dy);
                        (sx.clamp(0.0, side), sy.clamp(0.0, side))
                    };
                    let near = |k: usize| {
                        let (x, y) = at(k);
                        ((y + 0.5) as usize * CLIP + (x + 0.5) as usize) as u8
                    };
                    laid.push(Laid { frame, pixels: std::array::from_fn(near) });
                    samples.push(std::array::from_fn(|k| plane.bilinear(at(k).0 + 0.5, at(k).1 + 0.5)));
                    terms.push(dear(Turn::degrees(degrees as f32)));
                }
            }
        }
        let sites: Vec<(usize, usize)> = inner(TARGET).flat_map(|y| inner(TARGET).map(move |x| (x, y))).collect();
        let cost = |&(x, y): &(usize, usize)| {
            let patch: [f32; PIXELS] = std::array::from_fn(|k| target.at(x + k % 5 - 2, y + k / 5 - 2));
            let squared = |s: &[f32; PIXELS]| s.iter().zip(&patch).map(|(a, b)| (a - b) * (a - b)).sum::<f32>();
            samples.iter().zip(&terms).map(|(s, term)| squared(s) + term).collect()
        };
        let costs = sites.iter().map(cost).collect();
        let (targets, sources) = (sites.len() as f32, (FRAMES * (CLIP - 4) * (CLIP - 4)) as f32);
        let even = PIXELS as f32 * (2 * penalty.frames + 1) as f32 * targets / sources;
        Self { laid, costs, price: penalty.weight / (PIXELS as f32 * even), reach: penalty.frames }
    }

    /// Adds a patch to what is covered, or takes it away.
    fn count(&self, covered: &mut [i32], candidate: usize, by: i32) {
        let Laid { frame, pixels } = self.laid[candidate];
        for t in frame.saturating_sub(self.reach)..(frame + self.reach + 1).min(FRAMES) {
            pixels.iter().for_each(|&p| covered[t * CLIP * CLIP + usize::from(p)] += by);
        }
    }

    fn priced(&self, covered: &[i32], candidate: usize) -> f32 {
        let Laid { frame, pixels } = self.laid[candidate];
        self.price * pixels.iter().map(|&p| covered[frame * CLIP * CLIP + usize::from(p)]).sum::<i32>() as f32
    }

    /// Σ costs + ½ Σ prices of what every site has.
    fn energy(&self, chosen: &[usize]) -> f64 {
        let mut covered = vec![0; FRAMES * CLIP * CLIP];
        chosen.iter().for_each(|&c| self.count(&mut covered, c, 1));
        let each = |(site, &c): (usize, &usize)| {
            let mut others = covered.clone();
            self.count(&mut others, c, -1);
            f64::from(self.costs[site][c]) + 0.5 * f64::from(self.priced(&others, c))
        };
        chosen.iter().enumerate().map(each).sum()
    }

    /// Every site takes the best of all for what the others have, until none changes.
    fn best(&self) -> Vec<usize> {
        let least = |costs: &Vec<f32>| (0..costs.len()).min_by(|&a, &b| costs[a].total_cmp(&costs[b])).unwrap();
        let mut chosen: Vec<usize> = self.costs.iter().map(least).collect();
        let mut covered = vec![0; FRAMES * CLIP * CLIP];
        chosen.iter().for_each(|&c| self.count(&mut covered, c, 1));
        for _ in 0..50 {
            let mut changed = false;
            for (site, held) in chosen.iter_mut().enumerate() {
                self.count(&mut covered, *held, -1);
                let mut best = (self.costs[site][*held] + self.priced(&covered, *held), *held);
                for (candidate, &cost) in self.costs[site].iter().enumerate() {
                    if cost < best.0 {
                        let total = cost + self.priced(&covered, candidate);
                        if total < best.0 - 1e-6 {
                            best = (total, candidate);
                        }
                    }
                }
                changed |= best.1 != *held;
                *held = best.1;
                self.count(&mut covered, *held, 1);
            }
            if !changed {
                break;
            }
        }
        chosen
    }

    /// The numbers of what a field has.
    fn numbers(field: &Nnf<Turn>, source: &Patches) -> Vec<usize> {
        let inner = CLIP - 2 * RADIUS;
        let number = |(_, cell): (usize, Cell<Turn>)| {
            let (frame, x, y) = source.locate(cell.place);
            ((frame * inner + y - RADIUS) * inner + x - RADIUS) * 360 + usize::from(cell.pose.in_degrees())
        };
        field.assigned().map(number).collect()
    }
}

/// The field of a target after so many rounds of search alone: first without a price, so that patches find where they belong,
/// then with it. The energies are those with the price.
fn searched(source: &Source, target: Plane, penalty: Penalty, (rounds, seed): (usize, u64)) -> (Nnf<Turn>, Vec<f64>) {
    let engine = seeded(Some(1), seed);
    let targets = [Target::<Turn>::new(image(target))];
    let terms = Upwards(engine.layout().clone());
    let run = |rule: MakeRule<Turn>, start: Option<&Nnf<Turn>>| {
        let mut session = Session::begin(&engine, source, &targets, rule, Some(&terms), &Silent).unwrap();
        session.enter(0, 0);
        if let Some(start) = start {
            session.offer(0, 0, start);
        }
        let energies: Vec<f64> = (0..rounds).map(|round| session.search(0, 0, round)).collect();
        (session.field(0, 0).unwrap().clone(), energies)
    };
    let (free, _) = run(&|| Box::new(Plain { sweeps: 2, near: None }), None);
    run(&|| Box::new(Occurrence::new(penalty, 2)), Some(&free))
}

#[test]
fn turned_patches_of_a_clip_with_a_term_and_a_price_come_near_to_brute_force() {
    let ratios: Vec<(f64, f64)> = par::map(10, |case| {
        let case = case as u64;
        let angle = 5.0 + 31.0 * rng::unit(rng::hash(case, &[9]));
        let target = disc(TARGET, angle, case);
        let penalty = Penalty { weight: [0.02, 0.1][case as usize % 2], frames: 1 };
        let source = clip(&engine(Some(1)), case);
        // A price leaves many fields in which no patch alone gains: the best of eight starts, as the engine itself finds.
        let starts = (0..8).map(|seed| searched(&source, target.clone(), penalty, (250, seed)));
        let last = |energies: &[f64]| energies[energies.len() - 1];
        let (field, energies) = starts.min_by(|a, b| last(&a.1).total_cmp(&last(&b.1))).unwrap();
        let exhaustive = Exhaustive::new(case, &target, penalty);
        let ours = exhaustive.energy(&Exhaustive::numbers(&field, source.finest()));
        // What the engine says of itself is what brute force says of it, but for bytes.
        let said = last(&energies);
        assert!((said / ours - 1.0).abs() < 0.05, "case {case}: the engine says {said}, brute force {ours}");
        (ours, exhaustive.energy(&exhaustive.best()))
    });
    for (case, (ours, best)) in ratios.iter().enumerate() {
        println!("case {case}: {ours:.4} against {best:.4}, {:.3}", ours / best);
    }
    assert!(ratios.iter().all(|(ours, best)| ours <= &(1.05 * best)), "{ratios:?}");
}

#[test]
fn a_price_spreads_use_and_threads_do_not_change_it() {
    let target = || disc(TARGET, 17.0, 3);
    let source = clip(&engine(Some(1)), 3);
    let run = |threads| {
        par::with_threads(threads, || searched(&source, target(), Penalty { weight: 1.0, frames: 1 }, (8, 5))).unwrap()
    };
    let (dear, energies) = run(1);
    assert_eq!((dear.clone(), energies), run(2));
    let (cheap, _) = searched(&source, target(), Penalty { weight: 0.0, frames: 1 }, (8, 5));
    // Pixels under a patch, as if it stood upright.
    let covered = |field: &Nnf<Turn>| {
        let square = |(_, cell): (usize, Cell<Turn>)| {
            let (frame, x, y) = source.finest().locate(cell.place);
            (0..PIXELS).map(move |k| (frame, x + k % 5, y + k / 5))
        };
        field.assigned().flat_map(square).collect::<std::collections::BTreeSet<_>>().len()
    };
    assert!(covered(&dear) * 20 > covered(&cheap) * 21, "{} {}", covered(&dear), covered(&cheap));
}

#[test]
fn a_field_shifted_in_time_starts_the_next_frame_near_its_end() {
    let engine = engine(Some(1));
    let source = clip(&engine, 6);
    // The target turns as the clip does, so the next frame shows what the clip's next one shows.
    let targets = [3.0, 3.0 + STEP].map(|angle| Target::<Turn>::new(image(disc(CLIP, angle, 6))));
    let rule = || -> Box<dyn Constraint<Turn>> { Box::new(Plain { sweeps: 1, near: None }) };
    let mut session = Session::begin(&engine, &source, &targets, &rule, None, &Silent).unwrap();
    session.enter(0, 0);
    (0..12).for_each(|round| {
        session.search(0, 0, round);
    });
    session.enter(0, 1);
    let first = session.field(0, 0).unwrap().clone();
    let (target, from) = session.patches(0, 1).unwrap();
    let shifted = first.shifted(from, target, |_, _| 1);
    let lost = first.assigned().count() - shifted.assigned().count();
    let at_the_end = first.assigned().filter(|(_, cell)| from.locate(cell.place).0 == FRAMES - 1).count();
    assert_eq!(lost, at_the_end, "what leaves the clip has no place");
    session.offer(0, 1, &shifted);
    let offered = session.field(0, 1).unwrap().total();
    let by_chance = {
        let mut alone = Session::begin(&engine, &source, &targets[1..], &rule, None, &Silent).unwrap();
        alone.enter(0, 0);
        alone.search(0, 0, 0);
        alone.field(0, 0).unwrap().total()
    };
    assert!(offered < by_chance, "{offered} after the shift, {by_chance} after a sweep from chance");
}

#[test]
fn frames_of_sites_turn_what_is_laid_on_them() {
    // Stripes down, and a target of stripes across whose sites say that they stand a quarter turn askew.
    let stripes = |down: bool| {
        Plane::from_fn(40, 40, move |x, y| if (if down { x } else { y }) / 3 % 2 == 0 { 0.2 } else { 0.8 })
    };
    let engine = engine(None);
    let source = engine.source(&[image(stripes(true))]).unwrap();
    let made = |frames: Option<Vec<Matrix>>| {
        let noise = Plane::from_fn(40, 40, |x, y| rng::unit(rng::hash(1, &[x as u64, y as u64])));
        let target = Target::<Upright> { frames, ..Target::new(image(noise)) };
        engine.frame(&source, &target, &Silent).unwrap().planes.remove(0)
    };
    let across = |plane: &Plane| {
        let step = |dx: usize, dy: usize| -> f32 {
            let inner = (8..32).flat_map(|y| (8..32).map(move |x| (x, y)));
            inner.map(|(x, y)| (plane.at(x + dx, y + dy) - plane.at(x, y)).abs()).sum()
        };
        step(0, 1) / (step(1, 0) + step(0, 1))
    };
    let quarter = Turn::degrees(90.0).matrix();
    assert!(across(&made(None)) < 0.2, "{}", across(&made(None)));
    assert!(across(&made(Some(vec![quarter; 1600]))) > 0.8);
}

/// Answers that a site is always compared with its swapped guide.
struct Swapped;

impl Terms<Upright> for Swapped {
    fn is_swapped(&self, _: Pass, _: usize, _: Place, _: Upright) -> bool {
        true
    }
}

#[test]
fn swapped_guides_are_those_compared() {
    let channel = |name: &str, role| Channel::new(name, 1.0, role);
    let all = vec![channel("grey", Role::Synthesised), channel("a", Role::Guide), channel("b", Role::Guide)];
    let engine = Engine::new(Layout::new(2, all).unwrap(), Settings::default());
    let half = |dark: bool| Plane::from_fn(40, 40, move |x, _| if (x < 20) == dark { 0.2 } else { 0.8 });
    let flat = Plane::filled(40, 40, 0.5);
    let source = [Image { planes: vec![half(true), half(true), flat.clone()], blurred: None }];
    let source = engine.source(&source).unwrap();
    // Guide b of the target says what guide a of the source says.
    let planes = vec![flat.clone(), flat, half(true)];
    let targets = [Target { swapped: vec![(1, 2)], ..Target::new(Image { planes, blurred: None }) }];
    let rule = || -> Box<dyn Constraint<Upright>> { Box::new(Plain { sweeps: 1, near: None }) };
    let mut session = Session::begin(&engine, &source, &targets, &rule, Some(&Swapped), &Silent).unwrap();
    for level in (0..session.levels()).rev() {
        session.enter(level, 0);
        session.work(level, 0, &Silent).unwrap();
    }
    let made = session.finish(0).unwrap().planes.remove(0);
    assert!((made.at(8, 20) - 0.2).abs() < 0.05, "{}", made.at(8, 20));
    assert!((made.at(32, 20) - 0.8).abs() < 0.05, "{}", made.at(32, 20));
}
