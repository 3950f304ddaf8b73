//! One input through a run, and what came of it.

use super::Run;
use crate::event::{Counters, EndReason, Event};
use crate::geometry::environment::Environment;
use crate::reasoning::Predictor;
use crate::seeing::SeeError;
use crate::source::Input;
use std::sync::Arc;
use std::time::Duration;
use std::vec::Vec;

/// What one input brought.
#[derive(Clone, Debug, Default)]
pub struct Step {
    /// Its events.
    pub events: Vec<Event>,
    /// The live tracks after it.
    pub predictors: Vec<Predictor>,
    /// What is known of the scene after it.
    pub environment: Arc<Environment>,
    /// What went through up to it.
    pub counters: Counters,
    /// How long the engine worked up to it.
    pub busy: Duration,
    /// [`Run::arrival_ns`] of it.
    pub arrival_ns: Option<i64>,
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
        let (predictors, environment) = (run.predictors().collect(), Arc::clone(run.environment()));
        Self { events, predictors, environment, counters: run.counters(), busy: run.busy(), arrival_ns: run.arrival_ns() }
    }
}
