//! The page that explains a run: what it looks like, which clip went where, how good the labels are, where time went.

use std::path::{Component, Path};

use maud::{Markup, html};

use super::page;
use super::plot;
use crate::base::text::counted;
use crate::scene::file;
use crate::synth::record::{AssignmentRecord, RunRecord};

/// What the pictures of a run show, by name.
const CAPTIONS: [(&str, &str); 8] = [
    (
        "assignment",
        "Which clip moves what: its colour, its number in the table, its share. Shades of a colour are pieces that do not continue each other.",
    ),
    (
        "motion",
        "Motion that is aimed at, the mean of the pieces' where there are any: red right, yellow-green down, cyan left, violet up; white is still.",
    ),
    ("exemplar", "What the looks are borrowed from, at the size it was used, over black."),
    ("orientation", "Direction of the motion, as --orientation reads it."),
    ("speed", "Speed of the motion, as --speed reads it."),
    ("asked-orientation", "Direction asked for, by strokes or a map."),
    ("asked-speed", "Speed asked for, by strokes or a map."),
    ("background", "What the moving outline uncovers, made from the rest of the picture."),
];

const STYLE: &str = "\
:root{color-scheme:light dark;--energy:#1668b8;--bound:#b84a00}\
@media(prefers-color-scheme:dark){:root{--energy:#6db3f2;--bound:#f0a05a}}\
body{font:15px/1.45 system-ui,sans-serif;margin:1.5rem auto;padding:0 1rem;max-width:70rem}h2{margin:2rem 0 .6rem}\
img,video{max-width:100%;height:auto;display:block}figure{margin:0}figcaption{font-size:.85rem;margin-top:.3rem}\
.maps{display:grid;grid-template-columns:repeat(auto-fill,minmax(min(100%,20rem),1fr));gap:1rem}\
.scroll{overflow-x:auto}table{border-collapse:collapse;margin-top:.8rem}\
th,td{text-align:left;padding:.25rem .8rem .25rem 0;border-bottom:1px solid #8885}\
td.number,th.number{text-align:right;font-variant-numeric:tabular-nums}code,pre{font:.85rem/1.4 ui-monospace,monospace}\
pre{overflow-x:auto;background:#8882;padding:.8rem;border-radius:6px}\
.swatch{display:inline-block;width:1.1em;height:1.1em;border:1px solid #888;border-radius:3px;vertical-align:-.15em}\
svg{display:block;width:100%;max-width:720px;font-size:12px}svg text{fill:currentColor}.grid{stroke:#8885}\
.line{fill:none;stroke-width:2}.energy{stroke:var(--energy)}.bound{stroke:var(--bound);stroke-dasharray:6 4}\
.bar{fill:var(--energy)}.legend{display:flex;gap:1.5rem;margin:.3rem 0}.key{display:flex;align-items:center;gap:.4rem}\
.key svg{width:24px}";

/// The page of a run, for a folder that holds `contact-sheet.png` and a picture `NAME.png` for each of `pictures`;
/// `video` is where the video lies as seen from there.
pub fn page(record: &RunRecord, pictures: &[&str], video: Option<&Path>) -> Markup {
    let title = record.scene.title();
    let body = html! {
        h1 { (title) }
        p { (what(record)) }
        @if let Some(video) = video { (show(video)) }
        h2 { "Frames" }
        img src="contact-sheet.png" alt="Frames of the loop, in reading order";
        @if let Some(assignment) = &record.assignment { (clips(assignment, pictures)) (energy(assignment)) }
        (maps(record, pictures))
        (times(record))
        (notes(record))
        h2 { "Settings" }
        pre { (settings(record)) }
        p { "Enliven " (record.version) ", " (counted(record.threads as u64, "thread")) ", instruction set " (record.instructions) "." }
    };
    page::page(&format!("Run: {title}"), STYLE, &body)
}

fn what(record: &RunRecord) -> String {
    let (output, (width, height)) = (record.scene.output, record.output_size);
    let method = record.scene.method.as_deref().unwrap_or_default();
    let frames = output.wanted().len();
    let (fps, seconds) = (output.fps, record.seconds);
    let frames = counted(frames as u64, "frame");
    format!("{frames} of {width} × {height} at {fps} per second, method {method}, made in {seconds:.1} s.")
}

/// The video itself, where browsers show its format.
fn show(video: &Path) -> Markup {
    let (address, extension) = (address(video), video.extension().unwrap_or_default().to_string_lossy());
    html! {
        @match extension.to_ascii_lowercase().as_str() {
            "mp4" => video src=(address) autoplay loop muted playsinline controls aria-label="the video" {},
            "gif" | "webp" | "apng" | "png" => img src=(address) alt="the video";,
            _ => p { "The video: " a href=(address) { (video.display()) } },
        }
    }
}

/// A path as a relative address: every byte but the plain ones as %XX.
fn address(path: &Path) -> String {
    let part = |part: Component| {
        let plain = |b: u8| b.is_ascii_alphanumeric() || b"-._~".contains(&b);
        let byte = |b: u8| if plain(b) { char::from(b).to_string() } else { format!("%{b:02X}") };
        part.as_os_str().to_string_lossy().bytes().map(byte).collect::<String>()
    };
    let parts: Vec<String> = path.components().filter(|c| *c != Component::RootDir).map(part).collect();
    if path.is_absolute() { format!("/{}", parts.join("/")) } else { parts.join("/") }
}

fn picture(name: &str) -> Markup {
    let caption = CAPTIONS.iter().find(|c| c.0 == name).map_or(name, |c| c.1);
    html! {
        figure {
            img src=(format!("{name}.png")) alt=(name);
            figcaption { (caption) }
        }
    }
}

/// The assignment picture with its legend.
fn clips(assignment: &AssignmentRecord, pictures: &[&str]) -> Markup {
    let colour = |[r, g, b]: [u8; 3]| format!("background:#{r:02x}{g:02x}{b:02x}");
    html! {
        h2 { "Which clip went where" }
        @if pictures.contains(&"assignment") { (picture("assignment")) }
        p { "Places are squares of 48 pixels of the working image, 24 apart, each moved by one piece of a clip. Jump: how unlike the frames are that a clip's loop fades between, from 0, the same, to 1, unrelated." }
        div.scroll {
            table {
                thead {
                    tr {
                        th.number scope="col" { "No." } th scope="col" { "Colour" } th scope="col" { "Clip" } th scope="col" { "Tag" }
                        th.number scope="col" { "Share" } th.number scope="col" { "Places" }
                        th.number scope="col" { "Its loop" } th.number scope="col" { "Jump" } th.number scope="col" { "Played at" }
                    }
                }
                tbody {
                    @for clip in &assignment.clips {
                        tr {
                            td.number { (clip.number) }
                            td { span.swatch style=(colour(clip.colour)) {} }
                            th scope="row" { @if let Some(name) = &clip.name { (name) " " } code { (clip.clip) } }
                            td { (clip.tag) }
                            td.number { (format!("{:.1} %", 100.0 * clip.share)) }
                            td.number { (clip.nodes) }
                            td.number { "frames " (clip.loop_frames.0) " to " (clip.loop_frames.1) }
                            td.number { (format!("{:.2}", clip.loop_jump)) }
                            td.number { (format!("{:.2} ×", clip.rate)) }
                        }
                    }
                }
            }
        }
    }
}

fn energy(assignment: &AssignmentRecord) -> Markup {
    let AssignmentRecord { energy, data_energy, data_only_energy, bound, gap, history, bounds, .. } = assignment;
    let (smooth, gap) = (energy - data_energy, 100.0 * gap);
    // A solver that bounds the energy once has no history of bounds.
    let bounds = if bounds.is_empty() { std::slice::from_ref(bound) } else { bounds };
    let key = |name: &str, class| plot::Key { name: name.to_owned(), class, style: String::new() };
    html! {
        h2 { "Energy of the labels" }
        (plot::lines(&plot::Lines {
            title: "Energy and its lower bound, round by round",
            along: "rounds",
            start: 0.0,
            step: 1.0,
            lines: &[(key("energy", "energy"), history), (key("lower bound", "bound"), bounds)],
        })
        .on_page())
        p {
            "Energy " (format!("{energy:.3}")) ": data " (format!("{data_energy:.3}")) ", smoothness "
            (format!("{smooth:.3}")) ". The best pieces by themselves have " (format!("{data_only_energy:.3}"))
            "; no labels have less than " (format!("{bound:.3}")) ". At most " (format!("{gap:.2}"))
            " % of the way between the two could still be gained."
        }
    }
}

fn maps(record: &RunRecord, pictures: &[&str]) -> Markup {
    html! {
        @if pictures.iter().any(|name| *name != "assignment") {
            h2 { "Motion" }
            div.maps { @for name in pictures.iter().filter(|name| **name != "assignment") { (picture(name)) } }
        }
        @if let Some(speed) = record.max_speed {
            p { "White in the maps of speed is " (speed) " pixels of the picture per frame (--max-speed)." }
        }
    }
}

fn times(record: &RunRecord) -> Markup {
    let stages: Vec<(&str, f64)> = record.stages.iter().map(|s| (s.name.as_str(), s.seconds)).collect();
    html! {
        h2 { "Time" }
        (plot::bars("Seconds of every stage", "s", &stages))
    }
}

fn notes(record: &RunRecord) -> Markup {
    html! {
        @if !record.notes.is_empty() {
            h2 { "Notes of the run" }
            ul { @for note in &record.notes { li { (note) } } }
        }
    }
}

/// The scene as it was run; a path that no scene file can hold is told instead.
fn settings(record: &RunRecord) -> String {
    file::format(&record.scene).unwrap_or_else(|error| error.to_string())
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use super::*;
    use crate::synth::record::{ClipShare, Stage};

    /// Tags without content.
    const VOID: [&str; 2] = ["meta", "img"];

    /// Checks that every tag is closed in order, and gives the values of `attribute`.
    fn check(page: &str, attribute: &str) -> Vec<String> {
        let (mut open, mut values) = (Vec::new(), Vec::new());
        let body = page.strip_prefix("<!DOCTYPE html>").unwrap();
        for tag in body.split('<').skip(1) {
            let (inside, _) = tag.split_once('>').unwrap();
            let name = inside.split(' ').next().unwrap();
            if let Some(name) = name.strip_prefix('/') {
                assert_eq!(open.pop(), Some(name), "in {page}");
            } else if !VOID.contains(&name) {
                open.push(name);
            }
            let marked = format!(" {attribute}=\"");
            values.extend(inside.split(&marked).skip(1).map(|v| v.split('"').next().unwrap().to_owned()));
        }
        assert!(open.is_empty(), "{open:?}");
        values
    }

    fn record() -> RunRecord {
        let clip = |i: usize| ClipShare {
            number: i + 1,
            library: 0,
            clip: format!("00112233445566{i:02x}"),
            name: (i == 1).then(|| "<river>.mp4".into()),
            tag: "a <b> & \"c\"".into(),
            colour: [i as u8, 10, 200],
            nodes: 3 + i,
            share: [0.625, 0.375][i],
            rate: 1.5,
            loop_frames: (5, 77),
            loop_jump: 0.25,
        };
        let assignment = AssignmentRecord {
            energy: 12.5,
            bound: 10.0,
            bounds: vec![5.0, 10.0],
            history: vec![20.0, 14.0, 12.5],
            clips: vec![clip(0), clip(1)],
            ..AssignmentRecord::default()
        };
        let mut record = RunRecord { assignment: Some(assignment), ..RunRecord::default() };
        record.scene.picture = PathBuf::from("the <falls>.png");
        record.stages = vec![Stage { name: "frames".into(), seconds: 2.0 }];
        record.notes = vec!["no matte given: all of the picture moves".into()];
        record
    }

    #[test]
    fn the_page_is_whole_and_fetches_nothing() {
        let video = Path::new("../take #1/a video.mp4");
        let page = page(&record(), &["assignment", "motion"], Some(video)).into_string();
        let sources = check(&page, "src");
        assert_eq!(sources, ["../take%20%231/a%20video.mp4", "contact-sheet.png", "assignment.png", "motion.png"]);
        assert!(!page.contains("://") && !page.contains("<script") && !page.contains("@import"));
        let told = [
            "62.5 %",
            "37.5 %",
            "a &lt;b&gt; &amp; ",
            "0011223344556601",
            "no matte given",
            "1.50 ×",
            "&lt;river&gt;.mp4",
        ];
        for part in told.into_iter().chain(["background:#000ac8", "the &lt;falls&gt;.png"]) {
            assert!(page.contains(part), "{part} in {page}");
        }
    }

    #[test]
    fn a_run_without_assignment_has_a_page_too() {
        let page = page(&RunRecord::default(), &[], None).into_string();
        assert_eq!(check(&page, "src"), ["contact-sheet.png"]);
        assert!(page.contains("Settings") && !page.contains("Which clip"));
    }
}
