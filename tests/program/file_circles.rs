//! No circles between the renderer's files: what uses one another belongs into one file, or a third one. A file may use those that
//! its folder opens with (`super::`), which speak for the room.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::module_order::{code_only, module_path, sources};

type Module = Vec<String>;

/// What each file uses, apart from those above it.
type Uses = BTreeMap<Module, BTreeSet<Module>>;

/// All paths of a use declaration: `a::{b, c::{d, e}}` are three.
fn expanded(tree: &str) -> Vec<Vec<String>> {
    let names = |text: &str| -> Vec<String> {
        let plain = text.split(" as ").next().unwrap_or_default();
        plain.split("::").map(str::trim).filter(|name| !name.is_empty()).map(str::to_owned).collect()
    };
    let Some((before, group)) = tree.split_once('{') else { return vec![names(tree)] };
    let group = group.trim_end().strip_suffix('}').unwrap_or(group);
    let (mut parts, mut depth, mut start) = (Vec::new(), 0, 0);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' => depth -= 1,
            ',' if depth == 0 => {
                parts.push(&group[start..at]);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(&group[start..]);
    let inner = parts.into_iter().filter(|part| !part.trim().is_empty()).flat_map(expanded);
    inner.map(|path| [names(before), path].concat()).collect()
}

/// The paths that a file's code names: in use declarations, and elsewhere from the root, from above, or into a file of its folder.
fn paths(code: &str, children: &BTreeSet<&str>) -> Vec<Vec<String>> {
    let mut found = Vec::new();
    let mut rest = String::new();
    for statement in code.split_inclusive(';') {
        let declared = statement.trim_end_matches(';').rsplit_once("use ").filter(|(before, _)| {
            let before = before.trim_end();
            before.is_empty() || before.ends_with(['}', '{', ')', ']']) || before.ends_with("pub")
        });
        match declared {
            Some((_, tree)) => found.extend(expanded(&tree.split_whitespace().collect::<Vec<_>>().join(" "))),
            None => rest.push_str(statement),
        }
    }
    let word = |c: char| c.is_alphanumeric() || c == '_' || c == ':';
    for path in rest.split(|c| !word(c)).filter(|path| path.contains("::")) {
        let names: Vec<String> = path.split("::").map(str::to_owned).collect();
        if ["crate", "super", "self"].contains(&names[0].as_str()) || children.contains(names[0].as_str()) {
            found.push(names);
        }
    }
    found
}

/// The file that a path named in `module` leads to.
fn target(module: &[String], path: &[String], files: &BTreeSet<Module>) -> Option<Module> {
    let supers = path.iter().take_while(|name| *name == "super").count();
    let mut full = match path.first().map(String::as_str)? {
        "crate" => path[1..].to_vec(),
        "self" => [module, &path[1..]].concat(),
        "super" => [&module[..module.len().checked_sub(supers)?], &path[supers..]].concat(),
        _ => [module, path].concat(),
    };
    while !full.is_empty() && !files.contains(&full) {
        full.pop();
    }
    (!full.is_empty()).then_some(full)
}

/// What every file uses, given its code without tests.
fn uses(code: &BTreeMap<Module, String>) -> Uses {
    let files: BTreeSet<Module> = code.keys().cloned().collect();
    let of = |(module, code): (&Module, &String)| {
        let inside = |file: &&Module| file.len() == module.len() + 1 && file.starts_with(module);
        let children = files.iter().filter(inside).filter_map(|file| Some(file.last()?.as_str())).collect();
        let targets = paths(code, &children).into_iter().filter_map(|path| target(module, &path, &files));
        (module.clone(), targets.filter(|target| !module.starts_with(target)).collect())
    };
    code.iter().map(of).collect()
}

/// A circle, if there is one: files that cannot be put into an order in which each uses only earlier ones.
fn circle(uses: &Uses) -> Vec<String> {
    let mut left = uses.clone();
    loop {
        let waiting: BTreeSet<Module> = left.keys().cloned().collect();
        let before = left.len();
        left.retain(|_, targets| targets.iter().any(|target| waiting.contains(target)));
        if left.len() == before {
            break;
        }
    }
    left.keys().map(|module| module.join("/")).collect()
}

#[test]
fn files_use_one_another_in_one_direction() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    let code = files.iter().map(|file| {
        let source = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        let source = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
        (module_path(file.strip_prefix(&root).expect("listed below it")), code_only(source))
    });
    let code: BTreeMap<Module, String> = code.filter(|(module, _)| !module.is_empty()).collect();
    assert!(code.len() > 100, "the sources were not found");
    let uses = uses(&code);
    assert!(uses[&vec!["render".to_owned()]].contains(&vec!["render".to_owned(), "pass".to_owned()]));
    let left = circle(&uses);
    assert!(left.is_empty(), "in a circle, or before one: {}", left.join(", "));
}

#[test]
fn every_circle_is_found() {
    let found = |files: &[(&str, &str)]| {
        let code = files.iter().map(|(file, code)| (module_path(Path::new(file)), (*code).to_owned()));
        circle(&uses(&code.collect()))
    };
    let room = ("a/mod.rs", "mod b; mod c;");
    for (b, c) in [
        ("use super::c::C;", "use super::b::B;"),
        ("use super::c;", "fn f() { super::b::g() }"),
        ("use crate::a::{c::{C, D}, x};", "pub(super) use crate::a::b::B;"),
        ("fn f(c: super::c::C) {}", "use super::b::{self, B};"),
    ] {
        assert_eq!(found(&[room, ("a/b.rs", b), ("a/c.rs", c)]), ["a/b", "a/c"], "{b} {c}");
    }
    assert_eq!(found(&[("a.rs", "use crate::b::B;"), ("b.rs", "use crate::a::A;")]), ["a", "b"]);
    let front = ("a/mod.rs", "mod b; use b::B; pub struct A;");
    assert_eq!(found(&[front, ("a/b.rs", "use super::A;")]), [""; 0], "a room speaks for its files");
    assert_eq!(found(&[room, ("a/b.rs", "use super::c::C;"), ("a/c.rs", "struct C;")]), [""; 0]);
}
