//! Any bytes as a capture, packed or not: read to its end, or refused with a reason.
#![no_main]

use libfuzzer_sys::fuzz_target;
use physinc::capture::Packets;
use std::io::Cursor;

fuzz_target!(|bytes: &[u8]| {
    let why = match Packets::read(Cursor::new(bytes.to_vec())) {
        Err(error) => error.to_string(),
        Ok(Err(why)) => why,
        Ok(Ok(mut packets)) => loop {
            match packets.next_packet() {
                Err(why) => break why,
                Ok(None) => return,
                Ok(Some(_)) => (),
            }
        },
    };
    assert!(!why.is_empty() && !why.contains('\n'), "{why:?}");
});
