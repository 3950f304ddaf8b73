//! A source on a thread of its own, so that whoever waits for events can stop waiting at any time, even while the source is silent, and
//! a live source loses nothing however slow he is.

use super::queue::Queue;
use super::{Run, Step};
use crate::event::EndReason;
use crate::source::{Input, Source, SourceError};
use std::boxed::Box;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::string::String;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Condvar, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;
use std::time::Duration;
use std::vec::Vec;

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
    /// Of a live source, which must be let go of before another can have it.
    live: Mutex<Option<JoinHandle<()>>>,
}

/// Whoever needs both locks takes that of `run` first.
struct Shared {
    run: Mutex<Run>,
    queue: Mutex<Queue>,
    /// Something can be handed out.
    told: Condvar,
    /// A recording may go on.
    room: Condvar,
    remarks: OnceLock<Vec<String>>,
    /// The device is away, and awaited.
    is_away: AtomicBool,
}

/// A panic elsewhere has been turned into an outcome, so the state may be used on.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Shared {
    /// Ends the run, unless it is over, and the stream with `outcome`, unless it has another.
    fn end(&self, reason: Option<EndReason>, outcome: Result<(), SourceError>) {
        let mut run = lock(&self.run);
        let mut queue = lock(&self.queue);
        if let Some(reason) = reason.filter(|_| !run.is_over()) {
            queue.push(Step::end(&mut run, reason));
        }
        queue.outcome.get_or_insert(outcome);
        self.told.notify_all();
        self.room.notify_all();
    }
}

impl Reader {
    /// Starts to read. A recording waits for whoever listens, a live source only if `run` is to have every frame.
    pub fn spawn(mut source: Box<dyn Source>, run: Run) -> Self {
        let is_live = source.is_live();
        let waits = !is_live || run.options().every_frame;
        let (run, queue) = (Mutex::new(run), Mutex::default());
        let shared = Arc::new(Shared {
            run,
            queue,
            told: Condvar::new(),
            room: Condvar::new(),
            remarks: OnceLock::new(),
            is_away: AtomicBool::new(false),
        });
        let theirs = Arc::clone(&shared);
        let thread = std::thread::spawn(move || {
            let outcome = catch_unwind(AssertUnwindSafe(|| read(&mut *source, &theirs, waits))).unwrap_or(Err(SourceError::Panicked));
            let _ = theirs.remarks.set(source.remarks());
            drop(source);
            let reason = match outcome {
                Ok(()) => Some(EndReason::EndOfSource),
                Err(SourceError::Panicked) => None,
                Err(_) => Some(EndReason::Disconnected),
            };
            theirs.end(reason, outcome);
        });
        Self { shared, live: Mutex::new(is_live.then_some(thread)) }
    }

    /// Waits for the next step, at most `patience`.
    pub fn next(&self, patience: Duration) -> Next {
        let Shared { queue, told, room, .. } = &*self.shared;
        let (mut queue, _) =
            told.wait_timeout_while(lock(queue), patience, |queue| queue.is_idle()).unwrap_or_else(PoisonError::into_inner);
        if let Some(step) = queue.pop() {
            if queue.has_room() {
                room.notify_all();
            }
            return Next::Step(step);
        }
        queue.outcome.as_mut().map_or(Next::Silence, |outcome| Next::Over(core::mem::replace(outcome, Ok(()))))
    }

    /// What the user should know of the source, once it is over.
    pub fn remarks(&self) -> Vec<String> {
        if lock(&self.shared.queue).outcome.is_some() {
            self.release();
        }
        self.shared.remarks.get().cloned().unwrap_or_default()
    }

    /// Whether its device is away, and awaited.
    pub fn is_away(&self) -> bool {
        self.shared.is_away.load(Ordering::Relaxed)
    }

    /// Ends the stream now, and waits until its device, if it is one, can be had by others.
    pub fn release(&self) {
        self.interrupt();
        if let Some(thread) = lock(&self.live).take() {
            // It has no panic left to tell of.
            let _ = thread.join();
        }
    }

    /// Ends the stream now, even if its source is silent; the last events are still handed out.
    pub fn interrupt(&self) {
        self.shared.end(Some(EndReason::Interrupted), Ok(()));
    }
}

impl Drop for Reader {
    /// Lets the thread go: it ends at its next input, and a live source is never silent for long.
    fn drop(&mut self) {
        self.release();
    }
}

fn read(source: &mut dyn Source, shared: &Shared, waits: bool) -> Result<(), SourceError> {
    while let Some(input) = source.next_input()? {
        if let Input::Disconnected(_) | Input::Reconnected(_) = input {
            shared.is_away.store(matches!(input, Input::Disconnected(_)), Ordering::Relaxed);
        }
        let mut run = lock(&shared.run);
        if run.is_over() {
            return Ok(());
        }
        let Some(step) = Step::input(&mut run, input)? else { continue };
        let mut queue = lock(&shared.queue);
        if queue.push(step) {
            shared.told.notify_all();
        }
        if run.is_over() {
            return Ok(());
        }
        drop(run);
        if waits && queue.is_full() {
            let wait = |queue: &mut Queue| !queue.has_room() && queue.outcome.is_none();
            drop(shared.room.wait_while(queue, wait));
        }
    }
    if lock(&shared.run).has_begun() { Ok(()) } else { Err(SourceError::Empty { source_name: source.name().into() }) }
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
