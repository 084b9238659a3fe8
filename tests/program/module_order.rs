//! Arrows between the renderer's modules run one way. Reads every path into the crate and holds it against the design's order.

use std::path::{Path, PathBuf};

/// Modules of one rank are peers: they may not use one another. A module may use those of lower rank.
const ORDER: &[&[&str]] = &[
    &["base"],
    &["math"],
    &["picture"],
    &["sampling"],
    &["geometry"],
    &["materials", "lights", "camera"],
    &["scene"],
    &["film"],
    &["guiding"],
    &["network"],
    &["reconstruct"],
    &["integrators"],
    &["render"],
    &["generate"],
    &["report"],
    &["cli"],
    &["main"],
];

/// A path into the crate: 1-based line and the top-level module that it names.
#[derive(Debug, PartialEq, Eq)]
struct Arrow {
    line: usize,
    target: String,
}

/// Source text with comments, strings and character literals blanked out; lines stay where they are.
pub fn code_only(source: &str) -> String {
    let mut out = String::with_capacity(source.len());
    let mut rest = source;
    while let Some(c) = rest.chars().next() {
        let skipped = match c {
            '/' if rest.starts_with("//") => rest.find('\n').unwrap_or(rest.len()),
            '/' if rest.starts_with("/*") => block_comment(rest),
            '"' => string(rest),
            'r' if !out.ends_with(|c: char| c.is_alphanumeric() || c == '_') => raw_string(rest),
            '\'' => character(rest),
            _ => 0,
        };
        let taken = skipped.max(c.len_utf8());
        if skipped == 0 {
            out.push(c);
        } else {
            out.extend(rest[..taken].chars().map(|c| if c == '\n' { '\n' } else { ' ' }));
        }
        rest = &rest[taken..];
    }
    out
}

fn block_comment(text: &str) -> usize {
    let mut depth = 0;
    for (at, _) in text.char_indices() {
        if text[at..].starts_with("/*") {
            depth += 1;
        } else if text[at..].starts_with("*/") {
            depth -= 1;
            if depth == 0 {
                return at + 2;
            }
        }
    }
    text.len()
}

fn string(text: &str) -> usize {
    let mut escaped = false;
    for (at, c) in text.char_indices().skip(1) {
        match c {
            '"' if !escaped => return at + 1,
            '\\' => escaped = !escaped,
            _ => escaped = false,
        }
    }
    text.len()
}

fn raw_string(text: &str) -> usize {
    let hashes = text[1..].chars().take_while(|&c| c == '#').count();
    if !text[1 + hashes..].starts_with('"') {
        return 0;
    }
    let end = format!("\"{}", "#".repeat(hashes));
    text[2 + hashes..].find(&end).map_or(text.len(), |at| 2 + hashes + at + end.len())
}

/// A character literal; 0 for a lifetime.
fn character(text: &str) -> usize {
    let mut chars = text.char_indices().skip(1);
    match chars.next() {
        Some((_, '\\')) => text[3..].find('\'').map_or(0, |at| at + 4),
        Some(_) => chars.next().filter(|(_, c)| *c == '\'').map_or(0, |(at, _)| at + 1),
        None => 0,
    }
}

/// All paths that begin at the crate's root, in `file_depth` modules below it (0 for lib.rs).
fn arrows(source: &str, file_depth: usize) -> Vec<Arrow> {
    let code = code_only(source);
    let mut found = Vec::new();
    for (root, depth) in roots(file_depth) {
        for (at, _) in code.match_indices(&root) {
            let before = code[..at].chars().next_back();
            // `super::super::` holds `super::`: only a whole path counts, and only one that climbs right to the root.
            if before.is_some_and(|c| c.is_alphanumeric() || c == '_' || c == ':') {
                continue;
            }
            let nested = if depth.is_some() { inline_depth(&code[..at]) } else { 0 };
            if depth.is_some_and(|supers| supers != file_depth + nested) {
                continue;
            }
            let line = 1 + code[..at].matches('\n').count();
            for target in first_names(&code[at + root.len()..]) {
                found.push(Arrow { line, target });
            }
        }
    }
    found
}

/// `crate::`, `fanal::`, and chains of `super::` that may reach the root, from inline modules too.
fn roots(file_depth: usize) -> Vec<(String, Option<usize>)> {
    let climbs = (file_depth.max(1)..=file_depth + 3).map(|n| ("super::".repeat(n), Some(n)));
    [("crate::".to_owned(), None), ("fanal::".to_owned(), None)].into_iter().chain(climbs).collect()
}

/// Inline modules that are open at the end of `code`.
fn inline_depth(code: &str) -> usize {
    let (mut depth, mut open, mut word_before, mut pending) = (0usize, Vec::new(), "", false);
    let words = code.split_inclusive(|c: char| !(c.is_alphanumeric() || c == '_'));
    for piece in words {
        let word = piece.trim_end_matches(|c: char| !(c.is_alphanumeric() || c == '_'));
        if word_before == "mod" && !word.is_empty() {
            pending = true;
        }
        if !word.is_empty() {
            word_before = word;
        }
        match piece.chars().next_back() {
            Some('{') => {
                depth += 1;
                if std::mem::take(&mut pending) {
                    open.push(depth);
                }
            }
            Some('}') => {
                if open.last() == Some(&depth) {
                    open.pop();
                }
                depth = depth.saturating_sub(1);
            }
            Some(';') => pending = false,
            _ => {}
        }
    }
    open.len()
}

/// The first name after a root, or all first names of a group.
fn first_names(text: &str) -> Vec<String> {
    let text = text.trim_start();
    let Some(group) = text.strip_prefix('{') else { return vec![name(text)] };
    let (mut names, mut depth, mut expected) = (Vec::new(), 0, true);
    for (at, c) in group.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth == 0 => break,
            '}' => depth -= 1,
            ',' if depth == 0 => expected = true,
            c if expected && !c.is_whitespace() => {
                names.push(name(&group[at..]));
                expected = false;
            }
            _ => {}
        }
    }
    names
}

fn name(text: &str) -> String {
    text.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect()
}

fn rank(module: &str) -> Option<usize> {
    ORDER.iter().position(|peers| peers.contains(&module))
}

pub fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap_or_else(|e| panic!("{}: {e}", folder.display()));
    for entry in entries {
        let path = entry.expect("a folder that opened can be listed").path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Module path of a file below `src`: `film/filter.rs` is [film, filter], `film/mod.rs` is [film].
pub fn module_path(file: &Path) -> Vec<String> {
    let mut parts: Vec<String> = file.with_extension("").iter().map(|p| p.to_string_lossy().into_owned()).collect();
    if parts.last().is_some_and(|p| p == "mod" || p == "lib") {
        parts.pop();
    }
    parts
}

/// What breaks the order in one file, as `file:line: …`.
fn faults(file: &Path, source: &str) -> Vec<String> {
    let path = module_path(file);
    let Some(module) = path.first() else { return Vec::new() };
    let Some(own) = rank(module) else {
        return vec![format!("{}:1: `{module}` has no place in the order", file.display())];
    };
    let depth = if module == "main" { 0 } else { path.len() };
    let bad = |arrow: &Arrow| arrow.target != *module && rank(&arrow.target).is_none_or(|target| target >= own);
    arrows(source, depth)
        .into_iter()
        .filter(bad)
        .map(|a| format!("src/{}:{}: `{module}` must not use `{}`", file.display(), a.line, a.target))
        .collect()
}

#[test]
fn arrows_run_one_way() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    sources(&root, &mut files);
    assert!(files.len() > 20, "the sources were not found");
    files.sort();
    let mut all = Vec::new();
    for file in &files {
        let source = std::fs::read_to_string(file).unwrap_or_else(|e| panic!("{}: {e}", file.display()));
        all.extend(faults(file.strip_prefix(&root).expect("listed below it"), &source));
    }
    assert!(all.is_empty(), "{}", all.join("\n"));
}

#[test]
fn every_way_of_writing_an_arrow_is_seen() {
    let seen = |file: &str, source: &str| !faults(Path::new(file), source).is_empty();
    for bad in [
        "use crate::cli::args;",
        "use crate::{base::Error, cli};",
        "use crate::{\n    base::{Error, files::{a, b}},\n    render::Pass,\n};",
        "pub use crate :: cli;".replace(" :: ", "::").as_str(),
        "fn f() { crate::render::go() }",
        "use super::super::render;",
        "mod tests { use super::super::super::render; }",
        "use fanal::render;",
        "use crate::lantern;",
        "let c = '\"'; use crate::cli; let d = '\"';",
    ] {
        assert!(seen("film/filter.rs", bad), "{bad}");
    }
    assert!(seen("film/mod.rs", "use super::render;"));
    assert!(seen("lights/mod.rs", "use crate::materials::x;"), "peers may not use one another");
    for good in [
        "use crate::base::Error;",
        "use crate::{base, film::error, materials::{bump, render}};",
        "// use crate::cli;\n/* crate::cli */ let s = \"crate::cli::x\"; let r = r#\"crate::cli\"#;",
        "use super::render;",
        "mod tests { use super::super::render; }",
        "fn f<'a>(x: &'a str) { let c = 'x'; crate::base::go(x) }",
    ] {
        assert!(!seen("film/filter.rs", good), "{good}");
    }
}
