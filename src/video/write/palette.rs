//! Few colours for a whole video, and a dither that stays put.
//!
//! The palette splits the box of colours with the largest squared error at its mean until there are enough (after Wu
//! 1991), then k-means. The dither follows Knoll's pattern dithering: every colour has a short list of palette entries
//! whose mean it is, and a blue-noise threshold of the place picks one. Equal pixels give equal indices in every frame,
//! so nothing still flickers.

use macro_rules_attribute::apply;

use crate::base::instructions::kernel;
use crate::base::par;

/// Bits of each channel that the histogram keeps apart.
const BITS: u32 = 6;
/// Colours that the histogram keeps apart.
const CELLS: usize = 1 << (3 * BITS);
/// Palette entries in a colour's list.
const LIST: usize = 16;
/// Side of the square of thresholds, in pixels.
const TILE: usize = 32;
/// Rounds of k-means.
const ROUNDS: usize = 4;
/// Palette entries compared with a colour at once.
const LANES: usize = 16;
/// Weight of red, green and blue differences: the roots of the eye's sensitivity to them.
const WEIGHTS: [f32; 3] = [0.55, 0.77, 0.33];

/// Cell of a colour.
fn cell(rgb: &[u8]) -> usize {
    let top = |v: u8| usize::from(v >> (8 - BITS));
    top(rgb[0]) << (2 * BITS) | top(rgb[1]) << BITS | top(rgb[2])
}

/// Colours seen, counted.
#[derive(Debug)]
pub(super) struct Histogram(Vec<(u64, [u64; 3])>);

impl Histogram {
    /// Nothing seen.
    pub fn new() -> Self {
        Self(vec![(0, [0; 3]); CELLS])
    }

    /// Counts packed RGB pixels.
    pub fn add(&mut self, rgb: &[u8]) {
        for pixel in rgb.chunks_exact(3) {
            let (count, sums) = &mut self.0[cell(pixel)];
            *count += 1;
            sums.iter_mut().zip(pixel).for_each(|(sum, &v)| *sum += u64::from(v));
        }
    }

    /// Occupied cells, as weighted mean colour.
    fn points(&self) -> Vec<Point> {
        let point = |(cell, (count, sums)): (usize, &(u64, [u64; 3]))| Point {
            cell,
            count: *count as f64,
            colour: std::array::from_fn(|c| sums[c] as f32 / *count as f32 * WEIGHTS[c]),
        };
        self.0.iter().enumerate().filter(|(_, (count, _))| *count > 0).map(point).collect()
    }
}

#[derive(Debug, Clone, Copy)]
struct Point {
    cell: usize,
    count: f64,
    colour: [f32; 3],
}

/// Mean, weighted squared error per channel, of some points.
fn moments(points: &[Point]) -> ([f32; 3], [f64; 3]) {
    let total: f64 = points.iter().map(|p| p.count).sum();
    let sum = |f: &dyn Fn(&Point) -> f64| points.iter().map(|p| p.count * f(p)).sum::<f64>();
    let mean: [f64; 3] = std::array::from_fn(|c| sum(&|p| f64::from(p.colour[c])) / total);
    let error = std::array::from_fn(|c| sum(&|p| (f64::from(p.colour[c]) - mean[c]).powi(2)));
    (mean.map(|m| m as f32), error)
}

/// At most `colours` mean colours of the points (weighted), reordering them.
fn split(points: &mut [Point], colours: usize) -> Vec<[f32; 3]> {
    let mut boxes = vec![(0..points.len(), moments(points))];
    while boxes.len() < colours {
        let error = |(_, (_, error)): &(_, (_, [f64; 3]))| error.iter().sum::<f64>();
        let worst = (0..boxes.len()).max_by(|&a, &b| error(&boxes[a]).total_cmp(&error(&boxes[b]))).unwrap_or(0);
        let (range, (mean, errors)) = boxes[worst].clone();
        if errors.iter().sum::<f64>() <= 0.0 {
            break;
        }
        let axis = (0..3).max_by(|&a, &b| errors[a].total_cmp(&errors[b])).unwrap_or(0);
        let part = &mut points[range.clone()];
        part.sort_unstable_by(|a, b| a.colour[axis].total_cmp(&b.colour[axis]).then(a.cell.cmp(&b.cell)));
        // Rounding of the mean must not leave a side empty.
        let cut = part.partition_point(|p| p.colour[axis] <= mean[axis]).clamp(1, part.len() - 1);
        let middle = range.start + cut;
        boxes[worst] = (range.start..middle, moments(&points[range.start..middle]));
        boxes.push((middle..range.end, moments(&points[middle..range.end])));
    }
    boxes.into_iter().map(|(_, (mean, _))| mean).collect()
}

/// Entries of a palette, channel by channel, [`LANES`] entries together.
struct Entries(Vec<[[f32; LANES]; 3]>);

impl Entries {
    fn of(palette: &[[f32; 3]]) -> Self {
        // What fills up the last lanes is far from every colour.
        let entry = |i: usize, c: usize| palette.get(i).map_or(f32::INFINITY, |entry| entry[c]);
        let block = |b: usize| std::array::from_fn(|c| std::array::from_fn(|lane| entry(b * LANES + lane, c)));
        Self((0..palette.len().div_ceil(LANES)).map(block).collect())
    }

    /// Number of the entry nearest to a colour, the first of several.
    fn nearest(&self, colour: [f32; 3]) -> usize {
        nearest(&self.0, colour)
    }
}

#[apply(kernel)]
fn nearest(blocks: &[[[f32; LANES]; 3]], colour: [f32; 3]) -> usize {
    let (mut least, mut of) = ([f32::INFINITY; LANES], [0u32; LANES]);
    for (block, [red, green, blue]) in (0..).zip(blocks) {
        for lane in 0..LANES {
            let (r, g, b) = (red[lane] - colour[0], green[lane] - colour[1], blue[lane] - colour[2]);
            let distance = r * r + g * g + b * b;
            let nearer = distance < least[lane];
            least[lane] = if nearer { distance } else { least[lane] };
            of[lane] = if nearer { block } else { of[lane] };
        }
    }
    let found = (0..LANES).map(|lane| (least[lane], of[lane] as usize * LANES + lane));
    found.min_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1))).map_or(0, |(_, entry)| entry)
}

/// Moves the entries to the means of the colours nearest to them.
fn refine(points: &[Point], palette: &mut [[f32; 3]]) {
    for _ in 0..ROUNDS {
        let entries = Entries::of(palette);
        let owners = par::map(points.len(), |i| entries.nearest(points[i].colour));
        let mut sums = vec![(0.0, [0.0; 3]); palette.len()];
        for (point, owner) in points.iter().zip(owners) {
            let (count, sum) = &mut sums[owner];
            *count += point.count;
            (0..3).for_each(|c| sum[c] += point.count * f64::from(point.colour[c]));
        }
        for (entry, (count, sum)) in palette.iter_mut().zip(sums).filter(|(_, (count, _))| *count > 0.0) {
            *entry = std::array::from_fn(|c| (sum[c] / count) as f32);
        }
    }
}

/// A palette, and the dither to it.
#[derive(Debug)]
pub(super) struct Palette {
    /// Red, green, blue of every entry.
    pub rgb: Vec<u8>,
    /// Number in `lists` of every cell.
    list_of: Vec<u32>,
    lists: Vec<[u8; LIST]>,
    thresholds: Vec<u8>,
}

impl Palette {
    /// At most `colours` (at most 256) for the colours in a histogram.
    pub fn new(histogram: &Histogram, colours: usize) -> Self {
        let mut points = histogram.points();
        if points.is_empty() {
            points.push(Point { cell: 0, count: 1.0, colour: [0.0; 3] });
        }
        let mut entries = split(&mut points, colours.clamp(1, 256));
        refine(&points, &mut entries);
        let byte = |v: f32, c: usize| (v / WEIGHTS[c]).round().clamp(0.0, 255.0) as u8;
        let rgb: Vec<u8> = entries.iter().flat_map(|e| std::array::from_fn::<u8, 3, _>(|c| byte(e[c], c))).collect();
        // What will be shown is the rounded colour.
        let entry = |p: &[u8]| std::array::from_fn(|c| f32::from(p[c]) * WEIGHTS[c]);
        let entries: Vec<[f32; 3]> = rgb.chunks_exact(3).map(entry).collect();
        let lanes = Entries::of(&entries);
        let lists = par::map(points.len(), |i| list(&entries, &lanes, points[i].colour));
        let mut list_of = vec![0; CELLS];
        points.iter().enumerate().for_each(|(i, point)| list_of[point.cell] = i as u32);
        Self { rgb, list_of, lists, thresholds: thresholds() }
    }

    /// Palette indices of packed RGB pixels of an image `width` wide.
    pub fn dither(&self, rgb: &[u8], width: usize) -> Vec<u8> {
        let mut out = Vec::with_capacity(rgb.len() / 3);
        for (y, row) in rgb.chunks_exact(3 * width).enumerate() {
            let thresholds = &self.thresholds[y % TILE * TILE..][..TILE];
            let places = row.chunks_exact(3).zip(thresholds.iter().cycle());
            out.extend(places.map(|(p, &t)| self.lists[self.list_of[cell(p)] as usize][usize::from(t)]));
        }
        out
    }
}

/// Entries whose mean is near `colour`, dark to light; `lanes` holds the palette once more, for the search.
fn list(palette: &[[f32; 3]], lanes: &Entries, colour: [f32; 3]) -> [u8; LIST] {
    let mut error = [0.0; 3];
    let mut picked = [0; LIST];
    for slot in &mut picked {
        let best = lanes.nearest(std::array::from_fn(|c| colour[c] + error[c]));
        *slot = best as u8;
        (0..3).for_each(|c| error[c] += colour[c] - palette[best][c]);
    }
    let luma = |i: u8| palette[usize::from(i)].iter().zip(WEIGHTS).map(|(v, w)| v * w).sum::<f32>();
    picked.sort_by(|&a, &b| luma(a).total_cmp(&luma(b)).then(a.cmp(&b)));
    picked
}

/// A tile of thresholds in `0..LIST` without low frequencies: every next place is the one farthest from those before
/// (the last phase of Ulichney's void-and-cluster, 1993).
fn thresholds() -> Vec<u8> {
    let wrapped = |d: usize| d.min(TILE - d) as f64;
    let kernel = |dx: usize, dy: usize| (-(wrapped(dx).powi(2) + wrapped(dy).powi(2)) / 4.5).exp();
    let table: Vec<f64> = (0..TILE * TILE).map(|i| kernel(i % TILE, i / TILE)).collect();
    let mut crowding = vec![0.0f64; TILE * TILE];
    let mut out = vec![0; TILE * TILE];
    for rank in 0..TILE * TILE {
        let next = (0..TILE * TILE).min_by(|&a, &b| crowding[a].total_cmp(&crowding[b])).unwrap_or(0);
        out[next] = (rank * LIST / (TILE * TILE)) as u8;
        let (nx, ny) = (next % TILE, next / TILE);
        for (i, value) in crowding.iter_mut().enumerate() {
            *value += table[(i / TILE).abs_diff(ny) * TILE + (i % TILE).abs_diff(nx)];
        }
        crowding[next] = f64::INFINITY;
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_colours_are_kept_exactly() {
        let rgb: Vec<u8> = (0..200u32).flat_map(|i| [(i * 5 % 256) as u8, 17, (i * 11 % 256) as u8]).collect();
        let mut histogram = Histogram::new();
        histogram.add(&rgb);
        let palette = Palette::new(&histogram, 255);
        let back: Vec<u8> =
            palette.dither(&rgb, 200).iter().flat_map(|&i| palette.rgb[usize::from(i) * 3..][..3].to_vec()).collect();
        assert!(back.iter().zip(&rgb).all(|(a, b)| a.abs_diff(*b) <= 3));
    }

    #[test]
    fn the_mean_of_a_dithered_ramp_is_right() {
        let (width, height) = (256, 64);
        let rgb: Vec<u8> = (0..height).flat_map(|_| (0..width).flat_map(|x| [x as u8; 3])).collect();
        let mut histogram = Histogram::new();
        histogram.add(&rgb);
        let palette = Palette::new(&histogram, 8);
        assert!(palette.rgb.len() <= 24);
        let indices = palette.dither(&rgb, width);
        for x in (24..232).step_by(16) {
            let column = |x: usize| (0..height).map(move |y| y * width + x);
            let values = (x..x + 8).flat_map(column).map(|i| f64::from(palette.rgb[usize::from(indices[i]) * 3]));
            let mean = values.sum::<f64>() / (8 * height) as f64;
            assert!((mean - (x as f64 + 3.5)).abs() < 4.0, "{x}: {mean}");
        }
    }

    #[test]
    fn the_nearest_entry_is_the_first_of_the_nearest() {
        let grey = |v: usize| [v as f32; 3];
        let palette: Vec<[f32; 3]> = (0..77).map(|i| grey(10 * (i % 40))).collect();
        let entries = Entries::of(&palette);
        for v in 0..400 {
            let distance = |i: &usize| palette[*i][0].max(v as f32) - palette[*i][0].min(v as f32);
            let expected = (0..77).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            assert_eq!(entries.nearest(grey(v)), expected, "{v}");
        }
    }

    #[test]
    fn thresholds_are_balanced_and_without_clumps() {
        let tile = thresholds();
        for level in 0..LIST {
            assert_eq!(tile.iter().filter(|&&t| usize::from(t) == level).count(), TILE * TILE / LIST);
        }
        // Places of the lowest level are a sixteenth: well spread, none touches another.
        let low = |x: usize, y: usize| tile[y % TILE * TILE + x % TILE] == 0;
        let touching = (0..TILE * TILE).filter(|i| low(i % TILE, i / TILE) && low(i % TILE + 1, i / TILE)).count();
        assert_eq!(touching, 0);
    }
}
