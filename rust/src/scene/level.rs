//! Whether an accelerometer's level and the gravity that flights show agree.

use crate::math::{Mat3, Vec3, atan2, exp, sqrt};

/// How far the level of an accelerometer that is right may be off, standard deviation about each horizontal axis, rad: its makers promise 1°.
const LEVEL_SD: f64 = 0.5_f64.to_radians();

/// Where an accelerometer says that gravity pulls, held against flights, once after each.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Level {
    down: Vec3,
    /// How often they were compared; `None` after they disagreed, which is told once.
    tests: Option<u32>,
}

/// Two directions that should be one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Disagreement {
    /// Between them, rad.
    pub angle: f64,
    /// Standard deviation of `angle` if they were one, rad.
    pub sd: f64,
    /// Probability of such an angle if they were one.
    pub p_value: f64,
}

impl Level {
    /// Gravity by the accelerometer, in the frame of the flights; `None` where it has no direction.
    pub fn new(gravity: &Vec3) -> Option<Self> {
        Some(Self { down: gravity.try_normalize(1e-9)?, tests: Some(0) })
    }

    /// Compares it with what all flights together say, `gravity` and its covariance, m/s². A disagreement is told once; where there is none, the
    /// probability that one is told is below `false_alarm`, however many flights there are.
    pub fn test(&mut self, gravity: &Vec3, covariance: &Mat3, false_alarm: f64) -> Option<Disagreement> {
        let before = f64::from(self.tests?);
        self.tests = self.tests.map(|tests| tests.saturating_add(1));
        // 1/2 + 1/6 + 1/12 + … = 1.
        let found = self.compare(gravity, covariance).filter(|d| d.p_value < false_alarm / ((before + 1.0) * (before + 2.0)))?;
        self.tests = None;
        Some(found)
    }

    fn compare(&self, gravity: &Vec3, covariance: &Mat3) -> Option<Disagreement> {
        let axis = self.down.cross(gravity);
        let angle = atan2(axis.norm(), self.down.dot(gravity));
        let (axis, direction) = (axis.try_normalize(1e-12)?, gravity.try_normalize(1e-9)?);
        // Of the direction, in the plane across it: along the turn from the one to the other, and across that.
        let along = axis.cross(&direction);
        let covariance = covariance / gravity.norm_squared() + Mat3::from_diagonal_element(LEVEL_SD * LEVEL_SD);
        let [aa, ac, cc] = [(along, along), (along, axis), (axis, axis)].map(|(a, b)| a.dot(&(covariance * b)));
        let chi_squared = angle * angle * cc / (aa * cc - ac * ac);
        Some(Disagreement { angle, sd: sqrt(aa), p_value: exp(-0.5 * chi_squared) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tilted(degrees: f64) -> Vec3 {
        let angle = degrees.to_radians();
        Vec3::new(9.81 * angle.sin(), 0.0, -9.81 * angle.cos())
    }

    #[test]
    fn an_angle_is_weighed_by_what_is_known_of_it() {
        let level = Level::new(&tilted(0.0)).unwrap();
        let sd = 0.02 * 9.81;
        let found = level.compare(&tilted(5.0), &Mat3::from_diagonal_element(sd * sd)).unwrap();
        let expected = (0.02_f64.powi(2) + LEVEL_SD.powi(2)).sqrt();
        assert!((found.angle - 5.0_f64.to_radians()).abs() < 1e-12 && (found.sd - expected).abs() < 1e-12);
        assert!((found.p_value - (-0.5 * (found.angle / expected).powi(2)).exp()).abs() < 1e-12);
        // What is uncertain across the turn, or along gravity, changes nothing.
        let loose = Mat3::from_diagonal(&Vec3::new(sd * sd, 4.0, sd * sd));
        assert!((level.compare(&tilted(5.0), &loose).unwrap().p_value / found.p_value - 1.0).abs() < 1e-9);
    }

    #[test]
    fn a_disagreement_is_told_once_and_the_same_direction_never() {
        let mut level = Level::new(&tilted(0.0)).unwrap();
        let covariance = Mat3::from_diagonal_element(1e-4);
        assert_eq!(level.test(&tilted(0.0), &covariance, 1e-3), None);
        assert_eq!(level.test(&Vec3::zeros(), &covariance, 1e-3), None);
        assert!(level.test(&tilted(3.0), &covariance, 1e-3).is_some());
        assert_eq!(level.test(&tilted(3.0), &covariance, 1e-3), None);
        assert_eq!(Level::new(&Vec3::zeros()), None);
    }
}
