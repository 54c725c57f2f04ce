//! What a scene file says of exemplars: `exemplar` and `exemplar_alpha` of one, or a list `[[exemplars]]`.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::base::error::{Error, Kind, Result};
use crate::base::options::refuse_unknown;
use crate::base::text::counted;

/// Keys of an entry of `[[exemplars]]`.
pub const EXEMPLAR_KEYS: [&str; 4] = ["frames", "opacity", "flow", "parameters"];
/// How a list is written.
const LIST: &str = "for several exemplars write [[exemplars]], and below it frames = \"FILE\", once for each";
/// The word that stands for a file of opacity: what is bright is opaque.
pub const LUMINANCE: &str = "luminance";
/// The word that stands for a file of opacity: what is dark is opaque.
pub const DARKNESS: &str = "darkness";

/// A fluid whose looks are borrowed.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct ExemplarFile {
    /// Its frames: a picture, a clip, a folder of pictures or an `.npy` file.
    pub frames: PathBuf,
    /// Its opacity; none: the file's own, or opaque all over.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub opacity: Option<Opacity>,
    /// Its motion, pixels per frame: a folder with a file for every frame, or for every step between two.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub flow: Option<PathBuf>,
    /// What else is known of every pixel, in [0, 1]: a grey picture for all frames, a clip or a
    /// folder with one for each, or an `.npy` file of any number of components.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub parameters: Option<PathBuf>,
}

/// Where the opacity of an exemplar comes from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(from = "PathBuf", into = "PathBuf")]
pub enum Opacity {
    /// Footage on black: opaque where it is bright.
    Luminance,
    /// Footage on white: opaque where it is dark.
    Darkness,
    /// A grey picture for all frames, or a clip or a folder with one for each.
    File(PathBuf),
}

impl From<PathBuf> for Opacity {
    fn from(path: PathBuf) -> Self {
        match path.to_str() {
            Some(LUMINANCE) => Self::Luminance,
            Some(DARKNESS) => Self::Darkness,
            _ => Self::File(path),
        }
    }
}

impl From<Opacity> for PathBuf {
    fn from(opacity: Opacity) -> Self {
        opacity.path().to_owned()
    }
}

impl Opacity {
    /// What a scene file says: the word, or the file's path.
    pub fn path(&self) -> &Path {
        match self {
            Self::Luminance => Path::new(LUMINANCE),
            Self::Darkness => Path::new(DARKNESS),
            Self::File(path) => path,
        }
    }
}

impl ExemplarFile {
    /// A picture or a clip with its own opacity.
    pub fn new(frames: impl Into<PathBuf>) -> Self {
        Self { frames: frames.into(), ..Self::default() }
    }

    /// Every file and folder that is named, always in the same order.
    pub fn paths(&mut self) -> impl Iterator<Item = &mut PathBuf> {
        let Self { frames, opacity, flow, parameters } = self;
        let opacity = opacity.iter_mut().filter_map(|opacity| match opacity {
            Opacity::File(path) => Some(path),
            Opacity::Luminance | Opacity::Darkness => None,
        });
        [frames].into_iter().chain(opacity).chain(flow).chain(parameters)
    }
}

/// Exemplars as a command line names them, each with the opacity that is given for it or for all.
///
/// # Errors
/// Other numbers of opacities than one or one each.
pub fn with_opacities(mut exemplars: Vec<ExemplarFile>, opacities: Vec<PathBuf>) -> Result<Vec<ExemplarFile>> {
    let opacities: Vec<Opacity> = opacities.into_iter().map(Opacity::from).collect();
    if exemplars.is_empty() && !opacities.is_empty() {
        // What is wrong with it shows when the scene is checked.
        exemplars.push(ExemplarFile::default());
    }
    match &opacities[..] {
        [] => {}
        [one] => exemplars.iter_mut().for_each(|exemplar| exemplar.opacity = Some(one.clone())),
        each if each.len() == exemplars.len() => {
            exemplars.iter_mut().zip(each).for_each(|(exemplar, opacity)| exemplar.opacity = Some(opacity.clone()));
        }
        other => {
            let problem = format!("is given {} times for {}", other.len(), counted(exemplars.len() as u64, "exemplar"));
            return Err(Error::new(Kind::Usage, "--exemplar-alpha", problem)
                .allowed("one for each exemplar, in the same order, or one for all"));
        }
    }
    Ok(exemplars)
}

/// Refuses unknown keys, what is no text, and both ways of naming exemplars at once.
///
/// # Errors
/// The first of these, by name.
pub(super) fn check_keys(table: &toml::Table) -> Result<()> {
    let text = |name: &str, value: &toml::Value| match value {
        toml::Value::String(_) => Ok(()),
        toml::Value::Table(_) | toml::Value::Array(_) => {
            Err(Error::new(Kind::Usage, name, "is no text").allowed("the path of a file").remedy(LIST))
        }
        other => Err(Error::new(Kind::Usage, name, format!("{other} is not text")).allowed("the path of a file")),
    };
    let alone = ["exemplar", "exemplar_alpha"];
    alone.iter().filter_map(|key| Some((key, table.get(*key)?))).try_for_each(|(key, value)| text(key, value))?;
    let Some(list) = table.get("exemplars") else { return Ok(()) };
    if let Some(key) = alone.iter().find(|key| table.contains_key(**key)) {
        return Err(Error::new(Kind::Usage, *key, "is given beside [[exemplars]]")
            .allowed("one exemplar, or a list")
            .remedy("move it into the list, as frames and opacity"));
    }
    let entries = list.as_array().into_iter().flatten().map(toml::Value::as_table).collect::<Option<Vec<_>>>();
    let Some(entries) = entries.filter(|_| list.is_array()) else {
        return Err(Error::new(Kind::Usage, "exemplars", "is no list of tables")
            .allowed("[[exemplars]] and its keys below, once for each exemplar"));
    };
    for (entry, n) in entries.into_iter().zip(1..) {
        let owner = format!("exemplars {n}");
        refuse_unknown(&owner, entry.keys().map(String::as_str), &EXEMPLAR_KEYS)?;
        entry.iter().try_for_each(|(key, value)| text(&format!("{owner}.{key}"), value))?;
    }
    Ok(())
}

/// How exemplars lie among the keys of a scene file.
pub(super) mod keys {
    use std::path::PathBuf;

    use serde::{Deserialize, Deserializer, Serialize, Serializer};

    use super::{ExemplarFile, Opacity};

    #[derive(Default, Serialize, Deserialize)]
    #[serde(default)]
    struct Keys {
        #[serde(skip_serializing_if = "Option::is_none")]
        exemplar: Option<PathBuf>,
        #[serde(skip_serializing_if = "Option::is_none")]
        exemplar_alpha: Option<Opacity>,
        #[serde(skip_serializing_if = "Vec::is_empty")]
        exemplars: Vec<ExemplarFile>,
    }

    pub fn serialize<S: Serializer>(list: &[ExemplarFile], serializer: S) -> Result<S::Ok, S::Error> {
        let keys = match list {
            [ExemplarFile { frames, opacity, flow: None, parameters: None }] => {
                let exemplar = Some(frames.clone()).filter(|frames| !frames.as_os_str().is_empty());
                Keys { exemplar, exemplar_alpha: opacity.clone(), ..Keys::default() }
            }
            list => Keys { exemplars: list.to_vec(), ..Keys::default() },
        };
        keys.serialize(serializer)
    }

    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Vec<ExemplarFile>, D::Error> {
        let Keys { exemplar, exemplar_alpha: opacity, mut exemplars } = Keys::deserialize(deserializer)?;
        if exemplar.is_some() || opacity.is_some() {
            exemplars.insert(0, ExemplarFile { opacity, ..ExemplarFile::new(exemplar.unwrap_or_default()) });
        }
        Ok(exemplars)
    }
}
