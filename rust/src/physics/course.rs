//! Where a ball goes among known surfaces: it flies by the law, bounces where it meets one, and rolls where it bounces no more.

use crate::geometry::environment::{Environment, Sweep};
use crate::math::{Mat3, Vec3, ceil};
use crate::physics::flight::{Flight, Prediction};
use crate::physics::law::{Law, State};
use heapless::Vec;
use nalgebra::SVector;

/// How much of its speed along a surface a bounce takes from a ball: all between none and the 2/5 that a hollow ball's skin takes until it
/// rolls, as mean and standard deviation.
const GRIP: (f64, f64) = (0.2, 0.115);
/// What a spin changes of the velocity along a surface, as part of the speed of the ball's skin: that of a hollow ball.
const SPIN: f64 = 0.4;
/// A ball that would leave a surface more slowly than this rolls on it, m/s: it would hop a millimetre.
const HOP: f64 = 0.15;
/// Part of gravity along a slope that moves a rolling ball: between 5/7 (solid) and 3/5 (hollow).
const ROLLING: f64 = 0.65;
/// A ball that rolls and is further from a surface than this has left it, m.
const LIFT: f64 = 2e-3;
/// Steps along a course, s, and how many at the most; of a longer course they grow.
const STEP: f64 = 0.02;
const MOST_STEPS: f64 = 256.0;
/// Bounces at the most; a ball that rattles on is as good as at rest.
const BOUNCES: usize = 64;
/// Steps in which it is asked whether a surface is met at all, s, how many at the most, and how far the way bends from a straight one in each, m.
const GLANCE: (f64, f64, f64) = (0.04, 64.0, 2e-3);

/// The surfaces, and what a kind of ball does among them.
#[derive(Clone, Copy)]
pub struct Course<'a> {
    /// What is known.
    pub environment: &'a Environment,
    /// How it flies.
    pub law: &'a dyn Law,
    /// Gravity, m/s².
    pub gravity: Vec3,
    /// Radius, m.
    pub radius: f64,
    /// How long a bounce touches, s.
    pub duration: f64,
    /// Standard deviation of an unknown spin, rad/s.
    pub spin_sd: f64,
    /// Restitution on the surface of an id: mean and standard deviation.
    pub restitution: &'a dyn Fn(u32) -> (f64, f64),
}

/// What is not known of a bounce, in standard deviations.
#[derive(Clone, Copy)]
struct Luck {
    restitution: f64,
    grip: f64,
}

/// How it gets on.
#[derive(Clone, Copy, PartialEq)]
enum Gait {
    Flies,
    /// On a surface, as gravity lets it.
    Rolls,
    /// On a surface, with the acceleration along it that was measured, m/s².
    Carried(Vec3),
}

/// A ball on its way.
struct Ball<'a> {
    state: State,
    gravity: Vec3,
    luck: Luck,
    gait: Gait,
    course: &'a Course<'a>,
    /// When all ends, s.
    end: f64,
    /// What bounces add to the covariance of the center at the end, m².
    spread: Mat3,
    bounces: usize,
}

impl Course<'_> {
    /// Where the ball of `flight` is at `t` (s), a surface having `carried` it so far or not, and how well that is known: with what is known
    /// of the flight, of the time of impact, the restitution, the friction and where the surfaces are. `None` where it meets none, and the
    /// law tells all.
    ///
    /// Sigma points (after Julier and Uhlmann, "Unscented filtering and nonlinear estimation", 2004) rather than a linearisation, which an
    /// edge makes a fool of: a ball may bounce off a table or pass it by. Each direction of the flight's uncertainty is tried both ways
    /// with restitution and grip both ways, so that mean and covariance are exact wherever all is linear.
    pub fn predict(&self, flight: &Flight, carried: bool, t: f64) -> Option<Prediction> {
        if self.environment.count() == 0 || flight.count < 2 || t <= flight.state.t || !self.meets(flight, carried, t) {
            return None;
        }
        // Gravity that is known has no direction worth trying.
        let directions = if carried || flight.gravity_sd() > 1e-3 { 9 } else { 6 };
        let rounding = SVector::<f64, 9>::from_fn(|i, _| if i < 3 { 1e-12 } else { 1e-10 });
        let root = (flight.covariance + nalgebra::SMatrix::from_diagonal(&rounding)).cholesky()?.unpack();
        let reach = crate::math::sqrt(f64::from(directions));
        let share = 1.0 / f64::from(4 * directions);
        let mut ends: Vec<Vec3, 36> = Vec::new();
        let (mut position, mut velocity, mut covariance) = (Vec3::zeros(), Vec3::zeros(), Mat3::zeros());
        for (i, (side, restitution)) in
            (0..directions as usize).flat_map(|i| [(1.0, 1.0), (1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0)].map(|luck| (i, luck)))
        {
            let off = root.column(i) * (reach * side);
            let part = |k: usize| -> Vec3 { off.fixed_rows::<3>(k).into() };
            let State { t: since, position: center, velocity: speed } = flight.state;
            let state = State { t: since, position: center + part(0), velocity: speed + part(3) };
            let (end, spread) = self.follow(state, &(flight.gravity + part(6)), carried, Luck { restitution, grip: side * restitution }, t);
            position += end.position * share;
            velocity += end.velocity * share;
            covariance += spread * share;
            // There is room for four of each of nine directions.
            let _ = ends.push(end.position);
        }
        for end in ends {
            covariance += (end - position) * (end - position).transpose() * share;
        }
        Some(Prediction { state: State { t, position, velocity }, covariance })
    }

    /// Whether the ball may meet a surface before `t`, or one carries it.
    fn meets(&self, flight: &Flight, carried: bool, t: f64) -> bool {
        let (start, span) = (flight.state, t - flight.state.t);
        if carried {
            let covariance: Mat3 = flight.covariance.fixed_view::<3, 3>(0, 0).into();
            return self.environment.may_touch(&start.position, &start.position, &covariance, self.radius);
        }
        let steps = ceil(span / GLANCE.0).clamp(1.0, GLANCE.1);
        let mut from = start.position;
        (1..=steps as u32).any(|i| {
            let there = flight.predict(self.law, start.t + span * f64::from(i) / steps);
            let before = core::mem::replace(&mut from, there.state.position);
            self.environment.may_touch(&before, &from, &there.covariance, self.radius + GLANCE.2)
        })
    }

    /// The end of one course, and the covariance that its bounces add there.
    fn follow(&self, state: State, pull: &Vec3, carried: bool, luck: Luck, t: f64) -> (State, Mat3) {
        let (gravity, gait) = if carried { (self.gravity, Gait::Carried(*pull)) } else { (*pull, Gait::Flies) };
        let mut ball = Ball { state, gravity, luck, gait, course: self, end: t, spread: Mat3::zeros(), bounces: 0 };
        let span = t - state.t;
        let step = span / ceil(span / STEP).clamp(1.0, MOST_STEPS);
        while ball.state.t < t && ball.bounces < BOUNCES {
            let until = (ball.state.t + step).min(t);
            if ball.gait == Gait::Flies {
                ball.fly(until);
            } else {
                ball.roll(until);
            }
        }
        (State { t, ..ball.state }, ball.spread)
    }
}

impl Ball<'_> {
    /// Flies on until `until` or a bounce.
    fn fly(&mut self, until: f64) {
        let Course { environment, law, radius, .. } = *self.course;
        let next = self.state.at(until, law, &self.gravity);
        if let Some(hit) = environment.sweep(&self.state.position, &next.position, radius) {
            // The way is an arc, and touches a little later than its chord.
            let guess = self.state.at(self.state.t + hit.fraction * (until - self.state.t), law, &self.gravity);
            let closing = -hit.normal.dot(&guess.velocity);
            if closing > 0.0 {
                let late = hit.normal.dot(&(guess.position - hit.center)) / closing;
                self.state = self.state.at((guess.t + late).clamp(self.state.t, until), law, &self.gravity);
                return self.bounce(&hit);
            }
        }
        self.state = next;
    }

    fn bounce(&mut self, hit: &Sweep) {
        let normal = &hit.normal;
        let (mean, sd) = (self.course.restitution)(hit.surface);
        let e = (mean + self.luck.restitution * sd).clamp(0.0, 1.0);
        let into = -normal.dot(&self.state.velocity);
        let along = self.state.velocity + normal * into;
        let after = along * (1.0 - GRIP.0 - self.luck.grip * GRIP.1);
        let off = e * into;
        // Gravity must hold it there.
        let stays = off < HOP && normal.dot(&self.gravity) < 0.0;
        self.gait = if stays { Gait::Rolls } else { Gait::Flies };
        // It leaves from as far away as it came to, moved along the surface meanwhile.
        let touch = self.course.duration.min(self.end - self.state.t);
        self.state = State {
            t: self.state.t + touch,
            position: self.state.position + (along + after) * (0.5 * touch),
            velocity: if stays { after } else { after + normal * off },
        };
        let outwards = normal * normal.transpose();
        let rise = if stays { hit.sd } else { (1.0 + e) * hit.sd };
        self.spread += outwards * (rise * rise);
        // After the first bounce its spin is that of the bounce.
        if self.bounces == 0 {
            let swerve = SPIN * self.course.spin_sd * self.course.radius * (self.end - self.state.t);
            self.spread += (Mat3::identity() - outwards) * (swerve * swerve);
        }
        self.bounces += 1;
    }

    /// Rolls on until `until` or what is in its way.
    fn roll(&mut self, until: f64) {
        let Course { environment, radius, .. } = *self.course;
        let gait = core::mem::replace(&mut self.gait, Gait::Flies);
        // Of a ball that was seen to be carried the center is only measured; another is where it rolls.
        let near = |distance: f64| gait != Gait::Rolls || (distance - radius).abs() < LIFT;
        let held =
            environment.nearest(&self.state.position).filter(|(distance, normal, _)| near(*distance) && normal.dot(&self.gravity) < 0.0);
        let Some((distance, normal, surface)) = held else { return self.fly(until) };
        let level = |v: Vec3| v - normal * normal.dot(&v);
        let (dt, velocity) = (until - self.state.t, level(self.state.velocity));
        let pull = match gait {
            // What slows it down does not turn it round.
            Gait::Carried(pull) if (velocity + level(pull) * dt).dot(&velocity) <= 0.0 => -velocity / dt,
            Gait::Carried(pull) => level(pull),
            _ => level(self.gravity) * ROLLING,
        };
        let from = self.state.position + normal * (radius - distance);
        let to = from + velocity * dt + pull * (0.5 * dt * dt);
        let obstacle = environment.sweep(&from, &to, radius).filter(|hit| hit.surface != surface && -hit.normal.dot(&velocity) > HOP);
        if let Some(hit) = obstacle {
            self.state = State { t: self.state.t + hit.fraction * dt, position: hit.center, velocity };
            return self.bounce(&hit);
        }
        self.state = State { t: until, position: to, velocity: velocity + pull * dt };
        // An edge is where it falls.
        let still = environment.nearest(&to).is_some_and(|(distance, ..)| (distance - radius).abs() < LIFT);
        self.gait = if still { gait } else { Gait::Flies };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::{EnvironmentConfig, KnownBox, KnownPlane};
    use crate::geometry::environment::SURVEY_SD;
    use crate::math::sqrt;
    use crate::physics::Sample;
    use crate::physics::gravity::Gravity;
    use crate::physics::law::FreeFall;

    const G: Vec3 = Vec3::new(0.0, 0.0, -9.81);
    const RADIUS: f64 = 0.033;

    /// A floor, and a table with its edge at x = 1.
    fn room() -> Environment {
        let mut config = EnvironmentConfig::default();
        config.plane.push(KnownPlane::default()).unwrap();
        config.r#box.push(KnownBox { center: [0.5, 0.0, 0.35], size: [1.0, 1.0, 0.7], ..KnownBox::default() }).unwrap();
        Environment::new(&config)
    }

    fn flown(law: &dyn Law, end: State, gravity: &Gravity, sd: f64) -> Flight {
        let samples: [Sample; 10] = core::array::from_fn(|i| {
            let t = end.t - f64::from(9 - i as u32) / 30.0;
            Sample::isotropic(t, end.at(t, law, &gravity.mean).position, sd)
        });
        Flight::fit(law, &samples, gravity).unwrap()
    }

    fn course<'a>(environment: &'a Environment, restitution: &'a dyn Fn(u32) -> (f64, f64)) -> Course<'a> {
        Course { environment, law: &FreeFall, gravity: G, radius: RADIUS, duration: 0.0, spin_sd: 0.0, restitution }
    }

    fn state(position: [f64; 3], velocity: [f64; 3]) -> State {
        State { t: 1.0, position: position.into(), velocity: velocity.into() }
    }

    #[test]
    fn a_drop_bounces_as_in_the_textbook_and_the_restitution_is_what_is_unknown() {
        let (environment, sd) = (room(), 0.05);
        let restitution = |_| (0.75, sd);
        // Half a metre above where it touches, at rest.
        let flight = flown(&FreeFall, state([2.0, 0.0, RADIUS + 0.5], [0.0; 3]), &Gravity::known(G), 1e-5);
        let (fall, speed) = (sqrt(2.0 * 0.5 / 9.81), sqrt(2.0 * 0.5 * 9.81));
        for since in [0.05, 0.1, 0.2] {
            let there = course(&environment, &restitution).predict(&flight, false, 1.0 + fall + since).unwrap();
            let height = RADIUS + 0.75 * speed * since - 0.5 * 9.81 * since * since;
            assert!((there.state.position - Vec3::new(2.0, 0.0, height)).norm() < 1e-4, "{since} {}", there.state.position);
            let expected = sqrt((sd * speed * since).powi(2) + (1.75 * SURVEY_SD).powi(2));
            assert!((sqrt(there.covariance[(2, 2)]) / expected - 1.0).abs() < 0.03, "{since} {}", there.covariance);
        }
        assert_eq!(course(&environment, &restitution).predict(&flight, false, 1.0 + 0.5 * fall), None);
        // Touching for a while, it is late by that.
        let soft = Course { duration: 0.0045, ..course(&environment, &restitution) };
        let there = soft.predict(&flight, false, 1.0 + fall + 0.1).unwrap();
        let late = 0.1 - 0.0045;
        assert!((there.state.position.z - (RADIUS + 0.75 * speed * late - 0.5 * 9.81 * late * late)).abs() < 1e-4);
    }

    #[test]
    fn before_a_bounce_the_time_of_impact_is_what_counts() {
        let environment = room();
        let restitution = |_| (0.8, 1e-9);
        // Coming down fast; the flight is known to a centimetre.
        let flight = flown(&FreeFall, state([2.0, 0.0, RADIUS + 0.3], [0.0, 0.0, -3.0]), &Gravity::known(G), 0.01);
        let t = 1.2;
        let there = course(&environment, &restitution).predict(&flight, false, t).unwrap();
        // The closed form, at many flights drawn from what is known of this one: along z alone.
        let (p, v) = (flight.covariance[(2, 2)], flight.covariance[(5, 5)]);
        let across = flight.covariance[(2, 5)];
        let (a, b) = (sqrt(p), across / sqrt(p));
        let c = sqrt(v - b * b);
        let (mut sum, mut squares, mut weight) = (0.0, 0.0, 0.0);
        for i in -20..=20 {
            for j in -20..=20 {
                let (x, y) = (f64::from(i) / 5.0, f64::from(j) / 5.0);
                let (height, speed) = (0.3 + a * x, -3.0 + b * x + c * y);
                let impact = (speed + sqrt(speed * speed + 2.0 * 9.81 * height)) / 9.81;
                let (since, off) = (t - 1.0 - impact, 0.8 * sqrt(speed * speed + 2.0 * 9.81 * height));
                let z = RADIUS + off * since - 0.5 * 9.81 * since * since;
                let w = libm::exp(-0.5 * (x * x + y * y));
                (sum, squares, weight) = (sum + w * z, squares + w * z * z, weight + w);
            }
        }
        let (mean, variance) = (sum / weight, squares / weight - (sum / weight).powi(2));
        assert!((there.state.position.z - mean).abs() < 0.1 * sqrt(variance), "{} {mean}", there.state.position.z);
        let survey = (1.8 * SURVEY_SD).powi(2);
        assert!(((there.covariance[(2, 2)] - survey) / variance - 1.0).abs() < 0.1, "{} {variance}", there.covariance[(2, 2)]);
    }

    #[test]
    fn a_slow_ball_rolls_and_falls_off_the_edge() {
        let environment = room();
        let restitution = |_| (0.5, 0.01);
        // It drops three millimetres, and would hop less than one.
        let hops = flown(&FreeFall, state([0.2, 0.0, 0.703 + RADIUS], [0.5, 0.0, 0.0]), &Gravity::known(G), 1e-4);
        let course = course(&environment, &restitution);
        let on = course.predict(&hops, false, 2.0).unwrap();
        let fall = sqrt(2.0 * 0.003 / 9.81);
        let x = 0.2 + 0.5 * fall + 0.5 * (1.0 - GRIP.0) * (1.0 - fall);
        assert!((on.state.position - Vec3::new(x, 0.0, 0.7 + RADIUS)).norm() < 1e-3, "{}", on.state.position);
        // Its speed is unknown by what a bounce may take.
        assert!((sqrt(on.covariance[(0, 0)]) / (0.5 * GRIP.1 * (1.0 - fall)) - 1.0).abs() < 0.03, "{}", on.covariance);
        let off = course.predict(&hops, false, 3.5).unwrap();
        assert!(off.state.position.x > 1.0 && off.state.position.z < 0.5, "{}", off.state.position);
    }

    #[test]
    fn what_is_carried_stays_on_its_surface_until_that_ends() {
        let environment = room();
        let restitution = |_| (0.5, 0.1);
        let friction = Gravity { mean: Vec3::zeros(), information: Mat3::from_diagonal_element(100.0), size: None };
        let rolls = flown(&FreeFall, state([0.7, 0.0, 0.7 + RADIUS], [1.0, 0.0, 0.0]), &friction, 1e-3);
        let course = course(&environment, &restitution);
        let on = course.predict(&rolls, true, 1.2).unwrap();
        assert!((on.state.position - Vec3::new(0.9, 0.0, 0.7 + RADIUS)).norm() < 5e-3, "{}", on.state.position);
        let falls = course.predict(&rolls, true, 1.55).unwrap();
        assert!((falls.state.position.x - 1.25).abs() < 0.03 && falls.state.position.z < 0.6, "{}", falls.state.position);
        // What nothing known carries goes by the law alone.
        let held = flown(&FreeFall, state([0.7, 0.0, 1.5], [1.0, 0.0, 0.0]), &friction, 1e-3);
        assert_eq!(course.predict(&held, true, 1.2), None);
    }

    #[test]
    fn at_an_edge_it_may_bounce_or_pass() {
        let environment = room();
        let restitution = |_| (0.7, 0.05);
        let sd = |x: f64| {
            let flight = flown(&FreeFall, state([x, 0.0, 1.0], [0.0, 0.0, -2.0]), &Gravity::known(G), 5e-3);
            sqrt(course(&environment, &restitution).predict(&flight, false, 1.3).unwrap().covariance[(2, 2)])
        };
        assert!(sd(1.0 + 0.5 * RADIUS) > 3.0 * sd(0.5), "{} {}", sd(1.0 + 0.5 * RADIUS), sd(0.5));
    }

    #[test]
    fn a_bounce_may_take_its_part_of_the_speed_along_and_a_spin_give_some() {
        let environment = room();
        let restitution = |_| (0.7, 0.05);
        let flight = flown(&FreeFall, state([2.0, 0.0, 0.5], [2.0, 0.0, -1.0]), &Gravity::known(G), 1e-4);
        let plain = course(&environment, &restitution);
        let there = plain.predict(&flight, false, 1.5).unwrap();
        let impact = (-1.0 + sqrt(1.0 + 2.0 * 9.81 * (0.5 - RADIUS))) / 9.81;
        let since = 0.5 - impact;
        assert!((there.state.position.x - (2.0 + 2.0 * impact + 1.6 * since)).abs() < 2e-3, "{}", there.state.position);
        assert!((sqrt(there.covariance[(0, 0)]) / (2.0 * GRIP.1 * since) - 1.0).abs() < 0.05, "{}", there.covariance);
        let spinning = Course { spin_sd: 30.0, ..plain }.predict(&flight, false, 1.5).unwrap();
        let more = spinning.covariance - there.covariance;
        let expected = (0.4 * 30.0 * RADIUS * since).powi(2);
        assert!((more[(1, 1)] / expected - 1.0).abs() < 0.05 && more[(2, 2)].abs() < 1e-12, "{more}");
    }

    #[test]
    fn whatever_it_meets_and_however_late_it_comes_to_an_end() {
        let environment = room();
        let restitution = |_| (1.0, 0.3);
        let course = course(&environment, &restitution);
        for (position, velocity) in
            [([0.5, 0.0, 0.3], [0.1, 0.2, 0.3]), ([2.0, 0.0, 0.0], [9.0, -9.0, -50.0]), ([1.0 + RADIUS, 0.0, RADIUS], [0.0; 3])]
        {
            let flight = flown(&FreeFall, state(position, velocity), &Gravity::of_known_size(G), 0.05);
            for t in [1.0, 1.01, 2.0, 100.0, 1e9] {
                if let Some(there) = course.predict(&flight, false, t) {
                    assert!(there.state.position.iter().chain(&there.covariance).all(|x| x.is_finite()), "{t} {there:?}");
                    assert!(there.covariance.cholesky().is_some(), "{t} {there:?}");
                }
            }
        }
    }
}
