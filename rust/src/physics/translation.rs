//! How a camera of known orientation moved while balls flew before it: sec. 3.1 (ii), camera path = predicted − measured.
//!
//! The paper takes the ball's first velocity and predicts from there. Here the path is one linear-Gaussian problem: the balls' states, where the
//! camera stood before and after, and in each instant between a displacement of its own, which is integrated out; from one instant to the next it
//! goes evenly. When the camera began to
//! move, when it stopped and how smoothly it went are hypotheses, weighed by their evidence. Smoothness tells most of when it stood, and so of how
//! fast the ball is: what is no more than a millimetre in the first frame of a motion would else be taken for the ball's.
//!
//! What no flight tells is taken for granted: that the camera stands as the first flight begins (a constant velocity is the ball's as well).

use crate::math::{Mat3, Vec3, exp, symmetric};
use crate::physics::Sample;
use crate::physics::accumulator::{Accumulator, Solution};
use crate::physics::flight::{Flight, VELOCITY_SD};
use crate::physics::gravity::Gravity;
use crate::physics::law::Law;
use crate::physics::paper;
use heapless::Vec;
use nalgebra::{SMatrix, SVector};

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
/// Of a ball's position at first, m.
const ANYWHERE: f64 = 10.0;
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

/// The problem about a first guess. Unknowns: for each ball position and velocity (less the guess, at the ball's first glimpse), then where the camera
/// is at first, how far it goes, gravity (less the guess).
struct Linear<const N: usize> {
    /// One for each ball.
    flights: Vec<Flight, BALLS>,
    /// Measured less guessed, one for each glimpse.
    residuals: Vec<Vec3, GLIMPSES>,
    /// How far the camera goes, m, as a search for any motion had it.
    way: f64,
}

impl<const N: usize> Linear<N> {
    const ANCHOR: usize = N - 9;
    const AWAY: usize = N - 6;
    const GRAVITY: usize = N - 3;

    fn new(problem: &Problem) -> Option<Self> {
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
    fn improve(&mut self, problem: &Problem, solution: &Solution<N>) -> bool {
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
    fn fit(&self, problem: &Problem, span: Span) -> Accumulator<N> {
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
    fn path(&self, problem: &Problem, span: Span) -> Option<Vec<Displacement, INSTANTS>> {
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
