//! Frames of a live Kinect as samples of 16 bits, without the engine: `live [COUNT] [NAME]`, by default 90 of `kinect`.
//! At the end it says what came over the wire, and how often the host woke up for it.

use physinc::config::CameraConfig;
use physinc::geometry::camera::NO_DISPARITY;
use physinc::kinect::disparity::{HEIGHT, Packing, WIDTH};
use physinc::source::usb::Live;
use physinc::source::{Input, Source};
use physinc::stream::assembler::Assembler;
use std::error::Error;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let count: u64 = arguments.first().map_or(Ok(90), |count| count.parse())?;
    let name = arguments.get(1).map_or("kinect", String::as_str);
    let mut live = Live::open(name, &CameraConfig::default())?;
    let mut assembler = Assembler::new(Packing::Eleven, vec![0; Packing::Eleven.frame_bytes()])?;
    let mut samples = vec![0; WIDTH * HEIGHT];
    let begun = Instant::now();
    while assembler.counters().frames < count {
        let Some(input) = live.next_input()? else { break };
        if let Input::Packet { bytes, arrival_ns } = input {
            assembler.push(bytes, arrival_ns, &mut |frame| {
                // As long as the frame is.
                let _ = frame.packing.unpack(frame.packed, &mut samples);
            });
        }
    }
    let seen = samples.iter().filter(|sample| **sample != NO_DISPARITY).count();
    println!("{:?}\n{:?} in {:.2?}", assembler.counters(), live.traffic(), begun.elapsed());
    println!("the last frame has a reading at {seen} of {} pixels", samples.len());
    Ok(())
}
