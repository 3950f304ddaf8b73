//! What is known of a ball's restitution on one surface.

use crate::physics::contact::RESTITUTION;

/// How much it differs from bounce to bounce, before any was seen (standard deviation): impact speeds, seams, floor boards.
const SCATTER: f64 = 0.06;
/// That guess counts as so many bounces.
const GUESSES: f64 = 4.0;

/// Normal with unknown mean and variance (normal-inverse-gamma), begun at what holds for any ball on any surface.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Restitution {
    mean: f64,
    /// How many bounces the mean is worth.
    weight: f64,
    freedom: f64,
    squares: f64,
}

impl Default for Restitution {
    fn default() -> Self {
        let (mean, sd) = RESTITUTION;
        let weight = SCATTER * SCATTER / (sd * sd - SCATTER * SCATTER);
        Self { mean, weight, freedom: GUESSES, squares: (GUESSES - 2.0) * SCATTER * SCATTER }
    }
}

impl Restitution {
    /// Takes in what one bounce showed.
    pub fn learn(&mut self, e: f64) {
        let off = e - self.mean;
        self.squares += off * off * self.weight / (self.weight + 1.0);
        self.weight += 1.0;
        self.freedom += 1.0;
        self.mean += off / self.weight;
    }

    /// That of the next bounce: mean and standard deviation.
    pub fn expected(&self) -> (f64, f64) {
        let scatter = self.squares / (self.freedom - 2.0);
        (self.mean, crate::math::sqrt(scatter * (1.0 + 1.0 / self.weight)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_begins_at_any_balls_and_ends_at_this_ones() {
        let mut restitution = Restitution::default();
        let (mean, sd) = restitution.expected();
        assert!((mean - RESTITUTION.0).abs() < 1e-12 && (sd - RESTITUTION.1).abs() < 1e-12);
        let mut before = sd;
        for i in 0..40 {
            restitution.learn(if i % 2 == 0 { 0.73 } else { 0.77 });
            let sd = restitution.expected().1;
            assert!(sd < before, "{i} {sd}");
            before = sd;
        }
        let (mean, sd) = restitution.expected();
        assert!((mean - 0.75).abs() < 2e-3 && (0.02..0.04).contains(&sd), "{mean} {sd}");
        // A surface that is now this, now that, is never known well.
        let mut patchy = Restitution::default();
        (0..40).for_each(|i| patchy.learn(if i % 2 == 0 { 0.5 } else { 0.8 }));
        assert!((0.12..0.18).contains(&patchy.expected().1));
    }
}
