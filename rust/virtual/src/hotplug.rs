//! Tells programs that a device came or went, as udev would: a message to each socket that listens for uevents.

use std::os::unix::net::UnixDatagram;
use std::path::Path;
use std::{fs, io};

/// Of libudev's header.
const MAGIC: u32 = 0xfeed_cafe;
const HEADER: u32 = 40;

/// Sends the device's `properties`, `ACTION=add` or `remove` among them, to every listener in `root`.
pub fn announce(root: &Path, properties: &[String]) -> io::Result<()> {
    let properties: Vec<u8> = properties.iter().flat_map(|property| [property.as_bytes(), &[0]].concat()).collect();
    let mut message = b"libudev\0".to_vec();
    message.extend(MAGIC.to_be_bytes());
    message.extend([HEADER, HEADER, properties.len() as u32].map(u32::to_ne_bytes).as_flattened());
    message.extend(["usb", "usb_device"].map(|name| hash(name.as_bytes()).to_be_bytes()).as_flattened());
    // No tags.
    message.extend([0; 8]);
    message.extend(properties);
    let sender = UnixDatagram::unbound()?;
    for entry in fs::read_dir(root)? {
        let entry = entry?;
        if entry.file_name().to_string_lossy().starts_with("event") {
            // A listener that has gone left its socket behind.
            let _ = sender.send_to(&message, entry.path());
        }
    }
    Ok(())
}

/// Murmur's second hash with seed 0, by which listeners are chosen.
fn hash(bytes: &[u8]) -> u32 {
    const FACTOR: u32 = 0x5bd1_e995;
    let (words, rest) = bytes.as_chunks::<4>();
    let mut hash = bytes.len() as u32;
    for word in words {
        let mut k = u32::from_le_bytes(*word).wrapping_mul(FACTOR);
        k ^= k >> 24;
        hash = hash.wrapping_mul(FACTOR) ^ k.wrapping_mul(FACTOR);
    }
    if !rest.is_empty() {
        hash ^= rest.iter().rev().fold(0, |word, byte| word << 8 | u32::from(*byte));
        hash = hash.wrapping_mul(FACTOR);
    }
    hash ^= hash >> 13;
    hash = hash.wrapping_mul(FACTOR);
    hash ^ hash >> 15
}
