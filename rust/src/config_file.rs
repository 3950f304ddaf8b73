//! Configuration and camera files: TOML to structs, and errors that name file, line and key.

use crate::config::{CameraConfig, Config, EnvironmentConfig, Kind};
use crate::error::ConfigError;
use crate::mesh_file::{self, MeshFileError};
use serde::de::DeserializeOwned;
use std::collections::BTreeMap;
use std::format;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::sync::Arc;
use toml::de::DeTable;
use toml::{Spanned, Table};

/// What is wrong with a configuration, and where.
#[derive(Debug, thiserror::Error)]
pub enum ConfigFileError {
    /// It can't be read.
    #[error("{}: {error}; give the path of a TOML file, `physinc run --dump-config` prints one to start from", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        error: std::io::Error,
    },
    /// It is no TOML, or has keys or types that physinc doesn't know.
    #[error("{place}: {message}")]
    Malformed {
        /// File and line.
        place: String,
        /// The line, and what is wrong with it.
        message: String,
    },
    /// A value can't be.
    #[error("{place}: {error}")]
    Impossible {
        /// File and line.
        place: String,
        /// Key, value and what is expected.
        error: ConfigError,
    },
    /// A known mesh can't be had.
    #[error("{place}: environment.mesh.path: {error}")]
    Mesh {
        /// File and line, or whatever else gave the configuration.
        place: String,
        /// What is wrong with the mesh's own file.
        error: MeshFileError,
    },
}

/// A configuration file.
///
/// # Errors
/// What is wrong with it, in one line.
pub fn read_config(path: &Path) -> Result<Config, ConfigFileError> {
    let text = read(path)?;
    let mut config: Config = parse(path, &text)?;
    number(&mut config.environment, in_order(&text).values().map(String::as_str));
    let folder = path.parent().unwrap_or(Path::new(""));
    read_meshes(&mut config, folder, |named| {
        let line = || text.lines().position(|line| line.contains("path") && line.contains(named));
        place(path, if named.is_empty() { lacking(&text, "environment.mesh.path") } else { line() })
    })?;
    config.validate().map_err(|error| impossible(path, &text, error))?;
    Ok(config)
}

/// Lets the ids of known surfaces follow `kinds`, which says by name of which kind each is.
pub fn number<'a>(environment: &mut EnvironmentConfig, kinds: impl Iterator<Item = &'a str>) {
    let kind = |name: &str| Kind::ALL.into_iter().find(|kind| kind.name() == name);
    environment.order = kinds.filter_map(kind).take(environment.order.capacity()).collect();
}

/// Where in `text` each known surface stands, and of which kind it is.
fn in_order(text: &str) -> BTreeMap<usize, String> {
    let table = DeTable::parse(text).map(Spanned::into_inner).unwrap_or_default();
    let environment = table.get("environment").and_then(|environment| environment.get_ref().as_table());
    let entries = environment.into_iter().flatten().flat_map(|(kind, entries)| {
        let entries = entries.get_ref().as_array().into_iter().flat_map(|entries| entries.iter());
        entries.map(|entry| (entry.span().start, kind.get_ref().to_string()))
    });
    entries.collect()
}

/// Reads the meshes that `config` names, relative to `folder`; `place` says where one is named. Their paths are whole from then on, where
/// there is room for that, so that the configuration means the same wherever it is written.
///
/// # Errors
/// What is wrong with one of them, in one line.
pub fn read_meshes(config: &mut Config, folder: &Path, place: impl Fn(&str) -> String) -> Result<(), ConfigFileError> {
    for mesh in &mut config.environment.mesh {
        if mesh.path.is_empty() {
            let error = ConfigError { key: "environment.mesh.path", value: f64::NAN, expected: "the path of an OBJ, STL or PLY file" };
            return Err(ConfigFileError::Impossible { place: place(""), error });
        }
        let path = folder.join(mesh.path.as_str());
        let solid = mesh_file::read(&path).map_err(|error| ConfigFileError::Mesh { place: place(&mesh.path), error })?;
        mesh.solid = Some(Arc::new(solid));
        if let Some(whole) = std::path::absolute(path).ok().and_then(|path| path.to_str().and_then(|path| path.parse().ok())) {
            mesh.path = whole;
        }
    }
    Ok(())
}

/// A `camera.toml`.
///
/// # Errors
/// What is wrong with it, in one line.
pub fn read_camera(path: &Path) -> Result<CameraConfig, ConfigFileError> {
    let text = read(path)?;
    let camera: CameraConfig = parse(path, &text)?;
    camera.validate().map_err(|error| impossible(path, &text, error))?;
    Ok(camera)
}

/// The TOML of a configuration; what is left out is at its default. Known surfaces stand in the order of their ids.
///
/// # Errors
/// Never, in practice: every configuration can be written.
pub fn to_toml(config: &Config) -> Result<String, toml::ser::Error> {
    let mut whole = Table::try_from(config)?;
    let mut surfaces = String::new();
    if let Some(environment) = whole.get_mut("environment").and_then(toml::Value::as_table_mut) {
        // An empty list would have to be deleted before a surface could be appended to the file.
        let mut known = core::mem::take(environment);
        for name in config.environment.kinds().map(Kind::name) {
            let Some(toml::Value::Array(entries)) = known.get_mut(name).filter(|entries| entries.get(0).is_some()) else { continue };
            let entry = BTreeMap::from([(name, [entries.remove(0)])]);
            surfaces += &toml::to_string(&BTreeMap::from([("environment", entry)]))?;
        }
    }
    whole.retain(|_, section| section.as_table().is_none_or(|keys| !keys.is_empty()));
    Ok(toml::to_string(&whole)? + &surfaces)
}

fn read(path: &Path) -> Result<String, ConfigFileError> {
    std::fs::read_to_string(path).map_err(|error| ConfigFileError::Unreadable { path: path.into(), error })
}

fn parse<T: DeserializeOwned>(path: &Path, text: &str) -> Result<T, ConfigFileError> {
    toml::from_str(text).map_err(|error| {
        let line = error.span().map(|span| text[..span.start].matches('\n').count());
        let quoted = line.and_then(|line| text.lines().nth(line)).map_or(String::new(), |line| format!("`{}`: ", line.trim()));
        let message = error.message().trim_end().replace('\n', ", ");
        ConfigFileError::Malformed { place: place(path, line), message: quoted + &message }
    })
}

fn impossible(path: &Path, text: &str, error: ConfigError) -> ConfigFileError {
    let left_out = || lacking(text, error.key).filter(|_| NEEDED.contains(&error.key) && error.value.is_nan());
    ConfigFileError::Impossible { place: place(path, left_out().or_else(|| line_of(text, error.key))), error }
}

/// Keys that stand in each section of theirs.
const NEEDED: [&str; 4] = ["environment.box.center", "environment.box.size", "environment.sphere.center", "environment.sphere.radius"];

fn place(path: &Path, line: Option<usize>) -> String {
    match line {
        Some(line) => format!("{}:{}", path.display(), line + 1),
        None => path.display().to_string(),
    }
}

/// The line of `text` (from 0) that sets `key` (`section.name`), as far as it can be told from its shape.
fn line_of(text: &str, key: &str) -> Option<usize> {
    let (section, name) = key.rsplit_once('.')?;
    let mut here = "";
    text.lines().position(|line| {
        let line = line.trim();
        here = header(line).unwrap_or(here);
        // A camera file has the keys of [camera] at its top.
        sets(line, name) && (here == section || (here.is_empty() && section == "camera"))
    })
}

/// The line of `text` (from 0) at which the first section begins that leaves out its `key` (`section.name`).
fn lacking(text: &str, key: &str) -> Option<usize> {
    let (section, name) = key.rsplit_once('.')?;
    let mut begun = None;
    for (number, line) in text.lines().map(str::trim).enumerate() {
        if let Some(header) = header(line) {
            if begun.is_some() {
                break;
            }
            begun = (header == section).then_some(number);
        } else if sets(line, name) {
            begun = None;
        }
    }
    begun
}

/// The section that `line` begins.
fn header(line: &str) -> Option<&str> {
    line.starts_with('[').then(|| line.trim_matches(['[', ']', ' ']))
}

fn sets(line: &str, name: &str) -> bool {
    line.split_once('=').is_some_and(|(left, _)| left.trim() == name)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::environment::Environment;

    fn message(text: &str) -> String {
        match parse::<Config>(Path::new("c.toml"), text)
            .and_then(|config| config.validate().map_err(|error| impossible(Path::new("c.toml"), text, error)))
        {
            Ok(()) => String::new(),
            Err(error) => error.to_string(),
        }
    }

    #[test]
    fn errors_name_file_line_and_key() {
        assert!(message("[object]\nradus = 1").starts_with("c.toml:2: `radus = 1`: unknown field `radus`, expected one of `shape`"));
        assert!(message("\n[object]\nradius = -1.0\n").starts_with("c.toml:3: object.radius = -1: expected"));
        assert!(message("[object]\nmass = \"heavy\"").starts_with("c.toml:2: `mass = \"heavy\"`: invalid type"));
        assert!(message("[[environment.plane]]\nnormal = [0.0, 0.0, 2.0]").starts_with("c.toml:2: environment.plane.normal = 4"));
        assert!(message("[object").starts_with("c.toml:1: "));
        assert_eq!(message("[object]\nradius = [0.02, 0.033]"), "");
        for message in [message("[object]\nradus = 1"), message("[object"), message("a = \n\n\"")] {
            assert!(!message.contains('\n'), "{message}");
        }
    }

    #[test]
    fn what_is_left_out_is_named_where_its_section_begins() {
        let cuboid = "[[environment.box]]\ncenter = [0.0, 1.0, 0.0]\nsize = [1.0, 1.0, 1.0]\n";
        let told = message(&format!("{cuboid}[[environment.box]]\nname = \"b\"\nsize = [1.0, 1.0, 1.0]\n[object]\n"));
        assert!(told.starts_with("c.toml:4: environment.box.center: expected"), "{told}");
        let told = message(&format!("{cuboid}[[environment.sphere]]\ncenter = [0.0, 1.0, 0.0]"));
        assert!(told.starts_with("c.toml:4: environment.sphere.radius: expected"), "{told}");
        let told = message("[[environment.box]]\ncenter = [nan, 1.0, 0.0]\nsize = [1.0, 1.0, 1.0]\n");
        assert!(told.starts_with("c.toml:2: environment.box.center: expected"), "{told}");
        let path = std::env::temp_dir().join(format!("physinc-no-path-{}.toml", std::process::id()));
        std::fs::write(&path, "[object]\n[[environment.mesh]]\nname = \"path\"\n").unwrap();
        let told = read_config(&path).unwrap_err().to_string();
        std::fs::remove_file(&path).unwrap();
        assert!(told.ends_with(".toml:2: environment.mesh.path: expected the path of an OBJ, STL or PLY file"), "{told}");
    }

    #[test]
    fn more_surfaces_than_fit_are_counted() {
        let told = message(&"[[environment.plane]]\n".repeat(9));
        assert!(told.starts_with("c.toml:1: `[[environment.plane]]`: there are 9 of these, and room for 8"), "{told}");
        assert_eq!(message(&"[[environment.plane]]\n".repeat(8)), "");
    }

    #[test]
    fn what_is_to_come_is_refused() {
        for (text, key) in
            [("[laws]\nmagnus = true", "laws.magnus"), ("[assume]\nobjects = \"unknown\"\ncamera = \"moving\"", "assume.objects")]
        {
            assert!(message(text).contains(key), "{text}: {}", message(text));
        }
    }

    #[test]
    fn known_surfaces_stand_in_the_files_order() {
        let plane = "[[environment.plane]]\nname = \"a\"\n";
        let cuboid = "[[environment.box]]\nname = \"b\"\ncenter = [0.0, 1.0, 0.0]\nsize = [1.0, 1.0, 1.0]\n";
        let sphere = "[[environment.sphere]]\nname = \"c\"\ncenter = [0.0, 1.0, 0.0]\nradius = 1.0\n";
        let path = std::env::temp_dir().join(format!("physinc-order-{}.toml", std::process::id()));
        for (text, expected) in [
            ([sphere, plane, cuboid, plane].concat(), "caba"),
            ([plane, cuboid, sphere].concat(), "abc"),
            ("environment = { sphere = [{ name = 'c', center = [0.0, 1.0, 0.0], radius = 1.0 }], plane = [{ name = 'a' }] }".into(), "ca"),
            (String::new(), ""),
        ] {
            let read = |text: &str| {
                std::fs::write(&path, text).unwrap();
                read_config(&path).unwrap()
            };
            let config = read(&text);
            let surfaces = Environment::new(&config.environment);
            assert_eq!(surfaces.surfaces().iter().map(|surface| surface.name.as_str()).collect::<String>(), expected);
            assert_eq!(read(&to_toml(&config).unwrap()), config);
        }
        std::fs::remove_file(&path).unwrap();
    }

    #[test]
    fn an_unknown_shape_is_told_which_there_are() {
        let told = message("[[environment.cone]]\nradius = 1.0");
        assert!(
            told.starts_with("c.toml:1: `[[environment.cone]]`: unknown field `cone`, expected one of `plane`, `box`, `sphere`, `mesh`"),
            "{told}"
        );
    }

    #[test]
    fn a_mesh_is_read_from_beside_its_configuration() {
        let folder = std::env::temp_dir().join(format!("physinc-meshes-{}", std::process::id()));
        std::fs::create_dir_all(&folder).unwrap();
        let (config, mesh) = (folder.join("c.toml"), folder.join("m.obj"));
        let told = |text: &str| {
            std::fs::write(&config, text).unwrap();
            read_config(&config)
        };
        let named = "[object]\n[[environment.mesh]]\nname = \"table\"\npath = \"m.obj\"\n";
        let absent = told(named).unwrap_err().to_string();
        assert!(absent.contains("c.toml:4: environment.mesh.path: ") && absent.contains("m.obj: No such file"), "{absent}");
        let corners = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\n";
        std::fs::write(&mesh, format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\n")).unwrap();
        let open = told(named).unwrap_err().to_string();
        assert!(open.contains("c.toml:4") && open.contains("m.obj: it is not closed: 3 of its edges") && !open.contains('\n'), "{open}");
        std::fs::write(&mesh, format!("{corners}f 1 3 2\nf 1 2 4\nf 2 3 4\nf 3 1 4\n")).unwrap();
        let read = told(named).unwrap();
        assert_eq!(read.environment.mesh[0].solid.as_ref().unwrap().len(), 4);
        // What is in force means the same elsewhere.
        assert_eq!(told(&to_toml(&read).unwrap()).unwrap(), read);
        let scaled = told(&format!("{named}pose = [[2.0,0.0,0.0,0.0],[0.0,2.0,0.0,0.0],[0.0,0.0,2.0,0.0],[0.0,0.0,0.0,1.0]]")).unwrap_err();
        assert!(
            scaled.to_string().ends_with("c.toml:5: environment.mesh.pose: expected 4 rows of 4, a rotation and a translation"),
            "{scaled}"
        );
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn what_is_written_is_read_back() {
        let text = "[camera]\nfx = 500.5\nworld_from_camera = [[1.0,0.0,0.0,0.0],[0.0,1.0,0.0,0.0],[0.0,0.0,1.0,2.0],[0.0,0.0,0.0,1.0]]\n\
                    [object]\nradius = [0.02, 0.033]\n[[environment.plane]]\nname = \"ground\"\noffset = 0.25";
        let config: Config = parse(Path::new("c.toml"), text).unwrap();
        let again: Config = parse(Path::new("c.toml"), &to_toml(&config).unwrap()).unwrap();
        assert_eq!(again, config);
        assert_eq!(parse::<Config>(Path::new("c.toml"), &to_toml(&Config::default()).unwrap()).unwrap(), Config::default());
    }
}
