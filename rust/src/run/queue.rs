//! What waits for whoever listens. A recording waits when there is much of it; a live source can't, and then positions go first.

use super::Step;
use crate::event::{Event, Kind};
use crate::source::SourceError;
use std::collections::VecDeque;

/// So many steps that tell something may be ahead of whoever listens; then a recording waits.
const AHEAD: usize = 32;
/// With so many events waiting, positions are no longer kept; with twice as many, only what can't be seen again.
const MOST_EVENTS: usize = 4096;

/// Steps in order, and how the stream was over.
#[derive(Default)]
pub(super) struct Queue {
    steps: VecDeque<Step>,
    /// Events in them.
    events: usize,
    /// Events that were not kept.
    dropped: u64,
    /// Set once.
    pub outcome: Option<Result<(), SourceError>>,
}

impl Queue {
    /// Takes in a step and says whether it tells something. A step that does not only replaces another such: it says how things are.
    pub fn push(&mut self, mut step: Step) -> bool {
        let (told, waiting) = (step.events.len(), self.events);
        if waiting + told > MOST_EVENTS {
            step.events.retain(|event| is_kept(&event.kind, waiting));
        }
        self.dropped += (told - step.events.len()) as u64;
        step.counters.events -= self.dropped;
        step.counters.events_dropped += self.dropped;
        if let Some(Event { kind: Kind::StreamEnded(end), .. }) = step.events.last_mut() {
            end.counters = step.counters;
        }
        self.events += step.events.len();
        let tells = !step.events.is_empty();
        if !tells && self.steps.back().is_some_and(|last| last.events.is_empty()) {
            self.steps.pop_back();
        }
        self.steps.push_back(step);
        tells
    }

    /// The next step, if there is one.
    pub fn pop(&mut self) -> Option<Step> {
        let step = self.steps.pop_front()?;
        self.events -= step.events.len();
        Some(step)
    }

    /// A recording should wait.
    pub fn is_full(&self) -> bool {
        self.steps.len() >= AHEAD
    }

    /// A recording that waits should go on: not for each step, since waking a thread costs as much as a frame.
    pub fn has_room(&self) -> bool {
        self.steps.len() <= AHEAD / 2
    }

    /// Nothing to hand out.
    pub fn is_idle(&self) -> bool {
        self.steps.is_empty() && self.outcome.is_none()
    }
}

fn is_kept(kind: &Kind, waiting: usize) -> bool {
    match kind {
        Kind::Position(_) => false,
        Kind::Contact(_) | Kind::Surface(_) | Kind::StreamStarted(_) | Kind::StreamEnded(_) => true,
        _ => waiting < 2 * MOST_EVENTS,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::event::{Counters, EndReason, Gap, GapReason, StreamEnded};
    use std::vec::Vec;

    fn gap() -> Kind {
        Kind::Gap(Gap { start_ns: 0, end_ns: 1, reason: GapReason::Stalled, frames: None, packets: None, samples: None })
    }

    fn step(kinds: Vec<Kind>, before: u64) -> Step {
        let told = before + kinds.len() as u64;
        let events = kinds.into_iter().map(|kind| Event { timestamp_ns: 0, track: None, is_final: true, kind }).collect();
        Step { events, counters: Counters { events: told, ..Counters::default() }, ..Step::default() }
    }

    #[test]
    fn steps_that_tell_nothing_replace_each_other() {
        let mut queue = Queue::default();
        assert!(!queue.push(step([].into(), 0)));
        assert!(!queue.push(step([].into(), 7)));
        assert!(queue.push(step([gap()].into(), 7)));
        assert!(!queue.push(step([].into(), 8)));
        let events: Vec<_> = core::iter::from_fn(|| queue.pop()).map(|step| step.counters.events).collect();
        assert_eq!(events, [7, 8, 8]);
    }

    #[test]
    fn a_full_queue_drops_the_least_and_counts_it() {
        let mut queue = Queue::default();
        let told = 3 * MOST_EVENTS as u64;
        for i in 0..told {
            queue.push(step([gap()].into(), i));
        }
        let ended = StreamEnded { reason: EndReason::Interrupted, counters: Counters::default() };
        queue.push(step([ended.into()].into(), told));
        let last = core::iter::from_fn(|| queue.pop()).last().unwrap();
        let Kind::StreamEnded(end) = &last.events[0].kind else { panic!() };
        let kept = 2 * MOST_EVENTS as u64;
        assert_eq!((end.counters.events, end.counters.events_dropped), (kept + 1, told - kept));
    }
}
