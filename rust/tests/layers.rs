//! Who may use whom: the layers of CONTRIBUTING.md, held by reading the paths that `rust/src` names.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// The modules of a row, and which modules or items they may use beside the first row's and themselves.
type Row = (Vec<String>, Vec<String>);

/// The table's rows that are of `rust/src`, from top to bottom.
fn layers() -> Vec<Row> {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("CONTRIBUTING.md");
    let text = fs::read_to_string(path).expect("CONTRIBUTING.md is there");
    let mut rows: Vec<Row> = Vec::new();
    for line in text.lines() {
        let Some((folder, rest)) = line.strip_prefix("| `rust/src/").and_then(|row| row.split_once('`')) else { continue };
        let names = folder.trim_end_matches('/').trim_end_matches(".rs").trim_matches(['{', '}']);
        let below = rest.trim_end_matches('|').rsplit_once('|').map_or("", |(_, below)| below.trim());
        let below = match below {
            "all above" => rows.iter().flat_map(|(modules, _)| modules.clone()).collect(),
            below => below.split(',').map(|name| name.trim().into()).collect(),
        };
        rows.push((names.split(',').map(Into::into).collect(), below));
    }
    rows
}

/// What a module may use beside itself; `None` where it stands in no layer.
fn allowed(rows: &[Row], module: &str) -> Option<Vec<String>> {
    let (_, below) = rows.iter().find(|(modules, _)| modules.iter().any(|name| name == module))?;
    Some(rows.iter().take(1).flat_map(|(common, _)| common).chain(below).cloned().collect())
}

/// The paths that code names: `crate::x::y` anywhere, and each of a group `crate::{x::y, z}`. Comments and tests, at a file's end or in one of their own, don't count.
fn used_paths(text: &str) -> Vec<String> {
    let code = text.split("#[cfg(test)]\nmod tests").next().unwrap_or(text);
    let code: Vec<_> = code.lines().filter(|line| !line.trim_start().starts_with("//")).collect();
    code.join("\n").split("crate::").skip(1).flat_map(|path| path.strip_prefix('{').map_or_else(|| vec![plain(path)], group)).collect()
}

/// The path that `text` begins with, up to a group or whatever else follows it.
fn plain(text: &str) -> String {
    let path: String = text.trim_start().chars().take_while(|c| c.is_alphanumeric() || "_:".contains(*c)).collect();
    path.trim_end_matches(':').into()
}

/// The paths of a group's items, up to its closing brace.
fn group(text: &str) -> Vec<String> {
    let (mut depth, mut paths, mut item) = (0, Vec::new(), String::new());
    for c in text.chars() {
        depth += i32::from(c == '{') - i32::from(c == '}');
        match c {
            ',' if depth == 0 => paths.push(plain(&std::mem::take(&mut item))),
            '}' if depth < 0 => break,
            _ => item.push(c),
        }
    }
    paths.push(plain(&item));
    paths
}

/// Uses in the file `path` (relative to `rust/src`) that its layer may not.
fn violations(path: &str, text: &str) -> Vec<String> {
    let rows = layers();
    let module = path.split(['/', '.']).next().unwrap_or_default();
    if module == "lib" || path.ends_with("/tests.rs") {
        return Vec::new();
    }
    let Some(allowed) = allowed(&rows, module) else {
        return vec![format!("{path}: {module} stands in no layer")];
    };
    let inside = |used: &str, outer: &str| used.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"));
    let is_module = |used: &str| rows.iter().flat_map(|(modules, _)| modules).any(|module| inside(used, module));
    used_paths(text)
        .into_iter()
        .filter(|used| is_module(used) && !inside(used, module) && !allowed.iter().any(|outer| inside(used, outer)))
        .map(|used| format!("{path}: {module} may not use {used}"))
        .collect()
}

fn sources(folder: &Path, found: &mut Vec<PathBuf>) -> io::Result<()> {
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        if path.is_dir() {
            sources(&path, found)?;
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            found.push(path);
        }
    }
    Ok(())
}

#[test]
fn modules_use_only_the_layers_below_them() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/src");
    let mut files = Vec::new();
    sources(&root, &mut files).expect("the sources are there");
    assert!(files.len() > 5);
    let wrong: Vec<_> = files
        .iter()
        .flat_map(|file| {
            let path = file.strip_prefix(&root).expect("below the root").to_string_lossy();
            violations(&path, &fs::read_to_string(file).expect("readable"))
        })
        .collect();
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

/// Every module has its row, those of the core stand above the others, and each name in the last column is one.
#[test]
fn the_table_is_read_whole() {
    let rows = layers();
    let names: Vec<_> = rows.iter().flat_map(|(modules, _)| modules.iter().map(String::as_str)).collect();
    let (text, mut core) = (fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("rust/src/lib.rs")).expect("readable"), 0);
    let mut before = "";
    for line in text.lines() {
        if let Some(module) = line.trim_start_matches("pub ").strip_prefix("mod ") {
            let module = module.trim_end_matches(';');
            let place = names.iter().position(|name| *name == module).unwrap_or_else(|| panic!("{module} stands in no layer"));
            let engine = names.iter().position(|name| *name == "engine").expect("there is an engine");
            assert_eq!(before.starts_with("#[cfg(feature"), place > engine, "{module} is of the core, or needs a feature");
            core += usize::from(place <= engine);
        }
        before = line;
    }
    assert!(core > 10);
    for name in rows.iter().flat_map(|(_, below)| below).filter(|name| !name.is_empty() && *name != "each other") {
        assert!(names.contains(&name.split(':').next().unwrap_or_default()), "{name} is no module");
    }
}

#[test]
fn a_forbidden_use_is_seen_in_every_spelling() {
    for line in [
        "use crate::scene::X;",
        "use crate::{math::Vec3, scene};",
        "let a = crate::scene::f();",
        "use crate::{\n    math::{a, b},\n    scene::{c},\n};",
    ] {
        let found = violations("detect/sphere.rs", line);
        assert!(found.len() == 1 && found[0].starts_with("detect/sphere.rs: detect may not use scene"), "{line}: {found:?}");
    }
    assert_eq!(violations("source/npz.rs", "use crate::seeing::Seeing;").len(), 1);
    assert_eq!(violations("sim/body.rs", "use crate::physics::laws;").len(), 1);
    assert_eq!(violations("magic.rs", "").len(), 1, "a module without a layer");
}

#[test]
fn a_permitted_use_passes() {
    let code =
        "use crate::{geometry::camera::Camera, math};\n// crate::scene\nuse crate::detect::x;\n#[cfg(test)]\nmod tests { use crate::sim; }";
    assert_eq!(violations("source/npz.rs", "use crate::seeing::Image;"), Vec::<String>::new());
    assert_eq!(violations("detect/sphere.rs", code), Vec::<String>::new());
}
