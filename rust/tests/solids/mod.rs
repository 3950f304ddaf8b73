//! Bodies made of boxes and ellipsoids, drawn ray by ray, and what noise does to their depth.
#![allow(dead_code, clippy::missing_panics_doc)] // Each test uses what it needs.

use physinc::geometry::camera::Camera;
use physinc::geometry::motion::Motion;
use physinc::math::Vec3;

/// Part of a body: its middle and half its extent, object frame, m.
#[derive(Clone, Copy)]
pub enum Solid {
    Box(Vec3, Vec3),
    Ellipsoid(Vec3, Vec3),
}

/// A car of boxes: its hull, and a cabin on it; z is up, x forward.
pub fn car() -> Vec<Solid> {
    vec![
        Solid::Box(Vec3::new(0.0, 0.0, -0.02), Vec3::new(0.12, 0.05, 0.03)),
        Solid::Box(Vec3::new(-0.02, 0.0, 0.03), Vec3::new(0.06, 0.04, 0.02)),
    ]
}

/// A body that has neither a plane nor an axis.
pub fn blob() -> Vec<Solid> {
    vec![
        Solid::Ellipsoid(Vec3::zeros(), Vec3::new(0.12, 0.08, 0.06)),
        Solid::Ellipsoid(Vec3::new(0.08, 0.05, 0.03), Vec3::new(0.05, 0.05, 0.07)),
        Solid::Ellipsoid(Vec3::new(-0.07, 0.06, -0.02), Vec3::new(0.04, 0.06, 0.04)),
    ]
}

impl Solid {
    /// Along `ray` from `eye`, both in the object's frame: where it enters.
    fn enter(&self, eye: &Vec3, ray: &Vec3) -> Option<f64> {
        match self {
            Self::Box(middle, half) => {
                let (mut from, mut to) = (f64::NEG_INFINITY, f64::INFINITY);
                for i in 0..3 {
                    let [a, b] = [-1.0, 1.0].map(|side| (middle[i] + side * half[i] - eye[i]) / ray[i]);
                    (from, to) = (from.max(a.min(b)), to.min(a.max(b)));
                }
                (from < to && from > 0.0).then_some(from)
            }
            Self::Ellipsoid(middle, half) => {
                let (o, d) = ((eye - middle).component_div(half), ray.component_div(half));
                let (a, b, c) = (d.norm_squared(), o.dot(&d), o.norm_squared() - 1.0);
                let square = b * b - a * c;
                (square > 0.0).then(|| (-b - square.sqrt()) / a).filter(|t| *t > 0.0)
            }
        }
    }
}

/// Depth in metres of a body that stands at `camera_from_object`, row by row; NaN where there is nothing.
pub fn draw(camera: &Camera, body: &[Solid], camera_from_object: &Motion) -> Vec<f32> {
    let back = camera_from_object.inverse();
    let eye = back.of(&Vec3::zeros());
    let mut image = vec![f32::NAN; camera.width * camera.height];
    // Bodies are smaller than this.
    let (center, reach) = (camera_from_object.translation, 0.3);
    let Some((x, y)) = camera.project(&center) else { return image };
    let span = |middle: f64, focal: f64, end: usize| {
        let half = reach * focal / center.z;
        (middle - half).clamp(0.0, end as f64) as usize..(middle + half).clamp(0.0, end as f64) as usize
    };
    for row in span(y, camera.fy, camera.height) {
        for column in span(x, camera.fx, camera.width) {
            let ray = back.rotation * camera.deproject(column as f64, row as f64, 1.0);
            let nearest = body.iter().filter_map(|solid| solid.enter(&eye, &ray)).fold(f64::INFINITY, f64::min);
            if nearest.is_finite() {
                image[row * camera.width + column] = nearest as f32;
            }
        }
    }
    image
}

/// Random numbers, the same everywhere (xorshift).
pub struct Random(u64);

impl Random {
    pub fn new(seed: u64) -> Self {
        let mut random = Self(seed.wrapping_mul(0x9e37_79b9_7f4a_7c15) | 1);
        (0..8).for_each(|_| _ = random.uniform());
        random
    }

    /// 0 to 1.
    pub fn uniform(&mut self) -> f64 {
        self.0 ^= self.0 << 13;
        self.0 ^= self.0 >> 7;
        self.0 ^= self.0 << 17;
        (self.0 >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Of standard deviation 1 (Box and Muller).
    pub fn normal(&mut self) -> f64 {
        let (u, v) = (self.uniform().max(1e-300), self.uniform());
        (-2.0 * u.ln()).sqrt() * (std::f64::consts::TAU * v).cos()
    }

    pub fn vector(&mut self) -> Vec3 {
        Vec3::from_fn(|_, _| self.normal())
    }
}

/// A Kinect's noise (Nguyen 2012) that 9 × 7 neighbours share; the silhouette, smooth over the window, off by 0.8 px; and disparity in steps.
pub fn disturb(camera: &Camera, image: &[f32], random: &mut Random) -> Vec<f32> {
    let (width, height) = (camera.width, camera.height);
    let seen: Vec<usize> = (0..image.len()).filter(|i| image[*i].is_finite()).collect();
    let rows = seen.first().map_or(0, |i| i / width).saturating_sub(12)..(seen.last().map_or(0, |i| i / width) + 12).min(height);
    let columns = seen.iter().map(|i| i % width).min().unwrap_or(0).saturating_sub(12)
        ..(seen.iter().map(|i| i % width).max().unwrap_or(0) + 12).min(width);
    let size = [rows.len(), columns.len()];
    let (axial, right, down) = (shared(size, random), shared(size, random), shared(size, random));
    let mut out = vec![f32::NAN; image.len()];
    for row in rows.clone() {
        for column in columns.clone() {
            let i = (row - rows.start) * columns.len() + column - columns.start;
            let from = |middle: usize, shift: f64, end: usize| (middle as f64 + 0.8 * shift).round().clamp(0.0, end as f64 - 1.0) as usize;
            let (from_row, from_column) = (from(row, down[i], height), from(column, right[i], width));
            // Only the silhouette is shifted: what is read is this pixel's own depth, where it has one.
            let shifted = f64::from(image[from_row * width + from_column]);
            if shifted.is_finite() {
                let own = f64::from(image[row * width + column]);
                let z = if own.is_finite() { own } else { shifted };
                let noisy = z + (0.0012 + 0.0019 * (z - 0.4) * (z - 0.4)) * axial[i];
                let step = 0.0029;
                out[row * width + column] = (1.0 / ((1.0 / noisy / step).round() * step)) as f32;
            }
        }
    }
    out
}

/// White noise summed over windows of 9 × 7, of variance 1, row by row.
fn shared([rows, columns]: [usize; 2], random: &mut Random) -> Vec<f64> {
    let white: Vec<f64> = (0..rows * columns).map(|_| random.normal()).collect();
    let sum = |i: usize| {
        let (row, column) = (i / columns, i % columns);
        let window = (row.saturating_sub(3)..(row + 4).min(rows))
            .flat_map(|row| (column.saturating_sub(4)..(column + 5).min(columns)).map(move |column| row * columns + column));
        window.map(|i| white[i]).sum::<f64>() / 63_f64.sqrt()
    };
    (0..white.len()).map(sum).collect()
}
