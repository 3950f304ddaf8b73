//! A capture of an hour, a few seconds of it over and over, from its bytes to events: speed in × real time, growth of memory.

#[path = "../tests/looped/mod.rs"]
mod looped;
#[path = "../tests/packets/mod.rs"]
mod packets;

use std::time::Instant;

/// 844 × 4.27 s.
const LOOPS: usize = 844;

fn main() {
    let start = Instant::now();
    let outcome = looped::watch(LOOPS);
    let (frames, elapsed) = (outcome.counters.frames, start.elapsed().as_secs_f64());
    assert_eq!(frames, looped::frames(LOOPS));
    let growth = outcome.growth.map_or("unknown".into(), |bytes| format!("{:.2} MB", bytes as f64 * 1e-6));
    let stream = frames as f64 / 30.0;
    println!("{frames} frames, {stream:.0} s of them; {} contacts; memory grew by {growth}", outcome.contacts);
    for (seconds, of) in [(Some(elapsed), "as the clock tells it"), (looped::worked(), "of the processor's time")] {
        let Some(seconds) = seconds else { continue };
        println!("{seconds:.1} s {of}: {:.0} × real time, {:.1} µs a frame", stream / seconds, seconds / frames as f64 * 1e6);
    }
}
