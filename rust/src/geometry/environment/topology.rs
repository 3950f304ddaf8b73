//! Whether triangles bound a body: finite, closed, and with their faces outwards.

use crate::math::Vec3;
use std::collections::HashMap;
use std::vec::Vec;

/// Triangles at the most.
pub const MOST_TRIANGLES: usize = 1_000_000;
/// No vertex is further from the mesh's origin than this along an axis, m: what a camera may see at the most.
pub const FARTHEST: f64 = 1000.0;

/// Why triangles bound no body.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum MeshError {
    /// There are none.
    #[error("it has no triangles; export the surface, not only its points")]
    Empty,
    /// There are too many.
    #[error("it has {0} triangles, more than {MOST_TRIANGLES}; decimate it in a mesh editor")]
    TooMany(usize),
    /// A coordinate is no number.
    #[error("vertex {0} (from 0) is NaN or infinite; remove it in a mesh editor, or export the mesh anew")]
    NotFinite(usize),
    /// A triangle has a corner that isn't there.
    #[error("triangle {triangle} (from 0) has the vertex {vertex}, but there are {vertices}; export the mesh anew")]
    NoSuchVertex {
        /// The triangle.
        triangle: usize,
        /// What it asks for.
        vertex: u32,
        /// How many there are.
        vertices: usize,
    },
    /// It reaches too far.
    #[error("it reaches {0:.0} m from its origin, more than {FARTHEST}; its units are metres: export it in metres, not in millimetres")]
    TooLarge(f64),
    /// It has holes, or faces that meet three by three.
    #[error("it is not closed: {edges} of its edges don't join exactly two triangles, the first near ({}, {}, {}) m; fill its holes and merge its vertices by distance in a mesh editor", at[0], at[1], at[2])]
    Open {
        /// Edges with one triangle, or with more than two.
        edges: usize,
        /// Middle of the first one, mesh frame, m.
        at: [f32; 3],
    },
    /// Some of its faces look outwards and some inwards.
    #[error("its faces look different ways: at {edges} edges one outwards and the other inwards, the first near ({}, {}, {}) m; make its normals consistent in a mesh editor", at[0], at[1], at[2])]
    Twisted {
        /// Edges that two triangles run along in the same direction.
        edges: usize,
        /// Middle of the first one, mesh frame, m.
        at: [f32; 3],
    },
    /// All its faces look inwards.
    #[error("it is inside out: its faces look inwards (volume {0:.3e} m³); flip its normals in a mesh editor")]
    InsideOut(f64),
    /// It bounds nothing.
    #[error("it has no volume; give its walls a thickness")]
    Flat,
}

/// The places of corners (m), and which three each face has.
pub type Faces = (Vec<[f32; 3]>, Vec<[u32; 3]>);

/// The same without duplicates, if they bound a body and look outwards.
pub fn body(vertices: &[[f64; 3]], triangles: &[[u32; 3]]) -> Result<Faces, MeshError> {
    match triangles.len() {
        0 => return Err(MeshError::Empty),
        n if n > MOST_TRIANGLES => return Err(MeshError::TooMany(n)),
        _ => {}
    }
    let far = |v: &[f64; 3]| v.iter().fold(0.0, |most: f64, x| most.max(x.abs()));
    if let Some(vertex) = vertices.iter().position(|v| v.iter().any(|x| !x.is_finite())) {
        return Err(MeshError::NotFinite(vertex));
    }
    let reach = vertices.iter().map(far).fold(0.0, f64::max);
    if reach > FARTHEST {
        return Err(MeshError::TooLarge(reach));
    }
    let (places, merged) = merge(vertices);
    let mut faces = Vec::with_capacity(triangles.len());
    for (triangle, corners) in triangles.iter().enumerate() {
        if let Some(&vertex) = corners.iter().find(|&&v| v as usize >= vertices.len()) {
            return Err(MeshError::NoSuchVertex { triangle, vertex, vertices: vertices.len() });
        }
        let face = corners.map(|v| merged[v as usize]);
        // A triangle with two corners in one place is an edge.
        if face[0] != face[1] && face[1] != face[2] && face[2] != face[0] {
            faces.push(face);
        }
    }
    if faces.is_empty() {
        return Err(MeshError::Empty);
    }
    closed(&places, &faces)?;
    let (volume, area) = extent(&places, &faces);
    // Of a sheet no thicker than a few roundings, the volume's sign says nothing.
    match volume {
        v if v.abs() < 1e-6 * area * reach => Err(MeshError::Flat),
        v if v < 0.0 => Err(MeshError::InsideOut(v)),
        _ => Ok((places, faces)),
    }
}

/// The different places of `vertices`, and where each vertex stands among them: in STL every triangle has its own.
fn merge(vertices: &[[f64; 3]]) -> (Vec<[f32; 3]>, Vec<u32>) {
    let (mut places, mut known) = (Vec::new(), HashMap::new());
    let merged = vertices.iter().map(|v| {
        // -0 + 0 = 0: one place, one pattern.
        let place = v.map(|x| x as f32 + 0.0);
        *known.entry(place.map(f32::to_bits)).or_insert_with(|| {
            places.push(place);
            places.len() as u32 - 1
        })
    });
    let merged = merged.collect();
    (places, merged)
}

/// Each edge joins two triangles, which run along it in opposite directions.
fn closed(places: &[[f32; 3]], faces: &[[u32; 3]]) -> Result<(), MeshError> {
    // How many triangles run along an edge up, and how many down its numbers.
    let mut runs: HashMap<(u32, u32), [u32; 2]> = HashMap::with_capacity(3 * faces.len() / 2);
    for (a, b) in edges(faces) {
        runs.entry((a.min(b), a.max(b))).or_default()[usize::from(a > b)] += 1;
    }
    // Counted and found in the file's order, so that the same file always gives the same message.
    let wrong = |is: fn(&[u32; 2]) -> bool| {
        let count = runs.values().filter(|run| is(run)).count();
        let (a, b) = edges(faces).find(|&(a, b)| is(&runs[&(a.min(b), a.max(b))]))?;
        let (a, b) = (places[a as usize], places[b as usize]);
        Some((count, core::array::from_fn(|i| 0.5 * (a[i] + b[i]))))
    };
    if let Some((edges, at)) = wrong(|run| run[0] + run[1] != 2) {
        return Err(MeshError::Open { edges, at });
    }
    wrong(|run| run[0] != 1).map_or(Ok(()), |(edges, at)| Err(MeshError::Twisted { edges, at }))
}

/// Volume (m³, negative where the faces look inwards) and area (m²).
fn extent(places: &[[f32; 3]], faces: &[[u32; 3]]) -> (f64, f64) {
    let corner = |v: u32| Vec3::from(places[v as usize].map(f64::from));
    let origin = corner(faces[0][0]);
    let cones = faces.iter().map(|&[a, b, c]| {
        let (a, b, c) = (corner(a) - origin, corner(b) - origin, corner(c) - origin);
        (a.dot(&b.cross(&c)) / 6.0, 0.5 * (b - a).cross(&(c - a)).norm())
    });
    cones.fold((0.0, 0.0), |sum, cone| (sum.0 + cone.0, sum.1 + cone.1))
}

/// The edges of `faces`, each in the direction in which its triangle runs along it.
fn edges(faces: &[[u32; 3]]) -> impl Iterator<Item = (u32, u32)> + '_ {
    faces.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)])
}
