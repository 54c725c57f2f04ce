//! Where the fluid is and how it moves, frame by frame: what every exemplar method is steered by.
//!
//! A still picture's matte and asked motion, the same in every frame; or a designed sequence (LazyFluids, Jamriška et
//! al. 2015, §3: flow `F^t` and alpha masks).

use super::designed::{Designed, Height};
use super::frame_map::FrameMap;
use super::scene::{Scene, Still, resize_matte};
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::par;
use crate::flow::field::Field;
use crate::raster::filter::gaussian;
use crate::raster::image::Plane;
use crate::raster::resample::resize;

/// Speed of the fluid where a direction is asked for without a speed, as a share of the picture's long side per second:
/// 2 pixels per frame of a working image of 640 pixels at 25 frames per second. A gentle river, slow for a waterfall.
pub const DEFAULT_SPEED: f32 = 2.0 * 25.0 / 640.0;
/// Directions surer than this have full speed; less sure ones (between strokes that disagree) are slower.
const SURE: f32 = 0.25;
/// How far beyond the matte motion fades away, pixels of the working image (σ).
const FEATHER: f32 = 2.0;

/// Alpha and motion of every frame, at working size.
#[derive(Debug, Clone, PartialEq)]
pub struct Target {
    frames: usize,
    map: FrameMap,
    /// Whether [`DEFAULT_SPEED`] is used anywhere.
    assumed: bool,
    source: Source,
}

#[derive(Debug, Clone, PartialEq)]
enum Source {
    Still { alpha: Plane, flow: Field },
    Designed(Designed),
}

impl Target {
    /// The target of a scene: of a picture, its matte and what is asked of its motion, in every frame; else the designed
    /// sequences, every frame of which is looked at here once, so that a bad one is found before any work is done.
    ///
    /// # Errors
    /// A picture without any asked motion on its matte. A frame that cannot be read, with motion that is unknown or
    /// longer than the picture; alpha that is 0 in every frame. Heights and parameters are looked at by who asks for them.
    pub fn of(scene: &Scene, still: &Still) -> Result<Self> {
        let (frames, map) = (scene.settings().output.length(), scene.frame_map());
        if let Some(designed) = scene.designed() {
            check(designed, frames)?;
            return Ok(Self { frames, map, assumed: false, source: Source::Designed(designed.clone()) });
        }
        let (flow, assumed) = asked_flow(still, scene.settings().output.fps)?;
        Ok(Self { frames, map, assumed, source: Source::Still { alpha: still.working_matte.clone(), flow } })
    }

    /// Number of frames of the whole output.
    pub fn frames(&self) -> usize {
        self.frames
    }

    /// Width and height of alpha and flow: the working size.
    pub fn size(&self) -> (usize, usize) {
        self.map.working
    }

    /// Whether the last frame leads back to the first.
    pub fn loops(&self) -> bool {
        matches!(self.source, Source::Still { .. })
    }

    /// Opacity of the fluid in frame `t`, in [0, 1], not blurred.
    ///
    /// # Errors
    /// An unreadable file.
    pub fn alpha(&self, t: usize) -> Result<Plane> {
        match &self.source {
            Source::Still { alpha, .. } => Ok(alpha.clone()),
            Source::Designed(designed) => Ok(resize_matte(&designed.alpha(t)?, self.size())),
        }
    }

    /// Motion that led from frame `t − 1` to frame `t`, sampled at frame `t`, in pixels of the working image per output
    /// frame: what is at `p` in frame `t` was at `p − F(p)` in the frame before. Frame 0 has that of frame 1.
    ///
    /// # Errors
    /// A target without flow; an unreadable file.
    pub fn flow(&self, t: usize) -> Result<Field> {
        match &self.source {
            Source::Still { flow, .. } => Ok(flow.clone()),
            Source::Designed(designed) => {
                let (field, size) = (designed.flow(t)?, self.size());
                let scale = |to: usize, from: usize| to as f32 / from as f32;
                let (across, down) = (scale(size.0, field.width()), scale(size.1, field.height()));
                Ok(Field { u: shrunk(&field.u, size).map(|u| u * across), v: shrunk(&field.v, size).map(|v| v * down) })
            }
        }
    }

    /// Refuses a target that does not say how its fluid moves, for methods that must know.
    ///
    /// # Errors
    /// A target without flow.
    pub fn must_flow(&self) -> Result<()> {
        match &self.source {
            Source::Designed(designed) if !designed.has_flow() => Err(designed.no_flow()),
            Source::Designed(_) | Source::Still { .. } => Ok(()),
        }
    }

    /// Height of the surface in frame `t` at working size, its scale in pixels of the working image; none where there is
    /// none.
    ///
    /// # Errors
    /// An unreadable file; a height that is not a number.
    pub fn height(&self, t: usize) -> Result<Option<Height>> {
        let Source::Designed(designed) = &self.source else { return Ok(None) };
        let scale = self.size().0 as f32 / designed.size.0 as f32;
        let sized = |Height { plane, pixels }| Height {
            plane: shrunk(&plane, self.size()),
            pixels: pixels.map(|pixels: f32| pixels * scale),
        };
        Ok(designed.height(t)?.map(sized))
    }

    /// What else is known of every pixel in frame `t`, components in [0, 1] at working size; none where there is nothing.
    ///
    /// # Errors
    /// An unreadable file; what is not a number or outside [0, 1].
    pub fn parameters(&self, t: usize) -> Result<Option<Vec<Plane>>> {
        let Source::Designed(designed) = &self.source else { return Ok(None) };
        let sized = |plane: &Plane| shrunk(plane, self.size()).map(|v| v.clamp(0.0, 1.0));
        Ok(designed.parameters(t)?.map(|planes| planes.iter().map(sized).collect()))
    }

    /// Tells what was assumed.
    pub fn note(&self, observer: &dyn Observer) {
        if self.assumed {
            let share = 100.0 * DEFAULT_SPEED;
            observer.note(&format!(
                "a direction is asked for without a speed: {share:.0} % of the picture's long side per second is taken; \
                 give strokes a speed, or --speed with --max-speed"
            ));
        }
    }
}

fn shrunk(plane: &Plane, (width, height): (usize, usize)) -> Plane {
    if (plane.width, plane.height) == (width, height) { plane.clone() } else { resize(plane, width, height) }
}

/// Reads all that a designed target has for its first `frames` frames.
fn check(designed: &Designed, frames: usize) -> Result<()> {
    if designed.has_flow() {
        par::try_map(frames, |t| designed.flow(t).map(drop))?;
    }
    for t in 0..frames {
        if designed.alpha(t)?.data.iter().any(|&a| a > 0.5 / 255.0) {
            return Ok(());
        }
    }
    Err(designed.no_alpha())
}

/// The motion asked for on a still picture, fading to 0 off the matte; and whether some of it has the default speed.
fn asked_flow(still: &Still, fps: f32) -> Result<(Field, bool)> {
    let (width, height) = still.map.working;
    let mut flow = Field::zeros(width, height);
    let mut assumed = false;
    let default = DEFAULT_SPEED * width.max(height) as f32 / fps;
    if let Some(asked) = &still.asked {
        let near = gaussian(&still.working_matte, FEATHER);
        for i in 0..width * height {
            let (u, v, speed) = (asked.direction.u.data[i], asked.direction.v.data[i], asked.speed.data[i]);
            let sure = u.hypot(v);
            // On the edge of the matte half of what is near is matte: there motion is still whole.
            let share = (2.0 * near.data[i]).min(1.0).max(still.working_matte.data[i]);
            let length = share * if speed < 0.0 { default } else { speed } / sure.max(SURE);
            assumed |= speed < 0.0 && sure * share > 0.0;
            (flow.u.data[i], flow.v.data[i]) = (u * length, v * length);
        }
    }
    let fluid = flow.u.data.iter().zip(&flow.v.data).zip(&still.working_matte.data);
    if fluid.into_iter().any(|((u, v), matte)| *matte > 0.0 && u.hypot(*v) > 0.0) {
        return Ok((flow, assumed));
    }
    Err(Error::new(Kind::Usage, "motion", "no motion is asked for anywhere on the fluid")
        .allowed("a direction, strokes or an orientation map, and a speed above 0")
        .remedy("draw strokes along the flow (--strokes), or give --direction"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::observe::Silent;
    use crate::base::observe::testing::Notes;
    use crate::raster::image::Rgb8;
    use crate::raster::npy;
    use crate::raster::picture_io::{encode_deep_grey_png, write_grey_png, write_png};
    use crate::scene::file::{Motion, Output, SceneFile, TargetFile};
    use ndarray::Array4;
    use std::path::Path;

    /// A picture of 1280 × 720, its left half fluid, with some motion asked for.
    fn still(folder: &Path, motion: Motion) -> Result<Target> {
        let (picture, matte) = (folder.join("p.png"), folder.join("m.png"));
        write_png(&picture, &Rgb8::black(1280, 720)).unwrap();
        write_grey_png(&matte, &Plane::from_fn(1280, 720, |x, _| f32::from(x < 640))).unwrap();
        let scene = Scene::new(SceneFile { picture, matte: Some(matte), motion, ..SceneFile::default() })?;
        Target::of(&scene, &scene.still(&Silent)?)
    }

    #[test]
    fn a_picture_has_the_motion_asked_for_on_its_matte_and_none_far_off() {
        let folder = tempfile::tempdir().unwrap();
        let target = still(folder.path(), Motion { direction: Some(90.0), ..Motion::default() }).unwrap();
        assert_eq!((target.frames(), target.size(), target.loops()), (120, (640, 360), true));
        let (alpha, flow) = (target.alpha(7).unwrap(), target.flow(7).unwrap());
        assert_eq!((alpha.at(300, 9), alpha.at(340, 9)), (1.0, 0.0));
        // 2 pixels of the working image per frame up to the very edge, then less and less.
        let down: Vec<f32> = [10, 318, 324, 340].map(|x| flow.v.at(x, 100)).into();
        assert!((down[0] - 2.0).abs() < 1e-5 && (down[1] - 2.0).abs() < 1e-2, "{down:?}");
        assert!(down[2] > 0.01 && down[2] < 1.0 && down[3] == 0.0, "{down:?}");
        assert!(flow.u.data.iter().all(|u| u.abs() < 1e-5));
        let notes = Notes::default();
        target.note(&notes);
        assert!(notes.0.into_inner().unwrap()[0].contains("8 % of the picture's long side per second"));
    }

    #[test]
    fn a_speed_that_is_given_is_kept_and_no_motion_at_all_is_an_error() {
        let folder = tempfile::tempdir().unwrap();
        let strokes = folder.path().join("s.json");
        std::fs::write(&strokes, r#"{"strokes": [{"points": [[100, 300], [600, 300]], "speed": 8}]}"#).unwrap();
        let target = still(folder.path(), Motion { strokes: Some(strokes), ..Motion::default() }).unwrap();
        assert!((target.flow(0).unwrap().u.at(100, 150) - 4.0).abs() < 1e-3);
        let notes = Notes::default();
        target.note(&notes);
        assert!(notes.0.into_inner().unwrap().is_empty());
        let nothing = |motion| still(folder.path(), motion).unwrap_err().to_string();
        assert!(nothing(Motion::default()).contains("no motion is asked for"));
        let speed = Some(folder.path().join("m.png"));
        let only_speed = nothing(Motion { speed, max_speed: Some(3.0), ..Motion::default() });
        assert!(only_speed.contains("--direction") && only_speed.contains("--strokes"), "{only_speed}");
    }

    /// Four frames of 64 × 32, worked on at half that: frame `t` moves `t + 1` to the right, its column `t` is opaque.
    fn designed(folder: &Path) -> SceneFile {
        for (t, number) in (7..11).enumerate() {
            let flow = Field { u: Plane::filled(64, 32, t as f32 + 1.0), v: Plane::filled(64, 32, -2.0) };
            std::fs::create_dir_all(folder.join("flow")).unwrap();
            std::fs::create_dir_all(folder.join("alpha")).unwrap();
            crate::flow::io::write(&folder.join(format!("flow/{number:04}.flo")), &flow).unwrap();
            let alpha = Plane::from_fn(64, 32, |x, _| f32::from(x / 8 == t));
            std::fs::write(folder.join(format!("alpha/{number}.png")), encode_deep_grey_png(&alpha).unwrap()).unwrap();
        }
        let target =
            TargetFile { flow: Some(folder.join("flow")), alpha: folder.join("alpha"), ..TargetFile::default() };
        SceneFile { target: Some(target), ..SceneFile::default() }
    }

    fn of(file: SceneFile) -> Result<Target> {
        let scene = Scene::new(file)?;
        Target::of(&scene, &scene.still(&Silent)?)
    }

    #[test]
    fn a_designed_target_is_read_frame_by_frame_at_working_size() {
        let folder = tempfile::tempdir().unwrap();
        let file = designed(folder.path());
        let target = of(file.clone()).unwrap();
        assert_eq!((target.frames(), target.size(), target.loops()), (4, (64, 32), false));
        // What led to frame 2 is what frame 1 says of its future.
        let right = |target: &Target, t| target.flow(t).unwrap().u.at(20, 9);
        assert_eq!([0, 1, 2, 3].map(|t| right(&target, t)), [1.0, 1.0, 2.0, 3.0]);
        assert_eq!([0, 1, 2, 3].map(|t| target.alpha(t).unwrap().at(20, 9)), [0.0, 0.0, 1.0, 0.0]);
        let fewer = SceneFile { output: Output { frames: Some(3), ..Output::default() }, ..file.clone() };
        assert_eq!(of(fewer).unwrap().frames(), 3);
        let more = SceneFile { output: Output { frames: Some(5), ..Output::default() }, ..file };
        assert!(of(more).unwrap_err().to_string().contains("leave it out to make all 4"));
    }

    #[test]
    fn flow_is_in_pixels_of_the_working_image() {
        let map = FrameMap { picture: (64, 32), working: (32, 16), output: (64, 32) };
        let folder = tempfile::tempdir().unwrap();
        let target = Target { map, ..of(designed(folder.path())).unwrap() };
        let flow = target.flow(3).unwrap();
        assert_eq!((flow.width(), flow.height()), (32, 16));
        assert!((flow.u.at(9, 9) - 1.5).abs() < 1e-5 && (flow.v.at(9, 9) + 1.0).abs() < 1e-5);
    }

    #[test]
    fn bad_frames_are_found_before_any_work() {
        let folder = tempfile::tempdir().unwrap();
        let file = designed(folder.path());
        let refuse = |words: &[&str]| {
            let message = of(file.clone()).unwrap_err().to_string();
            words.iter().for_each(|word| assert!(message.contains(word), "{message} lacks {word}"));
        };
        let flow = |number: usize, value: f32, width: usize| {
            let field = Field { u: Plane::filled(width, 32, value), v: Plane::zeros(width, 32) };
            crate::flow::io::write(&folder.path().join(format!("flow/{number:04}.flo")), &field).unwrap();
        };
        for (value, words) in [
            (f32::NAN, "not a number"),
            (f32::INFINITY, "(0, 0) is not a number, or not known"),
            (-65.0, "farther than"),
        ] {
            flow(9, value, 64);
            refuse(&["0009.flo", words]);
        }
        flow(9, 1.0, 62);
        refuse(&["0009.flo", "62 × 32", "64 × 32"]);
        flow(9, 1.0, 64);
        for number in 7..11 {
            let path = folder.path().join(format!("alpha/{number}.png"));
            std::fs::write(path, encode_deep_grey_png(&Plane::zeros(64, 32)).unwrap()).unwrap();
        }
        refuse(&["alpha", "all black in every frame"]);
        std::fs::remove_file(folder.path().join("alpha/10.png")).unwrap();
        refuse(&["alpha", "7 to 9", "7 to 10"]);
    }

    #[test]
    fn a_folder_of_a_simulation_is_a_scene() {
        let folder = tempfile::tempdir().unwrap();
        designed(folder.path());
        std::fs::write(folder.path().join("sim.toml"), "fps = 12.5").unwrap();
        let file = super::super::scene::open(folder.path()).unwrap();
        assert_eq!((file.output.fps, file.loops()), (12.5, false));
        assert_eq!(of(file).unwrap().frames(), 4);
        std::fs::write(folder.path().join("scene.toml"), "picture = 'a.png'").unwrap();
        assert!(super::super::scene::open(folder.path()).unwrap().target.is_none());
    }

    #[test]
    fn rendered_frames_of_one_folder_are_motion_and_opacity() {
        use exr::prelude::{AnyChannel, AnyChannels, FlatSamples, Image, WritableImage};
        let folder = tempfile::tempdir().unwrap();
        for t in 0..3 {
            let names = ["Combined.A", "Vector.W", "Vector.X", "Vector.Y", "Vector.Z"];
            let plane = |(name, value): (&str, f32)| AnyChannel::new(name, FlatSamples::F32(vec![value; 64 * 32]));
            let list = names.into_iter().zip([1.01, 0.0, -(t as f32), 2.0, 0.0]).map(plane).collect();
            let path = folder.path().join(format!("{:04}.exr", t + 1));
            Image::from_channels((64, 32), AnyChannels::sort(list)).write().to_file(path).unwrap();
        }
        let target =
            TargetFile { flow: Some(folder.path().into()), alpha: folder.path().into(), ..TargetFile::default() };
        let target = of(SceneFile { target: Some(target), ..SceneFile::default() }).unwrap();
        assert_eq!((target.alpha(1).unwrap().at(3, 3), target.frames()), (1.0, 3));
        // Each frame says where it came from.
        let flow = target.flow(2).unwrap();
        assert_eq!((flow.u.at(9, 9), flow.v.at(9, 9)), (2.0, 2.0));
    }

    #[test]
    fn heights_keep_their_scale_and_parameters_their_components() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = designed(folder.path());
        std::fs::create_dir_all(folder.path().join("height")).unwrap();
        for (t, number) in (7..11).enumerate() {
            let height = Plane::filled(64, 32, 0.2 * t as f32);
            let bytes = encode_deep_grey_png(&height).unwrap();
            std::fs::write(folder.path().join(format!("height/{number}.png")), bytes).unwrap();
        }
        let (heat, array) =
            (folder.path().join("heat.npy"), |frames, value: f32| Array4::from_elem((frames, 32, 64, 2), value));
        npy::write_array(&heat, array(4, 0.25).view()).unwrap();
        let target = file.target.as_mut().unwrap();
        (target.height, target.parameters) = (Some(folder.path().join("height")), Some(heat.clone()));
        let of = |file: &SceneFile| of(file.clone());
        let height = |file: &SceneFile| of(file).unwrap().height(3).unwrap().unwrap();
        assert_eq!(height(&file).pixels, None);
        std::fs::write(folder.path().join("summary.json"), r#"{"height_white": 40.0}"#).unwrap();
        assert_eq!(height(&file).pixels, Some(40.0));
        assert!((height(&file).plane.at(9, 9) - 0.6).abs() < 1e-4);
        file.target.as_mut().unwrap().height_white = Some(8.0);
        assert_eq!(height(&file).pixels, Some(8.0));
        // At half the size a height is half as many pixels.
        let map = FrameMap { picture: (64, 32), working: (32, 16), output: (64, 32) };
        let half = Target { map, ..of(&file).unwrap() };
        let (height, parameters) = (half.height(3).unwrap().unwrap(), half.parameters(2).unwrap().unwrap());
        assert_eq!((height.pixels, height.plane.width, parameters.len()), (Some(4.0), 32, 2));
        assert!((parameters[1].at(9, 9) - 0.25).abs() < 1e-6);
        let refuse = |file: &SceneFile, words: &[&str]| {
            let message = of(file).unwrap_err().to_string();
            words.iter().for_each(|word| assert!(message.contains(word), "{message} lacks {word}"));
        };
        npy::write_array(&heat, array(3, 0.25).view()).unwrap();
        refuse(&file, &["heat.npy", "has 3 frames, the target has 4"]);
        npy::write_array(&heat, Array4::<f32>::zeros((4, 32, 60, 1)).view()).unwrap();
        refuse(&file, &["heat.npy", "60 × 32", "64 × 32"]);
        npy::write_array(&heat, array(4, 1.5).view()).unwrap();
        assert!(of(&file).unwrap().parameters(0).unwrap_err().to_string().contains("1.5"));
        file.target.as_mut().unwrap().parameters = Some(folder.path().join("alpha"));
        assert_eq!(of(&file).unwrap().parameters(1).unwrap().unwrap()[0].at(9, 9), 1.0);
        file.target.as_mut().unwrap().height_white = Some(f32::NAN);
        refuse(&file, &["target.height_white", "out of range"]);
        file.target.as_mut().unwrap().height = None;
        refuse(&file, &["target.height_white", "without a folder of heights"]);
    }

    #[test]
    fn a_target_may_be_opacity_alone() {
        let folder = tempfile::tempdir().unwrap();
        let mut file = designed(folder.path());
        file.target.as_mut().unwrap().flow = None;
        let target = of(file.clone()).unwrap();
        assert_eq!((target.frames(), target.size(), target.alpha(2).unwrap().at(20, 9)), (4, (64, 32), 1.0));
        assert_eq!((target.height(0).unwrap(), target.parameters(0).unwrap()), (None, None));
        for error in [target.must_flow().unwrap_err(), target.flow(1).unwrap_err()] {
            assert!(error.to_string().contains("the target has no flow: "), "{error}");
        }
        for number in [9, 10] {
            std::fs::remove_file(folder.path().join(format!("alpha/{number}.png"))).unwrap();
        }
        assert_eq!(of(file.clone()).unwrap().frames(), 2);
        std::fs::remove_file(folder.path().join("alpha/8.png")).unwrap();
        assert!(of(file).unwrap_err().to_string().contains("has only one frame"));
    }

    #[test]
    fn a_target_stands_alone() {
        let folder = tempfile::tempdir().unwrap();
        let file = designed(folder.path());
        let refuse = |file: SceneFile, word: &str| {
            let message = of(file).unwrap_err().to_string();
            assert!(message.contains(word), "{message} lacks {word}");
        };
        refuse(SceneFile { picture: "a.png".into(), ..file.clone() }, "as background");
        refuse(SceneFile { matte: Some("a.png".into()), ..file.clone() }, "matte");
        let motion = Motion { direction: Some(3.0), ..Motion::default() };
        refuse(SceneFile { motion, ..file.clone() }, "motion: ");
        let target = Some(TargetFile { flow: Some(folder.path().join("flow")), ..TargetFile::default() });
        refuse(SceneFile { target, ..file.clone() }, "target.alpha: is missing");
        for name in ["flow/0008.flo", "flow/0009.flo", "flow/0010.flo"] {
            std::fs::remove_file(folder.path().join(name)).unwrap();
        }
        refuse(file, "has only one frame");
    }
}
