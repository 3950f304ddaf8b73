//! A source on a thread of its own, so that whoever waits for events can stop waiting at any time, even while the source is silent.

use super::Run;
use crate::event::{Counters, EndReason, Event};
use crate::reasoning::Predictor;
use crate::seeing::SeeError;
use crate::source::{Input, Source, SourceError};
use std::boxed::Box;
use std::collections::VecDeque;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::vec::Vec;

/// So many inputs may be ahead of whoever listens; then a recording waits.
const AHEAD: usize = 32;

/// What one input brought.
#[derive(Clone, Debug)]
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
    /// One input through `run`.
    ///
    /// # Errors
    /// As of [`Run::push`].
    pub fn input(run: &mut Run, input: Input<'_>) -> Result<Self, SeeError> {
        let mut events = Vec::new();
        run.push(input, &mut |event| events.push(event))?;
        Ok(Self::after(run, events))
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
    pub fn spawn(source: Box<dyn Source>, run: Run) -> Self {
        let state = Mutex::new(State { run, steps: VecDeque::new(), outcome: None });
        let shared = Arc::new(Shared { state, changed: Condvar::new() });
        let theirs = Arc::clone(&shared);
        std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| read(source, &theirs))).unwrap_or(Err(SourceError::Panicked));
            let mut state = theirs.lock();
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

fn read(mut source: Box<dyn Source>, shared: &Shared) -> Result<(), SourceError> {
    while let Some(input) = source.next_input()? {
        let full = |state: &mut State| state.steps.len() >= AHEAD && state.outcome.is_none();
        let mut state = shared.changed.wait_while(shared.lock(), full).unwrap_or_else(PoisonError::into_inner);
        if state.outcome.is_some() {
            return Ok(());
        }
        let step = Step::input(&mut state.run, input)?;
        state.steps.push_back(step);
        shared.changed.notify_all();
        if state.run.is_over() {
            return Ok(());
        }
    }
    if shared.lock().run.has_begun() { Ok(()) } else { Err(SourceError::Empty { source_name: source.name().into() }) }
}
