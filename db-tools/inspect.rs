//! `enliven-db inspect`: what is in a pack.

use std::path::PathBuf;

use enliven::base::error::Result;
use enliven::base::observe::Observer;
use enliven::cli::common::{bytes, counted};
use enliven::library::names::Names;
use enliven::library::reader::Pack;
use enliven::library::variant::Variant;
use enliven::say;
use serde_json::json;

/// Show what is in a library: parameters, clips, pieces and why others were left out.
#[derive(clap::Args)]
pub struct Inspect {
    /// The library
    pack: PathBuf,
    /// Print as JSON
    #[arg(long)]
    json: bool,
}

impl Inspect {
    pub fn run(&self, observer: &dyn Observer) -> Result<()> {
        let pack = Pack::open(&self.pack)?;
        let names = Names::read(&self.pack, pack.clips(), observer);
        if self.json {
            say!("{}", as_json(&pack, &names));
        } else {
            self.print(&pack, &names);
        }
        Ok(())
    }

    fn print(&self, pack: &Pack, names: &Names) {
        let parameters = pack.parameters();
        let size = std::fs::metadata(&self.pack).map_or(0, |m| m.len());
        say!(
            "{}: {}, {}, {}",
            self.pack.display(),
            bytes(size),
            counted(pack.clips().len() as u64, "clip"),
            counted(pack.piece_count() as u64, "piece")
        );
        say!(
            "  {} frames/s, pieces of {} px every {} px, {} words",
            parameters.rate,
            parameters.piece,
            parameters.stride,
            parameters.words
        );
        let n = pack.normalizers();
        say!("  medians of the smoothness terms: motion {:.4}, dynamics {:.4}, texture {:.4}", n.dc, n.ac, n.texture);
        say!(
            "{:18} {:10} {:>9} {:>7} {:>8} {:>6} {:>8} {:>8}  {}",
            "clip",
            "tag",
            "size",
            "frames",
            "pieces",
            "share",
            "outside",
            "still",
            "file"
        );
        for clip in pack.clips() {
            let sum = |of: fn(&enliven::library::metadata::PieceCounts) -> u32| -> u64 {
                clip.counts.iter().map(|c| u64::from(of(c))).sum()
            };
            say!(
                "{:18} {:10} {:>9} {:>7} {:>8} {:>5.1}% {:>8} {:>8}  {}",
                clip.id.to_string(),
                clip.tag,
                format!("{}x{}", clip.width, clip.height),
                clip.frames,
                clip.pieces(),
                100.0 * clip.pieces() as f64 / pack.piece_count().max(1) as f64,
                sum(|c| c.outside),
                sum(|c| c.still),
                names.of(clip.id).unwrap_or_default()
            );
        }
    }
}

fn as_json(pack: &Pack, names: &Names) -> serde_json::Value {
    let parameters = pack.parameters();
    let variants = |counts: &[enliven::library::metadata::PieceCounts; Variant::COUNT]| -> serde_json::Value {
        let row = |(variant, c): (Variant, &enliven::library::metadata::PieceCounts)| {
            json!({ "flip": variant.flip, "scale": variant.scale_factor(), "degrees": variant.degrees(),
                "pieces": c.kept, "outside": c.outside, "still": c.still })
        };
        Variant::all().zip(counts).map(row).collect()
    };
    let clip = |c: &enliven::library::metadata::ClipMeta| {
        json!({ "id": c.id.to_string(), "name": names.of(c.id), "tag": c.tag, "width": c.width, "height": c.height, "frames": c.frames,
            "pieces": c.pieces(), "variants": variants(&c.counts) })
    };
    let n = pack.normalizers();
    json!({
        "rate": parameters.rate, "stride": parameters.stride, "words": parameters.words, "piece": parameters.piece,
        "cell": parameters.cell, "pieces": pack.piece_count(),
        "normalizers": { "dc": n.dc, "ac": n.ac, "texture": n.texture },
        "clips": pack.clips().iter().map(clip).collect::<Vec<_>>(),
    })
}
