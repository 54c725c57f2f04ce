//! The order of the crate: a module imports only from groups to its left, never within its group, and no two files import
//! each other.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use syn::visit::Visit;

/// Top-level modules, group by group; see ARCHITECTURE.md.
const LAYERS: [&[&str]; 12] = [
    &["base"],
    &["raster"],
    &["video", "flow", "descriptor"],
    &["measure"],
    &["patch", "simulate"],
    &["library"],
    &["scene"],
    &["assign"],
    &["render"],
    &["synth"],
    &["report"],
    &["cli"],
];

fn layer(module: &str) -> Option<usize> {
    LAYERS.iter().position(|group| group.contains(&module))
}

/// Collects the module after every `crate::` in paths and use trees, macros' tokens included.
#[derive(Default)]
struct CratePaths(BTreeSet<String>);

impl CratePaths {
    fn use_tree(&mut self, tree: &syn::UseTree) {
        match tree {
            syn::UseTree::Path(path) => {
                self.0.insert(path.ident.to_string());
            }
            syn::UseTree::Group(group) => group.items.iter().for_each(|item| self.use_tree(item)),
            syn::UseTree::Name(name) => {
                self.0.insert(name.ident.to_string());
            }
            syn::UseTree::Rename(name) => {
                self.0.insert(name.ident.to_string());
            }
            syn::UseTree::Glob(_) => {}
        }
    }

    fn tokens(&mut self, text: &str) {
        let flat: String = text.chars().filter(|c| !c.is_whitespace()).collect();
        for part in flat.split("crate::").skip(1) {
            self.0.insert(part.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect());
        }
    }
}

impl<'ast> Visit<'ast> for CratePaths {
    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        if let syn::UseTree::Path(path) = &item.tree
            && path.ident == "crate"
        {
            self.use_tree(&path.tree);
        }
    }

    fn visit_path(&mut self, path: &'ast syn::Path) {
        let mut segments = path.segments.iter();
        if segments.next().is_some_and(|s| s.ident == "crate")
            && let Some(module) = segments.next()
        {
            self.0.insert(module.ident.to_string());
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'ast syn::Macro) {
        self.tokens(&mac.tokens.to_string());
        syn::visit::visit_macro(self, mac);
    }
}

fn rust_files(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            rust_files(&path, out);
        } else if path.extension().is_some_and(|e| e == "rs") {
            out.push(path);
        }
    }
}

/// Wrong imports of one file's text, seen as part of top-level module `module`.
fn violations(module: &str, text: &str) -> Vec<String> {
    let own =
        layer(module).unwrap_or_else(|| panic!("module {module} has no layer: add it to LAYERS and ARCHITECTURE.md"));
    let mut paths = CratePaths::default();
    paths.visit_file(&syn::parse_file(text).unwrap());
    let wrong = |used: &&String| *used != module && layer(used).is_none_or(|l| l >= own);
    paths.0.iter().filter(wrong).map(|used| format!("{module} imports {used}")).collect()
}

#[test]
fn no_module_imports_upwards() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    rust_files(&root, &mut files);
    let mut wrong = Vec::new();
    for file in files {
        let inside = file.strip_prefix(&root).unwrap();
        let module = inside.components().next().unwrap().as_os_str().to_string_lossy().into_owned();
        if inside.components().count() == 1 {
            continue; // lib.rs and main.rs see everything
        }
        let found = violations(&module, &std::fs::read_to_string(&file).unwrap());
        wrong.extend(found.into_iter().map(|v| format!("{}: {v}", inside.display())));
    }
    assert!(wrong.is_empty(), "upward imports:\n{}", wrong.join("\n"));
}

#[test]
fn the_check_sees_upward_and_sideways_imports() {
    assert_eq!(violations("flow", "use crate::video::clip::Source;"), ["flow imports video"]);
    assert_eq!(violations("raster", "fn f() { crate::library::open(); }"), ["raster imports library"]);
    assert_eq!(violations("base", "fn f() { println!(\"{}\", crate::cli::x()); }"), ["base imports cli"]);
    assert_eq!(violations("scene", "use crate::{base::error, raster::image};"), Vec::<String>::new());
}

/// Files that may import although a circle comes of it: who, whom, and why.
const ALLOWED: [(&str, &str, &str); 0] = [];

/// Path of a module, or to an item in one.
type Names = Vec<String>;

/// What one file says of modules, tests left out.
#[derive(Default)]
struct Imports {
    /// What it names, by paths of two names or more, and what it uses.
    paths: Vec<Names>,
    /// What it hands on: the name, and what stands behind it.
    reexports: Vec<(String, Names)>,
    /// Modules of its own in files.
    children: BTreeSet<String>,
    /// Modules within the file that are being looked at.
    inner: usize,
}

impl Imports {
    fn of(text: &str) -> Self {
        let mut imports = Self::default();
        imports.visit_file(&syn::parse_file(text).unwrap());
        imports
    }

    /// Takes a path, as the file itself would write it.
    fn add(&mut self, mut path: Names) {
        let supers = path.iter().take_while(|name| *name == "super").count();
        // Within a module of the file, as many lead no farther than the file.
        path.drain(..supers.min(self.inner));
        if supers >= self.inner || supers == 0 {
            self.paths.push(path);
        }
    }

    fn use_tree(&mut self, before: &Names, tree: &syn::UseTree, public: bool) {
        let with = |name: &syn::Ident| before.iter().cloned().chain([name.to_string()]).collect::<Names>();
        let mut leaf = |path: Names, name: String| {
            let path = if path.last().is_some_and(|last| last == "self") { before.clone() } else { path };
            if public { self.reexports.push((name, path)) } else { self.add(path) }
        };
        match tree {
            syn::UseTree::Path(path) => self.use_tree(&with(&path.ident), &path.tree, public),
            syn::UseTree::Group(group) => group.items.iter().for_each(|item| self.use_tree(before, item, public)),
            syn::UseTree::Name(name) => leaf(with(&name.ident), name.ident.to_string()),
            syn::UseTree::Rename(name) => leaf(with(&name.ident), name.rename.to_string()),
            syn::UseTree::Glob(_) => self.add(before.clone()),
        }
    }
}

fn is_test(attributes: &[syn::Attribute]) -> bool {
    attributes.iter().any(|a| {
        a.path().is_ident("cfg") && a.meta.require_list().is_ok_and(|list| list.tokens.to_string().contains("test"))
    })
}

impl<'ast> Visit<'ast> for Imports {
    fn visit_item_mod(&mut self, item: &'ast syn::ItemMod) {
        match &item.content {
            _ if is_test(&item.attrs) => {}
            None => drop(self.children.insert(item.ident.to_string())),
            Some(_) => {
                self.inner += 1;
                syn::visit::visit_item_mod(self, item);
                self.inner -= 1;
            }
        }
    }

    fn visit_item_use(&mut self, item: &'ast syn::ItemUse) {
        let public = !matches!(item.vis, syn::Visibility::Inherited);
        self.use_tree(&Vec::new(), &item.tree, public);
    }

    fn visit_visibility(&mut self, _: &'ast syn::Visibility) {}

    fn visit_path(&mut self, path: &'ast syn::Path) {
        if path.segments.len() > 1 {
            self.add(path.segments.iter().map(|segment| segment.ident.to_string()).collect());
        }
        syn::visit::visit_path(self, path);
    }

    fn visit_macro(&mut self, mac: &'ast syn::Macro) {
        let flat: String = mac.tokens.to_string().replace(" :: ", "::");
        let word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
        let paths = flat.split(|c| !word(c)).filter(|part| part.contains("::"));
        paths.for_each(|part| self.add(part.split("::").map(str::to_owned).collect()));
        syn::visit::visit_macro(self, mac);
    }
}

/// All files, by the path of their module.
struct Files(BTreeMap<Names, Imports>);

impl Files {
    /// A path from the root, where it leads into the crate.
    fn absolute(&self, module: &Names, path: &Names) -> Option<Names> {
        let first = path.first()?.as_str();
        let supers = path.iter().take_while(|name| *name == "super").count();
        let (base, rest) = match first {
            "crate" => (0, 1),
            "self" => (module.len(), 1),
            "super" => (module.len().checked_sub(supers)?, supers),
            child if self.0[module].children.contains(child) => (module.len(), 0),
            _ => return None,
        };
        Some(module[..base].iter().chain(&path[rest..]).cloned().collect())
    }

    /// The file that what a path names stands in; what is handed on stands where it comes from.
    fn file_of(&self, path: &Names) -> Option<&Names> {
        let (module, imports) = (1..=path.len()).rev().find_map(|n| self.0.get_key_value(&path[..n]))?;
        let name = path.get(module.len());
        let behind = imports.reexports.iter().find(|(handed, _)| Some(handed) == name);
        match behind.and_then(|(_, path)| self.absolute(module, path)) {
            Some(mut behind) => {
                behind.extend(path[module.len() + 1..].iter().cloned());
                self.file_of(&behind)
            }
            None => Some(module),
        }
    }

    /// Which files each file imports.
    fn imports(&self) -> BTreeMap<&Names, BTreeSet<&Names>> {
        let of = |(module, imports): (&Names, &Imports)| {
            let absolute = imports.paths.iter().filter_map(|path| self.absolute(module, path));
            let files = absolute.filter_map(|path| self.file_of(&path).map(|file| self.0.get_key_value(file)));
            files.flatten().map(|(file, _)| file.clone()).filter(|file| file != module).collect::<BTreeSet<Names>>()
        };
        let known = |names: BTreeSet<Names>| {
            names.iter().filter_map(|name| self.0.get_key_value(name)).map(|(name, _)| name).collect()
        };
        self.0.iter().map(|(module, imports)| (module, known(of((module, imports))))).collect()
    }

    /// Imports that belong to a circle, apart from those that `allowed` lists.
    fn circles(&self, allowed: &[(&str, &str)]) -> Vec<String> {
        let mut imports = self.imports();
        for (file, imported) in &mut imports {
            imported.retain(|other| !allowed.contains(&(&*file.join("::"), &*other.join("::"))));
        }
        let reached: BTreeMap<&Names, BTreeSet<&Names>> =
            imports.keys().map(|file| (*file, reached(&imports, file))).collect();
        let pairs = imports.iter().flat_map(|(file, others)| others.iter().map(move |other| (*file, *other)));
        let circular = pairs.filter(|(file, other)| reached[other].contains(file));
        circular.map(|(file, other)| format!("{} imports {}", file.join("::"), other.join("::"))).collect()
    }
}

/// All files that a file comes to by imports.
fn reached<'a>(imports: &BTreeMap<&'a Names, BTreeSet<&'a Names>>, from: &'a Names) -> BTreeSet<&'a Names> {
    let (mut seen, mut rest) = (BTreeSet::new(), vec![from]);
    while let Some(file) = rest.pop() {
        rest.extend(imports[file].iter().copied().filter(|other| seen.insert(*other)));
    }
    seen
}

#[test]
fn no_files_import_each_other() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut paths = Vec::new();
    rust_files(&root, &mut paths);
    let module = |path: &Path| {
        let inside = path.strip_prefix(&root).unwrap().with_extension("");
        let mut names: Names = inside.iter().map(|name| name.to_string_lossy().into_owned()).collect();
        if names.last().is_some_and(|last| last == "mod") {
            names.pop();
        }
        names
    };
    // The roots of the library and of a program see everything, and nobody imports from them.
    let files = paths.iter().filter(|path| !["lib.rs", "main.rs"].iter().any(|end| path.ends_with(end)));
    let read = |path: &PathBuf| (module(path), Imports::of(&std::fs::read_to_string(path).unwrap()));
    let files = Files(files.map(read).collect());
    let allowed: Vec<(&str, &str)> = ALLOWED.iter().map(|(who, whom, _)| (*who, *whom)).collect();
    let circles = files.circles(&allowed);
    assert!(circles.is_empty(), "files that import each other, move what they share into a third:\n{circles:#?}");
    for (who, whom, _) in ALLOWED {
        assert!(
            files.circles(&[]).contains(&format!("{who} imports {whom}")),
            "{who} imports {whom}: no circle any more"
        );
    }
}

#[test]
fn the_check_sees_circles_between_files() {
    let circles = |files: &[(&str, &str)], allowed: &[(&str, &str)]| {
        let module = |name: &str| name.split("::").map(str::to_owned).collect();
        Files(files.iter().map(|(name, text)| (module(name), Imports::of(text))).collect()).circles(allowed)
    };
    let both = ["a::x imports a::y", "a::y imports a::x"];
    let pair = [("a", "mod x; mod y;"), ("a::x", "use super::y::Y;"), ("a::y", "fn f() { crate::a::x::f(); }")];
    assert_eq!(circles(&pair, &[]), both);
    assert!(circles(&pair, &[("a::y", "a::x")]).is_empty());
    // A file and its child; groups, renames and macros; what tests import does not count.
    let child = [("a", "mod x; fn f() { x::f(); }"), ("a::x", "use super::f;")];
    assert_eq!(circles(&child, &[]), ["a imports a::x", "a::x imports a"]);
    let hidden = [("a", "mod x; mod y;"), ("a::x", "use super::{y as z};"), ("a::y", "fn f() { vec![super::x::F]; }")];
    assert_eq!(circles(&hidden, &[]), both);
    let tests =
        [("a", "mod x; mod y;"), ("a::x", "use super::y::Y;"), ("a::y", "#[cfg(test)] mod t { use crate::a::x; }")];
    assert!(circles(&tests, &[]).is_empty());
    // What is handed on stands where it comes from, and a folder that only hands on imports nothing.
    let handed = [("a", "mod x; mod y; pub use x::X;"), ("a::x", "struct X;"), ("a::y", "use super::X;")];
    assert!(circles(&handed, &[]).is_empty());
    let through = [("a", "mod x; mod y; pub use x::X;"), ("a::x", "use super::y::Y;"), ("a::y", "use super::X;")];
    assert_eq!(circles(&through, &[]), both);
    let three = [("x", "use crate::y::Y;"), ("y", "use crate::z::Z;"), ("z", "use crate::x::X;")];
    assert_eq!(circles(&three, &[]).len(), 3);
    let within = [("x", "mod i { use super::F; use super::super::y::Y; }"), ("y", "use crate::x::F;")];
    assert_eq!(circles(&within, &[]), ["x imports y", "y imports x"]);
}
