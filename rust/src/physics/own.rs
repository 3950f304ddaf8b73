//! A law of the user's own, which is asked once per object and frame: what it answered, as a law in time.

use crate::math::Vec3;
use crate::physics::law::{FreeFallWithDrag, Law};
use heapless::Vec;

/// A law of the user's own.
pub trait OwnLaw {
    /// The whole acceleration (m/s²) of an object that nobody touches, gravity included, `t` seconds after its track began, at `position`
    /// (m) with `velocity` (m/s), in the world. `None` where there is no answer: the law isn't asked again then.
    fn acceleration(&mut self, t: f64, position: &Vec3, velocity: &Vec3) -> Option<Vec3>;
}

/// Answers that are kept of an object: as many as samples of its recent past.
pub const ANSWERS: usize = 96;
/// Answers closer together than this are one, the newest, s: samples are no closer.
const STEP: f64 = 1.0 / 120.0;

/// Accelerations along an object's way: linear in between, constant beyond the ends.
#[derive(Clone, Debug, PartialEq)]
pub struct Tabulated<const N: usize = ANSWERS> {
    /// Times (s), ascending, and accelerations (m/s²).
    answers: Vec<(f64, Vec3), N>,
    gravity: Vec3,
}

impl Tabulated {
    /// Still without answers. They hold under `gravity` (m/s²); a fit whose gravity is another adds the difference.
    pub fn new(gravity: Vec3) -> Self {
        Self { answers: Vec::new(), gravity }
    }

    /// Takes in the acceleration (m/s²) at `t` (s), which is later than all before. A full table forgets its oldest eighth.
    pub fn push(&mut self, t: f64, acceleration: Vec3) {
        if let [.., (before, _), (last, _)] = self.answers[..]
            && last - before < STEP
        {
            self.answers.pop();
        }
        if self.answers.is_full() {
            self.answers.copy_within(ANSWERS / 8.., 0);
            self.answers.truncate(ANSWERS - ANSWERS / 8);
        }
        // There is room: the line above made it.
        let _ = self.answers.push((t, acceleration));
    }

    /// Forgets all answers.
    pub fn clear(&mut self) {
        self.answers.clear();
    }

    /// What is needed from the newest answer on.
    pub fn ahead(&self) -> Tabulated<1> {
        Tabulated { answers: self.answers.last().copied().into_iter().collect(), gravity: self.gravity }
    }
}

impl<const N: usize> Law for Tabulated<N> {
    fn acceleration(&self, gravity: &Vec3, t: f64, _: &Vec3, _: &Vec3) -> Vec3 {
        let next = self.answers.partition_point(|(time, _)| *time < t);
        let (before, after) = (next.checked_sub(1).and_then(|i| self.answers.get(i)), self.answers.get(next));
        let own = match (before, after) {
            (Some((t0, a0)), Some((t1, a1))) => a0 + (a1 - a0) * ((t - t0) / (t1 - t0)),
            (Some((_, a)), None) | (None, Some((_, a))) => *a,
            (None, None) => self.gravity,
        };
        own + (gravity - self.gravity)
    }
}

/// How one object moves: by the configuration's law, or by the user's own.
#[derive(Clone, Debug, PartialEq)]
pub enum Motion<const N: usize = ANSWERS> {
    /// Gravity and the air.
    Fall(FreeFallWithDrag),
    /// What its user's own law answered.
    Own(Tabulated<N>),
}

impl Motion {
    /// What is needed from the newest answer on.
    pub fn ahead(&self) -> Motion<1> {
        match self {
            Self::Fall(law) => Motion::Fall(*law),
            Self::Own(law) => Motion::Own(law.ahead()),
        }
    }
}

impl<const N: usize> Law for Motion<N> {
    fn acceleration(&self, gravity: &Vec3, t: f64, position: &Vec3, velocity: &Vec3) -> Vec3 {
        match self {
            Self::Fall(law) => law.acceleration(gravity, t, position, velocity),
            Self::Own(law) => law.acceleration(gravity, t, position, velocity),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::State;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);

    fn at(law: &dyn Law, t: f64) -> Vec3 {
        law.acceleration(&G, t, &Vec3::zeros(), &Vec3::zeros())
    }

    #[test]
    fn is_linear_between_answers_and_constant_beyond() {
        let mut law = Tabulated::new(G);
        assert_eq!(at(&law, 3.0), G, "before the first answer gravity is all that is known");
        law.push(1.0, Vec3::new(1.0, 0.0, 0.0));
        law.push(2.0, Vec3::new(3.0, 4.0, 0.0));
        let expected = [(0.0, [1.0, 0.0]), (1.0, [1.0, 0.0]), (1.25, [1.5, 1.0]), (2.0, [3.0, 4.0]), (9.0, [3.0, 4.0])];
        for (t, [x, y]) in expected {
            assert!((at(&law, t) - Vec3::new(x, y, 0.0)).norm() < 1e-12, "{t}");
        }
        assert_eq!(at(&law.ahead(), 2.5), at(&law, 2.5));
        let more = G + Vec3::x();
        assert_eq!(law.acceleration(&more, 9.0, &Vec3::zeros(), &Vec3::zeros()), Vec3::new(4.0, 4.0, 0.0));
    }

    #[test]
    fn keeps_the_recent_past_at_any_rate() {
        for rate in [30.0, 120.0, 1000.0] {
            let mut law = Tabulated::new(G);
            for i in 0..5000 {
                let t = f64::from(i) / rate;
                law.push(t, Vec3::x() * t);
                assert!((at(&law, t).x - t).abs() < 1e-9);
            }
            let (from, until) = (law.answers.first().unwrap().0, 4999.0 / rate);
            assert!(until - from > 0.69, "{rate} Hz: {}", until - from);
            for k in 0..=10 {
                let t = from + (until - from) * f64::from(k) / 10.0;
                assert!((at(&law, t).x - t).abs() < 1e-9, "{rate} Hz at {t}");
            }
        }
    }

    #[test]
    fn a_spring_swings_as_its_closed_form() {
        let (omega, mut law): (f64, _) = (3.0, Tabulated::new(G));
        let mut state = State { t: 0.0, position: Vec3::x(), velocity: Vec3::zeros() };
        for i in 1..=30 {
            // Asked where the answers so far put it.
            let t = f64::from(i) / 30.0;
            let there = state.at(t, &law, &G);
            if i == 1 {
                law.push(0.0, -omega * omega * state.position);
            }
            law.push(t, -omega * omega * there.position);
            state = state.at(t, &law, &G);
        }
        assert!((state.position.x - libm::cos(omega)).abs() < 5e-3, "{}", state.position.x);
    }
}
