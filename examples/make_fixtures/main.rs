//! Makes everything under `fixtures/` that a program can make: `cargo run --release --example make_fixtures -- OUTDIR`.

mod canvas;
mod falls;
mod fire;
mod fluid;
mod land;
mod noise;
mod numeric;
mod smoke;

use std::path::Path;

use enliven::raster::image::Rgb8;

fn write_png(path: &Path, picture: &Rgb8) {
    image::save_buffer(path, &picture.data, picture.width as u32, picture.height as u32, image::ColorType::Rgb8).unwrap();
}

fn main() {
    let out = std::env::args().nth(1).expect("output folder");
    let out = Path::new(&out);
    std::fs::create_dir_all(out).unwrap();
    let what = std::env::args().nth(2).unwrap_or_default();
    let start = std::time::Instant::now();
    if what == "falls" {
        let scene = falls::clip_scene();
        let renderer = falls::FallsRenderer::new(&scene);
        println!("setup {:?}", start.elapsed());
        for t in 0..8 {
            write_png(&out.join(format!("falls{t:03}.png")), &renderer.frame(t as f32 + 200.0));
        }
        write_png(&out.join("falls.matte.png"), &canvas::grey(&renderer.matte()));
    }
    if what == "fire" {
        let scene = fire::clip_scene();
        let ground = fire::hearth(&scene);
        let mut burning = fire::Burning::lit(&scene, 60);
        println!("setup {:?}", start.elapsed());
        for t in 0..12 {
            let mut canvas = ground.clone();
            burning.draw(&mut canvas);
            write_png(&out.join(format!("fire{t:03}.png")), &canvas.develop(1.3));
            for _ in 0..4 {
            burning.advance();
            }
        }
    }
    if what == "smoke" {
        let scene = smoke::clip_scene();
        let ground = smoke::dusk(&scene);
        let mut burning = smoke::Smoking::started(&scene, 180);
        println!("setup {:?}", start.elapsed());
        for t in 0..8 {
            let mut canvas = ground.clone();
            burning.draw(&mut canvas);
            write_png(&out.join(format!("smoke{t:03}.png")), &canvas.develop(1.0));
            for _ in 0..4 {
            burning.advance();
            }
        }
    }
    println!("0 {:?}", start.elapsed());
}
