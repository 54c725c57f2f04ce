//! Scenes: what is accepted, what is refused and in which words, and that a written scene repeats the run.

use std::path::Path;
use std::sync::Mutex;

use enliven::base::error::{Error, Kind};
use enliven::base::observe::{Observer, Silent};
use enliven::base::options::Value;
use enliven::flow::field::Field;
use enliven::flow::io as flow;
use enliven::raster::image::{Plane, Rgb8};
use enliven::raster::picture_io::{write_grey_png, write_png};
use enliven::scene::file::{SceneFile, parse, set};
use enliven::scene::scene::{Scene, open};

fn picture(folder: &Path, width: usize, height: usize) {
    let data = (0..width * height * 3).map(|i| (i * 7 % 251) as u8).collect();
    write_png(&folder.join("falls.png"), &Rgb8 { width, height, data }).unwrap();
}

fn matte(folder: &Path, width: usize, height: usize, value: f32) {
    let plane = Plane::from_fn(width, height, |x, _| if x < width / 2 { value } else { 0.0 });
    write_grey_png(&folder.join("matte.png"), &plane).unwrap();
}

fn scene(folder: &Path, text: &str) -> Result<Scene, Error> {
    std::fs::write(folder.join("scene.toml"), text).unwrap();
    Scene::new(open(folder)?)
}

fn message(text: &str) -> String {
    parse(text, Path::new("scene.toml")).unwrap_err().to_string()
}

#[test]
fn unknown_keys_name_the_nearest() {
    assert!(message("pictur = 'a.png'").contains("did you mean \"picture\"?"));
    assert!(message("[output]\nframe = 3").contains("output.frame: no such key"));
    assert!(message("[output]\nframe = 3").contains("did you mean \"frames\"?"));
    assert!(message("[motion]\ndirecton = 3").contains("did you mean \"direction\"?"));
    let error = parse("picture = [", Path::new("scene.toml")).unwrap_err();
    assert_eq!((error.kind(), error.subject()), (Kind::Usage, "scene.toml"));
}

#[test]
fn paths_are_relative_to_the_scene_and_a_written_scene_repeats_the_run() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), 100, 60);
    matte(folder.path(), 100, 60, 1.0);
    std::fs::write(folder.path().join("water.pack"), b"").unwrap();
    let strokes = "{\"strokes\": [{\"points\": [[5, 5], [9, 30]], \"speed\": 2.5}]}";
    std::fs::write(folder.path().join("s.json"), strokes).unwrap();
    let text = "picture = 'falls.png'\nmatte = 'matte.png'\nlibrary = ['water.pack']\n[motion]\ndirection = -90\n\
                strokes = 's.json'\nspeed = 'matte.png'\nmax_speed = 3\n[output]\nframes = 7\nseed = 3\n[database]\nshutter = 2\nsigma = 0.3\n";
    let first = scene(folder.path(), text).unwrap();
    assert_eq!(first.settings().motion.direction, Some(270.0));
    assert_eq!(first.options("database")["sigma"], Value::Number(0.3));

    let elsewhere = folder.path().join("out");
    std::fs::create_dir(&elsewhere).unwrap();
    let written = first.to_toml(&elsewhere).unwrap();
    assert!(written.contains("../falls.png") && written.contains("seed = 3"), "{written}");
    assert!(written.contains("strokes = \"../s.json\"") && written.contains("speed = \"../matte.png\""), "{written}");
    let again = scene(&elsewhere, &written).unwrap();
    assert_eq!(again.frame_map(), first.frame_map());
    assert_eq!(again.still(&Silent).unwrap(), first.still(&Silent).unwrap());
    assert_eq!(again.to_toml(&elsewhere).unwrap(), written);
}

#[test]
fn one_exemplar_has_two_keys_and_several_are_a_list() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), 100, 60);
    matte(folder.path(), 100, 60, 1.0);
    let write = |name: &str| std::fs::copy(folder.path().join("matte.png"), folder.path().join(name)).unwrap();
    for name in ["a.png", "b.png", "map.png"] {
        write(name);
    }
    let scene = |text: &str| scene(folder.path(), &format!("picture = 'falls.png'\n{text}"));
    let elsewhere = folder.path().join("out");
    std::fs::create_dir(&elsewhere).unwrap();
    for (text, written) in [
        ("exemplar = 'a.png'", "exemplar = \"../a.png\"\n"),
        ("exemplar = 'a.png'\nexemplar_alpha = 'luminance'", "exemplar_alpha = \"luminance\"\n"),
        ("[[exemplars]]\nframes = 'a.png'\nopacity = 'matte.png'", "exemplar_alpha = \"../matte.png\"\n"),
        (
            "[[exemplars]]\nframes = 'a.png'\n[[exemplars]]\nframes = 'b.png'\nopacity = 'darkness'\nparameters = 'map.png'",
            "[[exemplars]]\nframes = \"../a.png\"\n\n[[exemplars]]\nframes = \"../b.png\"\nopacity = \"darkness\"\n\
             parameters = \"../map.png\"\n",
        ),
    ] {
        let first = scene(text).unwrap();
        let toml = first.to_toml(&elsewhere).unwrap();
        assert!(toml.contains(written), "{text}: {toml}");
        assert_eq!(toml.contains("[[exemplars]]"), written.contains("[["), "{toml}");
        std::fs::write(elsewhere.join("scene.toml"), &toml).unwrap();
        assert_eq!(Scene::new(open(&elsewhere).unwrap()).unwrap().to_toml(&elsewhere).unwrap(), toml);
        // Records are JSON.
        let json = serde_json::to_string(first.settings()).unwrap();
        assert_eq!(&serde_json::from_str::<SceneFile>(&json).unwrap(), first.settings());
    }
}

#[test]
fn bad_exemplars_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), 100, 60);
    matte(folder.path(), 100, 60, 1.0);
    for name in ["clip", "masks", "flow", "small"] {
        std::fs::create_dir(folder.path().join(name)).unwrap();
    }
    let grey = |name: &str, width: usize| {
        write_grey_png(&folder.path().join(name), &Plane::filled(width, 20, 0.5)).unwrap();
    };
    (0..4).for_each(|t| grey(&format!("clip/{t}.png"), 30));
    (0..3).for_each(|t| grey(&format!("masks/{t}.png"), 30));
    (0..4).for_each(|t| grey(&format!("small/{t}.png"), 28));
    grey("e.png", 30);
    let field = |name: &str, width: usize| {
        let field = Field { u: Plane::zeros(width, 20), v: Plane::zeros(width, 20) };
        flow::write(&folder.path().join(name), &field).unwrap();
    };
    field("flow/0.flo", 30);
    field("flow/2.flo", 30);
    let refuse = |text: &str, words: &str| {
        let error = scene(folder.path(), &format!("picture = 'falls.png'\n{text}")).unwrap_err().to_string();
        assert!(error.contains(words), "{error:?} should contain {words:?}");
    };
    let clip = |text: &str, words: &str| refuse(&format!("[[exemplars]]\nframes = 'clip'\n{text}"), words);
    clip("opacty = 'masks'", "exemplars 1.opacty: no such key");
    clip("opacty = 'masks'", "did you mean \"opacity\"?");
    clip("opacity = 3", "exemplars 1.opacity: 3 is not text");
    clip("opacity = 'luminence'", "luminence is no file and no known word");
    clip("opacity = 'none.png'", "none.png");
    clip("opacity = 'masks'", "masks: has 3 frames, the exemplar has 4 frames (allowed: 4");
    clip("opacity = 'small'", "small: is 28 × 20 pixels, the exemplar 30 × 20");
    clip("flow = 'flow'", "flow: frame 1 is missing");
    field("flow/1.flo", 28);
    clip("flow = 'flow'", "1.flo: is 28 × 20 pixels");
    field("flow/1.flo", 30);
    clip("flow = 'flow'\nparameters = 'none.npy'", "none.npy");
    clip("parameters = 'masks'", "masks: has 3 frames, the exemplar has 4 frames");
    clip("parameters = 'matte.png'", "matte.png: is 100 × 60 pixels, the exemplar 30 × 20");
    std::fs::remove_file(folder.path().join("flow/0.flo")).unwrap();
    clip("flow = 'flow'", "flow: has 2 frames, the exemplar has 4 frames (allowed: 3 or 4");
    std::fs::write(folder.path().join("p.npy"), "not an array").unwrap();
    clip("parameters = 'p.npy'", "p.npy: is not an .npy file");
    clip("[[exemplars]]\nframes = 'clip'", "clip: is named as an exemplar twice");
    refuse("[[exemplars]]\nflow = 'flow'", "exemplars 1.frames: is missing");
    refuse("exemplar = 'e.png'\n[[exemplars]]\nframes = 'clip'", "exemplar: is given beside [[exemplars]]");
    refuse("exemplars = 'e.png'", "exemplars: is no list of tables");
    refuse("exemplar = 3", "exemplar: 3 is not text");
    refuse("exemplar_alpha = 'darkness'", "darkness is given without an exemplar");
}

#[test]
fn bad_files_are_refused_by_name() {
    let folder = tempfile::tempdir().unwrap();
    let refuse = |text: &str, words: &str| {
        let error = scene(folder.path(), text).and_then(|s| s.still(&Silent).map(|_| s)).unwrap_err().to_string();
        assert!(error.contains(words), "{error:?} should contain {words:?}");
    };
    refuse("picture = 'falls.png'", "falls.png");
    refuse("method = 'database'", "no picture given");
    picture(folder.path(), 100, 60);
    refuse("picture = 'falls.png'\nlibrary = ['none.pack']", "none.pack");
    matte(folder.path(), 90, 60, 1.0);
    refuse("picture = 'falls.png'\nmatte = 'matte.png'", "the matte is 90 × 60 pixels, the picture 100 × 60");
    matte(folder.path(), 100, 60, 0.0);
    refuse("picture = 'falls.png'\nmatte = 'matte.png'", "all black");
    refuse("picture = 'falls.png'\n[output]\nframes = 0", "output.frames: 0 is out of range");
    refuse("picture = 'falls.png'\n[output]\nfps = nan", "output.fps");
    refuse("picture = 'falls.png'\n[output]\nframes = 'many'", "scene.toml");
    refuse("picture = 'falls.png'\n[motion]\ndirection = inf", "motion.direction");
    refuse("picture = 'falls.png'\n[output]\nsize = [100, 20]", "100 × 60");
    let motion = |text: &str, words: &str| refuse(&format!("picture = 'falls.png'\n[motion]\n{text}"), words);
    motion("stroke = 's.json'", "did you mean \"strokes\"?");
    motion("strokes = 'none.json'", "none.json");
    std::fs::write(folder.path().join("s.json"), "{\"strokes\": [{\"points\": [[5, 5]]}]}").unwrap();
    motion("strokes = 's.json'", "s.json: stroke 1 has 1 point");
    matte(folder.path(), 90, 60, 1.0);
    motion("strokes = 'matte.png'", "the strokes are 90 × 60 pixels, the picture 100 × 60");
    motion("orientation = 'matte.png'", "the orientation map is 90 × 60 pixels, the picture 100 × 60");
    motion("speed = 'matte.png'\nmax_speed = 3", "the speed map is 90 × 60 pixels, the picture 100 × 60");
    matte(folder.path(), 100, 60, 1.0);
    motion("strokes = 'matte.png'", "has no transparency");
    motion("speed = 'matte.png'", "motion.max_speed: ");
    motion("speed = 'matte.png'", "give --max-speed");
    motion("max_speed = 3", "without a speed map");
    for speed in ["0", "-1", "nan", "inf", "2000"] {
        motion(&format!("speed = 'matte.png'\nmax_speed = {speed}"), "above 0, at most 1000 pixels per frame");
    }
    picture(folder.path(), 1, 1);
    refuse("picture = 'falls.png'", "at least 48 pixels");
    std::fs::write(folder.path().join("falls.png"), "not a picture").unwrap();
    refuse("picture = 'falls.png'", "falls.png");
}

#[test]
fn a_hundred_megapixels_are_refused_before_they_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("falls.png");
    let file = std::fs::File::create(&path).unwrap();
    let mut encoder = png::Encoder::new(file, 12_500, 8_000);
    encoder.set_color(png::ColorType::Grayscale);
    let mut writer = encoder.write_header().unwrap();
    writer.write_chunk(png::chunk::IDAT, &[0; 16]).unwrap();
    drop(writer);
    let error = Scene::new(open(&path).unwrap()).unwrap_err().to_string();
    assert!(error.contains("falls.png") && error.contains("12500"), "{error}");
}

#[test]
fn no_matte_is_a_warning_that_all_moves() {
    #[derive(Default)]
    struct Notes(Mutex<Vec<String>>);
    impl Observer for Notes {
        fn note(&self, message: &str) {
            self.0.lock().unwrap().push(message.to_owned());
        }
    }
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), 64, 64);
    let notes = Notes::default();
    let still = scene(folder.path(), "picture = 'falls.png'").unwrap().still(&notes).unwrap();
    assert!(still.matte.data.iter().all(|&v| v == 1.0));
    assert!(notes.0.lock().unwrap()[0].contains("all of the picture moves"));
}

#[test]
fn the_picture_keeps_its_bytes_at_its_own_size() {
    let folder = tempfile::tempdir().unwrap();
    picture(folder.path(), 100, 60);
    let still = scene(folder.path(), "picture = 'falls.png'\n[output]\nworking_size = 96").unwrap();
    let still = still.still(&Silent).unwrap();
    assert_eq!(still.picture.data, (0..100 * 60 * 3).map(|i| (i * 7 % 251) as u8).collect::<Vec<_>>());
    assert_eq!((still.working.width(), still.working.height()), (96, 58));
}

#[test]
fn options_are_set_as_typed() {
    let mut file = SceneFile::default();
    set(&mut file, "database.shutter=4").unwrap();
    assert_eq!(file.options["database"]["shutter"], Value::Integer(4));
    assert!(set(&mut file, "shutter=4").unwrap_err().to_string().contains("METHOD.KEY=VALUE"));
}
