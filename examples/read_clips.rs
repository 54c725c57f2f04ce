//! Reads every clip under `$ENLIVEN_DATA/clips`: which decoder read it, what was found in it, or why it was refused;
//! and, when ffmpeg is on PATH, compares every frame of the embedded H.264 decoder with ffmpeg's, plane by plane.
//!
//! `ENLIVEN_DATA=… cargo run --release --example read_clips [NAME…]` — exit code 1 when a frame differs.

use std::io::Read;
use std::path::{Path, PathBuf};
use std::process::{Command, ExitCode, Stdio};
use std::time::Duration;

use enliven::base::error::Result;
use enliven::video::clip::Range;
use enliven::video::clip::{Pixels, RawFrame};
use enliven::video::conform::{ConformOptions, Conformed};
use enliven::video::read::ffmpeg;
use enliven::video::read::source::{self, Decoder};

fn main() -> ExitCode {
    let Some(data) = std::env::var_os("ENLIVEN_DATA") else {
        eprintln!("ENLIVEN_DATA does not name the data folder");
        return ExitCode::from(2);
    };
    let wanted: Vec<String> = std::env::args().skip(1).collect();
    let mut clips = Vec::new();
    gather(&Path::new(&data).join("clips"), &mut clips);
    clips.sort();
    clips.retain(|c| wanted.is_empty() || wanted.iter().any(|w| c.to_string_lossy().contains(w.as_str())));
    let compare = ffmpeg::available();
    println!("{:<22} {:<24} {:<14} same as ffmpeg", "clip", "codec", "decoder");
    println!("{:<22} conformed: read, duplicates, dropped, out, size, rate, bars, speed, CPU ms per frame", "");
    let mut differing = 0;
    for clip in &clips {
        let same = compare.then(|| identical(clip)).flatten();
        differing += usize::from(matches!(same, Some(Err(_))));
        describe(clip, same);
    }
    println!("{} clips, {differing} differ from ffmpeg", clips.len());
    ExitCode::from(u8::from(differing > 0))
}

fn gather(folder: &Path, clips: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
        let path = entry.path();
        if path.is_dir() { gather(&path, clips) } else { clips.push(path) }
    }
}

/// CPU time of this process's calling thread.
fn cpu() -> Duration {
    let now = rustix::time::clock_gettime(rustix::time::ClockId::ThreadCPUTime);
    Duration::new(now.tv_sec as u64, now.tv_nsec as u32)
}

fn describe(clip: &Path, same: Option<std::result::Result<usize, String>>) {
    let name = clip.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let start = cpu();
    match conform(clip) {
        Ok(conformed) => {
            let r = conformed.report();
            let same = match same {
                None => "—".into(),
                Some(Ok(frames)) => format!("all {frames} frames"),
                Some(Err(problem)) => format!("NO: {problem}"),
            };
            let ms = (cpu() - start).as_secs_f64() * 1e3 / r.frames_read.max(1) as f64;
            println!("{name:<22} {:<24} {:<14} {same}", r.codec, r.decoder);
            let bars = r.black_bars.map_or("none".into(), |c| format!("{}×{}+{}+{}", c.width, c.height, c.x, c.y));
            println!(
                "{:<22} {} read, {} dup, {} dropped, {} out, {}×{} → {}×{}, {:.2}/s{}, bars {bars}, ×{:.2}, {ms:.1} ms",
                "",
                r.frames_read,
                r.duplicates_removed,
                r.frames_dropped,
                r.frames_out,
                r.source.0,
                r.source.1,
                r.working.0,
                r.working.1,
                r.source_rate,
                if r.variable_rate { " variable" } else { "" },
                r.speed,
            );
        }
        Err(error) => println!("{name:<22} refused: {error}"),
    }
}

fn conform(clip: &Path) -> Result<Conformed> {
    let mut conformed = Conformed::open(clip, &ConformOptions::default())?;
    while conformed.next_frame()?.is_some() {}
    Ok(conformed)
}

/// Compares a clip that the embedded H.264 decoder reads with ffmpeg: the number of frames, or the first difference.
/// `None` for other clips.
fn identical(clip: &Path) -> Option<std::result::Result<usize, String>> {
    let mut source = source::open_with(clip, Decoder::Embedded).ok()?;
    if source.info().decoder != "embedded h264" {
        return None;
    }
    Some(compare(clip, &mut || source.next_frame()))
}

fn compare(clip: &Path, next: &mut dyn FnMut() -> Result<Option<RawFrame>>) -> std::result::Result<usize, String> {
    let mut frame = next().map_err(|e| e.to_string())?;
    let full = matches!(&frame, Some(RawFrame { pixels: Pixels::Yuv { range: Range::Full, .. }, .. }));
    let mut child = Command::new("ffmpeg")
        .args(["-v", "error", "-nostdin", "-noautorotate", "-i"])
        .arg(clip)
        .args(["-map", "0:v:0", "-f", "rawvideo", "-vsync", "passthrough", "-pix_fmt"])
        .args([if full { "yuvj420p" } else { "yuv420p" }, "-"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::null())
        .spawn()
        .map_err(|e| e.to_string())?;
    let mut pipe = child.stdout.take().ok_or("no pipe")?;
    let mut count = 0;
    let mut verdict = Ok(());
    while let Some(ours) = &frame {
        let Pixels::Yuv { planes, .. } = &ours.pixels else { return Err("not Y'CbCr".into()) };
        let mut theirs = vec![0; planes.iter().map(Vec::len).sum()];
        if pipe.read_exact(&mut theirs).is_err() {
            verdict = Err(format!("ffmpeg has only {count} frames"));
            break;
        }
        if blake3::hash(&planes.concat()) != blake3::hash(&theirs) {
            verdict = Err(format!("frame {count} differs"));
            break;
        }
        count += 1;
        frame = next().map_err(|e| e.to_string())?;
    }
    let more = verdict.is_ok() && pipe.read(&mut [0]).is_ok_and(|n| n > 0);
    let _ = child.kill();
    let _ = child.wait();
    verdict?;
    if more { Err(format!("ffmpeg has more than {count} frames")) } else { Ok(count) }
}
