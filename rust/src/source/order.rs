//! Lines that are not in the order of time.

use std::format;
use std::string::String;

/// Counts what is not later than something before it, and so is not used.
#[derive(Debug, Default)]
pub(super) struct Order {
    newest: Option<i64>,
    first_line: u64,
    count: u64,
}

impl Order {
    /// What line `line` tells of happened at `timestamp_ns`.
    pub(super) fn see(&mut self, timestamp_ns: i64, line: u64) {
        if self.newest.is_none_or(|newest| timestamp_ns > newest) {
            self.newest = Some(timestamp_ns);
            return;
        }
        self.count += 1;
        if self.count == 1 {
            self.first_line = line;
        }
    }

    /// What the user should know of it.
    pub(super) fn remark(&self) -> Option<String> {
        let Self { first_line, count, .. } = self;
        (*count > 0)
            .then(|| format!("time stands still or goes back in line {first_line}; not used for that: {count}; sort the lines by time"))
    }
}
