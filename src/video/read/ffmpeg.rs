//! Whatever the user's own `ffmpeg` reads, when `ffmpeg` and `ffprobe` are on PATH: run with argument lists, never
//! through a shell, allowed to open nothing but the one local file, killed when the clip is dropped.

use std::ffi::{OsStr, OsString};
use std::io::{BufRead, BufReader, Read};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdout, Command, Stdio};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::time::Duration;

use serde::Deserialize;

use super::decoder::MAX_PIXELS;
use super::h264::Colour;
use crate::base::error::{Error, Kind, Result};
use crate::video::clip::{ClipInfo, Pixels, Range, RawFrame, Source, Turn};

/// How to get what is missing.
pub const REMEDY: &str = "install ffmpeg (ffmpeg and ffprobe on PATH), or convert the clip to H.264 in MP4";

/// An absolute path of `program` on PATH.
fn on_path(program: &str) -> Option<PathBuf> {
    let name = format!("{program}{}", std::env::consts::EXE_SUFFIX);
    let path = std::env::var_os("PATH")?;
    std::env::split_paths(&path).filter(|dir| dir.is_absolute()).map(|dir| dir.join(&name)).find(|p| p.is_file())
}

/// Whether both programs are there.
pub fn available() -> bool {
    on_path("ffmpeg").is_some() && on_path("ffprobe").is_some()
}

#[derive(Debug, Deserialize)]
struct Probe {
    #[serde(default)]
    streams: Vec<Stream>,
}

#[derive(Debug, Deserialize)]
struct Stream {
    codec_name: Option<String>,
    width: Option<usize>,
    height: Option<usize>,
    pix_fmt: Option<String>,
    color_range: Option<String>,
    color_space: Option<String>,
    nb_frames: Option<String>,
    duration: Option<String>,
    avg_frame_rate: Option<String>,
    #[serde(default)]
    tags: std::collections::BTreeMap<String, String>,
    #[serde(default)]
    side_data_list: Vec<SideData>,
}

#[derive(Debug, Deserialize)]
struct SideData {
    rotation: Option<f64>,
}

impl Stream {
    /// Rotation tags count counter-clockwise in side data, clockwise in the older `rotate` tag.
    fn turn(&self) -> Turn {
        let tag = || self.tags.get("rotate").and_then(|t| t.parse::<f64>().ok());
        let clockwise = self.side_data_list.iter().find_map(|s| s.rotation).map(|r| -r).or_else(tag).unwrap_or(0.0);
        match (clockwise / 90.0).round().rem_euclid(4.0) as u8 {
            1 => Turn::Right,
            2 => Turn::Half,
            3 => Turn::Left,
            _ => Turn::None,
        }
    }

    fn colour(&self) -> Colour {
        let matrix = match self.color_space.as_deref() {
            Some("bt709" | "smpte240m" | "bt2020nc" | "bt2020c") => Some(1),
            Some("bt470bg" | "smpte170m" | "fcc") => Some(6),
            _ => None,
        };
        Colour { matrix, full_range: Some(self.color_range.as_deref() == Some("pc")) }
    }

    /// Whether the pixels are RGB (or a palette) rather than Y'CbCr.
    fn is_rgb(&self) -> bool {
        let name = self.pix_fmt.as_deref().unwrap_or_default();
        ["rgb", "bgr", "gbr", "pal8", "argb", "abgr"].iter().any(|p| name.starts_with(p))
    }

    fn rate(&self) -> f64 {
        let parts = self.avg_frame_rate.as_deref().and_then(|r| r.split_once('/'));
        let rate = parts.and_then(|(n, d)| Some(n.parse::<f64>().ok()? / d.parse::<f64>().ok()?));
        rate.filter(|r| r.is_finite() && *r > 0.0).unwrap_or(25.0)
    }
}

fn url(path: &Path) -> OsString {
    let mut url = OsString::from("file:");
    url.push(path);
    url
}

fn probe(program: &Path, path: &Path) -> Result<Stream> {
    let entries = "stream=codec_name,width,height,pix_fmt,color_range,color_space,nb_frames,duration,avg_frame_rate\
                   :stream_tags=rotate:stream_side_data=rotation";
    let output = Command::new(program)
        .args(["-v", "error", "-protocol_whitelist", "file", "-select_streams", "v:0", "-show_entries", entries])
        .args(["-of", "json"])
        .arg(url(path))
        .stdin(Stdio::null())
        .output()
        .map_err(|e| Error::io(program, "run", e))?;
    let refuse = |problem: String| Error::file(Kind::Data, path, problem).remedy("check that it is a video that plays");
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        let said = said.lines().last().unwrap_or("no reason given").rsplit(": ").next().unwrap_or_default();
        return Err(refuse(format!("not a video that ffmpeg can read ({said})")));
    }
    let probe: Probe = serde_json::from_slice(&output.stdout)
        .map_err(|e| Error::file(Kind::Data, path, "ffprobe gave an answer that cannot be read").source(e))?;
    probe.streams.into_iter().next().ok_or_else(|| refuse("it has no video stream".into()))
}

/// Whether this ffmpeg knows `-fps_mode` (since 5.1); older ones call it `-vsync`, newer ones may know that no more.
fn knows_fps_mode(program: &Path) -> bool {
    let output = Command::new(program).arg("-version").stdin(Stdio::null()).output();
    let text = output.map(|o| String::from_utf8_lossy(&o.stdout).into_owned()).unwrap_or_default();
    let version = text.strip_prefix("ffmpeg version ").unwrap_or_default().trim_start_matches('n');
    let mut parts = version.split(|c: char| !c.is_ascii_digit()).map(|p| p.parse::<u32>().ok());
    match (parts.next().flatten(), parts.next().flatten()) {
        (Some(major), minor) => (major, minor.unwrap_or(0)) >= (5, 1),
        _ => true,
    }
}

/// A clip read through a pipe from ffmpeg.
pub struct Ffmpeg {
    path: PathBuf,
    info: ClipInfo,
    colour: Colour,
    rgb: bool,
    rate: f64,
    child: Child,
    output: BufReader<ChildStdout>,
    times: Receiver<f64>,
    complaint: Receiver<String>,
    frames: u64,
    over: bool,
}

/// Opens a file with ffmpeg. `what` names codec or container for the message when ffmpeg is absent.
///
/// # Errors
/// When ffmpeg is absent, or cannot read the file.
pub fn open(path: &Path, what: &str) -> Result<Ffmpeg> {
    let (Some(program), Some(prober)) = (on_path("ffmpeg"), on_path("ffprobe")) else {
        return Err(missing(path, what));
    };
    let stream = probe(&prober, path)?;
    let (width, height) = (stream.width.unwrap_or(0), stream.height.unwrap_or(0));
    if width == 0 || height == 0 || width.saturating_mul(height) > MAX_PIXELS {
        let problem = format!("its frames are said to be {width} × {height} pixels");
        return Err(Error::file(Kind::Data, path, problem).allowed(format!("1 to {MAX_PIXELS} pixels")));
    }
    let rgb = stream.is_rgb();
    let colour = stream.colour();
    let format = match (rgb, colour.full_range) {
        (true, _) => "rgb24",
        (false, Some(true)) => "yuvj420p",
        (false, _) => "yuv420p",
    };
    let mut child = command(&program, path, format).spawn().map_err(|e| Error::io(&program, "run", e))?;
    let (times, complaint) = listen(child.stderr.take());
    let Some(output) = child.stdout.take() else { return Err(Error::file(Kind::Io, path, "ffmpeg gave no pipe")) };
    let duration = stream.duration.as_deref().and_then(|d| d.parse::<f64>().ok());
    let info = ClipInfo {
        width,
        height,
        turn: stream.turn(),
        frames: stream.nb_frames.as_deref().and_then(|n| n.parse().ok()),
        duration_ns: duration.filter(|d| d.is_finite() && *d > 0.0).map(|d| (d * 1e9) as u64),
        codec: stream.codec_name.clone().unwrap_or_else(|| what.into()),
        decoder: "ffmpeg",
    };
    let output = BufReader::with_capacity(1 << 16, output);
    let (path, rate) = (path.to_path_buf(), stream.rate());
    Ok(Ffmpeg { path, info, colour, rgb, rate, child, output, times, complaint, frames: 0, over: false })
}

/// The error for a clip that only ffmpeg could read.
pub fn missing(path: &Path, what: &str) -> Error {
    let problem = format!("{what} is not read by the embedded decoders, and ffmpeg is not available");
    Error::file(Kind::Unsupported, path, problem).remedy(REMEDY)
}

fn command(program: &Path, path: &Path, format: &str) -> Command {
    let passthrough = if knows_fps_mode(program) { "-fps_mode" } else { "-vsync" };
    let mut command = Command::new(program);
    command
        .args(["-hide_banner", "-nostdin", "-nostats", "-loglevel", "info", "-protocol_whitelist", "file"])
        .args(["-noautorotate", "-i"])
        .arg(url(path))
        .args(["-map", "0:v:0", "-an", "-sn", "-dn", passthrough, "passthrough"])
        .args([OsStr::new("-vf"), OsStr::new("showinfo=checksum=0"), OsStr::new("-pix_fmt"), OsStr::new(format)])
        .args(["-f", "rawvideo", "pipe:1"])
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped());
    command
}

/// Drains ffmpeg's messages on a thread of their own, so that its pipe never fills: presentation times as `showinfo`
/// tells them, and the last complaint.
fn listen(stderr: Option<std::process::ChildStderr>) -> (Receiver<f64>, Receiver<String>) {
    let (send_time, times) = channel();
    let (send_complaint, complaint) = channel();
    if let Some(stderr) = stderr {
        std::thread::spawn(move || drain(BufReader::new(stderr), &send_time, &send_complaint));
    }
    (times, complaint)
}

fn drain(mut lines: impl BufRead, times: &Sender<f64>, complaint: &Sender<String>) {
    let mut last = String::new();
    let mut line = Vec::new();
    while lines.by_ref().take(1 << 16).read_until(b'\n', &mut line).is_ok_and(|n| n > 0) {
        let text = String::from_utf8_lossy(&line);
        let text = text.trim();
        if text.starts_with("[Parsed_showinfo") {
            if let Some(time) = time_of(text) {
                // Nobody listens any more once the clip is dropped; draining goes on all the same.
                let _ = times.send(time);
            }
        } else if ["rror", "nvalid", "failed", "not found"].iter().any(|w| text.contains(w)) {
            last = text.chars().take(200).collect();
        }
        line.clear();
    }
    let _ = complaint.send(last);
}

/// `pts_time:` of a `showinfo` line about a frame.
fn time_of(line: &str) -> Option<f64> {
    line.contains(" n:").then_some(())?;
    let after = line.split_once("pts_time:")?.1;
    after.split_whitespace().next()?.parse().ok()
}

impl Ffmpeg {
    fn frame_bytes(&self) -> usize {
        let (w, h) = (self.info.width, self.info.height);
        if self.rgb { 3 * w * h } else { w * h + 2 * w.div_ceil(2) * h.div_ceil(2) }
    }

    /// Time of the frame just read; without one, the stream's average rate.
    fn time(&self) -> u64 {
        let told = self.times.recv_timeout(Duration::from_secs(2)).ok();
        let seconds = told.unwrap_or(self.frames as f64 / self.rate);
        (seconds.max(0.0) * 1e9).round() as u64
    }

    fn pixels(&self, data: Vec<u8>) -> Pixels {
        if self.rgb {
            return Pixels::Rgb(data);
        }
        let (w, h) = (self.info.width, self.info.height);
        let (matrix, range) = self.colour.resolve(w, h);
        let range = if range == Range::Full { Range::Full } else { Range::Limited };
        let (luma, chroma) = (w * h, w.div_ceil(2) * h.div_ceil(2));
        let planes = [data[..luma].to_vec(), data[luma..luma + chroma].to_vec(), data[luma + chroma..].to_vec()];
        Pixels::Yuv { planes, subsampling: (2, 2), matrix, range }
    }

    /// At the end of the pipe: how ffmpeg fared.
    fn end(&mut self, left_over: usize) -> Result<()> {
        self.over = true;
        let status = self.child.wait().map_err(|e| Error::io(&self.path, "read through ffmpeg", e))?;
        if status.success() && left_over == 0 {
            return Ok(());
        }
        let said = self.complaint.recv_timeout(Duration::from_secs(2)).unwrap_or_default();
        let said = if said.is_empty() { "it gave no reason".to_string() } else { said };
        let problem = format!("ffmpeg stopped after {} frames ({said})", self.frames);
        Err(Error::file(Kind::Data, &self.path, problem).remedy("check that it is a video that plays to its end"))
    }
}

impl Source for Ffmpeg {
    fn info(&self) -> &ClipInfo {
        &self.info
    }

    fn next_frame(&mut self) -> Result<Option<RawFrame>> {
        if self.over {
            return Ok(None);
        }
        let bytes = self.frame_bytes();
        let mut data = Vec::with_capacity(bytes);
        let read = self.output.by_ref().take(bytes as u64).read_to_end(&mut data);
        read.map_err(|e| Error::io(&self.path, "read through ffmpeg", e))?;
        if data.len() < bytes {
            self.end(data.len())?;
            return Ok(None);
        }
        let time_ns = self.time();
        self.frames += 1;
        Ok(Some(RawFrame { width: self.info.width, height: self.info.height, time_ns, pixels: self.pixels(data) }))
    }
}

impl Drop for Ffmpeg {
    fn drop(&mut self) {
        // Already gone is as good as killed; waiting keeps no zombie behind.
        let _ = self.child.kill();
        let _ = self.child.wait();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_read_from_showinfo_lines() {
        let line = "[Parsed_showinfo_0 @ 0x55d] n:   3 pts:   1536 pts_time:0.12    duration: 512 fmt:yuv420p";
        assert_eq!(time_of(line), Some(0.12));
        assert_eq!(time_of("[Parsed_showinfo_0 @ 0x55d] config in time_base: 1/12800"), None);
        assert_eq!(time_of("[Parsed_showinfo_0 @ 0x55d] n:   3 pts: NOPTS pts_time:NOPTS"), None);
    }
}
