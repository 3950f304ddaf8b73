//! How a camera of known orientation moved while balls flew before it: sec. 3.1 (ii), camera path = predicted − measured.
//!
//! The paper takes the ball's first velocity and predicts from there. Here the path is one linear-Gaussian problem: the balls' states, where the
//! camera stood before and after, and in each instant between a displacement of its own, which is integrated out; from one instant to the next it
//! goes evenly (`linear`). When the camera began to move, when it stopped and how smoothly it went are hypotheses, weighed by their evidence.
//! Smoothness tells most of when it stood, and so of how fast the ball is: what is no more than a millimetre in the first frame of a motion would
//! else be taken for the ball's.
//!
//! What no flight tells is taken for granted: that the camera stands as the first flight begins (a constant velocity is the ball's as well).

mod linear;

use self::linear::Linear;
use crate::math::{Mat3, Vec3, exp, symmetric};
use crate::physics::Sample;
use crate::physics::gravity::Gravity;
use crate::physics::law::Law;
use crate::physics::paper;
use heapless::Vec;

/// Instants solved together: 3 s of a Kinect.
pub const INSTANTS: usize = 96;
/// Balls that share the camera.
pub const BALLS: usize = 4;
/// Glimpses of them.
pub const GLIMPSES: usize = INSTANTS * BALLS;
/// Acceleration of a camera that is moved by hand, m/s² an axis (standard deviation).
pub const ACCELERATION: f64 = 6.0;
/// It gets no farther than this within a flight, m (standard deviation).
const REACH: f64 = 0.3;
/// One that stands is as still as this, m: on a table, or in a hand that keeps still.
const TREMOR: f64 = 1e-4;
/// How far, as a part of the way, a hand strays in the middle of it from the motion with least jerk (Flash and Hogan, J. Neurosci. 5, 1985): one that
/// is smooth, and one that is not so smooth. What else it does is bounded by [`ACCELERATION`] alone.
const ROUGHNESSES: [f64; 2] = [0.05, 0.2];
/// Smooth motions are tried with their ends up to so many halves of an instant from where any motion's are.
const HALVES: usize = 4;
/// Moments at which motion may begin or end that are tried at first; between the best ones all are.
const MOMENTS: usize = 20;
/// Log of the prior probability that the camera stands throughout; likewise that it moves, and that it moves and stops.
const STANDS: f64 = 0.5;

/// An instant.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Instant {
    /// Time, s.
    pub t: f64,
    /// Where static structure shows the camera then, world axes, m, and the information of that, 1/m²: none along what it says nothing of.
    pub structure: (Vec3, Mat3),
}

/// A ball's measured center at an instant: in world axes, from a camera that is thought not to have moved.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Glimpse {
    /// Index of the instant, the newest that is not after it.
    pub instant: usize,
    /// When, as a part of the time from that instant to the next.
    pub ahead: f64,
    /// Which ball, below [`BALLS`].
    pub ball: usize,
    /// When and where.
    pub sample: Sample,
}

/// Where the camera is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Displacement {
    /// World axes, m.
    pub mean: Vec3,
    /// m².
    pub covariance: Mat3,
}

/// The camera's path.
#[derive(Clone, Debug)]
pub struct Translation {
    /// At each instant.
    pub path: Vec<Displacement, INSTANTS>,
    /// Probability that the camera stood all the time.
    pub still: f64,
    /// Weighted squares of the best hypothesis' residuals, and how many numbers were left over to make them.
    pub chi2: (f64, f64),
}

impl Translation {
    /// Where the camera is a part of the time `ahead` of an instant, on its way to the next.
    pub fn at(&self, instant: usize, ahead: f64) -> Option<Displacement> {
        let here = self.path.get(instant)?;
        let next = self.path.get(instant + 1).unwrap_or(here);
        let between = |a: f64, b: f64| a + ahead * (b - a);
        // How the two err together is not known: at the worst, wholly.
        Some(Displacement { mean: here.mean.zip_map(&next.mean, between), covariance: here.covariance.zip_map(&next.covariance, between) })
    }
}

/// When the camera moved: it stood up to one moment, and again from the other one on; in halves of instants. And how: as any of [`ROUGHNESSES`], or
/// anyhow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Span {
    from: u16,
    to: u16,
    smooth: Option<u8>,
}

impl Span {
    /// Any motion between two instants.
    fn any(from: usize, to: usize) -> Self {
        Self { from: 2 * from as u16, to: 2 * to as u16, smooth: None }
    }

    fn roughness(self) -> Option<f64> {
        ROUGHNESSES.get(usize::from(self.smooth?)).copied()
    }
}

/// How many hypotheses are weighed at most.
const SPANS: usize = 768;
type Weighed = Vec<(Span, f64), SPANS>;

/// Moves of a camera, seen by balls.
pub struct Problem<'a> {
    /// How a ball flies.
    pub law: &'a dyn Law,
    /// What is known of gravity.
    pub gravity: &'a Gravity,
    /// In the order of time, about as far apart as a hand's motion is new.
    pub instants: &'a [Instant],
    /// In the order of time.
    pub glimpses: &'a [Glimpse],
    /// Where the camera is thought to be at the first instant.
    pub anchor: Displacement,
}

impl Problem<'_> {
    /// The path; `None` without instants, with too many, or where nothing makes sense.
    pub fn solve(&self) -> Option<Translation> {
        match self.glimpses.iter().map(|g| g.ball + 1).max().unwrap_or(0) {
            0 => self.solve_with::<9>(),
            1 => self.solve_with::<15>(),
            2 => self.solve_with::<21>(),
            3 => self.solve_with::<27>(),
            BALLS => self.solve_with::<33>(),
            _ => None,
        }
    }

    /// The paper's path: each ball's first two glimpses give its velocity, from there it is predicted by Eq. 5, run on from its own predictions, and
    /// the camera is where prediction and measurement differ; the mean over the balls. θ (m) is all that the paper says of its errors: the first
    /// step has it, and each later one as much more.
    pub fn solve_by_paper(&self, theta: f64) -> Translation {
        let displacement = |k: usize| {
            let (mut sum, mut steps, mut count) = (Vec3::zeros(), 0, 0.0);
            for ball in 0..BALLS {
                let mut own = self.at_instants(ball);
                if let (Some(first), Some(second), Some(glimpse)) =
                    (own.next(), own.next(), self.at_instants(ball).find(|g| g.instant == k))
                    && let Some(predicted) = paper::predict(&first.sample, &second.sample, glimpse.sample.t, &self.gravity.mean)
                {
                    sum += predicted - glimpse.sample.position;
                    steps = steps.max(k - first.instant);
                    count += 1.0;
                }
            }
            let sd = if count > 0.0 { theta * (1 + steps) as f64 } else { REACH };
            let mean = self.anchor.mean + if count > 0.0 { sum / count } else { Vec3::zeros() };
            Displacement { mean, covariance: Mat3::from_diagonal_element(sd * sd) }
        };
        Translation { path: (0..self.instants.len().min(INSTANTS)).map(displacement).collect(), still: 0.0, chi2: (0.0, 0.0) }
    }

    /// A ball's first glimpse from each instant on.
    fn at_instants(&self, ball: usize) -> impl Iterator<Item = &Glimpse> {
        let mut before = None;
        self.glimpses.iter().filter(move |g| g.ball == ball && before.replace(g.instant) != Some(g.instant))
    }

    fn solve_with<const N: usize>(&self) -> Option<Translation> {
        let mut frame = Linear::<N>::new(self)?;
        let mut weighed = Weighed::new();
        let mut best = self.search(&frame, &mut weighed)?;
        // Drag bends by what the velocities are: once more about the best ones.
        let solution = frame.fit(self, best).solve()?;
        if frame.improve(self, &solution) {
            weighed.clear();
            best = self.search(&frame, &mut weighed)?;
        }
        frame.way = frame.fit(self, best).solve()?.mean.fixed_rows::<3>(Linear::<N>::AWAY).norm();
        self.search_smooth(&frame, best, &mut weighed);
        best = top(&weighed)?;
        let top = weighed.iter().map(|(_, log)| *log).fold(f64::NEG_INFINITY, f64::max);
        weighed.retain(|(_, log)| log - top > -12.0);
        let total: f64 = weighed.iter().map(|(_, log)| exp(log - top)).sum();
        let nowhere = Displacement { mean: Vec3::zeros(), covariance: Mat3::zeros() };
        let mut path: Vec<Displacement, INSTANTS> = self.instants.iter().map(|_| nowhere).collect();
        let mut still = 0.0;
        for (span, log) in &weighed {
            let weight = exp(log - top) / total;
            still += if self.stands(*span) { weight } else { 0.0 };
            for (mixed, here) in path.iter_mut().zip(frame.path(self, *span)?) {
                mixed.mean += here.mean * weight;
                mixed.covariance += (here.covariance + here.mean * here.mean.transpose()) * weight;
            }
        }
        for mixed in &mut path {
            mixed.covariance = symmetric(&(mixed.covariance - mixed.mean * mixed.mean.transpose()));
        }
        let solution = frame.fit(self, best).solve()?;
        let balls = (N - 9) / 6;
        let unknowns = 6.0 * balls as f64 + if self.stands(best) { 0.0 } else { 3.0 };
        let dof = 3.0 * self.glimpses.len() as f64 - unknowns;
        Some(Translation { path, still, chi2: (solution.chi2, dof) })
    }

    /// Weighs a hypothesis that was not weighed before.
    fn weigh<const N: usize>(&self, frame: &Linear<N>, span: Span, weighed: &mut Weighed) {
        if weighed.iter().all(|(tried, _)| *tried != span)
            && let Some(solution) = frame.fit(self, span).solve()
        {
            let _ = weighed.push((span, solution.log_evidence + self.log_prior(span)));
        }
    }

    /// Weighs when the camera may have moved anyhow, coarsely and then finely; the best.
    fn search<const N: usize>(&self, frame: &Linear<N>, weighed: &mut Weighed) -> Option<Span> {
        let last = self.instants.len().checked_sub(1)?;
        let step = self.instants.len().div_ceil(MOMENTS);
        self.weigh(frame, Span::any(last, last), weighed);
        for from in (0..last).step_by(step) {
            self.weigh(frame, Span::any(from, last + 1), weighed);
            (from + 2..=last).step_by(step).for_each(|to| self.weigh(frame, Span::any(from, to), weighed));
        }
        let coarse = top(weighed)?;
        if !self.stands(coarse) && step > 1 {
            let [coarse_from, coarse_to] = [coarse.from, coarse.to].map(|moment| usize::from(moment / 2));
            for from in coarse_from.saturating_sub(step)..(coarse_from + step).min(last) {
                let ends =
                    if coarse_to > last { last + 1..last + 2 } else { coarse_to.saturating_sub(step)..(coarse_to + step).min(last + 1) };
                ends.filter(|to| *to >= from + 2).for_each(|to| self.weigh(frame, Span::any(from, to), weighed));
            }
        }
        top(weighed)
    }

    /// Weighs smooth motions that begin and end about when `any` does; none where that has no end.
    fn search_smooth<const N: usize>(&self, frame: &Linear<N>, any: Span, weighed: &mut Weighed) {
        let end = 2 * self.instants.len().saturating_sub(1);
        let [from, to] = [any.from, any.to].map(usize::from);
        if self.stands(any) || to > end {
            return;
        }
        for from in from.saturating_sub(HALVES)..=from + HALVES {
            for to in to.saturating_sub(HALVES).max(from + 4)..=(to + HALVES).min(end) {
                for smooth in 0..ROUGHNESSES.len() {
                    self.weigh(frame, Span { from: from as u16, to: to as u16, smooth: Some(smooth as u8) }, weighed);
                }
            }
        }
    }

    /// Whether the camera does not move.
    fn stands(&self, span: Span) -> bool {
        usize::from(span.from) + 2 >= 2 * self.instants.len()
    }

    /// The camera stands, or it moves from any instant on, for good or up to any later one; as likely smoothly as anyhow, and then up to any half.
    fn log_prior(&self, span: Span) -> f64 {
        let (count, moves) = (self.instants.len() as f64, 1.0 - STANDS);
        let part = match span.smooth {
            _ if self.stands(span) => STANDS,
            _ if usize::from(span.to) + 2 > 2 * self.instants.len() => 0.5 * moves / count,
            None => 0.5 * moves / (count * count),
            Some(_) => 0.5 * moves / (ROUGHNESSES.len() as f64 * 4.0 * count * count),
        };
        crate::math::log(part)
    }

    /// How far the camera gets in `span`, m (standard deviation): half the time it gathers speed, half it brakes, unless it goes on.
    fn reach(&self, span: Span) -> f64 {
        let last = self.instants.last().map_or(0.0, |instant| instant.t);
        let (from, to) = (self.moment(span.from), self.moment(span.to));
        let (time, part) = if to > last { (last - from, 0.5) } else { (to - from, 0.25) };
        (part * ACCELERATION * time * time).clamp(TREMOR, REACH)
    }

    /// A moment, s.
    fn moment(&self, halves: u16) -> f64 {
        let time = |i: usize| self.instants.get(i).map_or(f64::INFINITY, |instant| instant.t);
        let (before, after) = (usize::from(halves / 2), usize::from(halves.div_ceil(2)));
        0.5 * (time(before) + time(after))
    }
}

/// The best.
fn top(weighed: &[(Span, f64)]) -> Option<Span> {
    weighed.iter().max_by(|a, b| a.1.total_cmp(&b.1)).map(|(span, _)| *span)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::physics::law::{FreeFallWithDrag, State};
    use std::println;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);
    const LAW: FreeFallWithDrag = FreeFallWithDrag { drag: 0.019 };
    const SD: f64 = 1e-3;

    /// Part of the way by part of the time.
    type Shape = fn(f64) -> f64;
    const LEAST_JERK: Shape = |s| s * s * s * (10.0 - 15.0 * s + 6.0 * s * s);
    const LEAST_ACCELERATION: Shape = |s| s * s * (3.0 - 2.0 * s);
    const EVEN: Shape = |s| s;

    /// Numbers like independent normal ones.
    fn noise(seed: &mut u64) -> f64 {
        (0..12)
            .map(|_| {
                *seed = seed.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
                (*seed >> 11) as f64 / (1_u64 << 53) as f64
            })
            .sum::<f64>()
            - 6.0
    }

    /// 25 frames of balls before a camera that goes `travel` in mid-flight; the path found, and the true one.
    fn solve(balls: usize, travel: Vec3, shape: Shape, gravity: &Gravity, seed: &mut u64) -> (Translation, std::vec::Vec<Vec3>) {
        let part = |t: f64| shape(((t - 0.24) / 0.34).clamp(0.0, 1.0));
        let truth: std::vec::Vec<Vec3> = (0..25).map(|k| travel * part(f64::from(k) / 30.0)).collect();
        let instants: std::vec::Vec<Instant> =
            (0..25).map(|k| Instant { t: f64::from(k) / 30.0, structure: (Vec3::zeros(), Mat3::zeros()) }).collect();
        let starts = [Vec3::new(0.8, 0.2, 3.6), Vec3::new(-0.5, 0.1, 3.2), Vec3::new(0.1, -0.4, 3.9), Vec3::new(0.0, 0.3, 3.4)];
        let glimpses: std::vec::Vec<Glimpse> = (0..25 * balls)
            .map(|i| {
                let (instant, ball) = (i / balls, i % balls);
                let start = State { t: 0.0, position: Vec3::new(0.3 * ball as f64, 1.5, 0.0), velocity: starts[ball] };
                let t = instants[instant].t;
                let off = Vec3::new(noise(seed), noise(seed), noise(seed)) * SD;
                let seen = start.at(t, &LAW, &G).position - truth[instant] + off;
                Glimpse { instant, ahead: 0.0, ball, sample: Sample::isotropic(t, seen, SD) }
            })
            .collect();
        let anchor = Displacement { mean: Vec3::zeros(), covariance: Mat3::zeros() };
        let found = Problem { law: &LAW, gravity, instants: &instants, glimpses: &glimpses, anchor }.solve().unwrap();
        (found, truth)
    }

    #[test]
    fn a_camera_that_moves_in_mid_flight_is_followed_and_its_covariance_is_honest() {
        // In space a single glimpse is off by 1.7 mm. A motion that starts with a jerk is followed no worse than if nothing was thought of it.
        for (shape, most) in [(LEAST_JERK, 2.3), (LEAST_ACCELERATION, 2.3), (EVEN, 3.0)] {
            let (mut squares, mut nees, mut count, mut seed) = (0.0, 0.0, 0.0, 3);
            for run in 0..20 {
                let angle = f64::from(run);
                let travel = Vec3::new(angle.cos(), 0.3 * angle.sin(), 0.4 * angle.sin()).normalize() * 0.155;
                let (found, truth) = solve(1, travel, shape, &Gravity::known(G), &mut seed);
                assert!(found.still < 1e-6 && found.chi2.0 < 2.0 * found.chi2.1, "{:?}", found.chi2);
                for (found, truth) in found.path.iter().zip(&truth) {
                    let error = found.mean - truth;
                    squares += error.norm_squared();
                    // One that surely stands is known to be there: what is left of its covariance is a tenth of a millimetre.
                    nees += error.dot(&((found.covariance + Mat3::identity() * 1e-8).try_inverse().unwrap() * error)) / 3.0;
                    count += 1.0;
                }
            }
            let (rms, nees) = (crate::math::sqrt(squares / count), nees / count);
            println!("{:.2} mm, NEES {nees:.2}", 1e3 * rms);
            assert!(rms < most * SD, "{rms}");
            // How a path strays from the smoothest is thought to be new in each instant: that is on the safe side.
            assert!((0.5..1.6).contains(&nees), "{nees}");
        }
    }

    #[test]
    fn one_that_stands_is_known_to() {
        let (found, _) = solve(1, Vec3::zeros(), LEAST_JERK, &Gravity::known(G), &mut 5);
        assert!(found.still > 0.9 && found.path.iter().all(|d| d.mean.norm() < 1e-3), "{}", found.still);
    }

    #[test]
    fn balls_share_the_camera() {
        let travel = Vec3::new(0.1, 0.0, 0.1);
        let rms = |balls| {
            let mut seed = 9;
            let squares = (0..10).map(|_| {
                let (found, truth) = solve(balls, travel, LEAST_JERK, &Gravity::known(G), &mut seed);
                found.path.iter().zip(&truth).map(|(d, t)| (d.mean - t).norm_squared()).sum::<f64>() / 25.0
            });
            crate::math::sqrt(squares.sum::<f64>() / 10.0)
        };
        let (one, four) = (rms(1), rms(4));
        assert!(four < 0.75 * one, "{one} {four}");
    }

    #[test]
    fn what_structure_shows_is_believed() {
        let mut seed = 1;
        let (loose, truth) = solve(1, Vec3::new(0.155, 0.0, 0.0), LEAST_JERK, &Gravity::known(G), &mut seed);
        let wall = Mat3::from_diagonal(&Vec3::new(1e8, 0.0, 0.0));
        let instants: std::vec::Vec<Instant> =
            truth.iter().enumerate().map(|(k, d)| Instant { t: k as f64 / 30.0, structure: (*d, wall) }).collect();
        let start = State { t: 0.0, position: Vec3::new(0.0, 1.5, 0.0), velocity: Vec3::new(0.8, 0.2, 3.6) };
        let glimpses: std::vec::Vec<Glimpse> = (truth.iter().enumerate())
            .map(|(k, d)| {
                let t = instants[k].t;
                let off = Vec3::new(noise(&mut seed), noise(&mut seed), noise(&mut seed)) * SD;
                Glimpse { instant: k, ahead: 0.0, ball: 0, sample: Sample::isotropic(t, start.at(t, &LAW, &G).position - d + off, SD) }
            })
            .collect();
        let anchor = Displacement { mean: Vec3::zeros(), covariance: Mat3::zeros() };
        let tied = Problem { law: &LAW, gravity: &Gravity::known(G), instants: &instants, glimpses: &glimpses, anchor }.solve().unwrap();
        assert!(tied.path.iter().zip(&truth).all(|(d, t)| (d.mean.x - t.x).abs() < 4e-4));
        assert!(tied.path[12].covariance[(0, 0)] < 0.1 * loose.path[12].covariance[(0, 0)]);
    }
}
