//! The MP4 we write plays, seeks and shows its colours in Chromium. Skipped, saying so, where there is no Chromium.

use std::fs;

use enliven::raster::image::Rgb8;
use enliven::video::write::options::{FrameRate, SinkOptions};
use enliven::video::write::sink;

use crate::browser;

const WIDTH: usize = 320;
const HEIGHT: usize = 192;
const FRAMES: usize = 75;
const FPS: f64 = 25.0;

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
    // The end of seeking is told before the frame is there to be drawn; what is shown already is not shown anew.
    const shown = new Promise(done => v.requestVideoFrameCallback(done));
    v.currentTime = (t + 0.5) / 25;
    await until('seeked');
    await Promise.race([shown, new Promise(done => setTimeout(done, 1000))]);
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

#[test]
fn chromium_plays_seeks_and_shows_the_colours() {
    let folder = tempfile::tempdir().unwrap();
    let options =
        SinkOptions { width: WIDTH, height: HEIGHT, rate: FrameRate::new(FPS).unwrap(), loops: true, alpha: false };
    let mut sink = sink::create(&folder.path().join("a.mp4"), options).unwrap();
    (0..FRAMES).for_each(|t| sink.push(&frame(t)).unwrap());
    sink.finish().unwrap();
    fs::write(folder.path().join("page.html"), PAGE).unwrap();
    let Some(results) = browser::results(&folder.path().join("page.html"), folder.path(), (800, 600)) else { return };
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
