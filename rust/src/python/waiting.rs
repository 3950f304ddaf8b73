//! Waiting that Ctrl-C ends.

use super::error::PhysincError;
use pyo3::prelude::*;
use std::sync::mpsc::{RecvTimeoutError, channel};
use std::time::Duration;

/// Between two looks at the interpreter's signals.
pub const SLICE: Duration = Duration::from_millis(50);

/// What `work` comes to, on a thread of its own and with the interpreter released: opening a pipe may take for ever.
pub fn wait_for<T: Send + 'static>(py: Python<'_>, work: impl FnOnce() -> T + Send + 'static) -> PyResult<T> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || sender.send(work()));
    py.detach(move || {
        loop {
            match receiver.recv_timeout(SLICE) {
                Ok(outcome) => return Ok(outcome),
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(PhysincError::new_err("physinc made a mistake while opening (the panic is on stderr); please report it"));
                }
                #[allow(clippy::redundant_closure_for_method_calls)] // The method by itself is not of every lifetime.
                Err(RecvTimeoutError::Timeout) => Python::attach(|py| py.check_signals())?,
            }
        }
    })
}
