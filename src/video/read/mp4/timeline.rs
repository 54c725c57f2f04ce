//! Edit lists: which samples are decoded, which of them are shown, and when.

use super::track::{Edit, Sample};

/// A stretch of samples to decode in order and the frames to show from it.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Stretch {
    /// Samples to decode, in decoding order; the first is a sync sample where there is one.
    pub decode: std::ops::Range<usize>,
    /// Samples to show with their presentation times in media units, in presentation order.
    pub show: Vec<(i64, usize)>,
}

/// The stretches that `edits` ask for. Frames whose composition time lies before an edit's start are decoded, not
/// shown, like those after its end.
///
/// # Errors
/// In words, when the edits repeat the media so often that reading would not end.
pub fn stretches(samples: &[Sample], edits: &[Edit]) -> Result<Vec<Stretch>, String> {
    let whole = [Edit { duration: 0, media: samples.iter().map(|s| s.shown).min() }];
    let edits = if edits.iter().any(|e| e.media.is_some()) { edits } else { &whole };
    // By presentation time, once: an edit that shows nothing must cost next to nothing, for a file may hold many.
    let mut order: Vec<usize> = (0..samples.len()).collect();
    order.sort_by_key(|&i| samples[i].shown);
    let mut presented = 0i64;
    let mut work = 0usize;
    let mut out = Vec::new();
    for edit in edits {
        if let Some(start) = edit.media {
            // A single edit of duration 0 means "to the end", as writers that do not know the length use it.
            let end = if edit.duration == 0 { i64::MAX } else { start.saturating_add(edit.duration) };
            if let Some(stretch) = stretch(samples, &order, start..end, presented) {
                work += stretch.decode.len();
                out.push(stretch);
            }
        }
        presented = presented.saturating_add(edit.duration);
        if work > 4 * samples.len() + 1000 {
            return Err("its edit list repeats the media too often".into());
        }
    }
    Ok(out)
}

fn stretch(samples: &[Sample], order: &[usize], time: std::ops::Range<i64>, presented: i64) -> Option<Stretch> {
    let before = |t: i64| order.partition_point(|&i| samples[i].shown < t);
    let inside = order.get(before(time.start)..before(time.end))?;
    let show: Vec<(i64, usize)> =
        inside.iter().map(|&i| (presented.saturating_add(samples[i].shown - time.start), i)).collect();
    let first = show.iter().map(|&(_, i)| i).min()?;
    let last = show.iter().map(|&(_, i)| i).max()?;
    let sync = samples[..=first].iter().rposition(|s| s.sync).unwrap_or(0);
    Some(Stretch { decode: sync..last + 1, show })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn samples(shown: &[i64], sync: &[usize]) -> Vec<Sample> {
        let at =
            |(i, &shown): (usize, &i64)| Sample { offset: 0, size: 1, shown, duration: 10, sync: sync.contains(&i) };
        shown.iter().enumerate().map(at).collect()
    }

    #[test]
    fn without_edits_all_is_shown_in_presentation_order() {
        let s = stretches(&samples(&[20, 50, 30, 40], &[0]), &[]).unwrap();
        assert_eq!(s, [Stretch { decode: 0..4, show: vec![(0, 0), (10, 2), (20, 3), (30, 1)] }]);
    }

    #[test]
    fn an_empty_edit_delays_and_media_time_trims() {
        let edits = [Edit { duration: 7, media: None }, Edit { duration: 20, media: Some(20) }];
        let s = stretches(&samples(&[0, 10, 20, 30, 40], &[0, 1, 3]), &edits).unwrap();
        assert_eq!(s, [Stretch { decode: 1..4, show: vec![(7, 2), (17, 3)] }]);
    }

    #[test]
    fn media_may_be_repeated_but_not_for_ever() {
        let all = samples(&[0, 10, 20], &[0]);
        let twice = [Edit { duration: 30, media: Some(0) }; 2];
        let s = stretches(&all, &twice).unwrap();
        assert_eq!(s[1].show, [(30, 0), (40, 1), (50, 2)]);
        assert!(stretches(&all, &[Edit { duration: 30, media: Some(0) }; 4000]).is_err());
    }

    #[test]
    fn extreme_times_do_not_overflow() {
        let all = samples(&[i64::MIN / 2, i64::MAX / 2], &[0]);
        let edits = [Edit { duration: i64::MAX, media: Some(i64::MAX) }, Edit { duration: i64::MAX, media: Some(0) }];
        assert!(stretches(&all, &edits).is_ok());
    }
}
