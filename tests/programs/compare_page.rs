//! The page of a comparison in Chromium: it plays, keeps in step, wipes, fits, and is labelled. Skipped, saying so, where
//! there is no Chromium.

use std::fs;

use assert_cmd::Command;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};

use crate::browser;

const FRAMES: usize = 30;

/// Before the page's own script: errors are results.
const BEFORE: &str = r"
const say = (...parts) => console.log('RESULT ' + parts.join(' ') + ' .');
window.addEventListener('error', event => say('error', event.message));
window.addEventListener('unhandledrejection', event => say('error', event.reason));
";

/// After it: uses the page as a person does.
const AFTER: &str = r#"<script>
const until = async (test) => { while (!test()) await new Promise(done => setTimeout(done, 20)); };
(async () => {
  if (!document.createElement('video').canPlayType('video/mp4; codecs="avc1.42E01E"')) { say('codec'); say('end'); return; }
  const find = name => document.querySelector(name);
  const videos = [...document.querySelectorAll('.videos video')];
  const frames = () => videos.map(video => Math.floor(video.currentTime * 25 + 1e-6));
  const spread = all => Math.max(...all) - Math.min(...all);
  await until(() => videos.every(video => video.readyState >= 2));
  say('videos', videos.length);
  const scrub = find('.scrub');
  for (const frame of [0, 17, 3, 29]) {
    scrub.value = frame;
    scrub.dispatchEvent(new Event('input'));
    await until(() => videos.every(video => !video.seeking));
    say('scrub', frame, ...frames());
  }
  const key = name => document.body.dispatchEvent(new KeyboardEvent('keydown', { key: name, bubbles: true }));
  key(' ');
  let apart = [], seen = new Set(), start = performance.now();
  while (performance.now() - start < 2500) {
    await new Promise(requestAnimationFrame);
    if (videos.some(video => video.seeking)) continue;
    apart.push(spread(frames()));
    frames().forEach(frame => seen.add(frame));
  }
  apart.sort((a, b) => a - b);
  say('played', seen.size, apart[Math.floor(0.9 * apart.length)]);
  find('.play').click();
  say('paused', videos.every(video => video.paused), find('.play').textContent);
  find('.worst').click();
  await until(() => videos.every(video => !video.seeking));
  say('worst', find('.worst').dataset.frame, ...frames());
  const before = Number(scrub.value);
  key(before > 0 ? ',' : '.');
  say('step', Number(scrub.value) - before);
  const wipe = find('.wipe');
  wipe.open = true;
  const sides = ['.left', '.right'].map(name => wipe.querySelector(name));
  // Brought to the frame of the others once their lengths are known.
  await until(() => sides.every(video => video.readyState >= 2 && !video.seeking && video.currentTime > 0));
  const border = find('.border');
  border.value = 25;
  border.dispatchEvent(new Event('input'));
  say('wipe', getComputedStyle(wipe.querySelector('.over')).clipPath, sides[0].src !== sides[1].src);
  say('together', spread([...sides, ...videos].map(video => Math.floor(video.currentTime * 25 + 1e-6))));
  const named = e => e.getAttribute('aria-label') || e.textContent.trim() || e.closest('label')?.textContent.trim();
  const parts = [...document.querySelectorAll('button, input, select, video, [tabindex]')];
  say('unnamed', parts.filter(e => !named(e)).length, [...document.querySelectorAll('img')].filter(e => !e.alt).length);
  const term = find('.term');
  term.focus();
  const tip = find('.tip');
  say('tip', !tip.hidden, tip.textContent.length > 20, tip.getBoundingClientRect().right <= window.innerWidth);
  key('Escape');
  say('escaped', tip.hidden);
  const described = [...document.querySelectorAll('.term')].filter(e => !document.getElementById(e.getAttribute('aria-describedby')));
  say('undescribed', described.length);
  // Pictures are loaded only when they come into view.
  const pictures = [...document.querySelectorAll('.pictures img')];
  pictures.forEach(picture => picture.loading = 'eager');
  await Promise.all(pictures.map(picture => picture.decode()));
  say('pictures', pictures.length, pictures.every(picture => picture.naturalWidth > 0));
  const plots = [...document.querySelectorAll('.multiples svg[role=img]')];
  say('sweeps', plots.length > 5, plots.every(plot => plot.querySelectorAll('.point').length === 2 && plot.getBoundingClientRect().height > 60));
  const scroll = [...document.querySelectorAll('.scroll')].find(e => e.querySelector('table'));
  const name = scroll.querySelector('tbody tr:nth-child(2) th');
  const there = name.getBoundingClientRect().left;
  scroll.scrollLeft = 80;
  say('sticky', Math.abs(name.getBoundingClientRect().left - there) < 1);
  say('width', document.documentElement.scrollWidth <= window.innerWidth);
  say('end');
})();
</script>"#;

fn comparison(folder: &std::path::Path) {
    let stripes = |x: usize, y: usize| ((x * 7 + y * 13) % 31 * 8) as u8;
    let data = (0..80 * 112).flat_map(|i| [stripes(i % 112, i / 112); 3]).collect();
    write_png(&folder.join("p.png"), &Rgb8 { width: 112, height: 80, data }).unwrap();
    write_grey_png(&folder.join("m.png"), &Plane::from_fn(112, 80, |x, _| f32::from(x > 30))).unwrap();
    let scene = format!("picture = 'p.png'\nmatte = 'm.png'\n[motion]\ndirection = 90\n[output]\nframes = {FRAMES}\n");
    fs::write(folder.join("scene.toml"), scene).unwrap();
    let line = "compare scene.toml --methods advect,database --sweep advect.life=20,60 -o out";
    let run = Command::cargo_bin("enliven").unwrap().current_dir(folder).env("PATH", "").args(line.split(' ')).output();
    assert!(run.unwrap().status.success());
    let page = fs::read_to_string(folder.join("out/index.html")).unwrap();
    let page =
        page.replacen("<script>", &format!("<script>{BEFORE}"), 1).replacen("</body>", &format!("{AFTER}</body>"), 1);
    fs::write(folder.join("out/tested.html"), page).unwrap();
}

#[test]
fn the_page_plays_in_step_wipes_and_fits() {
    let folder = tempfile::tempdir().unwrap();
    comparison(folder.path());
    for size in [(400, 900), (1600, 1000)] {
        let page = folder.path().join("out/tested.html");
        let Some(results) = browser::results(&page, folder.path(), size) else { return };
        println!("{size:?}: {results:?}");
        let of = |name: &str| -> Vec<Vec<&str>> {
            let parts = results.iter().map(|line| line.split(' ').collect::<Vec<_>>());
            parts.filter(|parts| parts[0] == name).map(|parts| parts[1..].to_vec()).collect()
        };
        assert!(of("error").is_empty(), "{results:?}");
        // The frozen picture and two runs; the database has no library here.
        assert_eq!(of("videos"), [["3"]]);
        assert_eq!(of("scrub").len(), 4);
        for line in of("scrub").iter().chain(&of("worst")) {
            let numbers: Vec<i64> = line.iter().map(|word| word.parse().unwrap()).collect();
            assert!(numbers[1..].iter().all(|frame| (frame - numbers[0]).abs() <= 1), "{line:?}");
        }
        let played: Vec<usize> = of("played")[0].iter().map(|word| word.parse().unwrap()).collect();
        assert!(played[0] > FRAMES / 3 && played[1] <= 1, "{played:?}");
        assert_eq!(of("paused"), [["true", "Play"]]);
        assert!(["1", "-1"].contains(&of("step")[0][0]));
        assert_eq!(of("wipe"), [["inset(0px", "75%", "0px", "0px)", "true"]]);
        assert!(["0", "1"].contains(&of("together")[0][0]));
        assert_eq!(of("unnamed"), [["0", "0"]]);
        assert_eq!(of("tip"), [["true", "true", "true"]]);
        assert_eq!(of("escaped"), [["true"]]);
        assert_eq!(of("undescribed"), [["0"]]);
        assert_eq!(of("pictures"), [["3", "true"]]);
        assert_eq!(of("sweeps"), [["true", "true"]]);
        assert_eq!(of("sticky"), [["true"]]);
        assert_eq!(of("width"), [["true"]]);
    }
}
