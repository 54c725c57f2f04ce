//! Which row of how many is at work, and how long the rest may take.

use std::collections::{BTreeMap, VecDeque};

use super::plan::{Cell, PlannedScene};
use crate::base::text::rough_duration;

/// A row to make, as far as it tells about time.
pub struct Task {
    /// What is done: the same takes as long on as many pixels.
    what: String,
    effort: f64,
}

impl Task {
    /// Of a row.
    pub fn new(scene: &PlannedScene, cell: &Cell) -> Self {
        Self { what: cell.file.method.clone().unwrap_or_else(|| cell.stem.clone()), effort: scene.effort }
    }
}

/// How far a comparison is.
pub struct Progress {
    all: usize,
    rest: VecDeque<Task>,
    /// Seconds and effort of what was made in this run.
    taken: BTreeMap<String, (f64, f64)>,
}

impl Progress {
    /// Of `all` rows, of which `rest` have to be made.
    pub fn new(all: usize, rest: Vec<Task>) -> Self {
        Self { all, rest: rest.into(), taken: BTreeMap::new() }
    }

    /// The row at work: "[7/24, about 12 min left]". What has not been made yet in this run is not guessed at: "at least".
    pub fn place(&self) -> String {
        let number = self.all - self.rest.len() + 1;
        let known = self.rest.iter().map(|task| self.taken.get(&task.what).map(|(s, effort)| s / effort * task.effort));
        let (sum, guessed) = known.fold((0.0, 0), |(sum, n), s| (sum + s.unwrap_or(0.0), n + usize::from(s.is_none())));
        let left = match guessed {
            _ if sum < 1.0 => String::new(),
            0 => format!(", about {} left", rough_duration(sum)),
            _ => format!(", at least {} left", rough_duration(sum)),
        };
        format!("[{number}/{}{left}]", self.all)
    }

    /// The row at work is finished, after so many seconds.
    pub fn done(&mut self, seconds: f64) {
        if let Some(task) = self.rest.pop_front() {
            let sums = self.taken.entry(task.what).or_default();
            *sums = (sums.0 + seconds, sums.1 + task.effort);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_was_timed_is_estimated() {
        let task = |what: &str, effort| Task { what: what.into(), effort };
        let rest = vec![task("a", 1.0), task("b", 1.0), task("a", 2.0), task("b", 1.0)];
        let mut progress = Progress::new(6, rest);
        assert_eq!(progress.place(), "[3/6]");
        progress.done(10.0);
        assert_eq!(progress.place(), "[4/6, at least 20 s left]");
        progress.done(100.0);
        assert_eq!(progress.place(), "[5/6, about 2 min left]");
        progress.done(20.0);
        assert_eq!(progress.place(), "[6/6, about 2 min left]");
        assert_eq!(rough_duration(10_000.0), "2.8 h");
    }
}
