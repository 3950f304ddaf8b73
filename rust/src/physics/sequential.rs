//! How often a test that is made again with each measurement may alarm, so that a whole track does so as rarely as was stated.

use crate::math::chi2_3_sf;

/// Tests that share most of what may be spent: those of a throw at 30 Hz.
const FIRST: f64 = 20.0;
/// What they share; the rest is for all that come later, as Σ 1/i² beyond the first.
const SHARE: f64 = 0.9;
/// Σ 1/i² for i > [`FIRST`].
const TAIL: f64 = 0.048_771;

/// The largest of the ratios over all onsets exceeds a value this many times as often as one of them does, where a test comes with each
/// new measurement and what the last ones exceeded counts once. Of a law that is exact it is a property of white Gaussian noise: of a million
/// tracks of 20 positions, simulated as quadratic forms, 2.2 at one alarm in 100 tracks and 2.5 at one in 1000.
pub const OF_EXACT: f64 = 2.4;
/// The same of a law whose acceleration is known to some 0.1 m/s²: little is left to be exceeded by an acceleration that was always there.
/// `cargo bench --bench activity -- calibrate` simulates it through the estimator itself (seeds from 0; judged on others): 0.90 to 0.97 at
/// one alarm in 100 to 3000 tracks. A third of those then find another explanation (a wild measurement, an unknown surface), and fewer where
/// the scene is known: this is in between.
pub const OF_LOOSE: f64 = 0.75;

/// Spends a stated probability of false alarm over the tests of a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allowance {
    false_alarm: f64,
    tests: f64,
}

impl Allowance {
    /// `false_alarm`: probability that a passive track ever alarms.
    pub fn new(false_alarm: f64) -> Self {
        Self { false_alarm, tests: 0.0 }
    }

    /// What the next test may spend.
    pub fn spend(&mut self) -> f64 {
        self.tests += 1.0;
        let part = if self.tests <= FIRST { SHARE / FIRST } else { (1.0 - SHARE) / (TAIL * self.tests * self.tests) };
        self.false_alarm * part
    }

    /// Whether the largest ratio over all onsets, `chi2`, is too large for a test that may spend `allowance`, exceeded `multiplicity` times
    /// as often as one ratio.
    pub fn is_exceeded(allowance: f64, chi2: f64, multiplicity: f64) -> bool {
        multiplicity * chi2_3_sf(chi2) < allowance
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_track_spends_its_allowance_once_and_most_of_it_early() {
        let mut allowance = Allowance::new(1e-3);
        let early: f64 = (0..20).map(|_| allowance.spend()).sum();
        let late: f64 = (20..200_000).map(|_| allowance.spend()).sum();
        assert!((early - 0.9e-3).abs() < 1e-12 && (0.0999e-3..=0.1e-3).contains(&late), "{early} {late}");
    }
}
