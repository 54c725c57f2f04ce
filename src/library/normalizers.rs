//! Scales of the three distances of the smoothness term.

use serde::{Deserialize, Serialize};

/// Medians of the smoothness distances over random neighbouring pieces; each distance is divided by its own, so that
/// the weights σ and ρ are pure numbers (Okabe et al. 2011, §5, gives no units).
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct Normalizers {
    /// Squared distance of the mean motion vectors.
    pub dc: f32,
    /// Squared distance of the logarithmic motion spectra.
    pub ac: f32,
    /// Squared distance of the logarithmic textureness.
    pub texture: f32,
}

impl Default for Normalizers {
    fn default() -> Self {
        Self { dc: 1.0, ac: 1.0, texture: 1.0 }
    }
}
