//! A capture that goes on and on takes no more memory for it. `cargo bench --bench hour` does it for an hour.

mod looped;
mod packets;
mod skipping;

#[test]
fn memory_stays_flat() {
    let loops = 30;
    let outcome = looped::watch(loops);
    assert_eq!((outcome.counters.frames, outcome.counters.packets_lost), (looped::frames(loops), 0));
    assert!(outcome.contacts > 2 * loops, "{}", outcome.contacts);
    match outcome.growth {
        Some(bytes) => assert!(bytes.abs() < 1_000_000, "{bytes} bytes in {loops} loops"),
        None => skipping::skip("this system doesn't say how much memory is resident"),
    }
}
