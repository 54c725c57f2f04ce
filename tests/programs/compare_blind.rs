//! The blind test of `enliven compare`: the page that people vote on, in Chromium where there is one, and what becomes of
//! their votes.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::process::Output;

use assert_cmd::Command;
use enliven::base::rng;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};
use enliven::report::comparison::blind::BlindTest;
use enliven::report::comparison::blind::key::{Key, Named};
use enliven::report::comparison::{Comparison, Sort};
use serde_json::{Value, json};
use tempfile::TempDir;

use crate::browser;

const FRAMES: usize = 12;
/// Two methods in two scenes, and both planted ones.
const MAKE: &str =
    "torrent.toml brook.toml --methods advect --sweep advect.life=20,60 --blind --plant frozen,shuffled -o out";
const ROWS: [&str; 4] = ["frozen", "advect life=20", "advect life=60", "shuffled"];

/// A folder with two scenes of one picture.
fn studio() -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    let stripes = |x: usize, y: usize| ((x * 7 + y * 13) % 31 * 8) as u8;
    let data = (0..80 * 112).flat_map(|i| [stripes(i % 112, i / 112); 3]).collect();
    write_png(&folder.path().join("p.png"), &Rgb8 { width: 112, height: 80, data }).unwrap();
    write_grey_png(&folder.path().join("m.png"), &Plane::from_fn(112, 80, |x, _| f32::from(x > 30))).unwrap();
    for (name, direction) in [("torrent", 90), ("brook", 0)] {
        let motion = format!("[motion]\ndirection = {direction}\n[output]\nframes = {FRAMES}\n");
        fs::write(folder.path().join(format!("{name}.toml")), format!("picture = 'p.png'\nmatte = 'm.png'\n{motion}"))
            .unwrap();
    }
    folder
}

fn run(folder: &Path, line: &str) -> Output {
    let mut command = Command::cargo_bin("enliven").unwrap();
    command.current_dir(folder).env("PATH", "").arg("compare").args(line.split_whitespace()).output().unwrap()
}

/// What a run that succeeds says, results first.
fn succeed(folder: &Path, line: &str) -> String {
    let output = run(folder, line);
    let text = |bytes: &[u8]| String::from_utf8(bytes.to_vec()).unwrap();
    assert!(output.status.success(), "{line}: {}", text(&output.stderr));
    text(&output.stdout) + &text(&output.stderr)
}

fn results(folder: &Path) -> Comparison {
    Comparison::read(&folder.join("out")).unwrap()
}

fn blind(folder: &Path) -> BlindTest {
    results(folder).blind.unwrap()
}

fn key(folder: &Path) -> Key {
    Key::load(&folder.join("out")).unwrap().unwrap()
}

/// A vote on every pair of every scene, by a person who chooses like `prefers`; the first pairs once more, with sides swapped.
fn ballot(key: &Key, session: u64, prefers: impl Fn(&Named, &Named, u64) -> &'static str) -> Value {
    let mut votes = Vec::new();
    let all: Vec<(&String, &Named)> = key.videos.iter().collect();
    for (i, left) in all.iter().enumerate() {
        for right in all[..i].iter().filter(|right| right.1.scene == left.1.scene) {
            votes.push((*left, *right));
        }
    }
    let again: Vec<_> = votes.iter().take(3).map(|(left, right)| (*right, *left)).collect();
    votes.extend(again);
    let votes: Vec<Value> = votes
        .into_iter()
        .enumerate()
        .map(|(i, (left, right))| {
            let choice = prefers(left.1, right.1, rng::hash(session, &[i as u64]));
            json!({ "left": left.0, "right": right.0, "choice": choice, "seconds": 2.5 })
        })
        .collect();
    json!({ "format": "enliven votes 1", "comparison": key.comparison, "session": format!("{session:016x}"),
        "voter": "", "saved": "2026-01-31T12:00:00Z", "votes": votes })
}

/// How good a row is to somebody who can tell.
fn goodness(row: &str) -> usize {
    ["shuffled", "frozen", "advect life=20", "advect life=60"].iter().position(|name| *name == row).unwrap()
}

fn able(left: &Named, right: &Named, _: u64) -> &'static str {
    if goodness(&left.row) > goodness(&right.row) { "left" } else { "right" }
}

fn careless(_: &Named, _: &Named, chance: u64) -> &'static str {
    ["left", "tie", "right"][rng::below(chance, 3) as usize]
}

fn write(folder: &Path, name: &str, ballot: &Value) {
    fs::write(folder.join(name), ballot.to_string()).unwrap();
}

#[test]
fn neither_the_page_nor_its_files_name_a_video() {
    let folder = studio();
    let said = succeed(folder.path(), MAKE);
    assert!(said.contains("blind.html"), "{said}");
    let out = folder.path().join("out");
    let key = key(folder.path());
    let page = fs::read_to_string(out.join("blind.html")).unwrap();
    for name in ["frozen", "shuffled", "advect", "life", "torrent", "brook", "blind-key"] {
        assert!(!page.contains(name), "{name} is on the page");
    }
    assert!(!page.contains("://"));
    let mut files: Vec<String> =
        fs::read_dir(out.join("blind")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    files.sort();
    let named: Vec<String> = key.videos.keys().map(|id| format!("{id}.mp4")).collect();
    assert_eq!(files, named);
    assert!(files.iter().all(|file| page.contains(file.as_str())));
    // The key leads back to each row, and its video is the same.
    let mut rows: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (id, named) in &key.videos {
        rows.entry(&named.scene).or_default().push(&named.row);
        let stem = named.row.replace(' ', "-");
        let original = fs::read(out.join(format!("{}/{stem}.mp4", named.scene))).unwrap();
        assert!(fs::read(out.join(format!("blind/{id}.mp4"))).unwrap() == original);
    }
    let mut expected = ROWS.to_vec();
    expected.sort_unstable();
    for (scene, mut found) in rows {
        found.sort_unstable();
        assert_eq!(found, expected, "{scene}");
    }
    // The comparison tells of the planted row, and it has no part in what is best.
    let found = results(folder.path());
    let shuffled = &found.scenes[0].rows[3];
    assert_eq!((shuffled.sort, shuffled.name.as_str()), (Sort::Shuffled, "shuffled"));
    assert!(found.command.ends_with("--blind --plant frozen,shuffled -o ."), "{}", found.command);
    assert!(fs::read_to_string(out.join("index.html")).unwrap().contains("planted: a method's frames, shuffled"));
    assert_eq!(found.blind.unwrap().voters, 0);
    // Again: all is kept, and nothing on the page changes.
    let line = found.command.strip_prefix("enliven compare ").unwrap();
    let again = succeed(&out, line);
    assert_eq!(again.matches("kept, nothing has changed").count(), 8, "{again}");
    assert_eq!(fs::read_to_string(out.join("blind.html")).unwrap(), page);
}

#[test]
fn an_able_voter_s_votes_mean_something_and_stay() {
    let folder = studio();
    succeed(folder.path(), MAKE);
    write(folder.path(), "a.json", &ballot(&key(folder.path()), 1, able));
    write(folder.path(), "b.json", &ballot(&key(folder.path()), 2, able));
    let said = succeed(folder.path(), "--votes a.json b.json a.json -o out");
    assert!(said.contains("a.json: these votes are counted already"), "{said}");
    assert!(said.contains("2 voters, 24 votes") && said.contains("The votes mean something"), "{said}");
    let found = blind(folder.path());
    let names: Vec<&str> = found.pooled.rows.iter().map(|row| row.name.as_str()).collect();
    assert_eq!(names, ["advect life=60", "advect life=20", "frozen", "shuffled"]);
    assert_eq!((found.repeats, found.agreement.unwrap().value), (6, 1.0));
    assert_eq!(found.pooled.rows[0].over, [0.0, 4.0, 4.0, 4.0]);
    assert!(found.planted.iter().all(|planted| planted.votes == 8 && planted.found_out()), "{:?}", found.planted);
    assert_eq!(found.scenes.len(), 2);
    assert_eq!(found.scenes[1].1.rows[0].votes, 6);
    let out = folder.path().join("out");
    assert_eq!(fs::read_to_string(out.join("votes.csv")).unwrap().lines().count(), 1 + 30);
    let page = fs::read_to_string(out.join("index.html")).unwrap();
    assert!(page.contains("The votes mean something") && page.contains("Strength in the blind test, all scenes"));
    // A later sitting takes the place of what it saved before, an earlier one does not.
    let mut later = ballot(&key(folder.path()), 2, |_, _, _| "tie");
    later["saved"] = "2026-01-31T12:30:00Z".into();
    write(folder.path(), "later.json", &later);
    let said = succeed(folder.path(), "--votes later.json -o out");
    assert!(said.contains("takes the place of what this session saved before"), "{said}");
    assert_eq!(blind(folder.path()).pooled.rows[0].over, [0.0, 3.0, 3.0, 3.0]);
    // A run without votes and without --blind keeps them.
    succeed(folder.path(), &MAKE.replace("--blind --plant frozen,shuffled", ""));
    let found = blind(folder.path());
    // Of six pairs in each of two scenes, three are with the row that is no longer compared.
    assert_eq!((found.voters, found.votes, found.outdated + found.repeats), (2, 12, 18));
    assert!(found.stale);
    assert!(found.replaced.contains(&("torrent".to_owned(), "shuffled".to_owned())));
}

#[test]
fn a_careless_voter_s_votes_mean_little() {
    let folder = studio();
    succeed(folder.path(), MAKE);
    let names: Vec<String> = (0..4).map(|k| format!("{k}.json")).collect();
    names.iter().zip(10..).for_each(|(name, k)| write(folder.path(), name, &ballot(&key(folder.path()), k, careless)));
    let said = succeed(folder.path(), &format!("--votes {} -o out", names.join(" ")));
    assert!(said.contains("4 voters, 48 votes") && said.contains("These votes mean little"), "{said}");
    assert!(blind(folder.path()).agreement.unwrap().high < 0.9);
}

#[test]
fn votes_on_a_row_made_anew_count_no_more() {
    let folder = studio();
    succeed(folder.path(), MAKE);
    write(folder.path(), "a.json", &ballot(&key(folder.path()), 1, able));
    succeed(folder.path(), "--votes a.json -o out");
    let again = succeed(folder.path(), &format!("{MAKE} --set advect.fade=0.9"));
    assert!(again.contains("made again, changed: advect.fade"), "{again}");
    let found = blind(folder.path());
    assert_eq!((found.votes, found.outdated), (0, 15), "{found:?}");
    let remark = found.remarks().pop().unwrap();
    assert!(remark.contains("15 votes no longer count") && remark.contains("brook, advect life=20"), "{remark}");
    // The file still belongs here; one with new names counts.
    assert!(succeed(folder.path(), "--votes a.json -o out").contains("counted already"));
    write(folder.path(), "b.json", &ballot(&key(folder.path()), 2, able));
    succeed(folder.path(), "--votes b.json -o out");
    assert_eq!(blind(folder.path()).votes, 12);
}

/// How votes are spoilt, and parts of what is said then.
type Case<'a> = (&'a dyn Fn(&mut Value), &'a [&'a str]);

#[test]
fn votes_that_are_none_are_refused_by_name() {
    let folder = studio();
    let refuse = |line: &str, code: i32, parts: &[&str]| {
        let output = run(folder.path(), line);
        let said = String::from_utf8(output.stderr).unwrap();
        assert_eq!(output.status.code(), Some(code), "{line}: {said}");
        parts.iter().for_each(|part| assert!(said.contains(part), "{line}: {part:?} is not in {said}"));
    };
    fs::write(folder.path().join("a.json"), "{}").unwrap();
    refuse("--votes a.json -o out", 1, &["out: there is no comparison in this folder"]);
    assert!(!folder.path().join("out").exists());
    refuse("torrent.toml --plant shuffled -o out", 2, &["--blind"]);
    refuse("torrent.toml --blind --plant bad -o out", 2, &["'bad'", "frozen, shuffled"]);
    refuse("torrent.toml --votes a.json -o out", 2, &["cannot be used with"]);
    refuse("-o out", 2, &["SCENE"]);
    let short = "torrent.toml --methods advect -o out";
    succeed(folder.path(), short);
    refuse("--votes a.json -o out", 1, &["there is no blind test in this folder", "--blind"]);
    succeed(folder.path(), &format!("{short} --blind"));
    let good = ballot(&key(folder.path()), 1, |_, _, _| "left");
    let bad = |change: &dyn Fn(&mut Value)| {
        let mut ballot = good.clone();
        change(&mut ballot);
        write(folder.path(), "a.json", &ballot);
    };
    let votes = "--votes a.json -o out";
    let cases: [Case; 13] = [
        (&|b| b["format"] = "enliven votes 9".into(), &["its format is \"enliven votes 9\"", "\"enliven votes 1\""]),
        (&|b| *b = json!([1]), &["does not say \"format\""]),
        (&|b| b["comparison"] = "0123456789abcdef".into(), &["another comparison, \"0123456789abcdef\""]),
        (&|b| b["session"] = "../../../etc/x".into(), &["its session is \"../../../etc/x\""]),
        (&|b| b["saved"] = "yesterday".into(), &["its time is \"yesterday\""]),
        (&|b| b["voter"] = "x".repeat(201).into(), &["voter's name is too long"]),
        (&|b| b["voter"] = 3.into(), &["cannot be read as votes", "expected a string"]),
        (&|b| b["votes"] = json!([]), &["holds no vote"]),
        (&|b| b["votes"][1]["left"] = "ffffffffffffffff".into(), &["vote 2: no video \"ffffffffffffffff\""]),
        (&|b| b["votes"][0]["left"] = b["votes"][0]["right"].clone(), &["vote 1:", "never shown together"]),
        (&|b| b["votes"][0]["choice"] = "both".into(), &["vote 1: its choice is \"both\"", "left, tie, right"]),
        (&|b| b["votes"][0]["seconds"] = (-1).into(), &["vote 1: it took -1 seconds", "0 and more"]),
        (&|b| b["extra"] = 1.into(), &["unknown field `extra`"]),
    ];
    for (change, parts) in cases {
        bad(change);
        refuse(votes, 1, &[&["a.json: "], parts].concat());
    }
    fs::write(folder.path().join("a.json"), "votes!").unwrap();
    refuse(votes, 1, &["a.json: is not JSON"]);
    fs::write(folder.path().join("a.json"), "").unwrap();
    refuse(votes, 1, &["a.json: is not JSON"]);
    refuse("--votes gone.json -o out", 1, &["gone.json", "there is no such file"]);
    // One bad file among good ones: nothing is kept.
    write(folder.path(), "good.json", &good);
    refuse("--votes good.json a.json -o out", 1, &["a.json: is not JSON"]);
    assert!(!folder.path().join("out/votes").exists());
    assert!(succeed(folder.path(), "--votes good.json -o out").contains("1 voter, 1 vote"));
}

/// Before the page's own script: errors are results, and what is saved can be read.
const BEFORE: &str = r"
const say = (...parts) => console.log('RESULT ' + parts.join(' ') + ' .');
window.addEventListener('error', event => say('error', event.message));
window.addEventListener('unhandledrejection', event => say('error', event.reason));
let saved = null;
const make = URL.createObjectURL.bind(URL);
URL.createObjectURL = (blob) => { saved = blob; return make(blob); };
";

/// After it: votes as a person does, goes away half way, comes back, and saves.
const AFTER: &str = r#"<script>
const until = async (test) => { while (!test()) await new Promise(done => setTimeout(done, 20)); };
const find = name => document.querySelector(name);
const videos = [...document.querySelectorAll('video')];
const button = choice => find(`[data-choice=${choice}]`);
const key = (name, from = document.body) => from.dispatchEvent(new KeyboardEvent('keydown', { key: name, bubbles: true, cancelable: true }));
const shown = () => find('#count').textContent;
const ready = () => until(() => button('left').getAttribute('aria-disabled') === 'false');
const visible = e => e.getClientRects().length > 0;
const named = e => e.getAttribute('aria-label') || e.getAttribute('aria-labelledby') || e.innerText?.trim() || e.closest('label')?.innerText.trim();
const check = (where) => {
  const parts = [...document.querySelectorAll('button, input, video, progress, section, [role=group]')].filter(visible);
  say('unnamed', where, ...parts.filter(e => !named(e)).map(e => e.outerHTML.slice(0, 40)));
  say('width', where, document.documentElement.scrollWidth <= window.innerWidth);
  const html = document.documentElement.outerHTML + location.href + videos.map(video => video.currentSrc);
  say('told', where, ...NAMES.filter(name => html.includes(name)));
};
// Many people's orders, of scenes with 4 and 7 videos: pairs, repeats, repeats not swapped or too near, most that a video was
// ahead of another of its scene at any time, most that one was left more often than right, orders.
const fair = () => {
  const scenes = test.scenes;
  test.scenes = [4, 7].map((n, s) => ({ videos: Array.from({ length: n }, (_, i) => `blind/${s}-${i}.mp4`) }));
  const all = new Set();
  let [bad, ahead, sides] = [0, 0, 0];
  for (let k = 0; k < 30; k++) {
    const order = schedule(newSession());
    all.add(JSON.stringify(order));
    const [seen, shown, left] = [new Map(), {}, {}];
    const repeats = order.filter(({ left: a, right: b }, place) => {
      const pair = [a, b].sort().join(' ');
      if (seen.has(pair)) {
        const before = seen.get(pair);
        bad += order[before].left !== b || place - before < 4;
        return true;
      }
      seen.set(pair, place);
      for (const name of [a, b]) shown[name] = (shown[name] || 0) + 1;
      left[a] = (left[a] || 0) + 1;
      left[b] = (left[b] || 0) - 1;
      for (const scene of test.scenes) {
        const counts = scene.videos.map(name => shown[name] || 0);
        ahead = Math.max(ahead, Math.max(...counts) - Math.min(...counts));
      }
    });
    sides = Math.max(sides, ...Object.values(left).map(Math.abs));
    if (!k) say('order', seen.size, repeats.length);
  }
  test.scenes = scenes;
  say('fair', bad, ahead, sides, all.size);
};
const first = async () => {
  fair();
  check('start');
  find('#voter').value = 'Ada';
  find('#begin').click();
  key('ArrowLeft');
  button('left').click();
  say('early', shown());
  await until(() => videos.every(video => !video.paused));
  const apart = [];
  const end = performance.now() + 1800;
  while (performance.now() < end) {
    await new Promise(requestAnimationFrame);
    if (videos.some(video => video.seeking || video.paused)) continue;
    apart.push(Math.abs(videos[0].currentTime - videos[1].currentTime) * 25);
  }
  apart.sort((a, b) => a - b);
  say('apart', apart.length, apart[Math.floor(0.9 * apart.length)].toFixed(2));
  await ready();
  check('vote');
  const boxes = videos.map(video => video.getBoundingClientRect());
  say('boxes', boxes[0].width === boxes[1].width, boxes[0].height === boxes[1].height, boxes[0].left < boxes[1].left, boxes[0].top < boxes[1].top);
  button('tie').focus();
  key('ArrowLeft', button('tie'));
  say('voted', shown(), document.activeElement === button('tie'), getComputedStyle(button('tie')).outlineStyle);
  await ready();
  button('right').click();
  say('voted', shown());
  key('Backspace');
  say('undone', shown());
  await ready();
  button('tie').blur();
  key(' ');
  say('voted', shown());
  sessionStorage.setItem('second', 'yes');
  location.reload();
};
const second = async () => {
  say('back', find('#begin').textContent, find('#voter').value, find('#message').textContent);
  find('#begin').click();
  say('shown', shown());
  while (!visible(find('#end'))) {
    await ready();
    button('right').click();
  }
  say('ended', shown(), document.activeElement.id);
  check('end');
  find('#save').click();
  say('message', find('#message').textContent);
  say('saved', await saved.text().then(text => encodeURIComponent(JSON.stringify(JSON.parse(text)))));
  say('end');
};
if (!document.createElement('video').canPlayType('video/mp4; codecs="avc1.42E01E"')) { say('codec'); say('end'); }
else if (sessionStorage.getItem('second')) second();
else first();
</script>"#;

/// A copy of the page that uses itself.
fn tested(out: &Path) {
    let page = fs::read_to_string(out.join("blind.html")).unwrap();
    // Taken apart, so that this script does not itself name them.
    let names = "const NAMES = [['fro', 'zen'], ['shuf', 'fled'], ['adv', 'ect'], ['li', 'fe'], ['tor', 'rent']]
        .map(parts => parts.join(''));";
    let page = page.replacen("<script>", &format!("<script>{BEFORE}{names}"), 1).replacen(
        "</body>",
        &format!("{AFTER}</body>"),
        1,
    );
    fs::write(out.join("tested.html"), page).unwrap();
}

fn unescaped(text: &str) -> String {
    let mut bytes = Vec::new();
    let mut rest = text.bytes();
    while let Some(byte) = rest.next() {
        let mut digit = || (rest.next().unwrap() as char).to_digit(16).unwrap() as u8;
        bytes.push(if byte == b'%' { 16 * digit() + digit() } else { byte });
    }
    String::from_utf8(bytes).unwrap()
}

#[test]
fn people_can_vote_in_a_browser() {
    let folder = studio();
    succeed(folder.path(), &MAKE.replace("brook.toml", ""));
    let out = folder.path().join("out");
    tested(&out);
    for (k, size) in [(1600, 1000), (400, 900)].into_iter().enumerate() {
        let profile = folder.path().join(k.to_string());
        fs::create_dir(&profile).unwrap();
        let Some(results) = browser::results(&out.join("tested.html"), &profile, size) else { return };
        println!("{size:?}: {results:#?}");
        let of = |name: &str| -> Vec<Vec<&str>> {
            let parts = results.iter().map(|line| line.split(' ').collect::<Vec<_>>());
            parts.filter(|parts| parts[0] == name).map(|parts| parts[1..].to_vec()).collect()
        };
        assert!(of("error").is_empty(), "{results:?}");
        for place in ["start", "vote", "end"] {
            assert!(of("unnamed").contains(&vec![place]) && of("told").contains(&vec![place]), "{results:?}");
            assert!(of("width").contains(&vec![place, "true"]), "{results:?}");
        }
        assert_eq!(of("order"), [["27", "3"]]);
        let fair: Vec<usize> = of("fair")[0].iter().map(|word| word.parse().unwrap()).collect();
        assert!(fair[0] == 0 && fair[1] <= 2 && fair[2] <= 3 && fair[3] == 30, "{fair:?}");
        // Six pairs and a repeat; no vote before both were seen.
        assert_eq!(of("early"), [["1", "of", "7"]]);
        assert!(of("apart")[0][0].parse::<usize>().unwrap() > 5 && of("apart")[0][1].parse::<f64>().unwrap() <= 1.0);
        let beside = size.0 > 600;
        assert_eq!(of("boxes"), [["true", "true", &beside.to_string(), &(!beside).to_string()]]);
        assert_eq!(of("voted")[0], ["2", "of", "7", "true", "solid"]);
        assert_eq!(of("voted")[1..], [["3", "of", "7"], ["3", "of", "7"]]);
        assert_eq!(of("undone"), [["2", "of", "7"]]);
        assert_eq!(of("back")[0][..4], ["Go", "on", "Ada", "2"]);
        assert_eq!(of("shown"), [["3", "of", "7"]]);
        assert_eq!(of("ended"), [["7", "of", "7", "thanks"]]);
        let saved: Value = serde_json::from_str(&unescaped(of("saved")[0][0])).unwrap();
        let choices: Vec<&str> =
            saved["votes"].as_array().unwrap().iter().map(|v| v["choice"].as_str().unwrap()).collect();
        assert_eq!(choices, ["left", "tie", "right", "right", "right", "right", "right"]);
        assert_eq!((&saved["voter"], &saved["format"]), (&json!("Ada"), &json!("enliven votes 1")));
        assert!(saved["votes"][0]["seconds"].as_f64().unwrap() >= FRAMES as f64 / 25.0);
        assert!(of("message")[0].join(" ").contains(saved["session"].as_str().unwrap()));
        let file = format!("{k}.json");
        write(folder.path(), &file, &saved);
        let said = succeed(folder.path(), &format!("--votes {file} -o out"));
        assert!(said.contains("1 voter, 6 votes"), "the same name is one voter, who chose each pair once: {said}");
        let found = blind(folder.path());
        // In either sitting one pair came twice, and in the second sitting all that the first had seen.
        assert_eq!((found.repeats, found.cast.len()), ([1, 8][k], 7 * (k + 1)));
    }
}
