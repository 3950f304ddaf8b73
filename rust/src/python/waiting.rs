//! Waiting that Ctrl-C ends.

use super::error::{PhysincError, StreamTimeoutError};
use pyo3::prelude::*;
use std::format;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::{Duration, Instant};

/// Between two looks at the interpreter's signals.
pub const SLICE: Duration = Duration::from_millis(50);

/// What `work` comes to, on a thread of its own and with the interpreter released: opening or reading a pipe may take for ever, and then
/// `patience` ends, or Ctrl-C.
pub fn wait_for<T: Send + 'static>(py: Python<'_>, patience: Option<Duration>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    let (sender, receiver) = channel();
    let start = Instant::now();
    std::thread::spawn(move || sender.send(work()));
    py.detach(move || {
        loop {
            match receiver.recv_timeout(SLICE) {
                Ok(outcome) => return Ok(outcome),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(PhysincError::new_err("physinc made a mistake while reading (the panic is on stderr); please report it"));
                }
                #[allow(clippy::redundant_closure_for_method_calls)] // The method by itself is not of every lifetime.
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
            }
            check_patience(start, patience)?;
        }
    })
}

/// An error where nothing has come since `start` for longer than `patience`.
pub fn check_patience(start: Instant, patience: Option<Duration>) -> PyResult<()> {
    let silent = start.elapsed();
    if patience.is_none_or(|patience| silent < patience) {
        return Ok(());
    }
    let seconds = silent.as_secs_f64();
    Err(StreamTimeoutError::new_err(format!("no input for {seconds:.1} s; timeout=... waits longer, timeout=None as long as it takes")))
}
