//! The path of a camera that moves (sec. 3.1 ii): flights of all objects and static structure gathered, solved when a flight is over.

use crate::config::Method;
use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use crate::physics::gravity::Gravity;
use crate::physics::law::Law;
use crate::physics::translation::{BALLS, Displacement, GLIMPSES, Glimpse, INSTANTS, Instant, Problem, Translation};
use crate::time::seconds_between;
use crate::track::drift::{falls, trim};
use heapless::Vec;

/// The path is told when a flight is over for so long, s: what others that still fly show until then helps.
const PATIENCE: f64 = 0.2;
/// Instants that are solved are not closer together than this, s, whatever the rate: up to 40 Hz each frame is one. Between them the camera goes evenly.
const STEP: f64 = 0.024;
/// Measurements of an object within this, s, are averaged.
const BLINK: f64 = 0.012;
/// Frames at the most: 3.2 s at 240 Hz.
const FRAMES: usize = 8 * INSTANTS;
/// A flight counts from so many glimpses on.
const FEWEST: usize = 5;
/// Squares of residuals of what are flights, a degree of freedom.
const PLAUSIBLE: f64 = 3.0;
/// Probability from which on the camera is taken to have stood.
const STOOD: f64 = 0.9;
/// Information in every direction from which on static structure ties the camera down, 1/m²: 1 cm.
const TIED: f64 = 1e4;

/// A frame in which something was tracked.
#[derive(Clone, Copy, Debug)]
struct Frame {
    timestamp_ns: i64,
    number: u64,
    told: bool,
}

/// A frame that is an instant of the path.
#[derive(Clone, Copy, Debug)]
struct Knot {
    timestamp_ns: i64,
    structure: (Vec3, Mat3),
}

/// A measurement, or the mean of a few.
#[derive(Clone, Copy, Debug)]
struct Seen {
    track: u32,
    /// Stamps of its first frame and its last one, ns.
    frames_ns: (i64, i64),
    /// When the first was measured, and the last, ns.
    times_ns: (i64, i64),
    /// Means.
    timestamp_ns: i64,
    time_ns: i64,
    position: Vec3,
    /// Sum.
    weight: Mat3,
    count: i32,
    /// Which flight, once it is over.
    flight: Option<u32>,
}

/// What a solved path says.
#[derive(Clone, Copy, Debug)]
pub enum Told<'a> {
    /// Where the camera was in a frame, and whether static structure ties it down in all directions.
    Moved(u64, Displacement, bool),
    /// While it most probably stood, this was a flight.
    Flown(&'a [Sample]),
}

/// Gathers what shows the camera's path.
#[derive(Debug)]
pub struct CameraMotion {
    frames: Vec<Frame, FRAMES>,
    /// The newest frame is always one.
    knots: Vec<Knot, INSTANTS>,
    seen: Vec<Seen, GLIMPSES>,
    /// Where the camera was in the newest frame that was told.
    anchor: Displacement,
    flights: u32,
    /// End of the newest flight that is over and not told, ns.
    landed_ns: Option<i64>,
}

impl Default for CameraMotion {
    fn default() -> Self {
        let anchor = Displacement { mean: Vec3::zeros(), covariance: Mat3::zeros() };
        Self { frames: Vec::new(), knots: Vec::new(), seen: Vec::new(), anchor, flights: 0, landed_ns: None }
    }
}

impl CameraMotion {
    /// A frame begins, and what static structure shows in it: the camera's displacement (m), and the information of that (1/m²).
    pub fn begin(&mut self, timestamp_ns: i64, frame: u64, structure: (Vec3, Mat3)) {
        if self.frames.last().is_some_and(|last| last.number == frame) {
            return;
        }
        if self.knots.is_empty() {
            self.anchor.covariance += Mat3::from_diagonal_element(self.unseen(&structure));
        }
        if let [.., before, last] = self.knots.as_slice()
            && seconds_between(before.timestamp_ns, last.timestamp_ns) < STEP
        {
            self.knots.pop();
        }
        // Full buffers were told and emptied before.
        let _ = self.knots.push(Knot { timestamp_ns, structure });
        let _ = self.frames.push(Frame { timestamp_ns, number: frame, told: false });
    }

    /// How far (squared, m²) static structure shows the camera from where it was left, beyond what that is uncertain: it moved while nothing was
    /// tracked, and then as far along what structure does not tell.
    fn unseen(&self, (shown, information): &(Vec3, Mat3)) -> f64 {
        let Some(covariance) = (information + Mat3::from_diagonal_element(TIED)).try_inverse() else { return 0.0 };
        let told = covariance * information;
        let off = told * (shown - self.anchor.mean);
        (off.norm_squared() - (told * self.anchor.covariance * told.transpose()).trace()).max(0.0)
    }

    /// An object was measured in the frame that began last.
    pub fn see(&mut self, track: u32, time_ns: i64, position: Vec3, weight: Mat3) {
        let Some(&Frame { timestamp_ns, .. }) = self.frames.last() else { return };
        match self.seen.iter_mut().rev().find(|s| s.track == track) {
            Some(seen) if seen.frames_ns.1 == timestamp_ns => {}
            Some(seen) if seen.flight.is_none() && seconds_between(seen.frames_ns.0, timestamp_ns) < BLINK => {
                seen.count += 1;
                (seen.frames_ns.1, seen.times_ns.1) = (timestamp_ns, time_ns);
                seen.timestamp_ns += (timestamp_ns - seen.timestamp_ns) / i64::from(seen.count);
                seen.time_ns += (time_ns - seen.time_ns) / i64::from(seen.count);
                seen.position += (position - seen.position) / f64::from(seen.count);
                seen.weight += weight;
            }
            _ => {
                let (frames_ns, times_ns) = ((timestamp_ns, timestamp_ns), (time_ns, time_ns));
                // A full buffer was told and emptied before.
                let _ =
                    self.seen.push(Seen { track, frames_ns, times_ns, timestamp_ns, time_ns, position, weight, count: 1, flight: None });
            }
        }
    }

    /// What a track showed from `from_ns` to `to_ns` was a flight, or a piece of none; what it showed before that in no flight was none.
    pub fn land(&mut self, track: u32, from_ns: i64, to_ns: i64) {
        let own = |s: &Seen| s.track == track && s.flight.is_none() && s.times_ns.0 <= to_ns;
        self.seen.retain(|s| !own(s) || (s.times_ns.0 >= from_ns && s.times_ns.1 <= to_ns));
        let count = self.seen.iter().filter(|s| own(s)).count();
        for seen in self.seen.iter_mut().filter(|s| own(s)) {
            seen.flight = Some(self.flights);
            if count >= FEWEST || from_ns == i64::MIN {
                self.landed_ns = self.landed_ns.max(Some(seen.frames_ns.1));
            }
        }
        self.flights += 1;
    }

    /// Tracks that were not seen for long have landed, whether they come back or not.
    pub fn land_silent(&mut self, now_ns: i64) {
        while let Some(track) = self.silent(now_ns) {
            self.land(track, i64::MIN, now_ns);
        }
    }

    fn silent(&self, now_ns: i64) -> Option<u32> {
        let open = self.seen.iter().filter(|s| s.flight.is_none());
        let newest = |track: u32| self.seen.iter().rev().find(|s| s.track == track).map_or(now_ns, |s| s.time_ns);
        open.map(|s| s.track).find(|track| seconds_between(newest(*track), now_ns) > PATIENCE)
    }

    /// The path is due: a flight has been over for long enough, nothing flies any more (`idle`), or there is no more room.
    pub fn is_due(&self, now_ns: i64, idle: bool) -> bool {
        self.is_full()
            || self.landed_ns.map_or(idle && !self.frames.is_empty(), |landed_ns| idle || seconds_between(landed_ns, now_ns) > PATIENCE)
    }

    fn is_full(&self) -> bool {
        self.knots.is_full() || self.frames.is_full() || self.seen.len() + BALLS > GLIMPSES
    }

    /// Solves, and hands out the path up to the newest flight that is over; all of it, and the next one is another, when nothing flies any more or
    /// there is no more room.
    pub fn tell(&mut self, method: (Method, f64), law: &dyn Law, gravity: &Gravity, idle: bool, mut out: impl FnMut(Told<'_>)) {
        let all = idle || self.is_full();
        let until_ns = if all { i64::MAX } else { self.landed_ns.unwrap_or(i64::MIN) };
        self.landed_ns = None;
        let Some(&Knot { timestamp_ns: epoch_ns, .. }) = self.knots.first() else { return };
        let glimpses = self.glimpses(epoch_ns, &gravity.mean);
        let Some(solved) = self.solve(method, law, gravity, epoch_ns, &glimpses) else { return };
        if solved.still > STOOD {
            for ball in 0..BALLS {
                let samples: Vec<Sample, INSTANTS> = glimpses.iter().filter(|g| g.ball == ball).map(|g| g.sample).take(INSTANTS).collect();
                if all && !samples.is_empty() {
                    out(Told::Flown(&samples));
                }
            }
        }
        let knots = &self.knots;
        for frame in self.frames.iter_mut().filter(|frame| !frame.told && frame.timestamp_ns <= until_ns) {
            frame.told = true;
            let (instant, ahead) = place(knots, frame.timestamp_ns);
            let tied = knots.get(instant).is_some_and(|knot| knot.structure.1.symmetric_eigenvalues().min() > TIED);
            if let Some(displacement) = solved.at(instant, ahead) {
                out(Told::Moved(frame.number, displacement, tied));
            }
        }
        if all {
            self.anchor = solved.path.last().copied().unwrap_or(self.anchor);
            self.frames.clear();
            self.knots.clear();
            self.seen.clear();
        }
    }

    fn solve(
        &self,
        (method, theta): (Method, f64),
        law: &dyn Law,
        gravity: &Gravity,
        epoch_ns: i64,
        glimpses: &[Glimpse],
    ) -> Option<Translation> {
        let instant = |knot: &Knot| Instant { t: seconds_between(epoch_ns, knot.timestamp_ns), structure: knot.structure };
        let instants: Vec<Instant, INSTANTS> = self.knots.iter().map(instant).collect();
        let problem = |glimpses| Problem { law, gravity, instants: &instants, glimpses, anchor: self.anchor };
        if method == Method::Paper {
            return Some(problem(glimpses).solve_by_paper(theta));
        }
        // What agrees with no path of the camera were no flights: it tells nothing.
        let agrees = |solved: &Translation| solved.chi2.0 < PLAUSIBLE * solved.chi2.1.max(1.0);
        problem(glimpses).solve().filter(agrees).or_else(|| problem(&[]).solve())
    }

    /// The glimpses of the flights that show most, those that go on among them.
    fn glimpses(&self, epoch_ns: i64, gravity: &Vec3) -> Vec<Glimpse, GLIMPSES> {
        let sample = |s: &Seen| Sample { t: seconds_between(epoch_ns, s.time_ns), position: s.position, weight: s.weight, half_span: 0.0 };
        let mut flights: Vec<(u32, Option<u32>), 32> = Vec::new();
        for flight in self.seen.iter().map(Seen::flight) {
            if !flights.contains(&flight) {
                let _ = flights.push(flight);
            }
        }
        let whole = |flight: &(u32, Option<u32>)| {
            let samples: Vec<Sample, INSTANTS> = self.seen.iter().filter(|s| s.flight() == *flight).map(sample).take(INSTANTS).collect();
            let sure = trim(&samples, gravity);
            let (first, last) = (sure.first()?, sure.last()?);
            (sure.len() >= FEWEST && falls(sure, gravity)).then_some((*flight, sure.len(), first.t..=last.t))
        };
        let mut flights: Vec<_, 32> = flights.iter().filter_map(whole).collect();
        flights.sort_unstable_by_key(|(_, count, _)| core::cmp::Reverse(*count));
        flights.truncate(BALLS);
        let glimpse = |seen: &Seen| {
            let sample = sample(seen);
            let ball = flights.iter().position(|(flight, _, span)| *flight == seen.flight() && span.contains(&sample.t))?;
            let (instant, ahead) = place(&self.knots, seen.timestamp_ns);
            Some(Glimpse { instant, ahead, ball, sample })
        };
        let mut glimpses: Vec<Glimpse, GLIMPSES> = self.seen.iter().filter_map(glimpse).collect();
        glimpses.sort_unstable_by_key(|glimpse| glimpse.instant);
        glimpses
    }
}

/// The newest instant that is not after a stamp, and the part of the time from it to the next one that has passed then.
fn place(knots: &[Knot], timestamp_ns: i64) -> (usize, f64) {
    let instant = knots.partition_point(|knot| knot.timestamp_ns <= timestamp_ns).saturating_sub(1);
    let ahead = knots
        .get(instant..)
        .and_then(|rest| rest.first_chunk::<2>())
        .map_or(0.0, |[a, b]| seconds_between(a.timestamp_ns, timestamp_ns) / seconds_between(a.timestamp_ns, b.timestamp_ns));
    (instant, ahead)
}

impl Seen {
    /// Track and flight.
    fn flight(&self) -> (u32, Option<u32>) {
        (self.track, self.flight)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_planes_saw_move_while_nothing_was_tracked_is_uncertain_along_what_they_do_not_tell() {
        let mut motion = CameraMotion::default();
        let tied = Mat3::from_diagonal(&Vec3::new(0.0, 4e7, 4e7));
        let law = crate::physics::law::FreeFallWithDrag { drag: 0.0 };
        let gravity = Gravity::known(Vec3::new(0.0, 0.0, -9.81));
        let mut told = Vec::<Displacement, 2>::new();
        for (stamp, shown) in [(0, Vec3::zeros()), (500_000_000, Vec3::new(0.0, 0.03, 0.04))] {
            motion.begin(stamp, stamp as u64, (shown, tied));
            motion.tell((Method::Best, 0.0), &law, &gravity, true, |t| {
                if let Told::Moved(_, displacement, _) = t {
                    let _ = told.push(displacement);
                }
            });
        }
        let [first, second] = told.as_slice() else { panic!("{told:?}") };
        assert!(first.covariance[(0, 0)] < 1e-6, "{first:?}");
        assert!((second.mean - Vec3::new(0.0, 0.03, 0.04)).norm() < 1e-3, "{second:?}");
        assert!(second.covariance[(0, 0)] > 0.04 * 0.04 && second.covariance[(1, 1)] < 1e-6, "{second:?}");
    }
}
