//! The recent past of one track: samples at 120 Hz at the most, whatever the rate they come in.

use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use heapless::Vec;

/// Samples that a window holds: 0.8 s at the highest rate, 3.2 s of a Kinect.
pub const CAPACITY: usize = 96;
/// Samples closer together than this are averaged, s.
const STEP: f64 = 1.0 / 120.0;

/// Samples in order of time.
#[derive(Clone, Debug, Default)]
pub struct Window {
    samples: Vec<Sample, CAPACITY>,
    bin: Option<Bin>,
}

/// Samples that become one.
#[derive(Clone, Copy, Debug)]
struct Bin {
    first: f64,
    last: f64,
    times: f64,
    positions: Vec3,
    weights: Mat3,
    count: f64,
}

impl Bin {
    fn mean(&self) -> Sample {
        Sample {
            t: self.times / self.count,
            position: self.positions / self.count,
            weight: self.weights,
            half_span: 0.5 * (self.last - self.first),
        }
    }
}

impl Window {
    /// The samples.
    pub fn samples(&self) -> &[Sample] {
        &self.samples
    }

    /// Takes a measurement in; returns the samples that are complete: below 120 Hz each measurement at once, else means of a few.
    pub fn gather(&mut self, t: f64, position: Vec3, weight: Mat3) -> Vec<Sample, 2> {
        let previous = self.bin.map(|b| b.last).or_else(|| self.samples.last().map(|s| s.t + s.half_span));
        let interval = previous.map_or(STEP, |p| t - p);
        let mut complete = Vec::new();
        if let Some(bin) = self.bin.take_if(|b| t - b.first >= STEP) {
            let _ = complete.push(bin.mean());
        }
        let bin =
            self.bin.get_or_insert(Bin { first: t, last: t, times: 0.0, positions: Vec3::zeros(), weights: Mat3::zeros(), count: 0.0 });
        // Positions are means, their weights add up, as far as neighbouring samples err independently.
        bin.last = t;
        bin.times += t;
        bin.positions += position;
        bin.weights += weight;
        bin.count += 1.0;
        if let Some(bin) = self.bin.take_if(|b| t + interval - b.first >= STEP) {
            let _ = complete.push(bin.mean());
        }
        complete
    }

    /// Appends a sample; a full window forgets its oldest eighth.
    pub fn push(&mut self, sample: Sample) {
        if self.samples.is_full() {
            self.samples.copy_within(CAPACITY / 8.., 0);
            self.samples.truncate(CAPACITY - CAPACITY / 8);
        }
        // There is room: the line above made it.
        let _ = self.samples.push(sample);
    }

    /// Forgets the sample at time `t`, which turned out to be wild.
    pub fn remove(&mut self, t: f64) {
        self.samples.retain(|s| s.t != t);
    }

    /// Gives every sample the standard deviation `sd` (m): positions without covariance are as good as was learned last.
    pub fn reweigh(&mut self, sd: f64) {
        for sample in &mut self.samples {
            sample.weight = Mat3::from_diagonal_element(1.0 / (sd * sd));
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thirty_hertz_pass_at_once_and_three_hundred_come_in_threes() {
        for (rate, expected) in [(30.0, 30), (100.0, 100), (300.0, 100), (1000.0, 111)] {
            let mut window = Window::default();
            let (mut out, mut gathered) = (0i32, 0);
            for i in 0..rate as u32 {
                let t = f64::from(i) / rate;
                for s in window.gather(t, Vec3::new(t, 0.0, 0.0), Mat3::identity()) {
                    assert!((s.position.x - s.t).abs() < 1e-12);
                    window.push(s);
                    out += 1;
                    gathered += libm::round(s.weight[(0, 0)]) as u32;
                }
            }
            assert!((out - expected).abs() <= 14, "{rate}: {out}");
            for s in window.gather(7.0, Vec3::new(7.0, 0.0, 0.0), Mat3::identity()) {
                gathered += libm::round(s.weight[(0, 0)]) as u32;
            }
            assert_eq!(gathered, rate as u32 + 1, "none is lost, not even before a gap");
            assert!(window.samples().len() <= CAPACITY && window.samples().is_sorted_by(|a, b| a.t < b.t));
        }
    }
}
