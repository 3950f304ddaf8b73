//! Who may use whom: the layers of CONTRIBUTING.md, held by reading the paths that `rust/src` names.

use std::path::{Path, PathBuf};
use std::{fs, io};

/// What every module may use.
const COMMON: &[&str] = &["time", "error", "config", "event", "math", "simd"];

/// Each other module, and which modules or items it may use beside [`COMMON`] and itself.
const LAYERS: &[(&str, &[&str])] = &[
    // The law from disparity to depth stands with the camera model.
    ("kinect", &["geometry"]),
    ("stream", &["kinect"]),
    ("capture", &["kinect"]),
    ("geometry", &[]),
    ("detect", &["geometry"]),
    ("physics", &["geometry"]),
    ("track", &["geometry", "detect", "physics"]),
    ("scene", &["geometry", "physics", "track"]),
    ("seeing", &["kinect", "stream", "geometry", "detect", "physics", "track", "scene"]),
    ("reasoning", &["kinect", "stream", "geometry", "detect", "physics", "track", "scene"]),
    ("timeline", &[]),
    ("attention", &["geometry", "detect", "track", "seeing", "reasoning"]),
    ("engine", &["timeline", "attention", "kinect", "stream", "geometry", "detect", "physics", "track", "scene", "seeing", "reasoning"]),
    // What it hands on are images and measurements.
    (
        "source",
        &["kinect", "stream", "capture", "geometry", "config_file", "seeing::Image", "seeing::SeeError", "track::Measurement", "sim"],
    ),
    ("mesh_file", &["geometry"]),
    ("config_file", &["geometry", "mesh_file"]),
    ("run", &["kinect::disparity", "geometry", "physics::own", "engine", "reasoning::Predictor", "seeing", "source"]),
    // Never an estimator: it makes what estimators are judged by.
    ("sim", &["geometry", "kinect", "capture"]),
    (
        "python",
        &[
            "kinect",
            "stream",
            "geometry",
            "detect",
            "physics",
            "track",
            "scene",
            "seeing",
            "reasoning",
            "engine",
            "source",
            "sim",
            "run",
            "config_file",
        ],
    ),
];

/// What a module may use beside itself; `None` where it stands in no layer.
fn allowed(module: &str) -> Option<Vec<&'static str>> {
    if COMMON.contains(&module) {
        // `config` asks the camera whether a pose is rigid.
        return Some([COMMON, &["geometry"]].concat());
    }
    LAYERS.iter().find(|(name, _)| *name == module).map(|(_, below)| [COMMON, *below].concat())
}

/// The paths that code names: `crate::x::y` anywhere, and each of a group `crate::{x::y, z}`. Comments and the tests at a file's end don't count.
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
    let module = path.split(['/', '.']).next().unwrap_or_default();
    if module == "lib" {
        return Vec::new();
    }
    let Some(allowed) = allowed(module) else {
        return vec![format!("{path}: {module} stands in no layer")];
    };
    let inside = |used: &str, outer: &str| used.strip_prefix(outer).is_some_and(|rest| rest.is_empty() || rest.starts_with("::"));
    let is_module = |used: &str| COMMON.iter().chain(LAYERS.iter().map(|(module, _)| module)).any(|module| inside(used, module));
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
