//! Threads. The only file that names the thread library.
//!
//! Everything here gives the same result on any number of threads: each output cell has one writer, and ordered
//! results are handed over in order.

use rayon::prelude::*;

use super::error::{Error, Kind, Result};

/// Most threads that [`init`] starts.
pub const MAX_THREADS: usize = 256;

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
    (0..n).into_par_iter().map(f).collect()
}

/// `(0..n).map(f)` in parallel for fallible work; the error of the lowest index wins.
pub fn try_map<T: Send>(n: usize, f: impl Fn(usize) -> Result<T> + Sync + Send) -> Result<Vec<T>> {
    map(n, f).into_iter().collect()
}

/// Calls `f(index, chunk)` for consecutive chunks of `data` in parallel; the last may be shorter.
pub fn for_each_chunk<T: Send>(data: &mut [T], chunk: usize, f: impl Fn(usize, &mut [T]) + Sync + Send) {
    data.par_chunks_mut(chunk.max(1)).enumerate().for_each(|(i, c)| f(i, c));
}

/// Runs two closures, possibly at the same time.
pub fn join<A: Send, B: Send>(a: impl FnOnce() -> A + Send, b: impl FnOnce() -> B + Send) -> (A, B) {
    rayon::join(a, b)
}

/// Makes items `range` in parallel, at most `window` of them alive at once, and pushes them in order on the calling
/// thread. `make` and `push` overlap only between windows' halves, so memory stays bounded by `window` items.
///
/// # Errors
/// The first error of `make` (by index) or of `push`; later items are dropped.
pub fn ordered_map<T: Send>(
    range: std::ops::Range<usize>,
    window: usize,
    make: impl Fn(usize) -> Result<T> + Sync + Send,
    mut push: impl FnMut(usize, T) -> Result<()> + Send,
) -> Result<()> {
    let half = (window / 2).max(1);
    let chunk = |start: usize| start..(start + half).min(range.end);
    let make_chunk = |r: std::ops::Range<usize>| -> Vec<Result<T>> { r.into_par_iter().map(&make).collect() };
    let mut start = range.start;
    let mut ready = make_chunk(chunk(start));
    while start < range.end {
        let next = start + half;
        let (pushed, made) = rayon::join(
            || ready.into_iter().enumerate().try_for_each(|(i, item)| push(start + i, item?)),
            || if next < range.end { make_chunk(chunk(next)) } else { Vec::new() },
        );
        pushed?;
        ready = made;
        start = next;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn ordered_map_reports_the_first_error() {
        let fail = |i: usize| if i >= 5 { Err(Error::new(Kind::Data, i, "bad")) } else { Ok(i) };
        let error = ordered_map(0..20, 4, fail, |_, _| Ok(())).unwrap_err();
        assert_eq!(error.subject(), "5");
    }
}
