//! A scene whose settings have been checked; its pixels are read when they are needed.

use std::path::{Path, PathBuf};

use super::asked::Asked;
use super::designed::Designed;
use super::exemplar;
use super::exemplar_file::ExemplarFile;
use super::file::{self, Motion, Output, SceneFile, TargetFile};
use super::frame_map::FrameMap;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::options::Table;
use crate::flow::strokes::MAX_SPEED;
use crate::raster::image::{Color, Plane, Rgb8};
use crate::raster::picture_io::{picture_size, read_matte, read_picture};
use crate::raster::resample::{resize, resize_channel, resize_rgb8};
use crate::simulate;
use crate::simulate::output::SIMULATION_FILE;

/// Fewest frames of a loop.
pub const MIN_FRAMES: usize = 2;
/// Name of the scene file within a scene's folder.
pub const SCENE_FILE: &str = "scene.toml";

/// Reads what a person points at: a scene file, a folder with a `scene.toml`, a folder of a designed target (`flow` and
/// `alpha`, as `enliven simulate` makes; its frames per second are those of the simulation), or a picture. Paths in the
/// result no longer depend on the scene file's place.
///
/// # Errors
/// A missing or unreadable file, or those of [`file::parse`].
pub fn open(path: &Path) -> Result<SceneFile> {
    if let Some(scene) = target_folder(path)? {
        return Ok(scene);
    }
    let path = file_of(path);
    if let Some((there, missing)) = half_a_target(&path) {
        return Err(Error::file(Kind::Usage, &there, format!("has no folder {missing} beside it"))
            .remedy("a designed target is a folder with flow and alpha in it, as enliven simulate writes"));
    }
    if !path.exists() {
        return Err(Error::file(Kind::Io, &path, "there is no such file")
            .allowed("a picture, a scene file, or a folder with a scene.toml or with flow and alpha")
            .remedy("check the name"));
    }
    if path.extension().is_none_or(|e| !e.eq_ignore_ascii_case("toml")) {
        return Ok(SceneFile { picture: path, ..SceneFile::default() });
    }
    let text = std::fs::read_to_string(&path).map_err(|e| Error::io(&path, "read the scene", e))?;
    let mut scene = file::parse(&text, &path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    for_each_path(&mut scene, |p| *p = if p.as_os_str().is_empty() { PathBuf::new() } else { folder.join(&*p) });
    Ok(scene)
}

/// The scene of a folder that holds nothing but a target.
fn target_folder(folder: &Path) -> Result<Option<SceneFile>> {
    let [flow, alpha, height, parameters] = ["flow", "alpha", "height", "parameters"].map(|name| folder.join(name));
    if folder.join(SCENE_FILE).exists() || !flow.is_dir() || !alpha.is_dir() {
        return Ok(None);
    }
    let [height, parameters] = [height, parameters].map(|folder| Some(folder).filter(|folder| folder.is_dir()));
    let target = TargetFile { flow: Some(flow), alpha, height, parameters, height_white: None };
    let mut scene = SceneFile { target: Some(target), ..SceneFile::default() };
    let simulation = folder.join(SIMULATION_FILE);
    if simulation.exists() {
        let text = std::fs::read_to_string(&simulation).map_err(|e| Error::io(&simulation, "read", e))?;
        scene.output.fps = simulate::file::parse(&text, &simulation)?.fps;
    }
    Ok(Some(scene))
}

/// The folder of motion or opacity that stands alone where the scene file `path` should be, and the one that is missing.
fn half_a_target(path: &Path) -> Option<(PathBuf, &'static str)> {
    let folder = path.parent().filter(|_| !path.exists() && path.ends_with(SCENE_FILE))?;
    let [flow, alpha] = ["flow", "alpha"].map(|name| folder.join(name));
    match (flow.is_dir(), alpha.is_dir()) {
        (true, false) => Some((flow, "alpha")),
        (false, true) => Some((alpha, "flow")),
        _ => None,
    }
}

/// The file that a person points at: a scene's folder has its `scene.toml`.
pub fn file_of(path: &Path) -> PathBuf {
    if path.is_dir() { path.join(SCENE_FILE) } else { path.to_owned() }
}

/// Every file that [`open`] reads settings from.
pub fn files_of(path: &Path) -> Vec<PathBuf> {
    let simulation = path.join(SIMULATION_FILE);
    [file_of(path), simulation].into_iter().filter(|path| path.is_file()).collect()
}

/// Calls `f` with every file and folder that a scene is made from, always in the same order; the picture of a scene without
/// one is empty, and so may be an exemplar.
pub fn for_each_path(scene: &mut SceneFile, mut f: impl FnMut(&mut PathBuf)) {
    f(&mut scene.picture);
    if let Some(TargetFile { flow, alpha, height, parameters, height_white: _ }) = &mut scene.target {
        flow.iter_mut().chain([alpha]).chain(height).chain(parameters).for_each(&mut f);
    }
    let SceneFile { matte, background, exemplars, reference, library, motion, .. } = scene;
    let Motion { strokes, orientation, speed, .. } = motion;
    let optional = [matte, background, reference, strokes, orientation, speed];
    let exemplars = exemplars.iter_mut().flat_map(ExemplarFile::paths);
    optional.into_iter().flatten().chain(exemplars).chain(library).for_each(f);
}

/// A checked scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Scene {
    file: SceneFile,
    map: FrameMap,
    target: Option<Designed>,
}

/// The pixels of a scene.
#[derive(Debug, Clone, PartialEq)]
pub struct Still {
    /// Sizes and coordinates.
    pub map: FrameMap,
    /// The picture at output size; the file's own bytes when the sizes agree. Of a designed target: what is behind the
    /// fluid, black without a background.
    pub picture: Rgb8,
    /// The matte at output size, 0 = still, 1 = fluid. Of a designed target: 1 everywhere.
    pub matte: Plane,
    /// The picture at working size.
    pub working: Color,
    /// The matte at working size, 0 = still, 1 = fluid.
    pub working_matte: Plane,
    /// What is behind the fluid, at output size; there for every designed target.
    pub background: Option<Rgb8>,
    /// The motion that is asked for.
    pub asked: Option<Asked>,
}

impl Scene {
    /// Checks everything that can be checked without decoding pixels.
    ///
    /// # Errors
    /// A value out of range, a file that is missing, a matte or background of another size, a picture too small or too
    /// large; each by name.
    pub fn new(mut file: SceneFile) -> Result<Self> {
        check_numbers(&file)?;
        if let Some(direction) = &mut file.motion.direction {
            *direction = direction.rem_euclid(360.0);
        }
        let target = file.target.as_ref().map(|target| Designed::open(&file, target)).transpose()?;
        if file.picture.as_os_str().is_empty() && target.is_none() {
            return Err(Error::new(Kind::Usage, "picture", "no picture given").remedy("name a picture or a scene file"));
        }
        let size = target.as_ref().map_or_else(|| picture_size(&file.picture), |target| Ok(target.size))?;
        file.output.frames = Some(target.as_ref().map_or(Ok(file.output.length()), |t| t.length(&file.output))?);
        check_range(&file.output)?;
        let whole = if target.is_some() { "target" } else { "picture" };
        for (path, what) in [
            (&file.matte, "matte"),
            (&file.background, "background"),
            (&file.motion.orientation, "orientation map"),
            (&file.motion.speed, "speed map"),
        ] {
            path.as_deref().map_or(Ok(()), |path| same_size((path, what), (whole, size)))?;
        }
        file.library.iter().try_for_each(|path| library_exists(path))?;
        file.reference.iter().chain(&file.motion.strokes).try_for_each(|path| exists(path))?;
        exemplar::check(&file.exemplars)?;
        let fit = if target.is_some() { FrameMap::of_target } else { FrameMap::new };
        let map = fit(size, file.output.size, file.output.working_size).map_err(|error| match error.kind() {
            Kind::Unusable => error.about(file.target.as_ref().map_or(&*file.picture, TargetFile::lead).display()),
            _ => error,
        })?;
        Ok(Self { file, map, target })
    }

    /// The settings, with paths that do not depend on a scene file's place.
    pub fn settings(&self) -> &SceneFile {
        &self.file
    }

    /// Sizes of picture, working image and output.
    pub fn frame_map(&self) -> FrameMap {
        self.map
    }

    /// The frames of the loop that are to be made.
    pub fn wanted_frames(&self) -> std::ops::Range<usize> {
        self.file.output.wanted()
    }

    /// The designed target, where there is one.
    pub fn designed(&self) -> Option<&Designed> {
        self.target.as_ref()
    }

    /// The options given for a method, unread.
    pub fn options(&self, method: &str) -> Table {
        self.file.options.get(method).cloned().unwrap_or_default()
    }

    /// Replaces the clips that must not be used.
    pub fn leave_out(&mut self, clips: Vec<String>) {
        self.file.without = clips;
    }

    /// Replaces the options of a method, so that a written scene holds every value that was used.
    pub fn set_options(&mut self, method: &str, table: Table) {
        self.file.method = Some(method.to_owned());
        self.file.options.insert(method.to_owned(), table);
    }

    /// Everything needed to repeat the run, as a scene file's text that will lie in `folder`.
    ///
    /// # Errors
    /// A path that is not UTF-8.
    pub fn to_toml(&self, folder: &Path) -> Result<String> {
        let mut file = self.file.clone();
        for_each_path(&mut file, |path| *path = relative(path, folder));
        file.output.size = Some([self.map.output.0, self.map.output.1]);
        file::format(&file)
    }

    /// Reads the pixels.
    ///
    /// # Errors
    /// Unreadable files, and a matte that is all black.
    pub fn still(&self, observer: &dyn Observer) -> Result<Still> {
        let map = self.map;
        if self.target.is_some() {
            return self.behind_target();
        }
        // One thing of the file's size at a time.
        let (picture, working) = at_both_sizes(&self.file.picture, &map)?;
        let (matte, working_matte) = self.mattes(observer)?;
        let background = self.file.background.as_deref().map(read_picture).transpose()?;
        let background = background.map(|b| resized(b.rgb, map.output));
        let asked = Asked::read(&self.file.motion, &map, &working_matte, observer)?;
        Ok(Still { picture, matte, working, working_matte, background, map, asked })
    }
}

impl Scene {
    /// The pixels of a scene without a picture: what is behind its target.
    fn behind_target(&self) -> Result<Still> {
        let map = self.map;
        let ((width, height), (w, h)) = (map.output, map.working);
        let black = || Ok((Rgb8::black(width, height), Color::zeros(w, h)));
        let (picture, working) = self.file.background.as_deref().map_or_else(black, |p| at_both_sizes(p, &map))?;
        let (matte, working_matte) = (Plane::filled(width, height, 1.0), Plane::filled(w, h, 1.0));
        Ok(Still { background: Some(picture.clone()), picture, matte, working, working_matte, map, asked: None })
    }

    /// The matte at output size and at working size.
    fn mattes(&self, observer: &dyn Observer) -> Result<(Plane, Plane)> {
        let FrameMap { output, working, .. } = self.map;
        let Some(path) = &self.file.matte else {
            observer.note("no matte given: all of the picture moves; name one with --matte");
            return Ok((Plane::filled(output.0, output.1, 1.0), Plane::filled(working.0, working.1, 1.0)));
        };
        let matte = read_matte(path)?;
        if mostly_grey(&matte) {
            let file = path.display();
            observer.note(&format!("{file}: most of the matte is grey, and grey moves in part; white is all fluid"));
        }
        let working = resize_matte(&matte, working);
        Ok((if self.map.picture == output { matte } else { resize_matte(&matte, output) }, working))
    }
}

/// A picture at output size and at working size.
fn at_both_sizes(path: &Path, map: &FrameMap) -> Result<(Rgb8, Color)> {
    let picture = read_picture(path)?.rgb;
    let working = shrink(&picture, map.working);
    Ok((resized(picture, map.output), working))
}

/// `picture` itself where it has the size.
fn resized(picture: Rgb8, size: (usize, usize)) -> Rgb8 {
    if (picture.width, picture.height) == size { picture } else { resize_rgb8(&picture, size.0, size.1) }
}

fn check_numbers(file: &SceneFile) -> Result<()> {
    let out = &file.output;
    let bad = |key: &str, value: String, allowed: &str| {
        Err(Error::new(Kind::Usage, key, format!("{value} is out of range")).allowed(allowed))
    };
    if let Some(frames) = out.frames.filter(|frames| !(MIN_FRAMES..=100_000).contains(frames)) {
        return bad("output.frames", frames.to_string(), &format!("{MIN_FRAMES} to 100000"));
    }
    if !(1.0..=240.0).contains(&out.fps) {
        return bad("output.fps", out.fps.to_string(), "1 to 240");
    }
    if !(96..=4096).contains(&out.working_size) {
        return bad("output.working_size", out.working_size.to_string(), "96 to 4096");
    }
    if let Some([w, h]) = out.size.filter(|s| s.iter().any(|v| !(16..=8192).contains(v))) {
        return bad("output.size", format!("{w} × {h}"), "16 to 8192 each way");
    }
    check_motion(&file.motion)
}

/// Refuses a part of the frames that is none.
fn check_range(out: &Output) -> Result<()> {
    if let Some([first, end]) = out.frames_range.filter(|[first, end]| first >= end) {
        let problem = format!("{first}..{end} holds no frame: the first comes first, then the one after the last");
        return Err(Error::new(Kind::Usage, "output.frames_range", problem)
            .remedy(format!("write {end}..{}", first.max(end + 1))));
    }
    let Some([first, end]) = out.frames_range.filter(|[_, end]| *end > out.length()) else { return Ok(()) };
    Err(Error::new(Kind::Usage, "output.frames_range", format!("{first}..{end} is out of range"))
        .allowed(format!("0..{0}, or a part of it; frame {0} itself is not one", out.length())))
}

fn check_motion(motion: &Motion) -> Result<()> {
    let bad = |key: &str, problem: String, allowed: &str| {
        Err(Error::new(Kind::Usage, format!("motion.{key}"), problem).allowed(allowed))
    };
    match (motion.direction, &motion.speed, motion.max_speed) {
        (Some(d), ..) if !(-360.0..=360.0).contains(&d) => {
            bad("direction", format!("{d} is out of range"), "-360 to 360 degrees; 0 = right, 90 = down")
        }
        (.., Some(max)) if !(max > 0.0 && max <= MAX_SPEED) => bad(
            "max_speed",
            format!("{max} is out of range"),
            &format!("above 0, at most {MAX_SPEED} pixels per frame"),
        ),
        (_, Some(path), None) => {
            let problem = format!("{} needs the speed that its white stands for", path.display());
            bad("max_speed", problem, "pixels of the picture per output frame, such as 6")
                .map_err(|e| e.remedy("give --max-speed"))
        }
        (_, None, Some(_)) => {
            let missing = "is given without a speed map to go with it".to_owned();
            bad("max_speed", missing, "a grey picture of the picture's size as motion.speed or --speed")
        }
        _ => Ok(()),
    }
}

fn same_size((path, what): (&Path, &str), (whole, size): (&str, (usize, usize))) -> Result<()> {
    let found = picture_size(path)?;
    if found == size {
        return Ok(());
    }
    let problem = format!("the {what} is {} × {} pixels, the {whole} {} × {}", found.0, found.1, size.0, size.1);
    Err(Error::file(Kind::Unusable, path, problem).remedy(format!("make the {what} the {whole}'s size")))
}

fn exists(path: &Path) -> Result<()> {
    std::fs::metadata(path).map(|_| ()).map_err(|e| Error::io(path, "open", e))
}

fn library_exists(path: &Path) -> Result<()> {
    if path.exists() {
        return Ok(());
    }
    Err(Error::file(Kind::Io, path, "no such library")
        .remedy("build one with `enliven-db build CLIPS -o NAME.pack`, or name an existing one"))
}

/// Whether more of what is not black is grey than white.
fn mostly_grey(matte: &Plane) -> bool {
    let (mut grey, mut painted) = (0_usize, 0_usize);
    for &v in matte.data.iter().filter(|&&v| v > 0.05) {
        painted += 1;
        grey += usize::from(v < 0.95);
    }
    2 * grey > painted
}

/// A matte, or alpha, at another size, 0 to 1.
pub(super) fn resize_matte(matte: &Plane, size: (usize, usize)) -> Plane {
    // Below half an 8-bit step the resampler's ripples are not paint.
    if (matte.width, matte.height) == size {
        return matte.clone();
    }
    resize(matte, size.0, size.1).map(|v| if v < 0.5 / 255.0 { 0.0 } else { v.min(1.0) })
}

fn shrink(picture: &Rgb8, (width, height): (usize, usize)) -> Color {
    let channel = |c| resize_channel(picture, c, width, height).map(|v| v.clamp(0.0, 1.0));
    Color::from_planes(std::array::from_fn(channel))
}

/// `path` as seen from `folder`, when both exist; otherwise `path` itself.
pub fn relative(path: &Path, folder: &Path) -> PathBuf {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let (Ok(path), Ok(folder)) = (path.canonicalize(), folder.canonicalize()) else { return path.to_owned() };
    let shared = path.components().zip(folder.components()).take_while(|(a, b)| a == b).count();
    let up = folder.components().skip(shared).map(|_| Path::new(".."));
    let down: PathBuf = path.components().skip(shared).collect();
    up.collect::<PathBuf>().join(down)
}
