//! Scenes made from clips: they leave their clip and its twins out, they animate, and mistakes are named.

use std::fs;
use std::path::{Path, PathBuf};

use enliven::base::error::{Error, Kind, Result};
use enliven::base::observe::Silent;
use enliven::flow::strokes;
use enliven::library::build::build;
use enliven::library::inputs::identify;
use enliven::raster::image::Rgb8;
use enliven::raster::picture_io::{read_grey, read_picture};
use enliven::scene::leave_one_out::{Options, Report, scenes};
use enliven::scene::scene::{Scene, open};
use enliven::synth::run::run;
use enliven::video::clip::Sink;

use crate::common;

/// Counts frames.
#[derive(Default)]
struct Count(usize);

impl Sink for Count {
    fn push(&mut self, _: &Rgb8) -> Result<()> {
        self.0 += 1;
        Ok(())
    }

    fn finish(self: Box<Self>) -> Result<()> {
        Ok(())
    }
}

/// A library of the clips a, b, c and of a copy of a without its first frame.
struct Stage {
    folder: tempfile::TempDir,
}

impl Stage {
    fn new() -> Self {
        let stage = Self { folder: tempfile::tempdir().unwrap() };
        let mut clips = common::write_clips(stage.folder.path());
        let whole = fs::read(&clips[0]).unwrap();
        let header = whole.iter().position(|&b| b == b'\n').unwrap() + 1;
        let frame = "FRAME\n".len() + common::WIDTH * common::HEIGHT * 3 / 2;
        fs::write(stage.at("twin.y4m"), [&whole[..header], &whole[header + frame..]].concat()).unwrap();
        clips.push(stage.at("twin.y4m"));
        build(&clips, &stage.at("l.pack"), &common::options(), &Silent).unwrap();
        stage
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn id(&self, clip: &str) -> String {
        identify(&self.at(clip)).unwrap().to_string()
    }

    fn scenes(&self, clips: &[&str], libraries: &[&str], output: &str) -> Result<Report, Error> {
        let paths = |names: &[&str]| names.iter().map(|n| self.at(n)).collect::<Vec<_>>();
        let options = Options { libraries: paths(libraries), unasked: false, speeds: false };
        scenes(&paths(clips), &options, &self.at(output), &Silent)
    }
}

fn names(folder: &Path) -> Vec<String> {
    let mut names: Vec<String> =
        fs::read_dir(folder).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap()).collect();
    names.sort();
    names
}

#[test]
fn a_scene_leaves_its_clip_and_its_twins_out_and_animates() {
    let stage = Stage::new();
    let report = stage.scenes(&["a.y4m", "b.y4m"], &["l.pack"], "out").unwrap();
    assert!(report.refused.is_empty());
    let mut twins = vec![stage.id("a.y4m"), stage.id("twin.y4m")];
    twins.sort();
    assert_eq!(report.written[0].without, twins);
    assert_eq!(report.written[1].without, [stage.id("b.y4m")]);
    assert!(report.written.iter().all(|w| w.nearest.as_ref().is_some_and(|n| n.1 > 0.7)));

    let folder = stage.at("out/a");
    assert_eq!(names(&folder), ["matte.png", "picture.png", "reference", "scene.toml", "strokes.json"]);
    let scene = &report.written[0];
    let later = |t: usize| folder.join(format!("reference/{t:05}.png"));
    assert_eq!(names(&folder.join("reference")).len(), scene.reference.1 - scene.reference.0);
    assert!(scene.frame < scene.reference.0 && scene.reference.1 == common::FRAMES);
    let picture = read_picture(&folder.join("picture.png")).unwrap().rgb;
    assert!((0..scene.reference.1 - scene.reference.0).all(|t| read_picture(&later(t)).unwrap().rgb != picture));
    let matte = read_grey(&folder.join("matte.png")).unwrap();
    assert!(matte.at(4, 40) < 0.1 && matte.at(60, 40) > 0.9, "the wall is still, the fall moves");

    let drawn = strokes::read(&folder.join("strokes.json"), (common::WIDTH, common::HEIGHT)).unwrap();
    let [((x, y), (to_x, to_y))] = drawn.iter().map(|s| (s.points[0], s.points[1])).collect::<Vec<_>>()[..] else {
        panic!("{drawn:?}")
    };
    assert!(to_y - y > 3.0 * (to_x - x).abs(), "the fall goes down");

    let mut file = open(&folder).unwrap();
    assert_eq!(file.motion.strokes, Some(folder.join("strokes.json")));
    assert_eq!(file.reference, Some(folder.join("reference")));
    file.output.frames = Some(6);
    let mut sink = Count::default();
    let outcome = run(&Scene::new(file).unwrap(), &mut sink, &Silent).unwrap();
    assert_eq!(sink.0, 6);
    let used = outcome.record.assignment.unwrap().clips;
    assert!(used.iter().all(|c| !twins.contains(&c.clip)));
}

#[test]
fn clips_that_no_library_has_serve_too() {
    let stage = Stage::new();
    common::write_clip(&stage.at("new.y4m"), 77);
    let report = stage.scenes(&["new.y4m", "b.y4m"], &["l.pack"], "out").unwrap();
    assert_eq!(report.written.len(), 2);
    assert!(report.written[0].without.is_empty());
    assert_eq!(names(&stage.at("out")), ["b", "new"], "working files stay behind");

    let report = stage.scenes(&["new.y4m"], &[], "alone").unwrap();
    assert_eq!(report.written[0].nearest, None);
    let file = open(&stage.at("alone/new")).unwrap();
    assert!(file.library.is_empty() && file.without.is_empty());

    let options = Options { unasked: true, ..Options::default() };
    scenes(&[stage.at("new.y4m")], &options, &stage.at("unasked"), &Silent).unwrap();
    assert_eq!(names(&stage.at("unasked/new")), ["matte.png", "picture.png", "reference", "scene.toml"]);
}

#[test]
fn mistakes_are_named_and_nothing_is_written_over() {
    let stage = Stage::new();
    fs::write(stage.at("text.mp4"), "These are only words.").unwrap();
    let error = stage.scenes(&["text.mp4"], &["l.pack"], "out").unwrap_err();
    assert_eq!(error.kind(), Kind::Unusable);
    assert!(error.to_string().contains("text.mp4"), "{error}");
    assert!(!stage.at("out").exists());

    let report = stage.scenes(&["text.mp4", "b.y4m"], &["l.pack"], "out").unwrap();
    assert_eq!((report.written.len(), report.refused.len()), (1, 1));
    assert!(report.refused[0].reason.contains("not a video"), "{:?}", report.refused);
    let error = stage.scenes(&["b.y4m"], &["l.pack"], "out").unwrap_err();
    assert_eq!(error.kind(), Kind::Usage);
    assert!(error.to_string().contains("b: exists already"), "{error}");

    build(&[stage.at("b.y4m")], &stage.at("b.pack"), &common::options(), &Silent).unwrap();
    let error = stage.scenes(&["b.y4m"], &["b.pack"], "lonely").unwrap_err();
    assert!(error.to_string().contains("holds no other clip to animate it with"), "{error}");
    assert!(stage.scenes(&["b.y4m"], &["none.pack"], "lost").unwrap_err().to_string().contains("none.pack"));
    assert!(!stage.at("lost").exists() && !stage.at("lonely").exists());
}
