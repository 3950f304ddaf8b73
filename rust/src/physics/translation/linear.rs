//! The path under one hypothesis: a linear-Gaussian problem about a first guess.

use super::{ACCELERATION, BALLS, Displacement, GLIMPSES, Glimpse, INSTANTS, Problem, REACH, Span, TREMOR};
use crate::math::{Mat3, Vec3, symmetric};
use crate::physics::Sample;
use crate::physics::accumulator::{Accumulator, Solution};
use crate::physics::flight::{Flight, VELOCITY_SD};
use crate::physics::gravity::Gravity;
use heapless::Vec;
use nalgebra::{SMatrix, SVector};

/// Of a ball's position at first, m.
const ANYWHERE: f64 = 10.0;

/// The problem about a first guess. Unknowns: for each ball position and velocity (less the guess, at the ball's first glimpse), then where the camera
/// is at first, how far it goes, gravity (less the guess).
pub(super) struct Linear<const N: usize> {
    /// One for each ball.
    flights: Vec<Flight, BALLS>,
    /// Measured less guessed, one for each glimpse.
    residuals: Vec<Vec3, GLIMPSES>,
    /// How far the camera goes, m, as a search for any motion had it.
    pub(super) way: f64,
}

impl<const N: usize> Linear<N> {
    pub(super) const ANCHOR: usize = N - 9;
    pub(super) const AWAY: usize = N - 6;
    pub(super) const GRAVITY: usize = N - 3;

    pub(super) fn new(problem: &Problem) -> Option<Self> {
        let mut flights = Vec::new();
        for ball in 0..(N - 9) / 6 {
            let mut first = problem.glimpses.iter().filter(|g| g.ball == ball).map(|g| g.sample);
            // By the first few: the camera may move later.
            let samples: Vec<Sample, 6> = first.by_ref().take(6).collect();
            let mut flight = Flight::fit(problem.law, &samples, problem.gravity)?;
            flight.gravity = problem.gravity.mean;
            flight.state = flight.state.at(samples.first()?.t, problem.law, &flight.gravity);
            let _ = flights.push(flight);
        }
        let mut linear = Self { flights, residuals: Vec::new(), way: REACH };
        linear.compare(problem);
        Some(linear)
    }

    fn compare(&mut self, problem: &Problem) {
        let mut states: Vec<_, BALLS> = self.flights.iter().map(|flight| flight.state).collect();
        self.residuals.clear();
        for glimpse in problem.glimpses {
            let Some(state) = states.get_mut(glimpse.ball) else { continue };
            *state = state.at(glimpse.sample.t, problem.law, &problem.gravity.mean);
            let _ = self.residuals.push(glimpse.sample.position - state.position);
        }
    }

    /// Moves the guess to what was found; whether that bends the flights anew.
    pub(super) fn improve(&mut self, problem: &Problem, solution: &Solution<N>) -> bool {
        let mut farthest: f64 = 0.0;
        for (ball, flight) in self.flights.iter_mut().enumerate() {
            flight.state.position += solution.mean.fixed_rows::<3>(6 * ball);
            let change = solution.mean.fixed_rows::<3>(6 * ball + 3);
            flight.state.velocity += change;
            farthest = farthest.max(change.norm());
        }
        self.compare(problem);
        farthest > 1e-3
    }

    /// Where the camera is thought to be at `t` (s), as a part of the way that it goes, and the standard deviation of its displacement about that, m.
    fn freedom(&self, problem: &Problem, span: Span, t: f64) -> (f64, f64) {
        let [from, to] = [span.from, span.to].map(|moment| problem.moment(moment));
        if t <= from || problem.stands(span) {
            return (0.0, TREMOR);
        }
        if t >= to {
            return (1.0, TREMOR);
        }
        if let Some(roughness) = span.roughness() {
            let s = (t - from) / (to - from);
            let bump = 4.0 * s * (1.0 - s);
            return (s * s * s * (10.0 - 15.0 * s + 6.0 * s * s), (roughness * self.way * bump * bump * bump).max(TREMOR));
        }
        let (gone, left) = (t - from, to - t);
        let reach = |dt: f64| (0.5 * ACCELERATION * dt * dt).clamp(TREMOR, REACH);
        (if left < gone { 1.0 } else { 0.0 }, reach(gone.min(left)))
    }

    /// Of a glimpse between two instants what part of its way the camera has gone, and the weight that is left: from the one to the other it went not
    /// quite evenly.
    fn between(&self, problem: &Problem, span: Span, glimpse: &Glimpse, parts: [f64; 2]) -> (f64, Mat3) {
        let (w, weight) = (glimpse.ahead, glimpse.sample.weight);
        let time = |k: usize| problem.instants.get(k).map(|instant| instant.t);
        let (Some(a), Some(b)) = (time(glimpse.instant), time(glimpse.instant + 1)) else { return (parts[0], weight) };
        let [from, to] = [span.from, span.to].map(|moment| problem.moment(moment));
        if w <= 0.0 || b <= from || a >= to || problem.stands(span) {
            return (parts[0], weight);
        }
        let part =
            span.roughness().map_or_else(|| parts[0] + w * (parts[1] - parts[0]), |_| self.freedom(problem, span, a + w * (b - a)).0);
        let sag = 0.5 * ACCELERATION * (b - a) * (b - a) * w * (1.0 - w);
        (part, (Mat3::identity() + weight * (sag * sag)).try_inverse().map_or(weight, |less| symmetric(&(less * weight))))
    }

    /// What one glimpse sees of the unknowns when the camera has gone this `part` of its way.
    fn design(&self, glimpse: &Glimpse, part: f64) -> SMatrix<f64, 3, N> {
        let s = self.flights.get(glimpse.ball).map_or(0.0, |flight| glimpse.sample.t - flight.state.t);
        let blocks =
            [(6 * glimpse.ball, 1.0), (6 * glimpse.ball + 3, s), (Self::ANCHOR, -1.0), (Self::AWAY, -part), (Self::GRAVITY, 0.5 * s * s)];
        let mut design = SMatrix::zeros();
        for (first, coefficient) in blocks {
            for axis in 0..3 {
                design[(axis, first + axis)] = coefficient;
            }
        }
        design
    }

    /// Where the camera is when it has gone this `part` of its way.
    fn standing(part: f64) -> SMatrix<f64, 3, N> {
        let mut design = SMatrix::zeros();
        for axis in 0..3 {
            design[(axis, Self::ANCHOR + axis)] = 1.0;
            design[(axis, Self::AWAY + axis)] = part;
        }
        design
    }

    /// The normal equations under the hypothesis that the camera moved in `span`.
    pub(super) fn fit(&self, problem: &Problem, span: Span) -> Accumulator<N> {
        self.fit_with(problem, span, |_| ())
    }

    /// The same; what is known of the displacement at each instant goes to `each`.
    fn fit_with(&self, problem: &Problem, span: Span, mut each: impl FnMut(Link<N>)) -> Accumulator<N> {
        let mut fit = Accumulator::<N>::default();
        let known = |sd: f64| Mat3::from_diagonal_element(1.0 / (sd * sd));
        for ball in 0..self.flights.len() {
            fit.expect_block(6 * ball, &Vec3::zeros(), &known(ANYWHERE));
            fit.expect_block(6 * ball + 3, &Vec3::zeros(), &known(VELOCITY_SD));
        }
        let anchor = problem.anchor.covariance + Mat3::from_diagonal_element(TREMOR * TREMOR);
        let about = anchor.try_inverse().unwrap_or_else(|| known(TREMOR));
        fit.expect_block(Self::ANCHOR, &problem.anchor.mean, &about);
        fit.expect_block(Self::AWAY, &Vec3::zeros(), &known(problem.reach(span)));
        let guess = Gravity { mean: Vec3::zeros(), size: None, ..*problem.gravity };
        fit.expect_block(Self::GRAVITY, &guess.mean, &guess.information);
        if let Some(size) = problem.gravity.size {
            // Its size is known, as exactly as the guess's direction lets it be one number.
            let direction = problem.gravity.mean / size;
            let mut row = SVector::<f64, N>::zeros();
            row.fixed_rows_mut::<3>(Self::GRAVITY).copy_from(&direction);
            let curvature = problem.gravity.spread() / size;
            fit.observe(&row, 0.0, crate::math::hypot(0.02, curvature));
        }
        let mut glimpses = problem.glimpses.iter().zip(&self.residuals).peekable();
        let freedom = |k: usize| problem.instants.get(k).map_or((1.0, TREMOR), |instant| self.freedom(problem, span, instant.t));
        let (mut link, mut free) = (Link::<N>::default(), freedom(0));
        for (k, instant) in problem.instants.iter().enumerate() {
            let (mut next, next_free) = (Link::<N>::default(), freedom(k + 1));
            let prior = known(free.1);
            link.part = free.0;
            link.information += prior;
            fit.normalise(&prior);
            while let Some((glimpse, residual)) = glimpses.next_if(|(glimpse, _)| glimpse.instant <= k) {
                let (part, weight) = self.between(problem, span, glimpse, [free.0, next_free.0]);
                let design = self.design(glimpse, part);
                fit.observe_design(&design, residual, &weight);
                link.see(-(1.0 - glimpse.ahead), &design, residual, &weight);
                if glimpse.ahead > 0.0 {
                    next.see(-glimpse.ahead, &design, residual, &weight);
                    link.onward += weight * (glimpse.ahead * (1.0 - glimpse.ahead));
                }
            }
            let (shown, seen) = &instant.structure;
            if *seen != Mat3::zeros() {
                let standing = Self::standing(free.0);
                fit.observe_design(&standing, shown, seen);
                link.see(1.0, &standing, shown, seen);
            }
            fit.integrate_out(&link.information, &link.cross, &link.vector);
            if link.onward != Mat3::zeros()
                && let Some(own) = link.information.try_inverse()
            {
                let pull = link.onward * own;
                next.information -= pull * link.onward;
                next.cross -= pull * link.cross;
                next.vector -= pull * link.vector;
            }
            each(link);
            (link, free) = (next, next_free);
        }
        fit
    }

    /// The camera's displacement at each instant under `span`.
    pub(super) fn path(&self, problem: &Problem, span: Span) -> Option<Vec<Displacement, INSTANTS>> {
        let mut links: Vec<Link<N>, INSTANTS> = Vec::new();
        let solution = self.fit_with(problem, span, |link| _ = links.push(link)).solve()?;
        // From the last one back: each displacement less where the camera would stand is `vector` − `cross` · unknowns, and has a `covariance` beside.
        let (mut cross, mut vector, mut covariance) = (SMatrix::<f64, 3, N>::zeros(), Vec3::zeros(), Mat3::zeros());
        let mut path = Vec::new();
        for link in links.iter().rev() {
            let own = link.information.try_inverse()?;
            let pull = own * link.onward;
            cross = own * link.cross - pull * cross;
            vector = own * link.vector - pull * vector;
            covariance = own + pull * covariance * pull.transpose();
            let of_unknowns = Self::standing(link.part) - cross;
            let _ = path.push(Displacement {
                mean: of_unknowns * solution.mean + vector,
                covariance: symmetric(&(of_unknowns * solution.covariance * of_unknowns.transpose() + covariance)),
            });
        }
        path.reverse();
        Some(path)
    }
}

/// What is known of the camera's displacement at an instant, less where it would stand when it has gone `part` of its way:
/// `information` · it + `cross` · unknowns + `onward` · the next instant's = `vector`.
struct Link<const N: usize> {
    part: f64,
    information: Mat3,
    cross: SMatrix<f64, 3, N>,
    onward: Mat3,
    vector: Vec3,
}

impl<const N: usize> Default for Link<N> {
    fn default() -> Self {
        Self { part: 0.0, information: Mat3::zeros(), cross: SMatrix::zeros(), onward: Mat3::zeros(), vector: Vec3::zeros() }
    }
}

impl<const N: usize> Link<N> {
    /// An observation y = `coefficient` · displacement + `design` · unknowns + noise.
    fn see(&mut self, coefficient: f64, design: &SMatrix<f64, 3, N>, y: &Vec3, weight: &Mat3) {
        let weighed = weight * coefficient;
        self.information += weighed * coefficient;
        self.cross += weighed * design;
        self.vector += weighed * y;
    }
}
