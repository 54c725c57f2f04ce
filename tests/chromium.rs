//! The MP4 we write plays, seeks and shows its colours in Chromium. Skipped, saying so, where there is no Chromium.

use std::fs;
use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::mpsc;
use std::time::{Duration, Instant};

use enliven::raster::image::Rgb8;
use enliven::video::sink::{self, FrameRate, SinkOptions};

const WIDTH: usize = 320;
const HEIGHT: usize = 192;
const FRAMES: usize = 75;
const FPS: f64 = 25.0;
/// Longest wait for the browser.
const PATIENCE: Duration = Duration::from_secs(60);

const COLOURS: [[u8; 3]; 8] = [
    [255, 255, 255],
    [0, 0, 0],
    [200, 30, 30],
    [30, 200, 30],
    [30, 30, 200],
    [128, 128, 128],
    [240, 140, 20],
    [20, 90, 120],
];

/// Above, the frame number in binary; below, flat colours.
fn frame(t: usize) -> Rgb8 {
    let mut frame = Rgb8::black(WIDTH, HEIGHT);
    for (i, pixel) in frame.data.chunks_exact_mut(3).enumerate() {
        let (column, row) = (i % WIDTH * 8 / WIDTH, i / WIDTH * 2 / HEIGHT);
        let number = if t >> column & 1 == 1 { [255; 3] } else { [0; 3] };
        pixel.copy_from_slice(&if row == 0 { number } else { COLOURS[column] });
    }
    frame
}

/// Seeks to some frames, draws them, and logs one line each; then plays to the end.
const PAGE: &str = r#"<!doctype html><canvas id=c></canvas><script>
const v = document.createElement('video'), c = document.getElementById('c');
const say = (...parts) => console.log('RESULT ' + parts.join(' ') + ' .');
const until = name => new Promise(done => v.addEventListener(name, done, {once: true}));
v.onerror = () => { say('error', v.error.code); say('end'); };
(async () => {
  // Builds without patented codecs cannot tell anything about our file.
  if (!v.canPlayType('video/mp4; codecs="avc1.42E01E"')) { say('codec'); say('end'); return; }
  v.muted = true;
  v.src = 'a.mp4';
  await until('loadeddata');
  c.width = v.videoWidth; c.height = v.videoHeight;
  say('size', v.videoWidth, v.videoHeight, v.duration);
  const g = c.getContext('2d');
  for (const t of [0, 60, 7, 24, 25, 74, 31, 1]) {
    v.currentTime = (t + 0.5) / 25;
    await until('seeked');
    g.drawImage(v, 0, 0);
    const at = (column, row) => [...g.getImageData((column + .5) * c.width / 8, (row + .5) * c.height / 2, 1, 1).data];
    let number = 0, colours = [];
    for (let i = 0; i < 8; i++) {
      number |= (at(i, 0)[0] > 127) << i;
      colours.push(at(i, 1).slice(0, 3).join(','));
    }
    say('frame', t, number, colours.join(' '));
  }
  v.currentTime = 2; await until('seeked');
  v.play(); await until('ended');
  say('played', v.currentTime);
  say('end');
})();
</script>"#;

/// Ends the browser, however the test ends.
struct Browser(Child);

impl Drop for Browser {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

fn start(folder: &Path) -> Option<Browser> {
    let page = format!("file://{}", folder.join("page.html").display());
    let profile = format!("--user-data-dir={}", folder.join("profile").display());
    let mut command = Command::new("chromium");
    command.args(["--headless", "--no-sandbox", "--disable-quic", "--no-first-run"]);
    command.args(["--disable-background-networking", "--disable-component-update", "--disable-sync"]);
    // Colours as on a machine with a graphics card, without one.
    command.args(["--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist"]);
    command.args(["--enable-gpu-rasterization"]);
    command.args(["--allow-file-access-from-files", "--autoplay-policy=no-user-gesture-required"]);
    command.args(["--enable-logging=stderr", "--v=0", &profile, &page]);
    let child = command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::piped()).spawn();
    match child {
        Ok(child) => Some(Browser(child)),
        Err(error) => {
            println!("skipped: chromium does not start ({error})");
            None
        }
    }
}

/// What the page logged, until its end or the end of our patience.
fn results(browser: &mut Browser) -> Vec<String> {
    let stderr = browser.0.stderr.take().unwrap();
    let (send, receive) = mpsc::channel();
    std::thread::spawn(move || {
        for line in BufReader::new(stderr).lines().map_while(Result::ok) {
            let result = line.split_once("RESULT ").and_then(|(_, rest)| rest.split_once(" ."));
            if let Some((result, _)) = result
                && send.send(result.to_string()).is_err()
            {
                break;
            }
        }
    });
    let end = Instant::now() + PATIENCE;
    let mut results = Vec::new();
    while let Ok(result) = receive.recv_timeout(end.saturating_duration_since(Instant::now())) {
        if result == "end" {
            break;
        }
        results.push(result);
    }
    results
}

#[test]
fn chromium_plays_seeks_and_shows_the_colours() {
    let folder = tempfile::tempdir().unwrap();
    let options =
        SinkOptions { width: WIDTH, height: HEIGHT, rate: FrameRate::new(FPS).unwrap(), loops: true, alpha: false };
    let mut sink = sink::create(&folder.path().join("a.mp4"), options).unwrap();
    (0..FRAMES).for_each(|t| sink.push(&frame(t)).unwrap());
    sink.finish().unwrap();
    fs::write(folder.path().join("page.html"), PAGE).unwrap();
    let Some(mut browser) = start(folder.path()) else { return };
    let results = results(&mut browser);
    if results.is_empty() {
        println!("skipped: chromium said nothing in {} s", PATIENCE.as_secs());
        return;
    }
    if results[0].starts_with("codec") {
        println!("skipped: this chromium has no H.264 decoder");
        return;
    }
    assert_eq!(results[0], format!("size {WIDTH} {HEIGHT} 3"), "{results:?}");
    let frames: Vec<&String> = results.iter().filter(|r| r.starts_with("frame")).collect();
    assert_eq!(frames.len(), 8, "{results:?}");
    let mut worst = [0; 3];
    for line in frames {
        let words: Vec<&str> = line.split(' ').collect();
        assert_eq!(words[1], words[2], "asked and shown frame");
        for (shown, colour) in words[3..].iter().zip(COLOURS) {
            let shown = shown.split(',').map(|v| v.parse::<u8>().unwrap());
            shown.zip(colour).zip(&mut worst).for_each(|((a, b), worst)| *worst = a.abs_diff(b).max(*worst));
        }
    }
    println!("greatest differences of flat colours in red, green, blue: {worst:?}/255");
    // Where it falls back to converting without graphics, Chromium caps the blue coefficient of BT.709 (2.11) at 2.
    assert!(worst[0] <= 2 && worst[1] <= 2 && worst[2] <= 9, "{results:?}");
    assert!(results.iter().any(|r| r.starts_with("played 3")), "{results:?}");
}
