//! A sphere through bare points.

use crate::math::{Mat3, Vec3, sqrt, symmetric};
use nalgebra::{Matrix4, Vector4};

/// A sphere fitted to points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SphereFit {
    /// Center, in the points' frame, m.
    pub center: Vec3,
    /// Radius, m: the given one, or the estimate.
    pub radius: f64,
    /// Of `center`, m²; the noise is taken from the residuals and as independent from point to point.
    pub covariance: Mat3,
    /// Root mean square distance of the inliers from the sphere, m.
    pub residual_rms: f64,
    /// Points within three standard deviations.
    pub inliers: usize,
}

/// Fits a sphere of known or unknown radius (m) to points (m, any frame) by robust least squares on the distances from it (Gauss–Newton,
/// Huber weights). `None` where no sphere is determined: fewer than 4 points (5 with a free radius), points that are not finite, that
/// lie in a plane or on a line, or that are nowhere near a sphere. Points on a small cap leave two mirrored spheres of known radius; of
/// two that fit alike, the one away from the origin is meant, where the camera stands.
pub fn fit_sphere(points: &[Vec3], radius: Option<f64>) -> Option<SphereFit> {
    if points.len() < 4 + usize::from(radius.is_none()) || !points.iter().all(|p| p.iter().all(|x| x.is_finite() && x.abs() < 1e6)) {
        return None;
    }
    let n = points.len() as f64;
    let mean = points.iter().sum::<Vec3>() / n;
    let spread = points.iter().map(|p| (p - mean) * (p - mean).transpose()).sum::<Mat3>() / n;
    let eigen = spread.symmetric_eigen();
    let flat = eigen.eigenvalues.imin();
    let thickness = sqrt(eigen.eigenvalues[flat].max(0.0));
    if thickness <= 1e-9 * sqrt(eigen.eigenvalues.max()) {
        return None;
    }
    let Some(radius) = radius else {
        let (center, radius) = algebraic(points, &mean)?;
        return refine(points, center, radius, true);
    };
    if !(radius > 0.0 && radius.is_finite()) {
        return None;
    }
    let axis = eigen.eigenvectors.column(flat).into_owned();
    let axis = if axis.dot(&mean) < 0.0 { -axis } else { axis };
    // A cap whose rim has the radius r has its mean (2/3 of the height) behind the top; 0.7 radii are near enough to start from.
    let [away, towards] = [0.7, -0.7].map(|side| refine(points, mean + axis * (side * radius), radius, false));
    match (away, towards) {
        (Some(away), Some(towards)) if towards.residual_rms < 0.8 * away.residual_rms => Some(towards),
        (None, towards) => towards,
        (away, _) => away,
    }
}

/// Center and radius that make |p|² − 2 c·p + |c|² − r² smallest in squares: a start only, real caps come out too large.
fn algebraic(points: &[Vec3], mean: &Vec3) -> Option<(Vec3, f64)> {
    let (mut a, mut b) = (Matrix4::zeros(), Vector4::zeros());
    for p in points.iter().map(|p| p - mean) {
        let row = Vector4::new(2.0 * p.x, 2.0 * p.y, 2.0 * p.z, 1.0);
        a += row * row.transpose();
        b += row * p.norm_squared();
    }
    let solution = a.cholesky()?.solve(&b);
    let center = solution.xyz();
    let square = solution.w + center.norm_squared();
    (square > 0.0).then(|| (center + mean, sqrt(square)))
}

fn refine(points: &[Vec3], mut center: Vec3, mut radius: f64, free: bool) -> Option<SphereFit> {
    let n = points.len() as f64;
    let distance = |p: &Vec3, center: &Vec3, radius: f64| (p - center).norm() - radius;
    let scale_of = |center: &Vec3, radius: f64, limit: f64| {
        // A standard deviation that wild points can't raise by much: the mean size of what lies within `limit`, times √(π/2).
        let (sum, count) =
            points.iter().map(|p| distance(p, center, radius).abs()).filter(|d| *d <= limit).fold((0.0, 0), |(s, k), d| (s + d, k + 1));
        1.2533 * sum / f64::from(count.max(1))
    };
    let mut scale = scale_of(&center, radius, f64::INFINITY);
    let mut inverse = Matrix4::zeros();
    for _ in 0..30 {
        let (mut h, mut g) = (Matrix4::zeros(), Vector4::zeros());
        for p in points {
            let outward = (p - center).try_normalize(1e-300)?;
            let residual = distance(p, &center, radius);
            let weight = (1.5 * scale.max(1e-12) / residual.abs().max(1e-300)).min(1.0);
            let jacobian = Vector4::new(outward.x, outward.y, outward.z, f64::from(u8::from(free)));
            h += jacobian * jacobian.transpose() * weight;
            g += jacobian * (residual * weight);
        }
        if !free {
            h[(3, 3)] = 1.0;
        }
        inverse = h.cholesky()?.inverse();
        let step = inverse * g;
        center += step.xyz();
        radius += step.w;
        scale = scale_of(&center, radius, 3.0 * scale.max(1e-12));
        if step.norm() < 1e-12 * radius {
            break;
        }
    }
    let limit = 3.0 * scale + 1e-9 * radius;
    let (squares, inliers) =
        points.iter().map(|p| distance(p, &center, radius)).filter(|d| d.abs() <= limit).fold((0.0, 0), |(s, k), d| (s + d * d, k + 1));
    let residual_rms = sqrt(squares / f64::from(inliers.max(1)));
    let freedom = (n - 3.0 - f64::from(u8::from(free))).max(1.0);
    let variance = squares / freedom + 1e-24;
    let covariance = symmetric(&(inverse.fixed_view::<3, 3>(0, 0) * variance));
    let sphere = radius > 0.0 && residual_rms < 0.3 * radius && f64::from(inliers) >= 0.5 * n && inliers >= 4;
    let finite = center.iter().chain(covariance.iter()).all(|x| x.is_finite());
    (sphere && finite).then_some(SphereFit { center, radius, covariance, residual_rms, inliers: inliers as usize })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    const CENTER: Vec3 = Vec3::new(0.1, -0.2, 1.5);

    /// Points on the half of a sphere that faces the origin, spread evenly.
    fn cap(count: usize, radius: f64) -> Vec<Vec3> {
        let toward = -CENTER.normalize();
        let golden = 2.399_963_229_728_653;
        (0..2 * count)
            .map(|i| {
                let (z, turn) = (1.0 - (2 * i + 1) as f64 / (2 * count) as f64, golden * i as f64);
                let r = sqrt(1.0 - z * z);
                Vec3::new(r * libm::cos(turn), r * libm::sin(turn), z)
            })
            .filter(|n| n.dot(&toward) > 0.0)
            .map(|n| CENTER + n * radius)
            .collect()
    }

    #[test]
    fn exact_points_give_the_exact_sphere() {
        for count in [4, 8, 200] {
            let fit = fit_sphere(&cap(count, 0.033), Some(0.033)).unwrap();
            assert!((fit.center - CENTER).norm() < 1e-9, "{count}");
        }
        let fit = fit_sphere(&cap(200, 0.033), None).unwrap();
        assert!((fit.center - CENTER).norm() < 1e-9 && (fit.radius - 0.033).abs() < 1e-9);
        assert_eq!(fit.inliers, cap(200, 0.033).len());
    }

    #[test]
    fn wild_points_are_left_out() {
        let mut points = cap(200, 0.033);
        points.extend((0..20).map(|i| CENTER + Vec3::new(0.1, 0.01 * f64::from(i), 0.3)));
        let fit = fit_sphere(&points, Some(0.033)).unwrap();
        assert!((fit.center - CENTER).norm() < 1e-3, "{}", fit.center - CENTER);
        assert!(fit.inliers <= points.len() - 20);
    }

    #[test]
    fn what_determines_no_sphere_gives_none() {
        let plane: Vec<Vec3> = (0..100).map(|i| Vec3::new(f64::from(i % 10), f64::from(i / 10), 1.0) * 0.01).collect();
        let line: Vec<Vec3> = (0..100).map(|i| Vec3::new(0.01 * f64::from(i), 0.0, 1.0)).collect();
        let mut not_finite = cap(50, 0.033);
        not_finite[3].x = f64::NAN;
        for points in [&plane, &line, &not_finite, &cap(50, 0.033)[..3].to_vec(), &std::vec![CENTER; 50], &Vec::new()] {
            assert_eq!(fit_sphere(points, Some(0.033)), None);
            assert_eq!(fit_sphere(points, None), None);
        }
        assert_eq!(fit_sphere(&cap(50, 0.033), Some(f64::NAN)), None);
    }
}
