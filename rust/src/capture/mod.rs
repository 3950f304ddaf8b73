//! Captures of a Kinect's USB traffic, as Linux's usbmon makes them: pcap and pcapng, link types 189 and 220, in either byte order, as they
//! are or packed by gzip or zstd. A capture is streamed: whatever its size, memory stays bounded.

mod bus;
mod interface;
mod order;
mod output;
mod packets;
mod records;
mod unpacked;
mod urb;
mod writer;

pub use output::{Output, occupied};
pub use packets::Packets;
pub use writer::Writer;
