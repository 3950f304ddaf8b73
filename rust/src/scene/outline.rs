//! The part of a plane that was touched.

use crate::math::Vec3;
use heapless::Vec;

/// Corners of an outline at the most.
pub const CORNERS: usize = 32;

/// Two unit vectors that span the plane with unit `normal`.
pub fn tangents(normal: &Vec3) -> (Vec3, Vec3) {
    let axis = if normal.x.abs() < 0.7 { Vec3::x() } else { Vec3::y() };
    let first = (axis - normal * normal.dot(&axis)).normalize();
    (first, normal.cross(&first))
}

/// Convex hull of `points` (m) on the plane normal · p = offset, counter-clockwise about the normal; the points are projected onto it.
pub fn outline(points: impl Iterator<Item = Vec3>, normal: &Vec3, offset: f64) -> Vec<[f64; 3], CORNERS> {
    let (u, v) = tangents(normal);
    let mut flat: Vec<(f64, f64), 64> = points.map(|p| (u.dot(&p), v.dot(&p))).take(64).collect();
    flat.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.total_cmp(&b.1)));
    let turn = |o: (f64, f64), a: (f64, f64), b: (f64, f64)| (a.0 - o.0) * (b.1 - o.1) - (a.1 - o.1) * (b.0 - o.0);
    // Andrew's monotone chain: the lower side from left to right, the upper one back.
    let mut hull: Vec<(f64, f64), 128> = Vec::new();
    let chain = |points: &mut dyn Iterator<Item = &(f64, f64)>, hull: &mut Vec<(f64, f64), 128>| {
        let base = hull.len();
        for &p in points {
            while hull.len() >= base + 2 && turn(hull[hull.len() - 2], hull[hull.len() - 1], p) <= 0.0 {
                hull.pop();
            }
            let _ = hull.push(p);
        }
        if flat.len() > 1 {
            hull.pop();
        }
    };
    chain(&mut flat.iter(), &mut hull);
    chain(&mut flat.iter().rev(), &mut hull);
    hull.truncate(if flat.len() == 1 { 1 } else { hull.len() });
    let stride = hull.len().div_ceil(CORNERS).max(1);
    hull.iter().step_by(stride).map(|(a, b)| (u * *a + v * *b + normal * offset).into()).collect()
}

/// Whether `point`, seen along `normal`, lies within a hull by [`outline`].
pub fn is_within(point: &Vec3, hull: &[[f64; 3]], normal: &Vec3) -> bool {
    let next = hull.iter().cycle().skip(1);
    let to_the_left =
        |(a, b): (&[f64; 3], &[f64; 3])| normal.dot(&(Vec3::from(*b) - Vec3::from(*a)).cross(&(point - Vec3::from(*a)))) > 0.0;
    hull.len() > 2 && hull.iter().zip(next).all(to_the_left)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hull_of_a_square_with_points_inside_is_the_square() {
        let points = [(0.0, 0.0), (1.0, 0.0), (0.5, 0.5), (1.0, 1.0), (0.0, 1.0), (0.2, 0.7), (0.5, 0.0)];
        let hull = outline(points.iter().map(|&(x, y)| Vec3::new(x, y, 7.0)), &Vec3::z(), 0.5);
        assert_eq!(hull.len(), 4);
        assert!(hull.iter().all(|p| (p[2] - 0.5).abs() < 1e-12 && (p[0] * (1.0 - p[0])).abs() < 1e-12));
        for (point, within) in [((0.1, 0.9), true), ((0.9, 0.9), true), ((1.1, 0.5), false), ((0.5, -0.1), false), ((-0.1, -0.1), false)] {
            assert_eq!(is_within(&Vec3::new(point.0, point.1, -3.0), &hull, &Vec3::z()), within);
        }
        assert!(!is_within(&Vec3::zeros(), &hull[..2], &Vec3::z()));
        assert_eq!(outline([Vec3::x()].into_iter(), &Vec3::z(), 0.0).len(), 1);
        assert_eq!(outline([Vec3::x(), Vec3::y()].into_iter(), &Vec3::z(), 0.0).len(), 2);
        assert_eq!(outline(core::iter::empty(), &Vec3::z(), 0.0).len(), 0);
    }
}
