//! Meshes from files: OBJ, STL (binary and ASCII) and PLY (binary and ASCII), told apart by their endings. Units are metres.

use crate::geometry::environment::{Mesh, MeshError};
use ply_rs_bw::parser::{Parser, Reader};
use ply_rs_bw::ply::{Property, PropertyAccess, PropertyAccessResult};
use std::collections::HashMap;
use std::format;
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::string::{String, ToString};
use std::vec::Vec;

/// No file is longer than this, bytes: a million triangles in the wordiest format.
const LONGEST: u64 = 1 << 29;

/// What is wrong with a mesh's file.
#[derive(Debug, thiserror::Error)]
pub enum MeshFileError {
    /// It can't be read.
    #[error("{}: {error}; give the path of an OBJ, STL or PLY file", path.display())]
    Unreadable {
        /// The file.
        path: PathBuf,
        /// What the operating system says.
        error: std::io::Error,
    },
    /// It is of another kind, by its name.
    #[error("{}: its name ends like no mesh's; give a file that ends with .obj, .stl or .ply, in that format", path.display())]
    Unknown {
        /// The file.
        path: PathBuf,
    },
    /// It is very long.
    #[error("{}: it has {bytes} bytes, more than {LONGEST}; decimate the mesh in a mesh editor", path.display())]
    TooLong {
        /// The file.
        path: PathBuf,
        /// Its length.
        bytes: u64,
    },
    /// It is not what its name says.
    #[error("{}: it can't be read as {format}: {problem}; export the mesh anew", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// What its name says.
        format: &'static str,
        /// What is wrong.
        problem: String,
    },
    /// What it holds bounds no body.
    #[error("{}: {error}", path.display())]
    NoBody {
        /// The file.
        path: PathBuf,
        /// Why not.
        error: MeshError,
    },
}

/// Reads one format; what is wrong is told in words.
type Parse = fn(Vec<u8>) -> Result<Soup, String>;

/// Vertices, and triangles of them.
#[derive(Default)]
struct Soup {
    vertices: Vec<[f64; 3]>,
    triangles: Vec<[u32; 3]>,
}

/// The mesh in a file.
///
/// # Errors
/// What is wrong with it, in one line.
pub fn read(path: &Path) -> Result<Mesh, MeshFileError> {
    let ending = path.extension().and_then(|e| e.to_str()).unwrap_or_default().to_ascii_lowercase();
    let (format, parse): (_, Parse) = match ending.as_str() {
        "obj" => ("OBJ", obj),
        "stl" => ("STL", stl),
        "ply" => ("PLY", ply),
        _ => return Err(MeshFileError::Unknown { path: path.into() }),
    };
    let unreadable = |error| MeshFileError::Unreadable { path: path.into(), error };
    let bytes = std::fs::metadata(path).map_err(unreadable)?.len();
    if bytes > LONGEST {
        return Err(MeshFileError::TooLong { path: path.into(), bytes });
    }
    let soup = parse(std::fs::read(path).map_err(unreadable)?).map_err(|problem| MeshFileError::Malformed {
        path: path.into(),
        format,
        problem: problem.replace(['\n', '\t'], " "),
    })?;
    Mesh::new(&soup.vertices, &soup.triangles).map_err(|error| MeshFileError::NoBody { path: path.into(), error })
}

/// All objects of a Wavefront file together; polygons are cut into fans.
fn obj(bytes: Vec<u8>) -> Result<Soup, String> {
    let options = tobj::LoadOptions { triangulate: true, ignore_points: true, ignore_lines: true, ..Default::default() };
    // Colours and the like are of no interest.
    let no_materials = |_: &Path| Ok((Vec::new(), HashMap::default()));
    let (models, _) = tobj::load_obj_buf(&mut Cursor::new(bytes), &options, no_materials).map_err(|error| error.to_string())?;
    let mut soup = Soup::default();
    for tobj::Model { mesh, .. } in models {
        let first = soup.vertices.len() as u32;
        soup.vertices.extend(mesh.positions.as_chunks().0.iter().map(|v: &[f32; 3]| v.map(f64::from)));
        soup.triangles.extend(mesh.indices.as_chunks().0.iter().map(|t: &[u32; 3]| t.map(|v| first.saturating_add(v))));
    }
    Ok(soup)
}

/// Binary or ASCII.
fn stl(mut bytes: Vec<u8>) -> Result<Soup, String> {
    let promised = bytes.get(80..84).and_then(|n| n.try_into().ok()).map(u32::from_le_bytes);
    // Many programs begin a binary file's free text with the word by which an ASCII file is known; its length tells.
    if promised.is_some_and(|n| bytes.len() as u64 == 84 + 50 * u64::from(n)) {
        bytes[..5].fill(0);
    } else if bytes.starts_with(b"solid") {
        // A nameless one may leave out the blank.
        bytes.insert(5, b' ');
    }
    let mut soup = Soup::default();
    let mut file = Cursor::new(bytes);
    for triangle in stl_io::create_stl_reader(&mut file).map_err(|error| error.to_string())? {
        let first = soup.vertices.len() as u32;
        soup.vertices.extend(triangle.map_err(|error| error.to_string())?.vertices.map(|v| v.0.map(f64::from)));
        soup.triangles.push([first, first + 1, first + 2]);
    }
    Ok(soup)
}

/// Binary (of either order) or ASCII; polygons are cut into fans.
fn ply(bytes: Vec<u8>) -> Result<Soup, String> {
    let ply = Parser::<Element>::new();
    let length = bytes.len();
    let mut reader = Reader::new(Cursor::new(bytes));
    let header = ply.read_header(&mut reader).map_err(|error| error.to_string())?;
    if header.elements.values().any(|element| element.count > length) {
        return Err("its header promises more than there is".into());
    }
    let mut payload = ply.read_payload(&mut reader, &header).map_err(|error| match error.line() {
        Some(line) => format!("line {line} is not what its header says"),
        None => error.to_string(),
    })?;
    let mut elements = |name| payload.swap_remove(name).unwrap_or_default();
    let vertices = elements("vertex").into_iter().map(|e| e.place).collect();
    let fans = elements("face");
    let fan = |face: &Element| {
        let corners = face.corners.clone();
        (1..corners.len().saturating_sub(1)).map(move |i| [corners[0], corners[i], corners[i + 1]])
    };
    Ok(Soup { vertices, triangles: fans.iter().flat_map(fan).collect() })
}

/// A vertex or a face of a PLY file.
struct Element {
    place: [f64; 3],
    corners: Vec<u32>,
}

impl PropertyAccess for Element {
    fn new() -> Self {
        Self { place: [f64::NAN; 3], corners: Vec::new() }
    }

    fn set_property(&mut self, name: &str, value: Property) -> PropertyAccessResult {
        let axis = ["x", "y", "z"].iter().position(|axis| *axis == name);
        match (axis, name, &value) {
            (Some(axis), _, Property::Double(x)) => self.place[axis] = *x,
            (Some(axis), ..) => match value.to_f32_lossy() {
                Some(x) => self.place[axis] = x.into(),
                None => return PropertyAccessResult::UnsupportedType,
            },
            // Both names are in use.
            (_, "vertex_indices" | "vertex_index", _) => match value.to_u32_list() {
                Some(corners) => self.corners = corners,
                None => return PropertyAccessResult::UnsupportedType,
            },
            _ => return PropertyAccessResult::Ignored,
        }
        PropertyAccessResult::Set
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec;

    const PLACES: [[f32; 3]; 4] = [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
    const FACES: [[u8; 3]; 4] = [[0, 2, 1], [0, 1, 3], [1, 2, 3], [2, 0, 3]];

    fn read_as(name: &str, bytes: &[u8]) -> Result<Mesh, String> {
        let path = std::env::temp_dir().join(format!("physinc-{}-{name}", std::process::id()));
        std::fs::write(&path, bytes).unwrap();
        let mesh = read(&path).map_err(|error| error.to_string());
        std::fs::remove_file(&path).unwrap();
        if let Err(message) = &mesh {
            assert!(message.contains(name) && !message.contains('\n'), "{message}");
        }
        mesh
    }

    fn ply(format: &str, lists: &str, body: &[u8]) -> Vec<u8> {
        let header = format!(
            "ply\nformat {format} 1.0\ncomment made by hand\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n\
             property uchar red\nelement face 4\nproperty list uchar {lists} vertex_indices\nend_header\n"
        );
        [header.as_bytes(), body].concat()
    }

    fn binary_ply(number: fn(f32) -> [u8; 4], index: fn(u8) -> Vec<u8>) -> Vec<u8> {
        let vertices = PLACES.iter().flat_map(|v| [v.map(number).concat(), vec![255]].concat());
        let faces = FACES.iter().flat_map(|f| [vec![3], f.map(index).concat()].concat());
        vertices.chain(faces).collect()
    }

    fn ascii_stl(name: &str) -> String {
        let facets = FACES.map(|f| {
            let corners = f.map(|v| format!("vertex {} {} {}\n", PLACES[v as usize][0], PLACES[v as usize][1], PLACES[v as usize][2]));
            format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", corners.concat())
        });
        format!("solid{name}\n{}endsolid{name}\n", facets.concat())
    }

    fn binary_stl(header: &[u8]) -> Vec<u8> {
        let mut bytes = [header, &[b' '; 80][header.len()..], &4u32.to_le_bytes()].concat();
        for face in FACES {
            bytes.extend([0; 12]);
            bytes.extend(face.iter().flat_map(|&v| PLACES[v as usize]).flat_map(f32::to_le_bytes));
            bytes.extend([0; 2]);
        }
        bytes
    }

    #[test]
    fn each_format_says_the_same() {
        let obj = "# a tetrahedron\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf -4 -3 -1\ng other\nf 2 3 4\nusemtl none\nf 3/1 1/1 4/1\nvt 0 0\n";
        let text = PLACES.map(|v| format!("{} {} {} 255\n", v[0], v[1], v[2])).concat()
            + &FACES.map(|f| format!("3 {} {} {}\n", f[0], f[1], f[2])).concat();
        let files = [
            ("a.obj", obj.replace("f 3/1 1/1 4/1\nvt 0 0\n", "vt 0 0\nf 3/1 1/1 4/1\n").into_bytes()),
            ("named.stl", ascii_stl(" tetrahedron").into_bytes()),
            ("nameless.STL", ascii_stl("").into_bytes()),
            ("binary.stl", binary_stl(b"made by hand")),
            ("solid.stl", binary_stl(b"solid, says its free text")),
            ("ascii.ply", ply("ascii", "int", text.as_bytes())),
            ("little.ply", ply("binary_little_endian", "uint", &binary_ply(f32::to_le_bytes, |v| u32::from(v).to_le_bytes().into()))),
            ("big.ply", ply("binary_big_endian", "ushort", &binary_ply(f32::to_be_bytes, |v| u16::from(v).to_be_bytes().into()))),
        ];
        for (name, bytes) in files {
            assert_eq!(read_as(name, &bytes).map(|mesh| mesh.len()), Ok(4), "{name}");
        }
    }

    #[test]
    fn polygons_are_cut_into_triangles() {
        let cube = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n\
                    f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n";
        assert_eq!(read_as("cube.obj", cube.as_bytes()).unwrap().len(), 12);
    }

    #[test]
    fn what_is_wrong_with_a_file_is_told_in_a_line() {
        let wrong = |name, bytes: &[u8], expected: &str| {
            let told = read_as(name, bytes).unwrap_err();
            assert!(told.contains(expected), "{told}");
        };
        wrong("a.dae", b"", "ends like no mesh's; give a file that ends with .obj, .stl or .ply");
        wrong("empty.obj", b"", "no triangles");
        wrong("text.obj", b"This is no mesh.\n", "no triangles");
        wrong("points.obj", b"v 0 0 0\nv 1 0 0\n", "no triangles");
        wrong("index.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 9\n", "can't be read as OBJ: face vertex index out of bounds; export");
        wrong("nan.obj", b"v 0 nan 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0 (from 0) is NaN or infinite");
        wrong("empty.stl", b"", "can't be read as STL");
        wrong("cut.stl", &binary_stl(b"")[..200], "can't be read as STL");
        wrong("cut2.stl", &ascii_stl(" a").as_bytes()[..200], "can't be read as STL");
        wrong("nan.stl", ascii_stl(" a").replacen("vertex 1 0 0", "vertex 1 nan 0", 1).as_bytes(), "got NaN");
        let mut binary = binary_stl(b"");
        binary[100..104].copy_from_slice(&f32::NAN.to_le_bytes());
        wrong("nan2.stl", &binary, "vertex 0 (from 0) is NaN or infinite");
        wrong("text.ply", b"This is no mesh.\n", "can't be read as PLY");
        let little = ply("binary_little_endian", "uint", &binary_ply(f32::to_le_bytes, |v| u32::from(v).to_le_bytes().into()));
        wrong("cut.ply", &little[..little.len() - 3], "can't be read as PLY");
        wrong("negative.ply", &ply("ascii", "int", b"0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n3 0 1 -1\n"), "can't be read as PLY");
        wrong("text2.ply", &ply("ascii", "int", b"0 0 0 0\nzero\n"), "line 12 is not what its header says");
        wrong(
            "cloud.ply",
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\nproperty float z\nend_header\n0 0 0\n",
            "no triangles",
        );
        wrong("bomb.ply", b"ply\nformat binary_little_endian 1.0\nelement face 4000000000\nend_header\n", "promises more than there is");
        wrong("flat.ply", &ply("ascii", "int", b"0 0 0 0\n1 0 0 0\n0 1 0 0\n0 0 1 0\n3 0 1 2\n3 0 2 1\n3 0 1 2\n3 0 2 1\n"), "not closed");
    }

    #[test]
    fn an_absent_file_is_told_as_such() {
        let told = read(Path::new("/nowhere/a.obj")).unwrap_err().to_string();
        assert!(told.starts_with("/nowhere/a.obj: No such file") && told.ends_with("give the path of an OBJ, STL or PLY file"), "{told}");
    }
}
