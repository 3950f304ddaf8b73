//! How good positions are that come without a covariance: told by their own smoothness, and by how well flights explain them.

use crate::math::sqrt;
use crate::physics::Sample;
use crate::physics::flight::Flight;
use crate::physics::gravity::Gravity;
use crate::physics::law::Law;
use crate::physics::onset::LONGEST;
use heapless::Vec;

/// Third differences that the median is taken of.
const MEMORY: usize = 63;
/// Flights that the median is taken of.
const FLIGHTS: usize = 15;
/// Before there are this many, the estimate is the prior.
const ENOUGH: usize = 6;
/// What is taken for a tracker of which nothing is known yet, m.
const PRIOR_SD: f64 = 0.003;
/// Smoothness shows only the noise that changes from sample to sample: until flights were seen, there may be twice as much, and 1 mm
/// that comes and goes slowly.
const CAUTION: (f64, f64) = (2.0, 0.001);

/// What is off slowly in a tracker's positions (a marker on a ball that spins, axes that lean) stays alike for so long, s.
pub const SLOWLY: f64 = 0.1;
/// A flight shows it if it lasts so many times as long.
const SHOWS: f64 = 4.0;

/// Variances of flights, m².
#[derive(Clone, Debug, Default)]
struct Flights {
    variances: Vec<f64, FLIGHTS>,
    oldest: usize,
}

impl Flights {
    fn push(&mut self, variance: f64) {
        if self.variances.push(variance).is_err() {
            self.variances[self.oldest] = variance;
            self.oldest = (self.oldest + 1) % FLIGHTS;
        }
    }

    fn median(&self) -> Option<f64> {
        let mut sorted = self.variances.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        sorted.get(sorted.len() / 2).copied()
    }
}

/// Standard deviation of positions, m an axis.
#[derive(Clone, Debug)]
pub struct Noise {
    told: Option<f64>,
    differences: Vec<f64, MEMORY>,
    next: usize,
    smoothness: f64,
    /// About flights of any acceleration.
    flights: Flights,
    /// About passive flights as gravity is known.
    passive: Flights,
}

impl Noise {
    /// `told`: what the user knows, m.
    pub fn new(told: Option<f64>) -> Self {
        Self { told, differences: Vec::new(), next: 0, smoothness: PRIOR_SD, flights: Flights::default(), passive: Flights::default() }
    }

    /// Takes in the third difference of the last four samples: motion under any smooth force leaves none, white noise leaves √20 of its
    /// standard deviation. Contacts leave much, and do not move the median.
    pub fn observe(&mut self, samples: &[Sample]) {
        let Some([a, b, c, d]) = samples.last_chunk() else { return };
        let step = (d.t - a.t) / 3.0;
        if [(a, b), (b, c), (c, d)].iter().any(|(p, q)| ((q.t - p.t) / step - 1.0).abs() > 0.1) {
            return;
        }
        let difference = d.position - 3.0 * c.position + 3.0 * b.position - a.position;
        for x in difference.iter() {
            let x = x.abs() / sqrt(20.0);
            if self.differences.push(x).is_err() {
                self.differences[self.next] = x;
                self.next = (self.next + 1) % MEMORY;
            }
        }
        if self.differences.len() >= 3 * ENOUGH {
            let mut differences = self.differences.clone();
            let middle = differences.len() / 2;
            self.smoothness = *differences.select_nth_unstable_by(middle, f64::total_cmp).1 * 1.4826;
        }
    }

    /// Takes in how well a flight explains its samples.
    pub fn learn(&mut self, flight: &Flight, law: &dyn Law, samples: &[Sample]) {
        if samples.len() < 8 {
            return;
        }
        self.flights.push(squares(flight, law, samples) / (flight.dof() * samples.len() as f64 / flight.count as f64));
    }

    /// Takes in the samples of a flight of which `gravity` is known, and that nothing else moved: as many as a test for such looks at.
    pub fn learn_passive(&mut self, law: &dyn Law, samples: &[Sample], gravity: &Gravity) {
        let samples = samples.get(samples.len().saturating_sub(LONGEST)..).unwrap_or(samples);
        let [first, .., last] = samples else { return };
        if samples.len() < 8 || last.t - first.t < SHOWS * SLOWLY {
            return;
        }
        if let Some(flight) = Flight::fit(law, samples, gravity) {
            self.passive.push(squares(&flight, law, samples) / flight.dof());
        }
    }

    /// Standard deviations of what changes from sample to sample, and of what flights show beside it, m: it comes and goes slowly.
    pub fn parts(&self) -> (f64, f64) {
        if let Some(told) = self.told {
            return (told, 0.0);
        }
        let white = self.smoothness.max(1e-6);
        (white, self.passive.median().map_or(CAUTION.1, |variance| sqrt((variance - white * white).max(0.0))))
    }

    /// Standard deviation to weigh with: that of the median flight.
    pub fn sd(&self) -> f64 {
        if let Some(told) = self.told {
            return told;
        }
        match self.flights.median() {
            Some(variance) => sqrt(variance).max(self.smoothness).max(1e-6),
            None => (CAUTION.0 * self.smoothness).max(CAUTION.1),
        }
    }
}

fn squares(flight: &Flight, law: &dyn Law, samples: &[Sample]) -> f64 {
    flight.residuals(law, samples).map(|residual| residual.norm_squared()).sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::Vec3;
    use crate::physics::law::FreeFall;

    #[test]
    fn what_is_off_slowly_is_told_by_long_flights_alone() {
        let gravity = Gravity::known(Vec3::new(0.0, 0.0, -9.81));
        let fly = |seconds: f64| -> std::vec::Vec<Sample> {
            let of = |t: f64| Vec3::new(t, 0.0, 2.0 * t - 4.905 * t * t) + Vec3::new(libm::sin(12.0 * t), libm::cos(12.0 * t), 0.0) * 2e-3;
            (0..(seconds * 100.0) as u32).map(|i| f64::from(i) / 100.0).map(|t| Sample::isotropic(t, of(t), 1e-3)).collect()
        };
        let mut noise = Noise::new(None);
        (0..20).for_each(|_| noise.learn_passive(&FreeFall, &fly(0.3), &gravity));
        assert_eq!(noise.passive.median(), None);
        noise.learn_passive(&FreeFall, &fly(0.8), &gravity);
        let slow = sqrt(noise.passive.median().unwrap());
        assert!((0.5e-3..2e-3).contains(&slow), "{slow}");
    }
}
