//! A source that is being recorded: for the recording alone, or while it is used.

use super::{Input, Kinect, LatestVideo, RecordError, Recorder, Source, SourceError};
use crate::event::Counters;
use crate::geometry::camera::Camera;
use std::boxed::Box;
use std::string::String;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;
use std::vec::Vec;

/// What came of waiting for the next frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Recorded {
    /// It is recorded.
    Frame {
        /// How many there are now.
        count: u64,
        /// Its stamp.
        timestamp_ns: i64,
    },
    /// A live source is silent.
    Silence,
}

/// A source that is recorded frame by frame.
pub struct Recording {
    source: Box<dyn Source>,
    recorder: Recorder,
    limit: Option<u64>,
}

impl Recording {
    /// Will record at most `limit` frames of `source`.
    pub fn new(source: Box<dyn Source>, recorder: Recorder, limit: Option<u64>) -> Self {
        Self { source, recorder, limit }
    }

    /// Records the next frame. `None` at the end.
    ///
    /// # Errors
    /// The source broke or has no frames, or a frame can't be written.
    pub fn next_frame(&mut self) -> Result<Option<Recorded>, RecordError> {
        let Self { source, recorder, limit } = self;
        while limit.is_none_or(|limit| recorder.frames() < limit) {
            let Some(input) = source.next_input()? else {
                let is_empty = recorder.frames() == 0;
                return if is_empty { Err(SourceError::Empty { source_name: source.name().into() }.into()) } else { Ok(None) };
            };
            if let Some(timestamp_ns) = recorder.take(&input)? {
                return Ok(Some(Recorded::Frame { count: recorder.frames(), timestamp_ns }));
            }
            if matches!(input, Input::Silence) {
                return Ok(Some(Recorded::Silence));
            }
        }
        Ok(None)
    }

    /// Frames, and what was lost of a source of packets.
    pub fn counters(&self) -> Counters {
        self.recorder.counters()
    }

    /// How much was written, bytes.
    pub fn bytes(&self) -> u64 {
        self.recorder.bytes()
    }

    /// What the user should know of the source so far, a line each.
    pub fn remarks(&self) -> Vec<String> {
        self.source.remarks()
    }

    /// Completes what was recorded.
    ///
    /// # Errors
    /// It can't be written.
    pub fn finish(mut self) -> Result<(), RecordError> {
        self.recorder.finish()
    }
}

/// A recorder that several hold: who writes, and who may want to have it whole at once.
#[derive(Clone)]
pub struct Tape(Arc<Mutex<Recorder>>);

impl Tape {
    /// What `recorder` writes.
    pub fn new(recorder: Recorder) -> Self {
        Self(Arc::new(Mutex::new(recorder)))
    }

    /// Completes what was recorded; nothing is added after that.
    ///
    /// # Errors
    /// It can't be written.
    pub fn finish(&self) -> Result<(), RecordError> {
        self.recorder().finish()
    }

    fn recorder(&self) -> MutexGuard<'_, Recorder> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Hands on what a source delivers, and records it. What can't be recorded ends it.
pub struct Taped {
    source: Box<dyn Source>,
    tape: Tape,
}

impl Taped {
    /// `source`, recorded on `tape`.
    pub fn new(source: Box<dyn Source>, tape: Tape) -> Self {
        Self { source, tape }
    }
}

impl Source for Taped {
    fn name(&self) -> &str {
        self.source.name()
    }

    fn camera(&self) -> Option<Camera> {
        self.source.camera()
    }

    fn kinect(&self) -> Option<Kinect> {
        self.source.kinect()
    }

    fn is_live(&self) -> bool {
        self.source.is_live()
    }

    fn wait_for_return(&mut self, patience: Duration) {
        self.source.wait_for_return(patience);
    }

    fn video(&self) -> Option<Arc<LatestVideo>> {
        self.source.video()
    }

    fn remarks(&self) -> Vec<String> {
        self.source.remarks()
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        let input = self.source.next_input()?;
        match &input {
            Some(input) => drop(self.tape.recorder().take(input)?),
            None => self.tape.finish()?,
        }
        Ok(input)
    }
}

impl Drop for Taped {
    /// Whoever stops reading has a whole recording of what he read.
    fn drop(&mut self) {
        // Nobody is left to be told; what was written until now can be read.
        let _ = self.tape.finish();
    }
}
