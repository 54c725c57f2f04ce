//! Minimum cuts by augmenting paths from two search trees that are kept (Boykov & Kolmogorov 2004), on small sparse
//! graphs with whole-number capacities.

use std::collections::VecDeque;

/// No arc.
const NONE: u32 = u32::MAX;
/// In place of the arc to a node's parent: the node hangs on a terminal.
const TERMINAL: u32 = u32::MAX - 1;
/// In place of the arc to a node's parent: the node has lost it.
const ORPHAN: u32 = u32::MAX - 2;
const FAR: u32 = u32::MAX;

/// A graph between a source and a sink.
#[derive(Debug, Clone, Default)]
pub struct Graph {
    nodes: Vec<Node>,
    /// An arc and its opposite stand side by side: `a ^ 1` is the opposite of `a`.
    arcs: Vec<Arc>,
    active: VecDeque<u32>,
    orphans: VecDeque<u32>,
    time: u32,
}

#[derive(Debug, Clone, Copy)]
struct Node {
    /// Residual capacity from the source when positive, to the sink when negative.
    terminal: i64,
    first: u32,
    /// Arc towards the root of the node's tree, or a marker.
    parent: u32,
    sink: bool,
    active: bool,
    /// When `distance` to the root was known to hold.
    time: u32,
    distance: u32,
}

#[derive(Debug, Clone, Copy)]
struct Arc {
    head: u32,
    next: u32,
    residual: i64,
}

impl Graph {
    /// Back to `nodes` nodes and no arcs.
    pub fn reset(&mut self, nodes: usize) {
        let node = Node { terminal: 0, first: NONE, parent: NONE, sink: false, active: false, time: 0, distance: 0 };
        self.nodes.clear();
        self.nodes.resize(nodes, node);
        self.arcs.clear();
        self.active.clear();
        self.orphans.clear();
        self.time = 0;
    }

    /// Adds a capacity from the source (`capacity` > 0) or to the sink (`capacity` < 0). What runs from the source
    /// through the node to the sink is left out: it does not change which cut is least.
    pub fn add_terminal(&mut self, node: u32, capacity: i64) {
        self.nodes[node as usize].terminal += capacity;
    }

    /// Adds an arc with a capacity ≥ 0, and one back with another.
    pub fn add_arc(&mut self, from: u32, to: u32, capacity: i64, back: i64) {
        for (from, to, residual) in [(from, to, capacity), (to, from, back)] {
            let next = self.nodes[from as usize].first;
            self.nodes[from as usize].first = self.arcs.len() as u32;
            self.arcs.push(Arc { head: to, next, residual });
        }
    }

    /// Finds the least cut. Afterwards [`Graph::from_source`] tells its sides. Gives the flow, less what
    /// [`Graph::add_terminal`] left out.
    pub fn cut(&mut self) -> i64 {
        for i in 0..self.nodes.len() {
            let node = &mut self.nodes[i];
            if node.terminal != 0 {
                *node = Node { parent: TERMINAL, sink: node.terminal < 0, distance: 1, ..*node };
                self.activate(i as u32);
            }
        }
        let mut flow = 0;
        while let Some(&node) = self.active.front() {
            if self.nodes[node as usize].parent != NONE
                && let Some(bridge) = self.grow(node)
            {
                self.time += 1;
                flow += self.augment(bridge);
                while let Some(orphan) = self.orphans.pop_front() {
                    self.adopt(orphan);
                }
            } else {
                self.active.pop_front();
                self.nodes[node as usize].active = false;
            }
        }
        flow
    }

    /// After [`Graph::cut`]: whether the node can still be reached from the source; the source's side is the smallest
    /// that a least cut can have.
    pub fn from_source(&self, node: u32) -> bool {
        let node = &self.nodes[node as usize];
        node.parent != NONE && !node.sink
    }

    fn activate(&mut self, node: u32) {
        if !std::mem::replace(&mut self.nodes[node as usize].active, true) {
            self.active.push_back(node);
        }
    }

    /// Room on arc `a` of a node in the direction of flow: away from the node in the source's tree, towards it in the
    /// sink's.
    fn room(&self, a: u32, sink: bool) -> bool {
        self.arcs[(a ^ u32::from(sink)) as usize].residual > 0
    }

    /// Grows the tree at an active node. Gives an arc from the source's tree to the sink's as soon as there is one.
    fn grow(&mut self, node: u32) -> Option<u32> {
        let Node { sink, time, distance, first, .. } = self.nodes[node as usize];
        let mut a = first;
        while a != NONE {
            let Arc { head, next, .. } = self.arcs[a as usize];
            if self.room(a, sink) {
                let other = &mut self.nodes[head as usize];
                if other.parent == NONE {
                    *other = Node { sink, parent: a ^ 1, time, distance: distance + 1, ..*other };
                    self.activate(head);
                } else if other.sink != sink {
                    return Some(a ^ u32::from(sink));
                } else if other.time <= time && other.distance > distance {
                    // A shorter way to the root.
                    *other = Node { parent: a ^ 1, time, distance: distance + 1, ..*other };
                }
            }
            a = next;
        }
        None
    }

    /// Sends as much as fits along the path through `bridge`; nodes that are cut off become orphans.
    fn augment(&mut self, bridge: u32) -> i64 {
        let (tail, head) = (self.arcs[(bridge ^ 1) as usize].head, self.arcs[bridge as usize].head);
        let amount = self.arcs[bridge as usize].residual.min(self.fits(tail)).min(self.fits(head));
        self.push(bridge, amount);
        self.drain(tail, amount);
        self.drain(head, amount);
        amount
    }

    fn push(&mut self, arc: u32, amount: i64) {
        self.arcs[arc as usize].residual -= amount;
        self.arcs[(arc ^ 1) as usize].residual += amount;
    }

    /// What fits between `node` and its terminal.
    fn fits(&self, mut node: u32) -> i64 {
        let mut least = i64::MAX;
        loop {
            let Node { parent, sink, terminal, .. } = self.nodes[node as usize];
            if parent == TERMINAL {
                return least.min(terminal.abs());
            }
            least = least.min(self.arcs[(parent ^ u32::from(!sink)) as usize].residual);
            node = self.arcs[parent as usize].head;
        }
    }

    fn drain(&mut self, mut node: u32, amount: i64) {
        loop {
            let Node { parent, sink, terminal, .. } = self.nodes[node as usize];
            if parent == TERMINAL {
                self.nodes[node as usize].terminal -= if sink { -amount } else { amount };
                if terminal.abs() == amount {
                    self.nodes[node as usize].parent = ORPHAN;
                    self.orphans.push_front(node);
                }
                return;
            }
            let arc = parent ^ u32::from(!sink);
            self.push(arc, amount);
            if self.arcs[arc as usize].residual == 0 {
                self.nodes[node as usize].parent = ORPHAN;
                self.orphans.push_front(node);
            }
            node = self.arcs[parent as usize].head;
        }
    }

    /// Finds an orphan a new parent in its tree, the nearest to the root; without one the node is free again and its
    /// children are orphans.
    fn adopt(&mut self, orphan: u32) {
        let sink = self.nodes[orphan as usize].sink;
        let (mut best, mut nearest) = (NONE, FAR);
        let mut a = self.nodes[orphan as usize].first;
        while a != NONE {
            let Arc { head, next, .. } = self.arcs[a as usize];
            let other = &self.nodes[head as usize];
            // Flow would run from the parent to the orphan in the source's tree.
            if self.room(a ^ 1, sink) && other.parent != NONE && other.sink == sink {
                let distance = self.distance(head);
                if distance < nearest {
                    (best, nearest) = (a, distance);
                }
            }
            a = next;
        }
        let node = &mut self.nodes[orphan as usize];
        node.parent = best;
        if best == NONE {
            self.set_free(orphan, sink);
        } else {
            (node.time, node.distance) = (self.time, nearest + 1);
        }
    }

    fn set_free(&mut self, node: u32, sink: bool) {
        let mut a = self.nodes[node as usize].first;
        while a != NONE {
            let Arc { head, next, .. } = self.arcs[a as usize];
            let Node { parent, sink: side, .. } = self.nodes[head as usize];
            if side == sink && parent != NONE {
                if self.room(a ^ 1, sink) {
                    self.activate(head);
                }
                if parent < ORPHAN && self.arcs[parent as usize].head == node {
                    self.nodes[head as usize].parent = ORPHAN;
                    self.orphans.push_back(head);
                }
            }
            a = next;
        }
    }

    /// Length of the way from `node` to its terminal, [`FAR`] when it ends at an orphan; marks the way with it.
    fn distance(&mut self, node: u32) -> u32 {
        let (mut at, mut steps) = (node, 0);
        let length = loop {
            let Node { parent, time, distance, .. } = self.nodes[at as usize];
            if time == self.time && parent != ORPHAN {
                break steps + distance;
            }
            match parent {
                TERMINAL => break steps + 1,
                ORPHAN | NONE => return FAR,
                _ => at = self.arcs[parent as usize].head,
            }
            steps += 1;
        };
        let (mut at, mut left) = (node, length);
        loop {
            let node = &mut self.nodes[at as usize];
            if node.time == self.time {
                return length;
            }
            (node.time, node.distance) = (self.time, left);
            if node.parent == TERMINAL {
                return length;
            }
            at = self.arcs[node.parent as usize].head;
            left -= 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::rng;

    /// Terminals, and arcs (from, to, capacity, back).
    type Sample = (Vec<i64>, Vec<(u32, u32, i64, i64)>);

    fn sample(nodes: u64, arcs: u64, seed: u64) -> Sample {
        let random = |k: u64, i: u64, n: u64| rng::below(rng::hash(seed, &[k, i]), n);
        let terminals = (0..nodes).map(|i| random(0, i, 21) as i64 - 10).collect();
        let arc = |i: u64| {
            let from = random(1, i, nodes);
            let to = (from + 1 + random(2, i, nodes - 1)) % nodes;
            (from as u32, to as u32, random(3, i, 9) as i64, random(4, i, 9) as i64 * random(5, i, 2) as i64)
        };
        (terminals, (0..arcs).map(arc).collect())
    }

    fn graph((terminals, arcs): &Sample, graph: &mut Graph) {
        graph.reset(terminals.len());
        (0..).zip(terminals).for_each(|(i, &t)| graph.add_terminal(i, t));
        arcs.iter().for_each(|&(a, b, there, back)| graph.add_arc(a, b, there, back));
    }

    /// What is cut when the nodes of `side`'s bits stay with the source.
    fn cost((terminals, arcs): &Sample, side: u32) -> i64 {
        let with_source = |n: u32| side >> n & 1 == 1;
        let terminal = |(i, &t): (u32, &i64)| if with_source(i) { (-t).max(0) } else { t.max(0) };
        let arc = |&(a, b, there, back): &(u32, u32, i64, i64)| match (with_source(a), with_source(b)) {
            (true, false) => there,
            (false, true) => back,
            _ => 0,
        };
        (0..).zip(terminals).map(terminal).sum::<i64>() + arcs.iter().map(arc).sum::<i64>()
    }

    #[test]
    fn cuts_equal_the_best_of_all_sides() {
        let mut used = Graph::default();
        for seed in 0..400 {
            let nodes = 2 + seed % 9;
            let sample = sample(nodes, seed % 31, seed);
            graph(&sample, &mut used);
            let flow = used.cut();
            let best = (0..1 << nodes).map(|side| cost(&sample, side)).min().unwrap();
            let side = (0..nodes as u32).filter(|&n| used.from_source(n)).fold(0, |side, n| side | 1 << n);
            assert_eq!((flow, cost(&sample, side)), (best, best), "seed {seed}");
            let smallest = (0..1u32 << nodes).filter(|&s| cost(&sample, s) == best).fold(u32::MAX, |a, b| a & b);
            assert_eq!(side, smallest, "seed {seed}");
        }
    }

    #[test]
    fn flow_equals_the_cut_on_larger_graphs() {
        let mut used = Graph::default();
        for seed in 0..20 {
            let (mut terminals, arcs) = sample(31, 150, seed);
            terminals.iter_mut().for_each(|t| *t *= 5);
            let sample = (terminals, arcs);
            graph(&sample, &mut used);
            let flow = used.cut();
            let side = (0..31).filter(|&n| used.from_source(n)).fold(0, |side, n| side | 1 << n);
            assert_eq!(flow, cost(&sample, side));
        }
        used.reset(0);
        assert_eq!(used.cut(), 0);
    }
}
