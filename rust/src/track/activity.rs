//! Whether a track's object moves by a force of its own (sec. 3.3), by either method.

use crate::config::{LawsConfig, Method};
use crate::physics::Sample;
use crate::track::decision::{Decision, Ledger};
use crate::track::interval::{Intervals, Told};
use crate::track::motion::Finding;
use crate::track::paper_activity::PaperDecision;
use crate::track::passive::Circumstances;

#[derive(Clone, Debug)]
#[allow(clippy::large_enum_variant)] // No heap to put the larger one on.
enum Judge {
    Best(Decision),
    Paper(PaperDecision),
}

/// Whether a track's object is active, interval by interval.
#[derive(Clone, Debug)]
pub struct Activity {
    judge: Judge,
    intervals: Intervals,
    /// Newest sample that was judged, s.
    newest: f64,
}

impl Activity {
    /// Passive, until something else shows.
    pub fn new(laws: &LawsConfig) -> Self {
        let judge = match laws.method {
            Method::Best => Judge::Best(Decision::new(laws.false_alarm)),
            Method::Paper => Judge::Paper(PaperDecision::new(laws.theta)),
        };
        Self { judge, intervals: Intervals::default(), newest: f64::NEG_INFINITY }
    }

    /// The track was measured at `t` (s) in the frame with this stamp.
    pub fn frame(&mut self, t: f64, stamp_ns: i64) {
        self.intervals.frame(t, stamp_ns);
    }

    /// Takes in what is new among `samples`, after what was found in them came to light.
    pub fn push(&mut self, samples: &[Sample], findings: &[Finding], place: &Circumstances, ids: &mut u32, told: &mut Told) {
        let new = samples.partition_point(|s| s.t <= self.newest);
        let Self { judge, intervals, .. } = self;
        if let Judge::Best(decision) = judge {
            for finding in findings {
                match finding {
                    Finding::Touched(contact, _) => {
                        decision.touch(contact, place.around.duration, place, &mut Ledger { intervals, ids, told });
                    }
                    Finding::Parted(at) => decision.begin(*at),
                    Finding::Inconsistent(_) | Finding::Settled(_) | Finding::Flown(..) | Finding::Drifted(..) | Finding::Fell(..) => {}
                }
            }
        }
        for end in new + 1..=samples.len() {
            let samples = samples.get(..end).unwrap_or(samples);
            match judge {
                Judge::Best(decision) => decision.push(samples, place, &mut Ledger { intervals, ids, told }),
                Judge::Paper(paper) => paper.push(samples, place.law, &place.around.gravity.mean, intervals, ids, told),
            }
        }
        self.newest = samples.last().map_or(self.newest, |s| s.t);
    }

    /// The track is over: everything becomes final.
    pub fn finish(&mut self, samples: &[Sample], place: &Circumstances, ids: &mut u32, told: &mut Told) {
        let Self { judge, intervals, .. } = self;
        match judge {
            Judge::Best(decision) => decision.finish(samples, place, &mut Ledger { intervals, ids, told }),
            Judge::Paper(_) => intervals.tell(true, ids, told),
        }
    }

    /// Whether what the object did from `since` to `until` (s) was passive, as far as is known: only that tells of gravity.
    pub fn is_passive(&self, since: f64, until: f64) -> bool {
        /// Beginnings are known to this, s.
        const SHARP: f64 = 0.05;
        let by_test = match &self.judge {
            Judge::Best(decision) => decision.is_passive(until),
            Judge::Paper(_) => true,
        };
        by_test && !self.intervals.is_active() && self.intervals.since() < since + SHARP
    }
}
