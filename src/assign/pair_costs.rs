//! The smoothness term: how well two candidates of neighbouring nodes move together (Okabe et al. 2011, §5.2).
//!
//! `W(a, b) = d(DC)/N_dc + σ d(log₂ AC)/N_ac + ρ d(log₂ T)/N_t`, each `d` a mean of squared distances over the cells of
//! the overlap Ω that move in both pieces. The paper sums over Ω; with masks a sum would favour pieces that hardly move,
//! so the mean is taken instead. Where no cell moves in both there is nothing to compare, and the pair costs
//! `1 + σ + ρ`, what a random pair of neighbours costs (each N is the median of its distance over such pairs).
//!
//! All pairs of an edge at once are one matrix product: `Σ m_a m_b ‖a − b‖² = Σ (m_a‖a‖²) m_b + m_a (m_b‖b‖²) − 2 (m_a a)(m_b b)`.

use std::collections::BTreeMap;
use std::ops::Range;

use super::nodes::{Edge, Node, NodeGrid};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::base::{matmul, par};
use crate::library::normalizers::{self, AC, DC, FEATURES, Normalizers, TEXTURE};
use crate::library::tile::Tile;
use crate::library::variant::{CELL, PIECE, PIECE_CELLS};

/// Most pair costs that are kept (2 GiB).
const MAX_COSTS: usize = 1 << 29;
/// Edges whose costs are computed between two checks for a cancel.
const BATCH: usize = 32;
/// Numbers per cell and candidate in an edge's product: the features, ‖a‖² and the mask.
const TERMS: usize = FEATURES + 2;
/// Typical log₂ power and log₂ textureness, subtracted from all: distances stay, rounding shrinks.
const TYPICAL_LOG: f32 = -7.0;

/// Weights of the smoothness term's parts, pure numbers (see [`Normalizers`]).
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Weights {
    /// σ: the spectrum's weight against the mean motion's (Okabe et al. 2011, Eq. 3), default 1.
    pub sigma: f32,
    /// ρ: the textureness' weight (Okabe et al. 2011, Eq. 2), default 1.
    pub rho: f32,
}

impl Default for Weights {
    fn default() -> Self {
        Self { sigma: 1.0, rho: 1.0 }
    }
}

/// Where a candidate comes from: two candidates of one footage whose positions differ as their nodes do continue each
/// other exactly.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Origin {
    /// A number for (library, clip, variant).
    pub footage: u32,
    /// Left edge on the variant's canvas, pixels.
    pub x: u16,
    /// Top edge on the variant's canvas, pixels.
    pub y: u16,
}

/// The costs of all candidate pairs of all edges.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct PairCosts {
    /// The two nodes of every edge; they differ.
    pub edges: Vec<[u32; 2]>,
    /// Per edge: where its table lies in `costs`. Edges may share a table.
    pub tables: Vec<Range<usize>>,
    /// Per table a row for every candidate of the edge's first node, in it an entry for every candidate of its second.
    pub costs: Vec<f32>,
}

impl PairCosts {
    /// Costs of edge `e`, row by row.
    pub fn of(&self, e: usize) -> &[f32] {
        &self.costs[self.tables[e].clone()]
    }
}

/// Computes the costs of all edges of `grid`. Node `n` has candidates `offsets[n]..offsets[n + 1]`, entries of
/// `origins`; `tile` gives the cells of an entry's piece.
///
/// # Errors
/// Those of `tile`; too many pairs to keep; a cancel.
pub fn pair_costs(
    grid: &NodeGrid,
    offsets: &[usize],
    origins: &[Origin],
    tile: impl Fn(usize) -> Result<Tile> + Sync + Send,
    normalizers: &Normalizers,
    weights: Weights,
    observer: &dyn Observer,
) -> Result<PairCosts> {
    let mut out = allocate(grid, offsets)?;
    let scale = Scale::new(normalizers, weights);
    let last_use = last_uses(&grid.edges);
    let describe = |n: u32| describe_all(offsets[n as usize]..offsets[n as usize + 1], &tile, &scale);
    let mut described: BTreeMap<u32, Vec<Described>> = BTreeMap::new();
    observe::stage(observer, "pair costs", grid.edges.len() as u64, || {
        for (batch, edges) in grid.edges.chunks(BATCH).enumerate() {
            observe::check(observer)?;
            let mut new: Vec<u32> = edges.iter().flat_map(|e| [e.a, e.b]).collect();
            new.retain(|n| !described.contains_key(n));
            new.sort_unstable();
            new.dedup();
            let found = par::try_map(new.len(), |i| describe(new[i]))?;
            described.extend(new.into_iter().zip(found));
            let costs = par::map(edges.len(), |i| {
                let Edge { a, b, .. } = edges[i];
                let mut costs = edge_costs(&edges[i], &grid.nodes, &described[&a], &described[&b], scale.unknown);
                let of = |n: u32| &origins[offsets[n as usize]..offsets[n as usize + 1]];
                same_footage(&edges[i], &grid.nodes, of(a), of(b), scale.unknown, &mut costs);
                costs
            });
            for (i, costs) in costs.iter().enumerate() {
                let e = batch * BATCH + i;
                out.costs[out.tables[e].clone()].copy_from_slice(costs);
            }
            let done = batch * BATCH + edges.len();
            described.retain(|n, _| last_use.get(n).is_some_and(|&last| last >= done));
            observer.advance("pair costs", edges.len() as u64);
        }
        Ok(())
    })?;
    Ok(out)
}

fn allocate(grid: &NodeGrid, offsets: &[usize]) -> Result<PairCosts> {
    let count = |n: u32| offsets[n as usize + 1] - offsets[n as usize];
    let mut out = PairCosts { edges: grid.edges.iter().map(|e| [e.a, e.b]).collect(), ..PairCosts::default() };
    let mut total = 0usize;
    for edge in &grid.edges {
        let start = total;
        total = total.saturating_add(count(edge.a).saturating_mul(count(edge.b)));
        out.tables.push(start..total);
    }
    if total > MAX_COSTS {
        return Err(Error::new(Kind::Limit, "candidates", format!("{total} pairs of candidates are too many"))
            .allowed(format!("up to {MAX_COSTS} pairs"))
            .remedy("take fewer candidates, or a smaller working size"));
    }
    out.costs.resize(total, 0.0);
    Ok(out)
}

/// Number of the last edge that each node has.
fn last_uses(edges: &[Edge]) -> BTreeMap<u32, usize> {
    edges.iter().enumerate().flat_map(|(i, e)| [(e.a, i), (e.b, i)]).collect()
}

/// Factors that make the weighted, normalised distances plain squared distances.
struct Scale {
    factors: [f32; FEATURES],
    /// Cost of a pair without common cells.
    unknown: f32,
}

impl Scale {
    fn new(normalizers: &Normalizers, weights: Weights) -> Self {
        let mut factors = [0.0; FEATURES];
        factors[DC].fill((1.0 / normalizers.dc).sqrt());
        factors[AC].fill((weights.sigma / normalizers.ac).sqrt());
        factors[TEXTURE].fill((weights.rho / normalizers.texture).sqrt());
        Self { factors, unknown: 1.0 + weights.sigma + weights.rho }
    }
}

/// A piece's cells as the products need them: scaled features, their squared length, and 1; all 0 in cells that do
/// not count.
struct Described {
    cells: Vec<[f32; TERMS]>,
}

fn describe_all(
    entries: std::ops::Range<usize>,
    tile: &(impl Fn(usize) -> Result<Tile> + Sync + Send),
    scale: &Scale,
) -> Result<Vec<Described>> {
    entries.map(|entry| Ok(describe(&tile(entry)?, scale))).collect()
}

fn describe(tile: &Tile, scale: &Scale) -> Described {
    let mut cells = vec![[0.0; TERMS]; tile.cells.len()];
    normalizers::features_of(&tile.cells, &mut cells);
    for (out, cell) in cells.iter_mut().zip(&tile.cells) {
        if !normalizers::counts(cell) {
            *out = [0.0; TERMS];
            continue;
        }
        for (i, (value, factor)) in out.iter_mut().zip(&scale.factors).enumerate() {
            let centre = if DC.contains(&i) { 0.0 } else { TYPICAL_LOG };
            *value = factor * (*value - centre);
        }
        out[FEATURES] = out[..FEATURES].iter().map(|v| v * v).sum();
        out[FEATURES + 1] = 1.0;
    }
    Described { cells }
}

/// Costs of all pairs of one edge.
fn edge_costs(edge: &Edge, nodes: &[Node], a: &[Described], b: &[Described], unknown: f32) -> Vec<f32> {
    let (cells_a, cells_b) = (shared_cells(edge, &nodes[edge.a as usize]), shared_cells(edge, &nodes[edge.b as usize]));
    let shared = cells_a.len();
    let (mut left, mut mask_left) = (Vec::new(), Vec::new());
    for cell in a.iter().flat_map(|d| cells_a.iter().map(|&c| &d.cells[c])) {
        left.extend_from_slice(cell);
        mask_left.push(cell[FEATURES + 1]);
    }
    let (mut right, mut mask_right) = (Vec::new(), Vec::new());
    for cell in b.iter().flat_map(|d| cells_b.iter().map(|&c| &d.cells[c])) {
        right.extend(cell[..FEATURES].iter().map(|v| -2.0 * v));
        right.extend([cell[FEATURES + 1], cell[FEATURES]]);
        mask_right.push(cell[FEATURES + 1]);
    }
    let (mut sums, mut counts) = (vec![0.0; a.len() * b.len()], vec![0.0; a.len() * b.len()]);
    matmul::a_bt(a.len(), b.len(), shared * TERMS, &left, &right, &mut sums);
    matmul::a_bt(a.len(), b.len(), shared, &mask_left, &mask_right, &mut counts);
    sums.iter_mut().zip(&counts).for_each(|(s, &n)| *s = if n > 0.0 { s.max(0.0) / n } else { unknown });
    sums
}

/// Numbers of a node's cells that lie in the edge's overlap, row by row.
fn shared_cells(edge: &Edge, node: &Node) -> Vec<usize> {
    let cell = |v: u32| v as usize / CELL;
    let (x, y) = (cell(edge.overlap.x - node.x), cell(edge.overlap.y - node.y));
    let (width, height) = (cell(edge.overlap.width), cell(edge.overlap.height));
    (y..y + height).flat_map(|y| (x..x + width).map(move |x| y * PIECE_CELLS + x)).collect()
}

/// A number for every entry, equal for those that would lay one footage over the grid at one offset: neighbours among
/// them continue each other at no cost, so they are worth proposing together.
pub fn continuations(grid: &NodeGrid, offsets: &[usize], origins: &[Origin]) -> Vec<u32> {
    let mut numbers = BTreeMap::new();
    let mut number = |(node, origin): (&Node, &Origin)| {
        let at = |piece: u16, node: u32| i64::from(piece) - i64::from(node);
        let key = (origin.footage, at(origin.x, node.x), at(origin.y, node.y));
        let next = numbers.len() as u32;
        *numbers.entry(key).or_insert(next)
    };
    let of = |n: usize| origins[offsets[n]..offsets[n + 1]].iter().map(move |o| (&grid.nodes[n], o));
    (0..grid.nodes.len()).flat_map(of).map(&mut number).collect()
}

/// What neighbours from one clip cost: nothing where they continue each other, as much as strangers (1 + σ + ρ) on top
/// where both show the same place, displaced. Without the second a piece is stamped node by node, in lockstep.
fn same_footage(edge: &Edge, nodes: &[Node], a: &[Origin], b: &[Origin], stranger: f32, costs: &mut [f32]) {
    let (from, to) = (&nodes[edge.a as usize], &nodes[edge.b as usize]);
    let (dx, dy) = (i64::from(to.x) - i64::from(from.x), i64::from(to.y) - i64::from(from.y));
    for (row, p) in costs.chunks_exact_mut(b.len().max(1)).zip(a) {
        for (cost, q) in row.iter_mut().zip(b).filter(|(_, q)| p.footage == q.footage) {
            let apart = (i64::from(q.x) - i64::from(p.x), i64::from(q.y) - i64::from(p.y));
            if apart == (dx, dy) {
                *cost = 0.0;
            } else if apart.0.abs().max(apart.1.abs()) < PIECE as i64 {
                *cost += stranger;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use half::f16;

    use super::*;
    use crate::base::observe::Silent;
    use crate::base::rng;
    use crate::library::grid::Cell;
    use crate::raster::image::Plane;

    /// A random piece, `moving` of whose cells count.
    fn random_tile(seed: u64, moving: f32) -> Tile {
        let cell = |i: usize| {
            let random = |k: u64| rng::unit(rng::hash(seed, &[i as u64, k]));
            Cell {
                mean: [0, 1].map(|k| f16::from_f32(4.0 * random(k) - 2.0)),
                spectrum: std::array::from_fn(|k| f16::from_f32(random(10 + k as u64))),
                textureness: std::array::from_fn(|k| f16::from_f32(0.1 * random(40 + k as u64))),
                activity: f16::ONE,
                significant: f16::from_f32(if random(50) < moving { 1.0 } else { 0.2 }),
            }
        };
        Tile { cells: std::array::from_fn(cell) }
    }

    /// The cost of one pair from its definition; cells by their picture coordinates.
    fn naive(edge: &Edge, nodes: &[Node], a: &Tile, b: &Tile, n: &Normalizers, w: Weights) -> f64 {
        let (mut sum, mut count) = (0.0f64, 0);
        let r = edge.overlap;
        for (y, x) in
            (r.y..r.y + r.height).step_by(4).flat_map(|y| (r.x..r.x + r.width).step_by(4).map(move |x| (y, x)))
        {
            let cell = |t: &Tile, node: u32| {
                let node = nodes[node as usize];
                t.cells[((y - node.y) / 4 * 12 + (x - node.x) / 4) as usize]
            };
            let (p, q) = (cell(a, edge.a), cell(b, edge.b));
            if normalizers::counts(&p) && normalizers::counts(&q) {
                let (f, g) = (normalizers::features(&p), normalizers::features(&q));
                let d = |r: std::ops::Range<usize>| r.map(|i| f64::from(f[i] - g[i]).powi(2)).sum::<f64>();
                sum += d(DC) / f64::from(n.dc)
                    + f64::from(w.sigma) * d(AC) / f64::from(n.ac)
                    + f64::from(w.rho) * d(TEXTURE) / f64::from(n.texture);
                count += 1;
            }
        }
        if count == 0 { f64::from(1.0 + w.sigma + w.rho) } else { sum / f64::from(count) }
    }

    #[test]
    fn products_equal_the_definition() {
        let grid = NodeGrid::over(&Plane::filled(96, 72, 1.0), 0.5).unwrap();
        let counts: Vec<usize> = (0..grid.nodes.len()).map(|n| 1 + n % 4).collect();
        let offsets: Vec<usize> = (0..=counts.len()).map(|n| counts[..n].iter().sum()).collect();
        let total = offsets[counts.len()];
        let tiles: Vec<Tile> = (0..total).map(|i| random_tile(i as u64, [0.0, 0.1, 0.6, 1.0][i % 4])).collect();
        let origins: Vec<Origin> = (0..total).map(|i| Origin { footage: i as u32, x: 0, y: 0 }).collect();
        let normalizers = Normalizers { dc: 1.7, ac: 30.0, texture: 5.0 };
        let weights = Weights { sigma: 0.7, rho: 2.0 };
        let tile = |i: usize| Ok(tiles[i].clone());
        let found = pair_costs(&grid, &offsets, &origins, tile, &normalizers, weights, &Silent).unwrap();
        assert_eq!(found.edges.len(), grid.edges.len());
        for (e, edge) in grid.edges.iter().enumerate() {
            let (a, b) = (edge.a as usize, edge.b as usize);
            assert_eq!(found.of(e).len(), counts[a] * counts[b]);
            for (i, j) in (0..counts[a]).flat_map(|i| (0..counts[b]).map(move |j| (i, j))) {
                let (p, q) = (&tiles[offsets[a] + i], &tiles[offsets[b] + j]);
                let expected = naive(edge, &grid.nodes, p, q, &normalizers, weights);
                let cost = f64::from(found.of(e)[i * counts[b] + j]);
                assert!((cost - expected).abs() < 1e-3 * expected.max(1.0), "edge {e} {i},{j}: {cost} for {expected}");
            }
        }
    }

    #[test]
    fn a_continuation_costs_nothing_and_like_pieces_almost_nothing() {
        let grid = NodeGrid::over(&Plane::filled(72, 48, 1.0), 0.5).unwrap();
        let [left, right] = [Origin { footage: 3, x: 8, y: 4 }, Origin { footage: 3, x: 32, y: 4 }];
        let origins = [left, right, Origin { footage: 4, ..right }, Origin { x: 36, ..right }];
        let flat = random_tile(1, 1.0).cells[0];
        let tiles = [random_tile(1, 1.0), random_tile(2, 1.0), random_tile(3, 1.0), Tile { cells: [flat; 144] }];
        let tile = |i: usize| Ok(tiles[i].clone());
        let costs = pair_costs(&grid, &[0, 1, 4], &origins, tile, &Normalizers::default(), Weights::default(), &Silent)
            .unwrap();
        assert_eq!(costs.costs.len(), 3);
        assert_eq!(costs.costs[0], 0.0);
        assert!(costs.costs[1] > 0.1 && costs.costs[2] > 0.1);
        let same = |_: usize| Ok(Tile { cells: [flat; 144] });
        let costs = pair_costs(&grid, &[0, 1, 4], &origins, same, &Normalizers::default(), Weights::default(), &Silent)
            .unwrap();
        assert!(costs.costs[..2].iter().all(|&c| (0.0..1e-3).contains(&c)), "{:?}", costs.costs);
        // The same place of the same footage again, displaced: as dear as a stranger, however alike it looks.
        assert!(costs.costs[2] >= 3.0, "{:?}", costs.costs);
    }
}
