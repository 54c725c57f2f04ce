//! What a comparison makes: every scene with every method, and every value of a sweep.

use std::cell::OnceCell;
use std::collections::BTreeSet;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use super::arguments::Compare;
use super::blind::Plant;
use crate::base::error::{Error, Kind, Result};
use crate::base::observe::Observer;
use crate::base::own_file::{self, Inputs};
use crate::cli::measure::bare;
use crate::report::comparison::{Row, SceneRows, Sort};
use crate::report::yardstick::{Reference, Yardstick};
use crate::scene::exemplar_file::{ExemplarFile, with_opacities};
use crate::scene::file::{SceneFile, set};
use crate::scene::scene::{self, SCENE_FILE, Scene};
use crate::synth::methods::{PLAIN_METHOD, REGISTRY};
use crate::synth::run::{self, PreparedScene};

/// Folder of the scenes as they were run.
const SCENES: &str = "scenes";

/// Everything to make.
pub struct Plan {
    /// The scenes.
    pub scenes: Vec<PlannedScene>,
    /// What to tell before it is made.
    pub notes: Vec<String>,
    /// The methods asked for.
    pub methods: Vec<String>,
    sweep: Vec<String>,
    set: Vec<String>,
    blind: bool,
    /// Bad videos that take part in the blind test.
    pub planted: Vec<Plant>,
}

/// A scene and its rows.
pub struct PlannedScene {
    /// Name of its folder.
    pub name: String,
    /// The scene itself, without a method.
    pub file: SceneFile,
    /// Size, rate and number of frames.
    shape: ((usize, usize), f32, usize),
    /// Pixels of all working images, which the time that a method takes is roughly proportional to.
    pub effort: f64,
    /// The rows.
    pub cells: Vec<Cell>,
    /// What the rows are measured against, once one is measured.
    yardstick: OnceCell<Yardstick>,
}

/// A row to make.
#[derive(Clone)]
pub struct Cell {
    /// Name on the page.
    pub name: String,
    /// Name of its files, without extension.
    pub stem: String,
    /// What it is.
    pub sort: Sort,
    /// The scene with the method and its options.
    pub file: SceneFile,
    /// What a sweep sets: options and their values.
    pub point: Vec<(String, String)>,
    /// Whether it gives meaning to the numbers of others.
    pub baseline: bool,
    /// The row whose frames it shuffles.
    pub shuffles: Option<Box<Cell>>,
}

/// An option and the values to try.
struct Sweep {
    method: String,
    key: String,
    values: Vec<String>,
}

impl Plan {
    /// Reads the scenes and combines them with methods and sweeps.
    ///
    /// # Errors
    /// A scene that is not sound; unknown methods and options; a sweep without values, or of a method that is not
    /// compared.
    pub fn new(arguments: &Compare) -> Result<Self> {
        let methods = methods(&arguments.methods)?;
        let sweeps = arguments.sweep.iter().map(|text| Sweep::parse(text, &methods)).collect::<Result<Vec<_>>>()?;
        let mut options = BTreeSet::new();
        if let Some(twice) = sweeps.iter().find(|sweep| !options.insert((&sweep.method, &sweep.key))) {
            let problem = format!("{}.{} is swept twice", twice.method, twice.key);
            return Err(Error::new(Kind::Usage, "--sweep", problem).remedy("give all its values in one --sweep"));
        }
        let planted = if arguments.plant.is_empty() { vec![Plant::Frozen] } else { arguments.plant.clone() };
        let (mut names, mut notes) = (BTreeSet::new(), Vec::new());
        let exemplars = arguments.exemplars()?;
        let mut planned = |path: &PathBuf| -> Result<PlannedScene> {
            let file = arguments.scene(path, &exemplars)?;
            let own = [
                ("--library", !arguments.library.is_empty() && file.library != arguments.library),
                ("--exemplar", !exemplars.is_empty() && file.exemplars != exemplars),
            ];
            notes.extend(
                own.iter()
                    .filter(|flag| flag.1)
                    .map(|(flag, _)| format!("{}: {flag} is not used, the scene names its own", path.display())),
            );
            let scene = Scene::new(file.clone()).map_err(|error| error.within(path))?;
            let output = scene.settings().output;
            let shape = (scene.frame_map().output, output.fps, output.length());
            let (width, height) = scene.frame_map().working;
            let effort = (width * height * output.length()) as f64;
            let name = unused(&name_of(path), &mut names);
            // Without a wish a designed target is made by the methods that take one.
            let serves = |name: &&String| {
                let takes = REGISTRY.iter().any(|method| method.name == **name && method.designed);
                takes || scene.designed().is_none() || !arguments.methods.is_empty()
            };
            let methods: Vec<&String> = methods.iter().filter(serves).collect();
            let given = file.exemplars.len();
            let takes_fewer = |name: &&&String| {
                REGISTRY.iter().any(|entry| entry.name == ***name && (1..given).contains(&entry.exemplars))
            };
            notes.extend(methods.iter().filter(takes_fewer).map(|name| {
                format!(
                    "{}: {name} borrows from the first of its {given} exemplars, since it takes one",
                    path.display()
                )
            }));
            let mut cells = cells(&file, &scene, &methods, &sweeps)?;
            let first =
                cells.iter().find(|cell| cell.sort == Sort::Method).filter(|_| planted.contains(&Plant::Shuffled));
            if let Some(first) = first {
                let shuffles = Some(Box::new(first.clone()));
                cells.push(Cell { shuffles, ..baseline(&file, Sort::Shuffled, "shuffled") });
            }
            Ok(PlannedScene { name, file, shape, effort, cells, yardstick: OnceCell::new() })
        };
        let scenes = arguments.scenes.iter().map(&mut planned).collect::<Result<_>>()?;
        let (sweep, set) = (arguments.sweep.clone(), arguments.set.clone());
        Ok(Self { scenes, notes, methods, sweep, set, blind: arguments.blind, planted })
    }

    /// Writes the scenes as they are run, for [`Plan::command`]; one that is run from there stays as it is.
    ///
    /// # Errors
    /// A scene of that name there that a person changed; a folder that cannot be written to.
    pub fn write_scenes(&self, folder: &Path, inputs: &Inputs) -> Result<()> {
        let folder = folder.join(SCENES);
        std::fs::create_dir_all(&folder).map_err(|e| Error::io(&folder, "make the folder", e))?;
        self.scenes.iter().try_for_each(|planned| {
            let path = folder.join(format!("{}.toml", planned.name));
            if inputs.holding(&path).is_some() {
                return Ok(());
            }
            own_file::write(&path, Scene::new(planned.file.clone())?.to_toml(&folder)?.as_bytes())
        })
    }

    /// All rows: numbers of the scene, and of the row in it.
    pub fn cells(&self) -> impl Iterator<Item = (usize, usize)> {
        self.scenes.iter().enumerate().flat_map(|(s, scene)| (0..scene.cells.len()).map(move |c| (s, c)))
    }

    /// What repeats the comparison in its own folder.
    pub fn command(&self) -> String {
        let mut command = "enliven compare".to_owned();
        for planned in &self.scenes {
            let _ = write!(command, " {}", quoted(&format!("{SCENES}/{}.toml", planned.name)));
        }
        let _ = write!(command, " --methods {}", self.methods.join(","));
        for (flag, values) in [("--sweep", &self.sweep), ("--set", &self.set)] {
            values.iter().for_each(|value| {
                let _ = write!(command, " {flag} {}", quoted(value));
            });
        }
        if self.blind {
            let planted: Vec<&str> = self.planted.iter().map(|plant| plant.word()).collect();
            let _ = write!(command, " --blind --plant {}", planted.join(","));
        }
        command + " -o ."
    }
}

impl PlannedScene {
    /// Frames per second.
    pub fn fps(&self) -> f32 {
        self.shape.1
    }

    /// Frames of each video.
    pub fn frames(&self) -> usize {
        self.shape.2
    }

    /// What its rows are measured against.
    ///
    /// # Errors
    /// A scene that cannot be read; a cancel.
    pub fn yardstick(&self, observer: &dyn Observer) -> Result<&Yardstick> {
        if let Some(read) = self.yardstick.get() {
            return Ok(read);
        }
        let scene = Scene::new(bare(self.file.clone()))?;
        let read = Yardstick::read(Some(scene), Reference::default(), observer)?;
        Ok(self.yardstick.get_or_init(|| read))
    }

    /// Its place on the page, before anything is made.
    pub fn empty(&self) -> SceneRows {
        let (size, fps, frames) = self.shape;
        let rows = self.cells.iter().map(Cell::empty).collect();
        SceneRows { name: self.name.clone(), frames, fps, size, rows, ..SceneRows::default() }
    }
}

impl Compare {
    /// The exemplars that the command line names.
    fn exemplars(&self) -> Result<Vec<ExemplarFile>> {
        let exemplars = self.exemplar.iter().map(ExemplarFile::new).collect();
        with_opacities(exemplars, self.exemplar_alpha.clone())
    }

    /// A scene with what the command line adds.
    fn scene(&self, path: &Path, exemplars: &[ExemplarFile]) -> Result<SceneFile> {
        let mut file = scene::open(path)?;
        if file.library.is_empty() {
            file.library.clone_from(&self.library);
        }
        if file.exemplars.is_empty() {
            file.exemplars = exemplars.to_vec();
        }
        file.output.frames = self.frames.or(file.output.frames);
        file.output.working_size = self.working_size.unwrap_or(file.output.working_size);
        file.output.seed = self.seed.unwrap_or(file.output.seed);
        (file.method, file.output.frames_range, file.output.alpha) = (None, None, false);
        self.set.iter().try_for_each(|text| set(&mut file, text))?;
        run::check_options(&file.options).map_err(|error| error.within(path))?;
        Ok(file)
    }
}

/// The methods asked for, or all.
fn methods(asked: &[String]) -> Result<Vec<String>> {
    run::check_names("--methods", asked)?;
    let mut seen = BTreeSet::new();
    if let Some(twice) = asked.iter().find(|name| !seen.insert(name.as_str())) {
        return Err(Error::new(Kind::Usage, "--methods", format!("{twice} is named twice")));
    }
    let all = || REGISTRY.iter().map(|method| method.name.to_owned()).collect();
    Ok(if asked.is_empty() { all() } else { asked.to_vec() })
}

impl Sweep {
    fn parse(text: &str, methods: &[String]) -> Result<Self> {
        let parts = text.split_once('=').and_then(|(name, values)| Some((name.split_once('.')?, values)));
        let bad = |problem: String| Error::new(Kind::Usage, "--sweep", problem);
        let Some(((method, key), values)) = parts else {
            return Err(bad(format!("cannot read {text:?}"))
                .allowed("METHOD.KEY=V1,V2,…")
                .remedy("for example --sweep database.shutter=0,2,4"));
        };
        let values: Vec<String> = values.split(',').map(|v| v.trim().to_owned()).filter(|v| !v.is_empty()).collect();
        if values.is_empty() {
            return Err(bad(format!("{text:?} names no value")).allowed("METHOD.KEY=V1,V2,…"));
        }
        let mut seen = BTreeSet::new();
        if let Some(twice) = values.iter().find(|value| !seen.insert(*value)) {
            return Err(bad(format!("{text:?} names {twice} twice")).remedy("name every value once"));
        }
        if !methods.iter().any(|name| name == method) {
            return Err(bad(format!("{method} is not compared"))
                .allowed(methods.join(", "))
                .remedy("add it to --methods"));
        }
        Ok(Self { method: method.to_owned(), key: key.to_owned(), values })
    }
}

/// What gives meaning to the numbers, then the methods with every combination of swept values.
fn cells(file: &SceneFile, scene: &Scene, methods: &[&String], sweeps: &[Sweep]) -> Result<Vec<Cell>> {
    let mut cells = Vec::new();
    if scene.designed().is_none() {
        cells.push(baseline(file, Sort::Frozen, "frozen"));
    }
    if file.reference.is_some() {
        cells.push(baseline(file, Sort::Real, "real"));
    }
    // It is shown beside any others, where it can do anything.
    if !methods.iter().any(|name| *name == PLAIN_METHOD) && scene.designed().is_none() {
        cells.push(cell(file, PLAIN_METHOD, &[])?);
    }
    for method in methods {
        for point in points(method, sweeps) {
            cells.push(cell(file, method, &point)?);
        }
    }
    Ok(cells)
}

/// A row that is no method's.
fn baseline(file: &SceneFile, sort: Sort, name: &str) -> Cell {
    // Neither a library nor an exemplar makes such a row anew.
    let file = SceneFile { library: Vec::new(), without: Vec::new(), exemplars: Vec::new(), ..file.clone() };
    let point = Vec::new();
    Cell { name: name.into(), stem: name.into(), sort, file, point, baseline: true, shuffles: None }
}

/// All combinations of the values that are swept for a method.
fn points<'a>(method: &str, sweeps: &'a [Sweep]) -> Vec<Vec<(&'a str, &'a str)>> {
    let mut points = vec![Vec::new()];
    for sweep in sweeps.iter().filter(|sweep| sweep.method == method) {
        let with = |point: &Vec<(&'a str, &'a str)>, value: &'a str| {
            point.iter().copied().chain([(sweep.key.as_str(), value)]).collect()
        };
        points = points.iter().flat_map(|point| sweep.values.iter().map(move |value| with(point, value))).collect();
    }
    points
}

fn cell(file: &SceneFile, method: &str, point: &[(&str, &str)]) -> Result<Cell> {
    let mut file = SceneFile { method: Some(method.to_owned()), ..file.clone() };
    // What a method makes no use of does not make its rows anew.
    if let Some(entry) = REGISTRY.iter().find(|entry| entry.name == method) {
        file.library.retain(|_| entry.library);
        file.exemplars.truncate(entry.exemplars);
    }
    let mut name = method.to_owned();
    for (key, value) in point {
        set(&mut file, &format!("{method}.{key}={value}"))?;
        let _ = write!(name, " {key}={value}");
    }
    run::check_options(&file.options)?;
    let point: Vec<_> = point.iter().map(|(key, value)| ((*key).to_owned(), (*value).to_owned())).collect();
    // Whoever sweeps it wants to know about it.
    let baseline = method == PLAIN_METHOD && point.is_empty();
    Ok(Cell { stem: plain(&name), name, sort: Sort::Method, file, point, baseline, shuffles: None })
}

/// What a scene is called: its folder, or its file without extension.
fn name_of(path: &Path) -> String {
    let whole = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let named = if whole.file_name().is_some_and(|name| name == SCENE_FILE) { whole.parent() } else { Some(&*whole) };
    let name = named.and_then(|path| if path.is_dir() { path.file_name() } else { path.file_stem() });
    let name = plain(&name.unwrap_or_default().to_string_lossy());
    if name.is_empty() { "scene".into() } else { name }
}

/// A name that nobody has yet.
fn unused(name: &str, names: &mut BTreeSet<String>) -> String {
    let numbered = (2..).map(|k| format!("{name}-{k}"));
    let free = [name.to_owned()].into_iter().chain(numbered).find(|name| !names.contains(name)).unwrap_or_default();
    names.insert(free.clone());
    free
}

/// A name that any disk holds and any address takes.
fn plain(name: &str) -> String {
    let kept = |c: char| if c.is_ascii_alphanumeric() || "._=-".contains(c) { c } else { '-' };
    name.chars().map(kept).collect::<String>().trim_matches(['.', '-']).to_owned()
}

/// A word as a shell takes it.
fn quoted(word: &str) -> String {
    let simple = |c: char| c.is_ascii_alphanumeric() || "._=-,/:".contains(c);
    if word.chars().all(simple) { word.to_owned() } else { format!("'{}'", word.replace('\'', r"'\''")) }
}

impl Cell {
    /// Its row, before it is made.
    pub fn empty(&self) -> Row {
        let Self { name, sort, file, point, baseline, .. } = self;
        let method = file.method.clone().unwrap_or_default();
        Row { name: name.clone(), sort: *sort, method, point: point.clone(), baseline: *baseline, ..Row::default() }
    }

    /// The scene with every option that counts, defaults included, and no others.
    ///
    /// # Errors
    /// Those of [`Scene::new`] and [`PreparedScene::new`].
    pub fn settings(&self) -> Result<SceneFile> {
        let mut scene = Scene::new(self.file.clone())?;
        if self.file.method.is_some() {
            scene = PreparedScene::new(scene)?.into_scene();
        }
        let method = scene.settings().method.clone().unwrap_or_default();
        let mut file = scene.settings().clone();
        let (width, height) = scene.frame_map().output;
        (file.output.size, file.output.max_memory) = (Some([width, height]), None);
        file.options.retain(|name, _| *name == method);
        Ok(file)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sweeps_are_combined_and_named() {
        let methods = ["database".to_owned(), "advect".to_owned()];
        let sweeps: Vec<Sweep> = ["database.sigma=1,2", "database.shutter=0, 3", "advect.life=20"]
            .iter()
            .map(|text| Sweep::parse(text, &methods).unwrap())
            .collect();
        let points = points("database", &sweeps);
        assert_eq!(points.len(), 4);
        assert_eq!(points[1], [("sigma", "1"), ("shutter", "3")]);
        for (text, part) in
            [("sigma", "METHOD.KEY"), ("database.sigma=", "no value"), ("kwatra.patch=5", "not compared")]
        {
            let error = Sweep::parse(text, &methods).err().unwrap().to_string();
            assert!(error.contains(part), "{error}");
        }
    }

    #[test]
    fn names_are_plain_and_no_two_are_the_same() {
        assert_eq!(plain("lazyfluids nnf=plain"), "lazyfluids-nnf=plain");
        assert_eq!(plain("../a b"), "a-b");
        let mut names = BTreeSet::new();
        let made: Vec<String> = ["a", "a", "a-2", "a"].iter().map(|name| unused(name, &mut names)).collect();
        assert_eq!(made, ["a", "a-2", "a-2-2", "a-3"]);
        assert_eq!((quoted("a/b.toml"), quoted("it's")), ("a/b.toml".to_owned(), r"'it'\''s'".to_owned()));
    }

    #[test]
    fn methods_are_known_and_named_once() {
        assert_eq!(methods(&[]).unwrap().len(), REGISTRY.len());
        let error = methods(&["fluids".to_owned()]).unwrap_err().to_string();
        assert!(error.contains("no method \"fluids\"") && error.contains("lazyfluids"), "{error}");
        assert!(methods(&["advect".to_owned(), "advect".to_owned()]).is_err());
    }
}
