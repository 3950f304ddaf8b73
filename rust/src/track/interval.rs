//! A track's life in intervals, active or passive: each of its frames in exactly one.

use crate::event;
use heapless::Vec;

/// Frames at which an interval may be made to begin, looking back: those of 1 s, and of more where frames are rarer than [`STEP`].
const FRAMES: usize = 128;
/// Frames closer together than this, s, don't all count as such: samples aren't either.
const STEP: f64 = 1.0 / 125.0;
/// An interval that goes on is told anew so often, s.
const AGAIN: f64 = 1.0;
/// Intervals told at once.
pub const TOLD: usize = 8;

/// Intervals to be told, and whether they are final.
pub type Told = Vec<(event::Activity, bool), TOLD>;

/// A frame at which an interval may begin.
#[derive(Clone, Copy, Debug)]
struct Frame {
    t: f64,
    stamp_ns: i64,
    /// The track's frame before it, if there is one.
    before_ns: Option<i64>,
}

/// The intervals of a track.
#[derive(Clone, Debug, Default)]
pub struct Intervals {
    frames: Vec<Frame, FRAMES>,
    newest: Option<(f64, i64)>,
    /// First frame of the present interval.
    start: Option<(f64, i64)>,
    active: bool,
    probability: f64,
    id: Option<u32>,
    told: f64,
}

impl Intervals {
    /// The track was measured at `t` (s) in the frame with this stamp.
    pub fn frame(&mut self, t: f64, stamp_ns: i64) {
        if self.newest.is_some_and(|(_, newest)| stamp_ns <= newest) {
            return;
        }
        if self.frames.last().is_none_or(|last| t - last.t >= STEP) {
            if self.frames.is_full() {
                self.frames.remove(0);
            }
            // There is room: the line above made it.
            let _ = self.frames.push(Frame { t, stamp_ns, before_ns: self.newest.map(|(_, newest)| newest) });
        }
        self.newest = Some((t, stamp_ns));
        self.start.get_or_insert((t, stamp_ns));
    }

    /// Whether the present interval is active.
    pub fn is_active(&self) -> bool {
        self.active
    }

    /// When the present interval began, s.
    pub fn since(&self) -> f64 {
        self.start.map_or(f64::NEG_INFINITY, |(t, _)| t)
    }

    /// From the first frame at or after `at` (s) on it is the other way round. Where that is not after the present interval's beginning, the present
    /// one is.
    pub fn turn(&mut self, at: f64, active: bool, probability: f64, ids: &mut u32, told: &mut Told) {
        let first = self.frames.iter().find(|f| f.t >= at - 1e-9).or(self.frames.last()).copied();
        let later = first.filter(|f| self.start.is_some_and(|(_, start)| f.stamp_ns > start));
        if let (Some(Frame { t, stamp_ns, before_ns: Some(before) }), true) = (later, active != self.active) {
            self.tell_until(before, true, ids, told);
            (self.start, self.id) = (Some((t, stamp_ns)), None);
        }
        (self.active, self.probability) = (active, probability);
        self.tell(false, ids, told);
    }

    /// What is known of the present interval, before it ends.
    pub fn assess(&mut self, probability: f64) {
        self.probability = probability;
    }

    /// What is known of the present interval, told again now and then.
    pub fn go_on(&mut self, probability: f64, ids: &mut u32, told: &mut Told) {
        self.probability = probability;
        if self.newest.is_some_and(|(t, _)| self.id.is_none() || t - self.told >= AGAIN) {
            self.tell(false, ids, told);
        }
    }

    /// Tells the present interval, as it is now or for good.
    pub fn tell(&mut self, is_final: bool, ids: &mut u32, told: &mut Told) {
        if let Some((t, newest)) = self.newest {
            self.told = t;
            self.tell_until(newest, is_final, ids, told);
        }
    }

    fn tell_until(&mut self, end_ns: i64, is_final: bool, ids: &mut u32, told: &mut Told) {
        let Some((_, start_ns)) = self.start else { return };
        let id = *self.id.get_or_insert_with(|| {
            *ids += 1;
            *ids
        });
        let Self { active, probability, .. } = *self;
        // No more than two intervals end or begin with one sample, and there are two samples at the most.
        let _ = told.push((event::Activity { id, start_ns, end_ns, active, probability }, is_final));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn intervals_meet_between_frames_and_cover_each_once() {
        let (mut intervals, mut ids, mut told) = (Intervals::default(), 0, Told::new());
        for i in 0..300i64 {
            intervals.frame(i as f64 / 300.0, i);
        }
        intervals.turn(0.5, true, 0.9, &mut ids, &mut told);
        // Before the present interval began nothing can be turned any more: it is itself what is meant.
        intervals.turn(0.4, false, 0.1, &mut ids, &mut told);
        intervals.tell(true, &mut ids, &mut told);
        let finals: Vec<_, TOLD> = told.iter().filter(|(_, last)| *last).map(|(a, _)| (a.id, a.start_ns, a.end_ns, a.active)).collect();
        assert!(finals.len() == 2 && finals[0].1 == 0 && finals[1].2 == 299 && finals[0].2 + 1 == finals[1].1, "{finals:?}");
        assert!((148..=153).contains(&finals[1].1) && !finals[1].3 && finals[0].0 != finals[1].0, "{finals:?}");
    }

    #[test]
    fn what_goes_on_is_told_once_a_second() {
        let (mut intervals, mut ids, mut count) = (Intervals::default(), 0, 0);
        for i in 0..5400 {
            intervals.frame(f64::from(i) / 30.0, i64::from(i));
            let mut told = Told::new();
            intervals.go_on(0.0, &mut ids, &mut told);
            count += told.len();
        }
        assert!(ids == 1 && (179..=181).contains(&count), "{count}");
    }
}
