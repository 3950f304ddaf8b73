//! Rigid motions: from where something was to where it is.

use crate::math::{Mat3, Vec3, cos, sin};

/// p' = rotation · p + translation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Motion {
    /// Rotation.
    pub rotation: Mat3,
    /// Translation, m: where the origin comes to.
    pub translation: Vec3,
}

impl Motion {
    /// None.
    pub fn identity() -> Self {
        Self { rotation: Mat3::identity(), translation: Vec3::zeros() }
    }

    /// A turn by the rotation vector `turn` (rad, right-handed about its direction; Rodrigues) about `pivot`, and then a `shift`, m.
    pub fn about(pivot: &Vec3, turn: &Vec3, shift: &Vec3) -> Self {
        let angle = turn.norm();
        // sin x / x and (1 − cos x) / x², which rounding would lose near 0.
        let (first, second) =
            if angle < 1e-4 { (1.0 - angle * angle / 6.0, 0.5) } else { (sin(angle) / angle, (1.0 - cos(angle)) / (angle * angle)) };
        let cross = turn.cross_matrix();
        let rotation = Mat3::identity() + cross * first + cross * cross * second;
        Self { rotation, translation: pivot + shift - rotation * pivot }
    }

    /// Where `p` (m) comes to.
    pub fn of(&self, p: &Vec3) -> Vec3 {
        self.rotation * p + self.translation
    }

    /// This motion after a `first` one.
    pub fn after(&self, first: &Self) -> Self {
        Self { rotation: self.rotation * first.rotation, translation: self.of(&first.translation) }
    }

    /// The way back.
    pub fn inverse(&self) -> Self {
        let rotation = self.rotation.transpose();
        Self { rotation, translation: -(rotation * self.translation) }
    }

    /// By how much it turns, rad.
    pub fn angle(&self) -> f64 {
        let r = &self.rotation;
        // The axis' length tells small angles well, the trace large ones.
        let twice_sin = Vec3::new(r[(2, 1)] - r[(1, 2)], r[(0, 2)] - r[(2, 0)], r[(1, 0)] - r[(0, 1)]).norm();
        crate::math::atan2(0.5 * twice_sin, 0.5 * (r.trace() - 1.0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn motions_compose_and_undo() {
        let a = Motion::about(&Vec3::new(0.1, 0.2, 1.5), &Vec3::new(0.3, -0.2, 0.5), &Vec3::new(0.0, 0.1, -0.2));
        let b = Motion::about(&Vec3::zeros(), &Vec3::new(1e-6, 0.0, -2e-6), &Vec3::x());
        let p = Vec3::new(0.3, -0.7, 2.0);
        assert!((a.after(&b).of(&p) - a.of(&b.of(&p))).norm() < 1e-14);
        assert!((a.inverse().of(&a.of(&p)) - p).norm() < 1e-14);
        assert!((a.angle() - Vec3::new(0.3, -0.2, 0.5).norm()).abs() < 1e-14);
        assert!((b.angle() / crate::math::sqrt(5e-12) - 1.0).abs() < 1e-6);
        let pivot = Vec3::new(0.1, 0.2, 1.5);
        assert!((a.of(&pivot) - pivot - Vec3::new(0.0, 0.1, -0.2)).norm() < 1e-15);
        assert!((a.rotation.transpose() * a.rotation - Mat3::identity()).norm() < 1e-14);
    }
}
