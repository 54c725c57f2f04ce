//! The layer order of the crate: a module imports only from groups to its left, never within its group.

use std::collections::BTreeSet;
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
