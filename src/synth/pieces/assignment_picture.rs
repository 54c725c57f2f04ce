//! A picture of which clip went where.

use crate::base::rng::{hash, unit};
use crate::library::variant::PIECE;
use crate::raster::image::{Plane, Rgb8};
use crate::render::layout::{Layout, Open, STRIDE};

/// Colour of clip number `clip` among those of a picture: hues spread by the golden angle, in pairs light and dark.
pub fn colour(clip: usize) -> [u8; 3] {
    let hue = (clip as f32 * 0.381_966 + 0.55).fract() * 6.0;
    let value = if clip.is_multiple_of(2) { 235.0 } else { 165.0 };
    [5.0f32, 3.0, 1.0].map(|n| {
        let k = (n + hue) % 6.0;
        (value * (1.0 - 0.85 * k.min(4.0 - k).clamp(0.0, 1.0))) as u8
    })
}

/// The working picture in grey, with each node's own square tinted in the colour of its clip; a shade of its
/// own marks each stretch of nodes that show one continuous piece of footage.
pub fn assignment_picture(luma: &Plane, matte: &Plane, layout: &Layout, clips: &[usize]) -> Rgb8 {
    let mut out = Rgb8::black(luma.width, luma.height);
    for (pixel, &l) in out.data.chunks_exact_mut(3).zip(&luma.data) {
        pixel.fill((l.clamp(0.0, 1.0) * 255.0) as u8);
    }
    let groups = layout.groups();
    let open = layout.open_sides();
    for (i, placement) in layout.placements.iter().enumerate() {
        // A little brightness of its own tells the pieces of a clip apart.
        let shade = 0.8 + 0.2 * unit(hash(1, &[groups[i] as u64]));
        let tint = colour(clips[i]).map(|c| f32::from(c) * shade);
        let own = |v: usize, low: bool, high: bool| {
            let (low, high) = (if low { 0 } else { STRIDE / 2 }, if high { PIECE } else { STRIDE / 2 + STRIDE });
            v + low..v + high
        };
        let Open { left, right, top, bottom } = open[i];
        for y in own(placement.node.1, top, bottom).filter(|&y| y < luma.height) {
            for x in own(placement.node.0, left, right).filter(|&x| x < luma.width) {
                let share = 0.6 * matte.at(x, y);
                let start = (y * out.width + x) * 3;
                for (byte, tint) in out.data[start..start + 3].iter_mut().zip(tint) {
                    *byte = (f32::from(*byte) * (1.0 - share) + tint * share) as u8;
                }
            }
        }
    }
    out
}
