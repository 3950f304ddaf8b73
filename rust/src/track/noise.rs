//! How good positions are that come without a covariance: told by their own smoothness, and by how well flights explain them.

use crate::math::sqrt;
use crate::physics::Sample;
use crate::physics::flight::Flight;
use crate::physics::law::Law;
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

/// Standard deviation of positions, m an axis.
#[derive(Clone, Debug)]
pub struct Noise {
    told: Option<f64>,
    differences: Vec<f64, MEMORY>,
    next: usize,
    smoothness: f64,
    /// Variances of the last flights, m².
    flights: Vec<f64, FLIGHTS>,
    oldest: usize,
}

impl Noise {
    /// `told`: what the user knows, m.
    pub fn new(told: Option<f64>) -> Self {
        Self { told, differences: Vec::new(), next: 0, smoothness: PRIOR_SD, flights: Vec::new(), oldest: 0 }
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
        let squares: f64 = flight.residuals(law, samples).map(|residual| residual.norm_squared()).sum();
        let variance = squares / (flight.dof() * samples.len() as f64 / flight.count as f64);
        if self.flights.push(variance).is_err() {
            self.flights[self.oldest] = variance;
            self.oldest = (self.oldest + 1) % FLIGHTS;
        }
    }

    /// Standard deviation to weigh with: that of the median flight.
    pub fn sd(&self) -> f64 {
        if let Some(told) = self.told {
            return told;
        }
        let mut sorted = self.flights.clone();
        sorted.sort_unstable_by(f64::total_cmp);
        match sorted.get(sorted.len() / 2) {
            Some(variance) => sqrt(*variance).max(self.smoothness).max(1e-6),
            None => (CAUTION.0 * self.smoothness).max(CAUTION.1),
        }
    }
}
