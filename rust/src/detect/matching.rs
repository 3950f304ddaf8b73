//! Over how many pixels a camera matches to tell a depth: balls show it. A window flattens their caps, more towards the rim; one that is taken for
//! larger or smaller than it is puts them before or behind where they are.

use super::Blob;
use super::ball::{Found, LARGEST_RESIDUAL};
use super::noise::Noise;
use crate::math::log;

/// Windows that are told apart, columns and rows, px: a Kinect v1's, a smaller one, and none.
pub const WINDOWS: [[usize; 2]; 3] = [Noise::KINECT, [5, 5], [1, 1]];

/// How much less likely another window is than a Kinect's before a ball is seen: one in twenty.
const RARER: f64 = 3.0;
/// The best window is settled once it leads by so much of log-likelihood,
const LEAD: f64 = 6.0;
/// or has been weighed with so many balls.
const BALLS: u32 = 16;
/// Balls that show less than so many pixels say nothing of it.
const FEWEST_POINTS: u32 = 60;

/// What balls have said by now, and what is made of it: the same within one frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Matching {
    /// How much less likely each of [`WINDOWS`] makes the caps seen so far: the sum of points / 2 · log of their mean squared residual.
    misfit: [f64; WINDOWS.len()],
    balls: u32,
    /// The place of the most likely of them before this frame.
    best: usize,
    settled: bool,
}

impl Default for Matching {
    fn default() -> Self {
        Self { misfit: [0.0, RARER, RARER], balls: 0, best: 0, settled: false }
    }
}

impl Matching {
    /// The window, once it is settled.
    pub fn settled(&self) -> Option<[usize; 2]> {
        self.settled.then_some(WINDOWS[self.best])
    }

    /// Learns from one ball, fitted with each of [`WINDOWS`], and hands out the fit with the one that was most likely before this frame.
    pub fn weigh(&mut self, fits: [Option<Found>; WINDOWS.len()]) -> Option<Found> {
        let whole = || fits.iter().flatten().filter(|found| found.detection.blob == Blob::Whole);
        let points = whole().map(|found| found.detection.points).max().unwrap_or(0);
        if points >= FEWEST_POINTS {
            self.balls += 1;
            let [least, refused] = whole().fold([f64::INFINITY; 2], |[least, refused], found| {
                let largest = LARGEST_RESIDUAL * Noise::default().axial(found.detection.center.z);
                [least.min(found.least_square), refused.min(largest * largest)]
            });
            // Neighbours share their noise: if each point counted as if by itself, noise would decide.
            let weight = 0.5 * f64::from(points) / (Noise::KINECT[0] * Noise::KINECT[1]) as f64;
            for (misfit, fit) in self.misfit.iter_mut().zip(&fits) {
                let square = fit.as_ref().map_or(refused, |found| found.least_square);
                *misfit += weight * log((square / least).max(1.0));
            }
        }
        fits.into_iter().nth(self.best).flatten()
    }

    /// The frame is over.
    pub fn decide(&mut self) {
        if self.settled {
            return;
        }
        let places = || 0..WINDOWS.len();
        self.best = places().min_by(|a, b| self.misfit[*a].total_cmp(&self.misfit[*b])).unwrap_or(0);
        let leads = |other: usize| other == self.best || self.misfit[other] > self.misfit[self.best] + LEAD;
        self.settled = self.balls >= BALLS || places().all(leads);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::detect::Detection;
    use crate::math::{Mat3, Vec3};

    fn fit(residual_rms: f64) -> Found {
        let detection = Detection {
            center: Vec3::z(),
            covariance: Mat3::identity(),
            drift: Mat3::zeros(),
            radius: 0.033,
            points: 500,
            residual_rms,
            row: 0.0,
            blob: Blob::Whole,
            shape: None,
        };
        Found { detection, cap_ratio: 1.0, outline_ratio: 1.0, least_square: residual_rms * residual_rms }
    }

    /// After how many frames that show these residuals which window is settled.
    fn settled(residuals: [f64; 3]) -> (u32, [usize; 2]) {
        let mut matching = Matching::default();
        for frame in 1.. {
            matching.weigh(residuals.map(|residual| Some(fit(residual))));
            matching.decide();
            if let Some(window) = matching.settled() {
                return (frame, window);
            }
        }
        unreachable!("after some balls it is settled whatever they show")
    }

    #[test]
    fn the_window_that_fits_best_is_settled_and_a_kinects_if_none_does() {
        assert!(matches!(settled([0.003, 0.0036, 0.0045]), (..8, window) if window == WINDOWS[0]));
        assert!(matches!(settled([0.0036, 0.003, 0.0036]), (..12, window) if window == WINDOWS[1]));
        assert!(matches!(settled([0.008, 0.004, 0.001]), (..3, window) if window == WINDOWS[2]));
        assert_eq!(settled([0.003, 0.00301, 0.00302]), (BALLS, WINDOWS[0]));
    }

    #[test]
    fn one_ball_that_no_kinects_window_lets_be_seen_is_enough_to_try_another() {
        let two = || [None, Some(fit(0.004)), Some(fit(0.001))];
        let mut matching = Matching::default();
        assert!(matching.weigh(two()).is_none());
        matching.decide();
        assert_eq!(matching.weigh(two()).unwrap().detection.residual_rms, 0.001);
        matching.weigh([None, None, None]);
        assert_eq!(matching.balls, 2);
    }
}
