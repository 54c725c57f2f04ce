//! Experiments.
#![allow(clippy::all)]
use enliven::flow::{
    draw,
    field::Field,
    io,
    tv_l1::{Params, TvL1},
};
use enliven::raster::image::{Plane, Rgb8};
use std::path::Path;

fn read(path: &Path) -> Plane {
    let image = image::open(path).unwrap().to_rgb8();
    Rgb8 { width: image.width() as usize, height: image.height() as usize, data: image.into_raw() }.luma()
}
fn cpu() -> f64 {
    let t = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    t.tv_sec as f64 + t.tv_nsec as f64 * 1e-9
}
fn main() {
    let root = std::env::var("ENLIVEN_DATA").unwrap();
    let e = |k: &str, d: f32| std::env::var(k).ok().map_or(d, |v| v.parse().unwrap());
    for (pname, mut params) in [("quality", Params::quality()), ("library", Params::library())] {
        if std::env::var("ONLY").is_ok_and(|o| o != pname) {
            continue;
        }
        params.lambda = e("L", params.lambda);
        params.theta = e("T", params.theta);
        params.tau = e("TAU", params.tau);
        params.scale = e("S", params.scale);
        params.warps = e("W", params.warps as f32) as usize;
        params.iterations = e("I", params.iterations as f32) as usize;
        params.median = e("M", params.median as f32) as usize;
        params.gradient_blend = e("B", params.gradient_blend);
        params.min_side = e("MS", params.min_side as f32) as usize;
        for name in ["RubberWhale", "Dimetrodon"] {
            let dir = Path::new(&root).join("benchmarks/flow").join(name);
            let (a, b) = (read(&dir.join("frame10.png")), read(&dir.join("frame11.png")));
            let truth = io::read(&dir.join("flow10.flo")).unwrap();
            let mut s = TvL1::new(a.width, a.height, params);
            let mut out = Field::default();
            let mut best = f64::MAX;
            for _ in 0..e("R", 1.0) as usize {
                let t = cpu();
                s.flow(&a, &b, &mut out);
                best = best.min(cpu() - t);
            }
            let (mut sum, mut n) = (0.0, 0);
            for i in 0..truth.u.data.len() {
                if io::is_known(truth.u.data[i], truth.v.data[i]) {
                    sum += f64::from((truth.u.data[i] - out.u.data[i]).hypot(truth.v.data[i] - out.v.data[i]));
                    n += 1;
                }
            }
            println!("{pname} {name} {}x{} AEE {:.4} cpu {:.3}s", a.width, a.height, sum / n as f64, best);
            if let Ok(d) = std::env::var("DRAW") {
                for (tag, f) in [("out", &out), ("truth", &truth)] {
                    let c = draw::colour(f, 0.0);
                    image::save_buffer(
                        format!("{d}/{pname}-{name}-{tag}.png"),
                        &c.data,
                        c.width as u32,
                        c.height as u32,
                        image::ColorType::Rgb8,
                    )
                    .unwrap();
                }
            }
        }
    }
}
