//! A real clip as a scene whose answer is known: one frame is the picture, what moves is the matte, and the clip's later
//! frames are what an animation of it should look like.

use std::ops::Range;

use crate::base::error::{Error, Kind, Result};
use crate::base::observe::{self, Observer};
use crate::library::reader::Pack;
use crate::library::variant::{CELL, PIECE_CELLS};
use crate::raster::filter::gaussian;
use crate::raster::image::{Plane, Rgb8};

/// Frames between the picture and the reference: half a second, after which the motion has decorrelated…
const GAP: usize = 12;
/// …or one in so many of a short clip.
const GAP_SHARE: usize = 8;
/// Islands and holes of the matte smaller than a quarter of a piece are noise, cells.
const SPECK: usize = PIECE_CELLS * PIECE_CELLS / 4;
/// Smoothing of the significance before it is decided, cells.
const SMOOTHING: f32 = 1.0;
/// Frames on either side of the picture that tell where the fluid is then: a quarter of a second.
const NEAR: usize = 6;
/// Pairs of frames from all over the clip that tell how much a place changes as a rule…
const PAIRS: usize = 32;
/// …of which it changes by this share at least where the fluid is: flames and smoke come and go.
const PRESENT: f32 = 0.5;
/// Smoothing of both, Gaussian, cells.
const PRESENCE: f32 = 3.0;
/// Softness of the matte's edge, Gaussian, pixels.
const EDGE: f32 = 4.0;

/// A frame of a clip as a picture to animate, and where the clip goes on.
#[derive(Debug, Clone, PartialEq)]
pub struct LeftOut {
    /// The sharpest frame of those in the clip's first half that change most, at the library's working size.
    pub picture: Rgb8,
    /// Where the clip moves significantly, and does so about the time of the picture; soft, 0 to 1.
    pub matte: Plane,
    /// Number of the picture's frame.
    pub frame: usize,
    /// Frames to measure an animation against: from half a second after the picture to the end.
    pub reference: Range<usize>,
}

impl LeftOut {
    /// Takes a scene from clip number `clip` of a pack.
    ///
    /// # Errors
    /// [`Kind::Unusable`] when nothing moves in it over the area of a quarter piece; a damaged pack; a cancel.
    pub fn of(pack: &Pack, clip: u32, observer: &dyn Observer) -> Result<Self> {
        let grid = pack.grid(clip, 0)?;
        let significant = grid.cells.iter().map(|c| c.significant.to_f32()).collect();
        let significant = Plane::from_vec(grid.width, grid.height, significant);
        let ever = matte(&significant);
        if ever.data.iter().all(|&m| m < 0.5) {
            let problem =
                format!("clip {} has no area of significant motion to animate", pack.clips()[clip as usize].id);
            return Err(Error::new(Kind::Unusable, pack.subject(), problem));
        }
        let count = pack.clips()[clip as usize].frames as usize;
        let frame = liveliest_and_sharpest(pack, clip, &ever, count / 2, observer)?;
        let matte = match matte(&present(&significant, pack, clip, frame, observer)?) {
            none if none.data.iter().all(|&m| m < 0.5) => {
                observer.note(&format!(
                    "clip {}: the picture is of a quiet moment; its matte is where the clip ever moves",
                    pack.clips()[clip as usize].id
                ));
                ever
            }
            matte => matte,
        };
        let picture = pack.frame(clip, frame)?;
        let gap = GAP.min(count / GAP_SHARE);
        Ok(Self { picture, matte, frame, reference: (frame + gap).min(count)..count })
    }
}

/// `significant` (per cell) where the clip moves about frame `frame` as it does as a rule, else 0.
fn present(significant: &Plane, pack: &Pack, clip: u32, frame: usize, observer: &dyn Observer) -> Result<Plane> {
    let last = pack.clips()[clip as usize].frames as usize - 1;
    let near = frame.saturating_sub(NEAR)..(frame + NEAR).min(last);
    let all = (0..last).step_by(last.div_ceil(PAIRS).max(1));
    let near = changes(pack, clip, near, significant, observer)?;
    let all = changes(pack, clip, all, significant, observer)?;
    Ok(where_as_ever(significant, &near, &all))
}

/// `significant` where the changes `near` reach the share [`PRESENT`] of those of `all` the clip, else 0.
fn where_as_ever(significant: &Plane, near: &Plane, all: &Plane) -> Plane {
    let rates = near.data.iter().zip(&all.data);
    let present =
        significant.data.iter().zip(rates).map(|(s, (near, all))| if *near < PRESENT * all { 0.0 } else { *s });
    Plane::from_vec(significant.width, significant.height, present.collect())
}

/// Mean absolute difference of frame t and the one after it over `times`, about every cell.
fn changes(
    pack: &Pack,
    clip: u32,
    times: impl ExactSizeIterator<Item = usize>,
    cells: &Plane,
    observer: &dyn Observer,
) -> Result<Plane> {
    let mut frames = pack.frames(clip)?;
    let mut sums = Plane::zeros(cells.width, cells.height);
    let share = 1.0 / (times.len().max(1) * CELL * CELL) as f32;
    for t in times {
        observe::check(observer)?;
        let (before, after) = (frames.luma_at(t)?, frames.luma_at(t + 1)?);
        for y in 0..cells.height * CELL {
            let pixels = before.row(y).chunks_exact(CELL).zip(after.row(y).chunks_exact(CELL));
            for (sum, (b, a)) in sums.data[y / CELL * cells.width..].iter_mut().zip(pixels) {
                *sum += share * b.iter().zip(a).map(|(b, a)| (a - b).abs()).sum::<f32>();
            }
        }
    }
    Ok(gaussian(&sums, PRESENCE))
}

/// Of the frames 1 to `count` of a clip, the sharpest among the half that change most from the frame before: a frame
/// before the fluid comes is no picture of it.
fn liveliest_and_sharpest(
    pack: &Pack,
    clip: u32,
    matte: &Plane,
    count: usize,
    observer: &dyn Observer,
) -> Result<usize> {
    let mut frames = pack.frames(clip)?;
    let mut before = frames.at(0)?.luma();
    let mut found = Vec::with_capacity(count);
    for t in 1..=count {
        observe::check(observer)?;
        let luma = frames.at(t)?.luma();
        found.push((change(&before, &luma, matte), sharpness(&luma, matte), t));
        before = luma;
    }
    found.sort_by(|a, b| b.0.total_cmp(&a.0));
    found.truncate(count.div_ceil(2));
    Ok(found.into_iter().max_by(|a, b| a.1.total_cmp(&b.1).then(b.2.cmp(&a.2))).map_or(0, |f| f.2))
}

/// Summed absolute difference within the matte.
fn change(before: &Plane, luma: &Plane, matte: &Plane) -> f64 {
    let row = |y: usize| {
        let pixels = before.row(y).iter().zip(luma.row(y)).zip(matte.row(y));
        f64::from(pixels.map(|((b, l), m)| m * (l - b).abs()).sum::<f32>())
    };
    (0..luma.height).map(row).sum()
}

/// Summed squared Laplacian of luma within the matte: largest in the frame that is least blurred.
fn sharpness(luma: &Plane, matte: &Plane) -> f64 {
    let mut sum = 0.0f64;
    for y in 1..luma.height - 1 {
        let (above, row, below, weights) = (luma.row(y - 1), luma.row(y), luma.row(y + 1), matte.row(y));
        let at = |x: usize| {
            let laplacian = above[x] + below[x] + row[x - 1] + row[x + 1] - 4.0 * row[x];
            weights[x] * laplacian * laplacian
        };
        sum += f64::from((1..luma.width - 1).map(at).sum::<f32>());
    }
    sum
}

/// The matte of a clip from the share of significant motion in its cells: smoothed and decided, specks dropped and
/// pinholes filled, then the edge softened; in pixels, [`CELL`] a cell.
fn matte(significant: &Plane) -> Plane {
    let (width, height) = (significant.width, significant.height);
    let mut fluid: Vec<bool> = gaussian(significant, SMOOTHING).data.iter().map(|&s| s >= 0.5).collect();
    fill_small(&mut fluid, width, true);
    fill_small(&mut fluid, width, false);
    let hard =
        Plane::from_fn(width * CELL, height * CELL, |x, y| f32::from(u8::from(fluid[y / CELL * width + x / CELL])));
    // The ends of the Gaussian would show as a faint veil over the background.
    gaussian(&hard, EDGE).map(|m| if m < 0.02 { 0.0 } else { m.min(1.0) })
}

/// Turns over connected areas (by edges) of `value` that are smaller than [`SPECK`].
fn fill_small(cells: &mut [bool], width: usize, value: bool) {
    let mut seen = vec![false; cells.len()];
    for start in 0..cells.len() {
        if seen[start] || cells[start] != value {
            continue;
        }
        seen[start] = true;
        let mut area = vec![start];
        let mut next = 0;
        while let Some(&cell) = area.get(next) {
            next += 1;
            let (x, left, right) = (cell % width, cell.wrapping_sub(1), cell + 1);
            let neighbours = [
                (x > 0).then_some(left),
                (x + 1 < width).then_some(right),
                cell.checked_sub(width),
                Some(cell + width).filter(|&c| c < cells.len()),
            ];
            for neighbour in neighbours.into_iter().flatten() {
                if !seen[neighbour] && cells[neighbour] == value {
                    seen[neighbour] = true;
                    area.push(neighbour);
                }
            }
        }
        if area.len() < SPECK {
            area.iter().for_each(|&cell| cells[cell] = !value);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mattes_lose_specks_and_pinholes_and_have_soft_edges() {
        let (width, height) = (40, 30);
        let significant = Plane::from_fn(width, height, |x, y| {
            let hole = (8..10).contains(&x) && (14..16).contains(&y);
            let speck = (33..36).contains(&x) && (4..7).contains(&y);
            f32::from(u8::from(x < 20 && !hole || speck))
        });
        let matte = matte(&significant);
        assert_eq!((matte.width, matte.height), (160, 120));
        assert!((matte.at(36, 60) - 1.0).abs() < 1e-4, "a pinhole stays");
        assert_eq!(matte.at(138, 22), 0.0, "a speck stays");
        assert!(matte.at(0, 0) > 0.999 && matte.at(159, 119) == 0.0);
        assert!((matte.at(80, 60) - 0.5).abs() < 0.1, "the edge is not soft");
        let rising = matte.row(60)[60..100].windows(2).all(|w| w[0] >= w[1]);
        assert!(rising, "the edge is not smooth");
    }

    #[test]
    fn what_rests_at_the_time_of_the_picture_is_no_part_of_the_matte() {
        let significant = Plane::from_fn(4, 1, |x, _| [1.0, 0.8, 0.9, 0.0][x]);
        let (near, all) = (Plane::from_fn(4, 1, |x, _| [0.2, 0.01, 0.06, 0.5][x]), Plane::filled(4, 1, 0.1));
        assert_eq!(where_as_ever(&significant, &near, &all).data, [1.0, 0.0, 0.9, 0.0]);
        assert_eq!(where_as_ever(&significant, &all, &all), significant);
    }

    #[test]
    fn the_sharper_frame_wins_and_only_the_matte_counts() {
        let sharp = Plane::from_fn(32, 32, |x, y| ((x * 7 + y * 13) % 5) as f32 * 0.2);
        let soft = gaussian(&sharp, 1.0);
        let all = Plane::filled(32, 32, 1.0);
        assert!(sharpness(&sharp, &all) > 2.0 * sharpness(&soft, &all));
        assert_eq!(sharpness(&sharp, &Plane::zeros(32, 32)), 0.0);
    }
}
