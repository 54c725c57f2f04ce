//! The method of a scene that names none: nobody has to know methods.

use super::method::MethodEntry;
use super::methods::{EXEMPLAR_METHOD, FIRE_METHOD, LIBRARY_METHOD, PLAIN_METHOD, REGISTRY};
use crate::library::reader::Pack;
use crate::scene::file::SceneFile;

/// Tag of a library's clips of flames.
const FLAMES: &str = "fire";

/// A method and why it was chosen.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DefaultMethod {
    /// Its name in the registry.
    pub name: &'static str,
    /// The reason, which goes on after "…, since".
    pub reason: String,
}

impl DefaultMethod {
    /// Chooses for a scene that names no method.
    pub fn of(file: &SceneFile) -> Self {
        let usual = Self::by_sources(file);
        // Who sets options of one method wants that one.
        let mut set = REGISTRY.iter().filter(|method| file.options.get(method.name).is_some_and(|t| !t.is_empty()));
        match (set.next(), set.next()) {
            (Some(MethodEntry { name, .. }), None) if *name != usual.name => {
                Self { name, reason: format!("options of {name} are set") }
            }
            _ => usual,
        }
    }

    fn by_sources(file: &SceneFile) -> Self {
        let choice = |name, reason: &str| Self { name, reason: reason.to_owned() };
        if file.target.is_some() {
            return choice(EXEMPLAR_METHOD, "the motion is designed in a [target]");
        }
        match (file.library.is_empty(), file.exemplars.is_empty()) {
            (false, _) if of_flames(file) => {
                choice(FIRE_METHOD, "most of the library's clips are of fire, and flames change their shape")
            }
            (false, _) => {
                choice(LIBRARY_METHOD, "a library is named: the picture itself is carried, by the motion of its clips")
            }
            (true, false) => choice(EXEMPLAR_METHOD, "an exemplar is named and no library"),
            (true, true) => choice(PLAIN_METHOD, "no library is named: the picture itself goes along what is asked"),
        }
    }

    /// What the person is told.
    pub fn note(&self) -> String {
        format!("method {}, since {} (--method chooses another)", self.name, self.reason)
    }
}

/// Whether most clips that a scene uses are tagged fire; what cannot be opened counts nothing, and is refused later.
fn of_flames(file: &SceneFile) -> bool {
    let packs: Vec<_> = file.library.iter().filter_map(|path| Pack::open(path).ok()).collect();
    let used = |tag: &String| file.tags.is_empty() || file.tags.contains(tag);
    let clips = packs.iter().flat_map(|pack| pack.clips()).filter(|clip| used(&clip.tag));
    let (flames, all) = clips.fold((0, 0), |(flames, all), clip| (flames + usize::from(clip.tag == FLAMES), all + 1));
    2 * flames > all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::base::options::Value;
    use crate::scene::exemplar_file::ExemplarFile;

    #[test]
    fn a_scene_gets_a_method_that_its_sources_serve() {
        let mut file = SceneFile::default();
        let name = |file: &SceneFile| DefaultMethod::of(file).name;
        assert_eq!(name(&file), "advect");
        file.exemplars = vec![ExemplarFile::new("looks.png")];
        assert_eq!(name(&file), "lazyfluids");
        file.library = vec!["water.pack".into()];
        assert_eq!(name(&file), "hybrid");
        file.options.insert("database".into(), [("tau".to_owned(), Value::Number(0.5))].into());
        let chosen = DefaultMethod::of(&file);
        assert_eq!((chosen.name, chosen.reason.as_str()), ("database", "options of database are set"));
        file.options.insert("hybrid".into(), [("life".to_owned(), Value::Number(20.0))].into());
        assert_eq!(name(&file), "hybrid");
    }
}
