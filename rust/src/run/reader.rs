//! A source on a thread of its own, so that whoever waits for events can stop waiting at any time, even while the source is silent.

use super::Run;
use crate::event::{Counters, EndReason, Event};
use crate::reasoning::Predictor;
use crate::seeing::SeeError;
use crate::source::{Input, Source, SourceError};
use std::boxed::Box;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::string::String;
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::vec::Vec;

/// So many inputs may be ahead of whoever listens; then a recording waits.
const AHEAD: usize = 32;

/// What one input brought.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Its events.
    pub events: Vec<Event>,
    /// The live tracks after it.
    pub predictors: Vec<Predictor>,
    /// What went through up to it.
    pub counters: Counters,
    /// How long the engine worked up to it.
    pub busy: Duration,
}

impl Step {
    /// One input through `run`; `None` where nothing came of it.
    ///
    /// # Errors
    /// As of [`Run::push`].
    pub fn input(run: &mut Run, input: Input<'_>) -> Result<Option<Self>, SeeError> {
        let mut events = Vec::new();
        let happened = run.push(input, &mut |event| events.push(event))?;
        Ok(happened.then(|| Self::after(run, events)))
    }

    /// The end of `run`.
    pub fn end(run: &mut Run, reason: EndReason) -> Self {
        let mut events = Vec::new();
        run.end(reason, &mut |event| events.push(event));
        Self::after(run, events)
    }

    fn after(run: &Run, events: Vec<Event>) -> Self {
        Self { events, predictors: run.predictors().collect(), counters: run.counters(), busy: run.busy() }
    }
}

/// What waiting brought.
#[derive(Debug)]
pub enum Next {
    /// An input went through.
    Step(Step),
    /// Nothing yet.
    Silence,
    /// The stream is over; the error that ended it is told once.
    Over(Result<(), SourceError>),
}

/// A run whose source is read by a thread.
pub struct Reader {
    shared: Arc<Shared>,
}

struct Shared {
    state: Mutex<State>,
    changed: Condvar,
}

struct State {
    run: Run,
    steps: VecDeque<Step>,
    outcome: Option<Result<(), SourceError>>,
    remarks: Vec<String>,
}

impl Shared {
    /// A panic elsewhere has been turned into an outcome, so the state may be used on.
    fn lock(&self) -> MutexGuard<'_, State> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl State {
    fn end(&mut self, reason: EndReason) {
        let step = Step::end(&mut self.run, reason);
        self.steps.push_back(step);
    }
}

impl Reader {
    /// Starts to read.
    pub fn spawn(mut source: Box<dyn Source>, run: Run) -> Self {
        let state = Mutex::new(State { run, steps: VecDeque::new(), outcome: None, remarks: Vec::new() });
        let shared = Arc::new(Shared { state, changed: Condvar::new() });
        let theirs = Arc::clone(&shared);
        std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| read(&mut *source, &theirs))).unwrap_or(Err(SourceError::Panicked));
            let mut state = theirs.lock();
            state.remarks = source.remarks();
            if !matches!(outcome, Err(SourceError::Panicked)) {
                let reason = if outcome.is_ok() { EndReason::EndOfSource } else { EndReason::Disconnected };
                state.end(reason);
            }
            state.outcome.get_or_insert(outcome);
            theirs.changed.notify_all();
        });
        Self { shared }
    }

    /// Waits for the next step, at most `patience`.
    pub fn next(&self, patience: Duration) -> Next {
        let idle = |state: &mut State| state.steps.is_empty() && state.outcome.is_none();
        let (mut state, _) =
            self.shared.changed.wait_timeout_while(self.shared.lock(), patience, idle).unwrap_or_else(PoisonError::into_inner);
        if let Some(step) = state.steps.pop_front() {
            self.shared.changed.notify_all();
            return Next::Step(step);
        }
        state.outcome.as_mut().map_or(Next::Silence, |outcome| Next::Over(core::mem::replace(outcome, Ok(()))))
    }

    /// What the user should know of the source, once it is over.
    pub fn remarks(&self) -> Vec<String> {
        self.shared.lock().remarks.clone()
    }

    /// Ends the stream now, even if its source is silent; the last events are still handed out.
    pub fn interrupt(&self) {
        let mut state = self.shared.lock();
        if state.outcome.is_none() {
            state.end(EndReason::Interrupted);
            state.outcome = Some(Ok(()));
        }
        self.shared.changed.notify_all();
    }
}

impl Drop for Reader {
    /// Lets the thread go: it ends at its next input.
    fn drop(&mut self) {
        self.interrupt();
    }
}

fn read(source: &mut dyn Source, shared: &Shared) -> Result<(), SourceError> {
    while let Some(input) = source.next_input()? {
        let full = |state: &mut State| state.steps.len() >= AHEAD && state.outcome.is_none();
        let mut state = shared.changed.wait_while(shared.lock(), full).unwrap_or_else(PoisonError::into_inner);
        if state.outcome.is_some() {
            return Ok(());
        }
        let Some(step) = Step::input(&mut state.run, input)? else { continue };
        state.steps.push_back(step);
        shared.changed.notify_all();
        if state.run.is_over() {
            return Ok(());
        }
    }
    if shared.lock().run.has_begun() { Ok(()) } else { Err(SourceError::Empty { source_name: source.name().into() }) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::Config;
    use crate::event::Kind;
    use crate::geometry::camera::Camera;
    use crate::run::Options;
    use std::sync::mpsc::{Receiver, channel};

    /// Hands out the stamps that it receives; one below zero breaks it.
    struct Scripted(Receiver<i64>);

    impl Source for Scripted {
        fn name(&self) -> &'static str {
            "scripted"
        }

        fn camera(&self) -> Option<Camera> {
            None
        }

        fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
            match self.0.recv() {
                Ok(-1) => panic!("a mistake"),
                Ok(-2) => Err(SourceError::malformed("scripted", "broken")),
                Ok(timestamp_ns) => Ok(Some(Input::Positions { timestamp_ns, positions: &[] })),
                Err(_) => Ok(None),
            }
        }
    }

    /// The end that the stream tells, if any, and how it was over.
    fn over(stamps: &[i64], then: impl FnOnce(&Reader)) -> (Option<EndReason>, Result<(), SourceError>) {
        let (sender, receiver) = channel();
        let run = Run::new("scripted", &Config::default(), None, Options::default()).unwrap();
        let reader = Reader::spawn(Box::new(Scripted(receiver)), run);
        for &stamp in stamps {
            sender.send(stamp).unwrap();
        }
        then(&reader);
        // A source that is interrupted stays silent for ever.
        let _silent = Some(sender).filter(|_| stamps.last() == Some(&0));
        let mut end = None;
        loop {
            match reader.next(Duration::from_secs(10)) {
                Next::Step(step) => {
                    end = step.events.iter().find_map(|event| match &event.kind {
                        Kind::StreamEnded(ended) => Some(ended.reason),
                        _ => end,
                    });
                }
                Next::Silence => panic!("it hangs"),
                Next::Over(outcome) => return (end, outcome),
            }
        }
    }

    #[test]
    fn ends_as_its_source_does() {
        assert!(matches!(over(&[1, 2], |_| ()), (Some(EndReason::EndOfSource), Ok(()))));
        assert!(matches!(over(&[], |_| ()), (None, Err(SourceError::Empty { .. }))));
        assert!(matches!(over(&[1, -2], |_| ()), (Some(EndReason::Disconnected), Err(SourceError::Malformed { .. }))));
        let many: Vec<i64> = (1..1000).collect();
        assert!(matches!(over(&many, |_| ()), (Some(EndReason::EndOfSource), Ok(()))));
    }

    #[test]
    fn a_panic_is_an_error_and_no_hang() {
        assert!(matches!(over(&[1, -1], |_| ()), (_, Err(SourceError::Panicked))));
    }

    #[test]
    fn a_silent_source_can_be_interrupted() {
        assert!(matches!(over(&[0], Reader::interrupt), (_, Ok(()))));
        let begun = |reader: &Reader| {
            assert!(matches!(reader.next(Duration::from_secs(10)), Next::Step(_)));
            reader.interrupt();
        };
        assert!(matches!(over(&[0], begun), (Some(EndReason::Interrupted), Ok(()))));
    }
}
