//! Mattes drawn as polygons: read from JSON, filled with soft edges.

use std::path::Path;

use anyhow::{Context, Result};
use enliven::raster::filter;
use enliven::raster::image::Plane;
use serde::Deserialize;

/// What the JSON file says.
#[derive(Deserialize)]
pub struct Outlines {
    /// Blur of the edges: standard deviation in pixels.
    pub feather: f32,
    /// Outlines of the water, in pixels of the picture.
    pub water: Vec<Vec<[f32; 2]>>,
    /// Outlines of what stands in it.
    pub rock: Vec<Vec<[f32; 2]>>,
}

impl Outlines {
    /// Reads a file.
    pub fn read(path: &Path) -> Result<Self> {
        let text = std::fs::read_to_string(path).with_context(|| path.display().to_string())?;
        serde_json::from_str(&text).with_context(|| path.display().to_string())
    }

    /// White inside the water.
    pub fn fill(&self, width: usize, height: usize) -> Plane {
        const SUB: usize = 3;
        let hard = Plane::from_fn(width, height, |px, py| {
            let sub = |i: usize, start: usize| start as f32 + (i as f32 + 0.5) / SUB as f32;
            let hits = (0..SUB * SUB).filter(|i| {
                let (x, y) = (sub(i % SUB, px), sub(i / SUB, py));
                self.water.iter().any(|p| contains(p, x, y)) && !self.rock.iter().any(|p| contains(p, x, y))
            });
            hits.count() as f32 / (SUB * SUB) as f32
        });
        filter::gaussian(&hard, self.feather)
    }
}

fn contains(polygon: &[[f32; 2]], x: f32, y: f32) -> bool {
    let mut inside = false;
    for (i, &[ax, ay]) in polygon.iter().enumerate() {
        let [bx, by] = polygon[(i + 1) % polygon.len()];
        if (ay > y) != (by > y) && x < ax + (y - ay) / (by - ay) * (bx - ax) {
            inside = !inside;
        }
    }
    inside
}
