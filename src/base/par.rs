//! Threads. The only file that names the thread library.
//!
//! Everything here gives the same result on any number of threads: each output cell has one writer, and ordered
//! results are handed over in order.

use std::any::Any;
use std::collections::VecDeque;
use std::panic::AssertUnwindSafe;
use std::sync::mpsc::{Receiver, TryRecvError, channel};
use std::sync::{Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rayon::Scope;
use rayon::prelude::*;

use super::error::{Error, Kind, Result};

/// Most threads that [`init`] starts.
pub const MAX_THREADS: usize = 256;

/// Longest wait before looking whether the pool has other work.
const PATIENCE: Duration = Duration::from_millis(1);

/// Sets the number of worker threads for the whole process; 0 means one per core. Call once, before any work.
///
/// # Errors
/// More than [`MAX_THREADS`] threads; when the pool exists already or threads cannot be started.
pub fn init(threads: usize) -> Result<()> {
    if threads > MAX_THREADS {
        return Err(Error::new(Kind::Usage, "--threads", format!("{threads} asked"))
            .allowed(format!("0 to {MAX_THREADS}; 0 is one per core")));
    }
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build_global()
        .map_err(|e| Error::new(Kind::Usage, "--threads", e.to_string()))
}

/// Runs `work` inside a pool of exactly `threads` threads, whatever the process-wide number.
pub fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> Result<R> {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .map_err(|e| Error::new(Kind::Limit, "threads", e.to_string()))?;
    Ok(pool.install(work))
}

/// Number of threads of the current pool.
pub fn threads() -> usize {
    rayon::current_num_threads()
}

/// `(0..n).map(f)` in parallel, results in order.
pub fn map<T: Send>(n: usize, f: impl Fn(usize) -> T + Sync + Send) -> Vec<T> {
    let mut results = Vec::<T>::with_capacity(n);
    let cells = Cells(results.as_mut_ptr());
    for_each_index(n, &|i| {
        let result = f(i);
        // SAFETY: `i` is below `n`, for which there is room, and only this call has this `i`.
        unsafe { cells.at(i).write(result) }
    });
    // SAFETY: each of the first `n` cells was written; after a panic this is not reached, and results are not dropped.
    unsafe { results.set_len(n) };
    results
}

/// `(0..n).map(f)` in parallel for fallible work; the error of the lowest index wins.
pub fn try_map<T: Send>(n: usize, f: impl Fn(usize) -> Result<T> + Sync + Send) -> Result<Vec<T>> {
    map(n, f).into_iter().collect()
}

/// Calls `f(index, chunk)` for consecutive chunks of `data` in parallel; the last may be shorter.
pub fn for_each_chunk<T: Send>(data: &mut [T], chunk: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    let (chunk, length) = (chunk.max(1), data.len());
    let cells = Cells(data.as_mut_ptr());
    for_each_index(length.div_ceil(chunk), &|i| {
        let first = i * chunk;
        // SAFETY: the range lies within `data`, which is borrowed exclusively, and only this call has this `i`.
        let part = unsafe { std::slice::from_raw_parts_mut(cells.at(first), chunk.min(length - first)) };
        f(i, part);
    });
}

/// Runs two closures, possibly at the same time.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    let (mut a, mut b) = (Some(a), Some(b));
    let (mut first, mut second) = (None, None);
    both(&mut || first = a.take().map(|a| a()), &mut || second = b.take().map(|b| b()));
    first.zip(second).expect("both were run")
}

/// Calls `work(i)` for all `i` below `n`. Like [`both`], it knows nothing of the types at work, so that the thread library
/// is compiled once and not once for every caller.
fn for_each_index(n: usize, work: &(dyn Fn(usize) + Sync)) {
    (0..n).into_par_iter().for_each(work);
}

fn both(a: &mut (dyn FnMut() + Send), b: &mut (dyn FnMut() + Send)) {
    rayon::join(a, b);
}

/// Where results go: each cell is written by one thread.
struct Cells<T>(*mut T);

// SAFETY: who uses a cell answers for being the only one; its value may go to another thread.
unsafe impl<T: Send> Sync for Cells<T> {}

impl<T> Cells<T> {
    /// The cell `i`, which must be one of those that there are.
    unsafe fn at(&self, i: usize) -> *mut T {
        // SAFETY: as asked of the caller.
        unsafe { self.0.add(i) }
    }
}

/// Makes items `range` one after another (each may use all threads) and pushes them in order on the calling thread.
/// Making runs ahead of pushing, so that a push that takes long starves nobody; at most `window` items (2 at least)
/// are alive at once, the one being made and the one being pushed among them.
///
/// # Errors
/// The first error of `make` (by index) or of `push`; later items are dropped.
pub fn ordered_map<T: Send>(
    range: std::ops::Range<usize>,
    window: usize,
    make: impl Fn(usize) -> Result<T> + Sync + Send,
    mut push: impl FnMut(usize, T) -> Result<()>,
) -> Result<()> {
    let line = Line { make, end: range.end, ahead: window.max(2) - 2, belt: Mutex::default(), arrival: Condvar::new() };
    line.belt().next = range.start;
    rayon::in_place_scope(|scope| {
        for i in range {
            line.start(scope);
            let item = line.take();
            line.start(scope);
            let pushed = item.and_then(|item| push(i, item));
            if pushed.is_err() {
                line.belt().stopped = true;
                return pushed;
            }
        }
        Ok(())
    })
}

/// Items on their way from a maker to a pusher.
struct Line<T, F> {
    make: F,
    end: usize,
    /// Most items that lie ready while another is made.
    ahead: usize,
    belt: Mutex<Belt<T>>,
    arrival: Condvar,
}

struct Belt<T> {
    ready: VecDeque<Finished<Result<T>>>,
    next: usize,
    making: bool,
    stopped: bool,
}

impl<T> Default for Belt<T> {
    fn default() -> Self {
        Self { ready: VecDeque::new(), next: 0, making: false, stopped: false }
    }
}

impl<T: Send, F: Fn(usize) -> Result<T> + Sync + Send> Line<T, F> {
    fn belt(&self) -> MutexGuard<'_, Belt<T>> {
        self.belt.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Starts making the next item where none is being made and there is room.
    fn start<'s>(&'s self, scope: &Scope<'s>) {
        let mut belt = self.belt();
        if belt.making || belt.stopped || belt.next >= self.end || belt.ready.len() > self.ahead {
            return;
        }
        belt.making = true;
        let i = belt.next;
        belt.next += 1;
        scope.spawn(move |scope| {
            let item = std::panic::catch_unwind(AssertUnwindSafe(|| (self.make)(i)));
            let mut belt = self.belt();
            belt.ready.push_back(item);
            belt.making = false;
            drop(belt);
            self.arrival.notify_one();
            self.start(scope);
        });
    }

    /// The next item; waits for it, and on a thread of the pool does other work meanwhile.
    fn take(&self) -> Result<T> {
        loop {
            if let Some(item) = self.belt().ready.pop_front() {
                return item.unwrap_or_else(|panic| std::panic::resume_unwind(panic));
            }
            if rayon::yield_now() != Some(rayon::Yield::Executed) {
                // Another thread is at it. Short waits, for on the pool there may be something to do again soon.
                let belt = self.belt();
                if belt.ready.is_empty() {
                    drop(self.arrival.wait_timeout(belt, PATIENCE));
                }
            }
        }
    }
}

/// Work that goes on in the background on the pool, its results handed over in the order in which it was started; what is
/// under way and not yet handed over is bounded in bytes.
#[derive(Debug)]
pub struct Tasks<T> {
    limit: usize,
    bytes: usize,
    running: VecDeque<(usize, Receiver<Finished<T>>)>,
}

/// A result, or what the work panicked with.
type Finished<T> = Result<T, Box<dyn Any + Send>>;

impl<T: Send + 'static> Tasks<T> {
    /// Nothing under way, at most `limit` bytes at a time (one piece of work may be larger).
    pub fn new(limit: usize) -> Self {
        Self { limit, bytes: 0, running: VecDeque::new() }
    }

    /// Starts `work`, which holds `bytes` of memory until its result is taken. Ask [`Tasks::has_room`] first.
    pub fn start(&mut self, bytes: usize, work: impl FnOnce() -> T + Send + 'static) {
        let (sender, receiver) = channel();
        rayon::spawn(move || {
            let result = std::panic::catch_unwind(AssertUnwindSafe(work));
            // Nobody waits for the results of a run that was given up.
            let _ = sender.send(result);
        });
        self.bytes += bytes;
        self.running.push_back((bytes, receiver));
    }

    /// True when `bytes` more stay within the limit, or nothing is under way.
    pub fn has_room(&self, bytes: usize) -> bool {
        self.running.is_empty() || self.bytes.saturating_add(bytes) <= self.limit
    }

    /// The oldest result if it is there.
    pub fn ready(&mut self) -> Option<T> {
        match self.running.front()?.1.try_recv() {
            Err(TryRecvError::Empty) => None,
            result => Some(self.hand_over(result.ok())),
        }
    }

    /// The oldest result; waits for it, and on a thread of the pool does other work meanwhile. `None` when nothing is
    /// under way.
    pub fn wait(&mut self) -> Option<T> {
        let receiver = &self.running.front()?.1;
        let result = loop {
            match receiver.try_recv() {
                Err(TryRecvError::Empty) if rayon::yield_now() == Some(rayon::Yield::Executed) => {}
                Err(TryRecvError::Empty) => {
                    // Another thread is at it. Short waits, for on the pool there may be something to do again soon.
                    if let Ok(result) = receiver.recv_timeout(PATIENCE) {
                        break Ok(result);
                    }
                }
                other => break other,
            }
        };
        Some(self.hand_over(result.ok()))
    }

    fn hand_over(&mut self, result: Option<Finished<T>>) -> T {
        self.bytes -= self.running.pop_front().map_or(0, |(bytes, _)| bytes);
        match result {
            Some(Ok(value)) => value,
            Some(Err(panic)) => std::panic::resume_unwind(panic),
            None => panic!("work that was started gives a result"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tasks_come_back_in_order_within_their_memory() {
        let run = |threads| {
            with_threads(threads, || {
                let mut tasks = Tasks::new(100);
                let mut out = Vec::new();
                for i in 0..50usize {
                    while !tasks.has_room(30) {
                        out.push(tasks.wait().unwrap());
                    }
                    // Work that itself waits for the pool.
                    tasks.start(30, move || map(i % 7, |k| k + i).into_iter().sum::<usize>());
                    out.extend(tasks.ready());
                }
                out.extend(std::iter::from_fn(|| tasks.wait()));
                assert!(tasks.has_room(usize::MAX));
                out
            })
            .unwrap()
        };
        let expected: Vec<usize> = (0..50).map(|i| (0..i % 7).map(|k| k + i).sum()).collect();
        assert!([1, 2, 5].into_iter().all(|threads| run(threads) == expected));
    }

    #[test]
    fn a_panic_of_a_task_reaches_who_takes_it() {
        let mut tasks = Tasks::new(1);
        tasks.start(1, || panic!("on purpose"));
        let taken = std::panic::catch_unwind(std::panic::AssertUnwindSafe(|| tasks.wait()));
        assert_eq!(taken.unwrap_err().downcast_ref(), Some(&"on purpose"));
    }

    #[test]
    fn ordered_map_keeps_order_and_covers_the_range() {
        for (n, window) in [(0, 4), (1, 1), (7, 3), (100, 8)] {
            let mut seen = Vec::new();
            ordered_map(
                0..n,
                window,
                |i| Ok(i * i),
                |i, v| {
                    assert_eq!(v, i * i);
                    seen.push(i);
                    Ok(())
                },
            )
            .unwrap();
            assert_eq!(seen, (0..n).collect::<Vec<_>>());
        }
    }

    #[test]
    fn ordered_map_makes_ahead_within_its_window() {
        use std::sync::atomic::{AtomicUsize, Ordering::SeqCst};
        for (threads, window) in [(1, 2), (2, 2), (3, 5)] {
            let (alive, most) = (AtomicUsize::new(0), AtomicUsize::new(0));
            let make = |i: usize| {
                most.fetch_max(alive.fetch_add(1, SeqCst) + 1, SeqCst);
                Ok(map(3, |k| i + k).len())
            };
            let push = |_, _| {
                std::thread::sleep(Duration::from_micros(300));
                alive.fetch_sub(1, SeqCst);
                Ok(())
            };
            with_threads(threads, || ordered_map(0..40, window, make, push)).unwrap().unwrap();
            assert!(most.load(SeqCst) <= window, "{most:?} of {window}");
            assert!(threads == 1 || most.load(SeqCst) > 1, "nothing was made ahead");
        }
    }

    #[test]
    fn a_panic_while_making_reaches_who_pushes() {
        let make = |i: usize| if i == 2 { panic!("on purpose") } else { Ok(i) };
        let run = || ordered_map(0..5, 3, make, |_, _| Ok(()));
        let taken = std::panic::catch_unwind(std::panic::AssertUnwindSafe(run));
        assert_eq!(taken.unwrap_err().downcast_ref(), Some(&"on purpose"));
    }

    #[test]
    fn ordered_map_reports_the_first_error() {
        let fail = |i: usize| if i >= 5 { Err(Error::new(Kind::Data, i, "bad")) } else { Ok(i) };
        let error = ordered_map(0..20, 4, fail, |_, _| Ok(())).unwrap_err();
        assert_eq!(error.subject(), "5");
    }
}
