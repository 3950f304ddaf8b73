//! A whole recorded motion beside its predictions (Eq. 3): what a track does as it goes, for those who have the positions already.

use crate::math::{Vec3, sqrt};
use crate::physics::Sample;
use crate::physics::flight::{Flight, Prediction};
use crate::physics::gravity::Gravity;
use crate::physics::inconsistency::{Inconsistency, MovingAverage, WhitenedTest};
use crate::physics::law::Law;
use crate::physics::paper;

/// What a prediction rests on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Horizon {
    /// The last two measurements.
    Step,
    /// Everything since the flight began: at the first measurement, and anew at each that is inconsistent.
    Flight,
}

/// When a distance is too large.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Criterion {
    /// Whitened by its covariance it would be, without a cause, with this probability over all measurements.
    FalseAlarm(f64),
    /// It exceeds the paper's θ, m; predictions are by Eq. 5.
    Theta(f64),
}

/// One measurement beside its prediction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Verdict {
    /// Prediction, measurement, their distance, and what it is held against.
    pub comparison: Inconsistency,
    /// Mean of the last distances, m.
    pub moving_average: f64,
    /// They disagree.
    pub inconsistent: bool,
}

/// How a motion is watched.
#[derive(Clone, Copy)]
pub struct Watch<'a> {
    /// How the object moves; Eq. 5 knows gravity alone.
    pub law: &'a dyn Law,
    /// Gravity, m/s².
    pub gravity: Vec3,
    /// What predictions rest on.
    pub horizon: Horizon,
    /// When a distance is too large.
    pub criterion: Criterion,
}

impl Watch<'_> {
    /// Hands out a verdict on each of `samples` (sorted by time), `None` where nothing can be predicted yet.
    pub fn over(&self, samples: &[Sample], mut out: impl FnMut(Option<Verdict>)) {
        let gravity = Gravity::known(self.gravity);
        let mut average = MovingAverage::default();
        let mut test = WhitenedTest::new(if let Criterion::FalseAlarm(p) = self.criterion { p } else { 0.0 });
        let mut since = 0;
        for (i, sample) in samples.iter().enumerate() {
            let start = if self.horizon == Horizon::Step { i.saturating_sub(2) } else { since };
            let compared = samples.get(start..i).filter(|history| history.len() >= 2).and_then(|history| match self.criterion {
                Criterion::FalseAlarm(_) => {
                    let prediction = self.predict(history, &gravity, sample.t)?;
                    Some(test.assess(&prediction, &sample.position, &sample.covariance()))
                }
                Criterion::Theta(theta) => {
                    let (a, b) = (history.first()?, history.get(1)?);
                    let predicted = paper::predict(a, b, sample.t, &self.gravity)?;
                    let (measured, distance) = (sample.position, (sample.position - predicted).norm());
                    Some((Inconsistency { predicted, measured, distance, threshold: theta, p_value: None }, distance > theta))
                }
            });
            if let Some((_, true)) = compared {
                since = i;
            }
            out(compared.map(|(comparison, inconsistent)| Verdict {
                comparison,
                moving_average: average.push(comparison.distance),
                inconsistent,
            }));
        }
    }

    fn predict(&self, history: &[Sample], gravity: &Gravity, t: f64) -> Option<Prediction> {
        Some(Flight::fit(self.law, history, gravity)?.predict(self.law, t))
    }
}

/// Standard deviation (m an axis) of `samples` whose noise is white, whatever smooth force moves them: the median size of third
/// differences, which neither a constant acceleration nor a few contacts move. `scratch` takes 3 numbers for each sample but three.
/// `None` where it is too short, or there are fewer than 8 samples.
pub fn noise(samples: &[Sample], scratch: &mut [f64]) -> Option<f64> {
    let sizes = scratch.get_mut(..3 * samples.len().checked_sub(3)?).filter(|_| samples.len() >= 8)?;
    for (window, sizes) in samples.windows(4).zip(sizes.chunks_exact_mut(3)) {
        let (mut difference, mut gain) = (Vec3::zeros(), 0.0);
        for (i, a) in window.iter().enumerate() {
            // Newton's divided difference: for any spacing.
            let others = window.iter().enumerate().filter(|(j, _)| *j != i);
            let weight = 1.0 / others.map(|(_, b)| a.t - b.t).product::<f64>();
            difference += (a.position - window[0].position) * weight;
            gain += weight * weight;
        }
        sizes.copy_from_slice((difference / sqrt(gain)).abs().as_slice());
    }
    sizes.sort_unstable_by(f64::total_cmp);
    // Of a Gaussian, half lie within 0.6745 standard deviations.
    Some(1.4826 * sizes[sizes.len() / 2])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::{FreeFall, State};

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);

    /// 20 frames at 30 Hz that bounce off a floor between the frames 9 and 10.
    fn bounce() -> [Sample; 20] {
        let start = State { t: 0.0, position: Vec3::new(0.0, 1.5, 1.0), velocity: Vec3::new(1.0, 0.0, 0.5) };
        let hit = start.at(0.31, &FreeFall, &G);
        let off = State { velocity: hit.velocity.component_mul(&Vec3::new(0.8, 0.8, -0.75)), ..hit };
        core::array::from_fn(|i| {
            let t = i as f64 / 30.0;
            Sample::isotropic(t, if i < 10 { start } else { off }.at(t, &FreeFall, &G).position, 1e-3)
        })
    }

    fn watch(horizon: Horizon, criterion: Criterion) -> heapless::Vec<Option<Verdict>, 20> {
        let mut verdicts = heapless::Vec::new();
        Watch { law: &FreeFall, gravity: G, horizon, criterion }.over(&bounce(), |verdict| verdicts.push(verdict).unwrap());
        verdicts
    }

    fn alarms(verdicts: &[Option<Verdict>]) -> heapless::Vec<usize, 20> {
        (0..20).filter(|&i| verdicts[i].is_some_and(|v| v.inconsistent)).collect()
    }

    #[test]
    fn a_bounce_is_inconsistent_and_ends_a_flight() {
        let flights = watch(Horizon::Flight, Criterion::FalseAlarm(1e-3));
        assert_eq!(alarms(&flights), [10]);
        // Two measurements of the new flight must come first.
        assert!(flights[0].is_none() && flights[1].is_none() && flights[11].is_none() && flights[12].is_some());
        // The step before a prediction must lie on one side, too.
        assert_eq!(alarms(&watch(Horizon::Step, Criterion::FalseAlarm(1e-3))), [10, 11]);
    }

    #[test]
    fn eq_5_lags_by_half_a_step_of_falling() {
        let lag = 0.5 * 9.81 / 900.0;
        let steps = watch(Horizon::Step, Criterion::Theta(6e-3));
        assert_eq!(alarms(&steps), [10, 11]);
        let passive = steps[5].unwrap();
        assert!((passive.comparison.distance - lag).abs() < 1e-9 && (passive.moving_average - lag).abs() < 1e-9);
        // From the first step of a flight on, the lag grows with time.
        let flights = watch(Horizon::Flight, Criterion::Theta(1.0));
        assert!((flights[8].unwrap().comparison.distance - 7.0 * lag).abs() < 1e-9);
    }

    #[test]
    fn noise_is_told_apart_from_falling_and_bouncing_at_any_spacing() {
        let mut scratch = [0.0; 60];
        assert!(noise(&bounce(), &mut scratch).unwrap() < 1e-9);
        let mut uneven = bounce();
        for (i, sample) in uneven.iter_mut().enumerate() {
            let t = sample.t + 0.005 * f64::from(i as u32 % 3);
            *sample = Sample::isotropic(t, G * (0.5 * t * t), 1.0);
        }
        assert!(noise(&uneven, &mut scratch).unwrap() < 1e-9);
        assert_eq!(noise(&uneven[..7], &mut scratch), None);
        assert_eq!(noise(&uneven, &mut [0.0; 3]), None);
    }
}
