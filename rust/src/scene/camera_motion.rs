//! The path of a camera that moves (sec. 3.1 ii): flights of all objects and static structure gathered, solved when a flight is over.

use crate::config::Method;
use crate::math::{Mat3, Vec3};
use crate::physics::Sample;
use crate::physics::gravity::Gravity;
use crate::physics::law::Law;
use crate::physics::translation::{BALLS, Displacement, Glimpse, INSTANTS, Instant, Problem, Translation};
use crate::time::seconds_between;
use crate::track::drift::falls;
use heapless::Vec;

/// The path is told when a flight is over for so long, s: what others that still fly show until then helps.
const PATIENCE: f64 = 0.2;
/// Frames that come sooner after another than this, s, are told with it.
const STEP: f64 = 0.012;
/// What is seen at the most: a few objects in all instants.
const SEEN: usize = 3 * INSTANTS;
/// A flight of an object that is still there counts from so many glimpses on.
const FEWEST: usize = 5;
/// Squares of residuals of what are flights, a degree of freedom.
const PLAUSIBLE: f64 = 3.0;
/// Probability from which on the camera is taken to have stood.
const STOOD: f64 = 0.9;
/// Information in every direction from which on static structure ties the camera down, 1/m²: 1 cm.
const TIED: f64 = 1e4;

/// A frame in which something was tracked, and those that came right after it.
#[derive(Clone, Copy, Debug)]
struct Frame {
    timestamp_ns: i64,
    numbers: (u64, u64),
    structure: (Vec3, Mat3),
    told: bool,
}

/// A measurement in a frame.
#[derive(Clone, Copy, Debug)]
struct Seen {
    timestamp_ns: i64,
    track: u32,
    time_ns: i64,
    position: Vec3,
    weight: Mat3,
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
    frames: Vec<Frame, INSTANTS>,
    seen: Vec<Seen, SEEN>,
    /// Where the camera was in the newest frame that was told.
    anchor: Displacement,
    flights: u32,
    /// End of the newest flight that is over and not told, ns.
    landed_ns: Option<i64>,
}

impl Default for CameraMotion {
    fn default() -> Self {
        let anchor = Displacement { mean: Vec3::zeros(), covariance: Mat3::zeros() };
        Self { frames: Vec::new(), seen: Vec::new(), anchor, flights: 0, landed_ns: None }
    }
}

impl CameraMotion {
    /// A frame begins, and what static structure shows in it: the camera's displacement (m), and the information of that (1/m²).
    pub fn begin(&mut self, timestamp_ns: i64, frame: u64, structure: (Vec3, Mat3)) {
        match self.frames.last_mut() {
            Some(last) if seconds_between(last.timestamp_ns, timestamp_ns) < STEP => last.numbers.1 = frame,
            _ => {
                // A full buffer was told and emptied before.
                let _ = self.frames.push(Frame { timestamp_ns, numbers: (frame, frame), structure, told: false });
            }
        }
    }

    /// An object was measured in the frame that began last.
    pub fn see(&mut self, track: u32, time_ns: i64, position: Vec3, weight: Mat3) {
        let Some(frame) = self.frames.last() else { return };
        let again = self.seen.iter().rev().take_while(|s| s.timestamp_ns == frame.timestamp_ns).any(|s| s.track == track);
        if !again {
            // A full buffer was told and emptied before.
            let _ = self.seen.push(Seen { timestamp_ns: frame.timestamp_ns, track, time_ns, position, weight, flight: None });
        }
    }

    /// What a track showed from `from_ns` to `to_ns` was a flight.
    pub fn land(&mut self, track: u32, from_ns: i64, to_ns: i64) {
        let flight = self.flights;
        for seen in self.seen.iter_mut().filter(|s| s.track == track && s.flight.is_none() && (from_ns..=to_ns).contains(&s.time_ns)) {
            seen.flight = Some(flight);
            self.landed_ns = self.landed_ns.max(Some(seen.timestamp_ns));
            self.flights = flight + 1;
        }
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
        let full = self.frames.is_full() || self.seen.len() + BALLS > SEEN;
        full || self.landed_ns.map_or(idle && !self.frames.is_empty(), |landed_ns| idle || seconds_between(landed_ns, now_ns) > PATIENCE)
    }

    /// Solves, and hands out the path up to the newest flight that is over; all of it, and the next one is another, when nothing flies any more or
    /// there is no more room.
    pub fn tell(&mut self, method: (Method, f64), law: &dyn Law, gravity: &Gravity, idle: bool, mut out: impl FnMut(Told<'_>)) {
        let all = idle || self.frames.is_full() || self.seen.len() + BALLS > SEEN;
        let until_ns = if all { i64::MAX } else { self.landed_ns.unwrap_or(i64::MIN) };
        self.landed_ns = None;
        let Some(&Frame { timestamp_ns: epoch_ns, .. }) = self.frames.first() else { return };
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
        for (frame, displacement) in self.frames.iter_mut().zip(&solved.path) {
            if !frame.told && frame.timestamp_ns <= until_ns {
                frame.told = true;
                let tied = frame.structure.1.symmetric_eigenvalues().min() > TIED;
                (frame.numbers.0..=frame.numbers.1).for_each(|number| out(Told::Moved(number, *displacement, tied)));
            }
        }
        if all {
            self.anchor = solved.path.last().copied().unwrap_or(self.anchor);
            self.frames.clear();
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
        let instant = |frame: &Frame| Instant { t: seconds_between(epoch_ns, frame.timestamp_ns), structure: frame.structure };
        let instants: Vec<Instant, INSTANTS> = self.frames.iter().map(instant).collect();
        let problem = |glimpses| Problem { law, gravity, instants: &instants, glimpses, anchor: self.anchor };
        if method == Method::Paper {
            return Some(problem(glimpses).solve_by_paper(theta));
        }
        // What agrees with no path of the camera were no flights: it tells nothing.
        let agrees = |solved: &Translation| solved.chi2.0 < PLAUSIBLE * solved.chi2.1.max(1.0);
        problem(glimpses).solve().filter(agrees).or_else(|| problem(&[]).solve())
    }

    /// The glimpses of the flights that show most, those that go on among them.
    fn glimpses(&self, epoch_ns: i64, gravity: &Vec3) -> Vec<Glimpse, SEEN> {
        let sample = |s: &Seen| Sample { t: seconds_between(epoch_ns, s.time_ns), position: s.position, weight: s.weight, half_span: 0.0 };
        let mut flights: Vec<((u32, Option<u32>), usize), 32> = Vec::new();
        for seen in &self.seen {
            match flights.iter_mut().find(|(flight, _)| *flight == seen.flight()) {
                Some((_, count)) => *count += 1,
                None => _ = flights.push((seen.flight(), 1)),
            }
        }
        flights.retain(|(flight, count)| {
            let samples: Vec<Sample, INSTANTS> = self.seen.iter().filter(|s| s.flight() == *flight).map(sample).take(INSTANTS).collect();
            *count >= FEWEST && falls(&samples, gravity)
        });
        flights.sort_unstable_by_key(|(_, count)| core::cmp::Reverse(*count));
        flights.truncate(BALLS);
        let glimpse = |seen: &Seen| {
            let ball = flights.iter().position(|(flight, _)| *flight == seen.flight())?;
            let instant = self.frames.iter().position(|frame| frame.timestamp_ns == seen.timestamp_ns)?;
            Some(Glimpse { instant, ball, sample: sample(seen) })
        };
        self.seen.iter().filter_map(glimpse).collect()
    }
}

impl Seen {
    /// Track and flight.
    fn flight(&self) -> (u32, Option<u32>) {
        (self.track, self.flight)
    }
}
