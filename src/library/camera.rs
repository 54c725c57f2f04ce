//! Where the camera points over time, followed on what stays recognisable.
//!
//! Fluid changes its texture within a second; a rigid background does not. Textured blocks of a reference frame are
//! looked for in later frames by normalised cross-correlation. Blocks that stay recognisable and move together are
//! background, and their motion is the camera's. Of several such groups the steadiest counts: in front of a fixed
//! camera clouds may sail as one, but nothing fixed to the ground stands still before a moving one. Where a similarity
//! (zoom, roll, a pan with perspective) explains several times as many blocks as any common shift, it counts instead.

use crate::base::rng;
use crate::raster::image::Plane;

/// Frames from one measurement to the next.
pub const STEP: usize = 2;
/// Side of a block, in pixels of the half-size picture.
const BLOCK: usize = 16;
/// Distance between blocks.
const STRIDE: usize = 12;
/// Fewest blocks that make a background.
const MIN_BLOCKS: usize = 8;
/// Least correlation at which a block counts as recognised.
const RECOGNISED: f32 = 0.85;
/// Least texture in every direction: smaller eigenvalue of the mean gradient tensor, of luma in [0, 1].
const MIN_TEXTURE: f32 = 3.0e-5;
/// Search range around a block's last place, half-size pixels.
const REACH: isize = 4;
/// Fewest measurements that make a segment (1 s).
const MIN_SAMPLES: usize = 12;
/// Largest distance between the paths of two blocks of one group, half-size pixels.
const TOGETHER: f32 = 0.75;

/// How far the background has moved, in half-size pixels: at four points amid its blocks, for
/// elsewhere a zoom or roll would be guessed.
pub type Pose = [[f32; 2]; 4];

/// A stretch of the clip over which one background was followed.
#[derive(Debug, Clone, PartialEq)]
pub struct Segment {
    /// First frame; measurements follow every [`STEP`] frames.
    pub start: usize,
    /// Motion of the background since `start`, one per measurement.
    pub path: Vec<Pose>,
    /// Blocks that moved together.
    pub blocks: usize,
}

/// Follows the background through a clip.
#[derive(Debug, Clone, Default)]
pub struct Tracker {
    start: usize,
    blocks: Vec<Block>,
    lost: Vec<Block>,
    size: (usize, usize),
    samples: usize,
    segments: Vec<Segment>,
    rest: usize,
}

/// A block of the reference frame and where it was found since.
#[derive(Debug, Clone)]
struct Block {
    x: isize,
    y: isize,
    /// Zero mean, unit length.
    pattern: [[f32; BLOCK]; BLOCK],
    path: Vec<[f32; 2]>,
    missed: usize,
    /// Measurements until it was last recognised.
    found: usize,
}

impl Tracker {
    /// Takes the half-size luma of frame `frame`, a multiple of [`STEP`].
    pub fn push(&mut self, frame: usize, luma: &Plane) {
        if self.blocks.is_empty() {
            if self.rest > 0 {
                self.rest -= 1;
                return;
            }
            self.begin(frame, luma);
            return;
        }
        self.blocks.iter_mut().for_each(|block| block.follow(luma));
        self.samples += 1;
        let samples = self.samples;
        self.lost.extend(self.blocks.extract_if(.., |block| block.missed > 4 && block.missed * 4 > samples));
        if self.blocks.len() < MIN_BLOCKS {
            self.end();
            self.begin(frame, luma);
        }
    }

    /// The segments of the clip.
    pub fn finish(mut self) -> Vec<Segment> {
        let whole = if self.samples >= MIN_SAMPLES { background(&self.blocks, self.start, self.size) } else { None };
        match whole {
            Some(segment) => self.segments.push(segment),
            None => self.end(),
        }
        self.segments
    }

    fn begin(&mut self, frame: usize, luma: &Plane) {
        self.blocks = blocks(luma);
        (self.start, self.samples, self.size) = (frame, 1, (luma.width, luma.height));
        if self.blocks.len() < MIN_BLOCKS {
            self.blocks.clear();
            self.rest = 5;
        }
    }

    /// Judges the blocks over the longest time for which enough of them lasted, or else a quarter of all.
    fn end(&mut self) {
        let mut blocks = std::mem::take(&mut self.lost);
        blocks.append(&mut self.blocks);
        blocks.sort_by_key(|block| std::cmp::Reverse(block.found));
        let counts = [MIN_BLOCKS + MIN_BLOCKS / 2, blocks.len() / 4];
        let group =
            counts.into_iter().filter(|count| *count > MIN_BLOCKS && *count <= blocks.len()).find_map(|count| {
                let samples = blocks[count - 1].found;
                let lasting = blocks.iter().filter(|block| block.path.len() >= samples && block.found + 2 >= samples);
                let mut lasting: Vec<Block> = lasting.cloned().collect();
                lasting.iter_mut().for_each(|block| block.path.truncate(samples));
                if samples >= MIN_SAMPLES { background(&lasting, self.start, self.size) } else { None }
            });
        self.segments.extend(group);
    }
}

/// The textured blocks of a frame.
fn blocks(luma: &Plane) -> Vec<Block> {
    let places = |side: usize| (REACH as usize..side.saturating_sub(BLOCK + REACH as usize)).step_by(STRIDE);
    let places = places(luma.height).flat_map(|y| places(luma.width).map(move |x| (x, y)));
    places.filter(|&(x, y)| texture(luma, x, y) >= MIN_TEXTURE).filter_map(|(x, y)| Block::new(luma, x, y)).collect()
}

/// Smaller eigenvalue of the gradient tensor: texture in every direction, so that a place is certain in both.
fn texture(luma: &Plane, x: usize, y: usize) -> f32 {
    let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
    for y in y..y + BLOCK {
        for x in x..x + BLOCK {
            let gx = 0.5 * (luma.at(x + 1, y) - luma.at(x - 1, y));
            let gy = 0.5 * (luma.at(x, y + 1) - luma.at(x, y - 1));
            xx += gx * gx;
            xy += gx * gy;
            yy += gy * gy;
        }
    }
    let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
    (mean - (half * half + xy * xy).sqrt()) / (BLOCK * BLOCK) as f32
}

impl Block {
    fn new(luma: &Plane, x: usize, y: usize) -> Option<Self> {
        let mut pattern = [[0.0; BLOCK]; BLOCK];
        for (j, row) in pattern.iter_mut().enumerate() {
            row.copy_from_slice(&luma.row(y + j)[x..x + BLOCK]);
        }
        let mean = pattern.iter().flatten().sum::<f32>() / (BLOCK * BLOCK) as f32;
        pattern.iter_mut().flatten().for_each(|v| *v -= mean);
        let length = pattern.iter().flatten().map(|v| v * v).sum::<f32>().sqrt();
        pattern.iter_mut().flatten().for_each(|v| *v /= length);
        let (x, y) = (x as isize, y as isize);
        (length > 0.0).then(|| Self { x, y, pattern, path: vec![[0.0; 2]], missed: 0, found: 1 })
    }

    /// Looks for the block near its last place.
    fn follow(&mut self, luma: &Plane) {
        let last = self.path.last().copied().unwrap_or_default();
        let start = (last[0].round() as isize, last[1].round() as isize);
        let mut best = self.climb(luma, start);
        if best.1 < RECOGNISED {
            let around = (-REACH..=REACH).flat_map(|dy| (-REACH..=REACH).map(move |dx| (dx, dy)));
            for (dx, dy) in around {
                let place = (start.0 + dx, start.1 + dy);
                let score = self.score(luma, place);
                if score > best.1 {
                    best = (place, score);
                }
            }
            best = self.climb(luma, best.0);
        }
        let found = best.1 >= RECOGNISED;
        self.missed += usize::from(!found);
        self.path.push(if found { self.refine(luma, best) } else { last });
        if found {
            self.found = self.path.len();
        }
    }

    /// Steepest ascent of the correlation over whole pixels.
    fn climb(&self, luma: &Plane, start: (isize, isize)) -> ((isize, isize), f32) {
        let mut best = (start, self.score(luma, start));
        for _ in 0..REACH {
            let centre = best.0;
            for (dx, dy) in [(-1, 0), (1, 0), (0, -1), (0, 1), (-1, -1), (1, -1), (-1, 1), (1, 1)] {
                let place = (centre.0 + dx, centre.1 + dy);
                let score = self.score(luma, place);
                if score > best.1 {
                    best = (place, score);
                }
            }
            if best.0 == centre {
                break;
            }
        }
        best
    }

    /// Place to a fraction of a pixel, by a parabola through the correlation in each direction.
    fn refine(&self, luma: &Plane, ((dx, dy), score): ((isize, isize), f32)) -> [f32; 2] {
        let peak = |low: f32, high: f32| {
            let curve = low + high - 2.0 * score;
            if curve < -1e-6 && low > -1.0 && high > -1.0 { (0.5 * (low - high) / curve).clamp(-0.5, 0.5) } else { 0.0 }
        };
        let x = peak(self.score(luma, (dx - 1, dy)), self.score(luma, (dx + 1, dy)));
        let y = peak(self.score(luma, (dx, dy - 1)), self.score(luma, (dx, dy + 1)));
        [dx as f32 + x, dy as f32 + y]
    }

    /// Normalised cross-correlation with the frame, displaced; −1 outside of it or where it is flat.
    fn score(&self, luma: &Plane, (dx, dy): (isize, isize)) -> f32 {
        let (x, y) = (self.x + dx, self.y + dy);
        let side = BLOCK as isize;
        if x < 0 || y < 0 || x + side > luma.width as isize || y + side > luma.height as isize {
            return -1.0;
        }
        let (mut sum, mut square, mut product) = ([0.0f32; BLOCK], [0.0f32; BLOCK], [0.0f32; BLOCK]);
        for (j, pattern) in self.pattern.iter().enumerate() {
            let row = &luma.row(y as usize + j)[x as usize..x as usize + BLOCK];
            for i in 0..BLOCK {
                sum[i] += row[i];
                square[i] += row[i] * row[i];
                product[i] += row[i] * pattern[i];
            }
        }
        let total = |lanes: [f32; BLOCK]| lanes.iter().sum::<f32>();
        let sum = total(sum);
        let variance = total(square) - sum * sum / (BLOCK * BLOCK) as f32;
        if variance > 1e-5 { total(product) / variance.sqrt() } else { -1.0 }
    }
}

/// Largest distance between two positions of the camera along a path, half-size pixels: per point the diagonal of the
/// box around its positions, and of those the largest.
pub fn extent(path: &[Pose]) -> f32 {
    let span = |point: usize, c: usize| {
        let positions = path.iter().map(|pose| pose[point][c]);
        let (low, high) = positions.fold((f32::MAX, f32::MIN), |(l, h), p| (l.min(p), h.max(p)));
        (high - low).max(0.0)
    };
    (0..4).map(|point| span(point, 0).hypot(span(point, 1))).fold(0.0, f32::max)
}

/// The group of blocks that is the background, if there is one.
fn background(blocks: &[Block], start: usize, size: (usize, usize)) -> Option<Segment> {
    if blocks.len() < MIN_BLOCKS {
        return None;
    }
    let similar = similarity(blocks, size);
    let (group, needed) = match steadiest(blocks) {
        Some(shifted) if !explains(&similar, &shifted) => (shifted, MIN_BLOCKS),
        Some(_) => (similar, MIN_BLOCKS),
        // Twice the unknowns of a shift: a few blocks of drifting haze would do, so twice the witnesses.
        None => (similar, 2 * MIN_BLOCKS),
    };
    (group.members.len() >= needed).then_some(Segment { start, path: group.path, blocks: group.members.len() })
}

/// Blocks that move together, by number, and how.
struct Group {
    members: Vec<usize>,
    path: Vec<Pose>,
}

/// True when `similar` holds most of `shifted` and several times as many more: around the centre of a zoom, blocks
/// stand still together, but a pot that sways before a still wall does not explain the wall.
fn explains(similar: &Group, shifted: &Group) -> bool {
    let shared = shifted.members.iter().filter(|block| similar.members.contains(block)).count();
    similar.members.len() >= 3 * shifted.members.len() && shared * 5 >= 4 * shifted.members.len()
}

/// Of the groups of blocks that share their shifts, the one that moved least.
fn steadiest(blocks: &[Block]) -> Option<Group> {
    let samples = blocks.first()?.path.len();
    let seen: Vec<usize> = (0..samples).step_by(samples.div_ceil(64)).collect();
    let together = |a: &Block, b: &Block| {
        let far = |t: &&usize| (a.path[**t][0] - b.path[**t][0]).hypot(a.path[**t][1] - b.path[**t][1]) > TOGETHER;
        seen.iter().filter(far).count() * 10 <= seen.len()
    };
    let median = |members: &[usize], t: usize, c: usize| {
        let mut values: Vec<f32> = members.iter().map(|&b| blocks[b].path[t][c]).collect();
        values.sort_by(f32::total_cmp);
        values[values.len() / 2]
    };
    let path = |members: &[usize]| -> Vec<Pose> {
        (0..samples).map(|t| [[median(members, t, 0), median(members, t, 1)]; 4]).collect()
    };
    let groups =
        blocks.iter().map(|a| -> Vec<usize> { (0..blocks.len()).filter(|&b| together(a, &blocks[b])).collect() });
    let large = groups.filter(|members| members.len() >= MIN_BLOCKS);
    let groups = large.map(|members| Group { path: path(&members), members });
    groups.min_by(|a, b| extent(&a.path).total_cmp(&extent(&b.path)))
}

/// A position from the centre of the picture, and its displacement.
type Shifted = ([f32; 2], [f32; 2]);

/// Displacement `shift + turn · (position from the centre)`, positions and turn as complex numbers.
#[derive(Debug, Clone, Copy, Default)]
struct Similarity {
    shift: [f32; 2],
    turn: [f32; 2],
}

impl Similarity {
    fn at(&self, [x, y]: [f32; 2]) -> [f32; 2] {
        let [a, b] = self.turn;
        [self.shift[0] + a * x - b * y, self.shift[1] + b * x + a * y]
    }

    /// Least squares over (position, displacement).
    fn fit(pairs: &[Shifted]) -> Self {
        let n = pairs.len().max(1) as f32;
        let mean = |f: &dyn Fn(&Shifted) -> f32| pairs.iter().map(f).sum::<f32>() / n;
        let (p, d) = ([mean(&|q| q.0[0]), mean(&|q| q.0[1])], [mean(&|q| q.1[0]), mean(&|q| q.1[1])]);
        let (mut re, mut im, mut square) = (0.0, 0.0, 1e-6);
        for (q, e) in pairs {
            let (x, y, u, v) = (q[0] - p[0], q[1] - p[1], e[0] - d[0], e[1] - d[1]);
            re += x * u + y * v;
            im += x * v - y * u;
            square += x * x + y * y;
        }
        let turned = Self { shift: [0.0; 2], turn: [re / square, im / square] };
        let moved = turned.at(p);
        Self { shift: [d[0] - moved[0], d[1] - moved[1]], ..turned }
    }
}

/// The most blocks that one similarity explains at the end. Nearer and farther things part in a pan, so what moves
/// far may differ by a tenth of its motion.
fn similarity(blocks: &[Block], (width, height): (usize, usize)) -> Group {
    const TRIES: u64 = 500;
    let samples = blocks.first().map_or(0, |b| b.path.len());
    let half = BLOCK as f32 / 2.0;
    let place = |b: &Block| [b.x as f32 + half - width as f32 / 2.0, b.y as f32 + half - height as f32 / 2.0];
    let fit = |members: &[usize], t: usize| {
        Similarity::fit(&members.iter().map(|&b| (place(&blocks[b]), blocks[b].path[t])).collect::<Vec<_>>())
    };
    let near = |model: &Similarity, b: &Block, t: usize| {
        let at = model.at(place(b));
        (at[0] - b.path[t][0]).hypot(at[1] - b.path[t][1]) <= TOGETHER + 0.1 * at[0].hypot(at[1])
    };
    let mut best: Vec<usize> = Vec::new();
    for attempt in 0..TRIES {
        let pick = |k: u64| rng::below(rng::hash(k, &[attempt]), blocks.len() as u64) as usize;
        let (a, b) = (pick(0), pick(1));
        // Neighbours overlap and say little about zoom and roll.
        if (blocks[a].x - blocks[b].x).abs() + (blocks[a].y - blocks[b].y).abs() < 3 * BLOCK as isize {
            continue;
        }
        let model = fit(&[a, b], samples - 1);
        let members: Vec<usize> = (0..blocks.len()).filter(|&i| near(&model, &blocks[i], samples - 1)).collect();
        if members.len() > best.len() {
            best = members;
        }
    }
    let places: Vec<[f32; 2]> = best.iter().map(|&b| place(&blocks[b])).collect();
    let spread = |c: usize| {
        let n = places.len().max(1) as f32;
        let mean = places.iter().map(|p| p[c]).sum::<f32>() / n;
        (mean, (places.iter().map(|p| (p[c] - mean).powi(2)).sum::<f32>() / n).sqrt())
    };
    let ((x, w), (y, h)) = (spread(0), spread(1));
    let pose = |t: usize| {
        let model = fit(&best, t);
        let kept: Vec<usize> = best.iter().copied().filter(|&b| near(&model, &blocks[b], t)).collect();
        let model = if kept.len() * 2 >= best.len() { fit(&kept, t) } else { model };
        [[x - w, y - h], [x + w, y - h], [x - w, y + h], [x + w, y + h]].map(|point| model.at(point))
    };
    let path = (0..samples).map(pose).collect();
    Group { members: best, path }
}
