//! Stamps of the input, one after the other: those that stand still or go back, and what is missing between them.

use crate::event::{Gap, GapReason};
use crate::time::seconds_between;

/// Intervals that the typical one is the median of.
const MEMORY: usize = 15;

/// Watches the stamps of a stream.
#[derive(Clone, Debug, Default)]
pub struct Timeline {
    newest: Option<i64>,
    intervals: [f64; MEMORY],
    count: usize,
    standing: u64,
    /// Inputs that were refused.
    pub dropped: u64,
}

impl Timeline {
    /// Takes in the stamp of the next input. `None`: it is not later than the one before and can't be used; otherwise the gaps
    /// that it ends.
    pub fn advance(&mut self, timestamp_ns: i64) -> Option<[Option<Gap>; 2]> {
        let Some(newest) = self.newest else {
            self.newest = Some(timestamp_ns);
            return Some([None, None]);
        };
        if timestamp_ns <= newest {
            self.standing += 1;
            self.dropped += 1;
            return None;
        }
        let stalled = self.stall(timestamp_ns);
        let interval = seconds_between(newest, timestamp_ns);
        let lost = self.typical().filter(|typical| interval > 1.5 * typical).map(|typical| Gap {
            start_ns: newest,
            end_ns: timestamp_ns,
            reason: GapReason::FramesLost,
            frames: Some(libm::round(interval / typical) as u64 - 1),
            packets: None,
            samples: None,
        });
        self.intervals[self.count % MEMORY] = interval;
        self.count += 1;
        self.newest = Some(timestamp_ns);
        Some([stalled, lost])
    }

    /// The gap that refused stamps are, if there were any since the last good one.
    pub fn stall(&mut self, end_ns: i64) -> Option<Gap> {
        let frames = core::mem::take(&mut self.standing);
        let start_ns = self.newest?;
        (frames > 0).then_some(Gap { start_ns, end_ns, reason: GapReason::Stalled, frames: Some(frames), packets: None, samples: None })
    }

    /// The newest good stamp, ns.
    pub fn newest(&self) -> Option<i64> {
        self.newest
    }

    /// The median interval, s, once there are a few.
    fn typical(&self) -> Option<f64> {
        let mut sorted = self.intervals;
        let known = sorted.get_mut(..self.count.min(MEMORY)).filter(|known| known.len() >= 5)?;
        known.sort_unstable_by(f64::total_cmp);
        known.get(known.len() / 2).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn missing_frames_are_counted_and_standing_stamps_refused() {
        let mut timeline = Timeline::default();
        for i in 0..10 {
            assert_eq!(timeline.advance(i * 33_000_000), Some([None, None]));
        }
        let gap = timeline.advance(12 * 33_000_000).unwrap()[1].clone().unwrap();
        assert_eq!((gap.frames, gap.reason, gap.start_ns), (Some(2), GapReason::FramesLost, 9 * 33_000_000));
        for stamp in [12 * 33_000_000, 0, i64::MIN] {
            assert_eq!(timeline.advance(stamp), None);
        }
        let gap = timeline.advance(13 * 33_000_000).unwrap()[0].clone().unwrap();
        assert_eq!((gap.frames, gap.reason, timeline.dropped), (Some(3), GapReason::Stalled, 3));
        assert!(timeline.advance(i64::MAX).is_some());
    }
}
