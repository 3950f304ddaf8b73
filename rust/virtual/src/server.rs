//! The process that is the Kinect, as long as the command lives.

use crate::node::Node;
use crate::options::Options;
use crate::testbed::{Place, Testbed};
use physinc::capture;
use physinc::sim::kinect::{Audio, Camera, Depth, Device, Ending, Motor};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{PidfdFlags, getppid, pidfd_open};
use std::ffi::OsString;
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// The serial number of a virtual Kinect.
const SERIAL: &str = "V00000000001000A";

/// Says on stdout where the folder is, and serves until the parent ends.
pub fn serve(arguments: &[OsString]) -> Result<(), String> {
    let options = Options::parse(arguments)?;
    let parent = getppid().ok_or("the command is gone already")?;
    let parent = pidfd_open(parent, PidfdFlags::empty()).map_err(|error| format!("the command can't be watched: {error}"))?;
    let testbed = Testbed::new().map_err(|error| format!("no folder to work in: {error}"))?;
    let camera = Camera::new(depth(options.view.as_deref().unwrap_or("sim:bounce"))?, SERIAL);
    let devices: [Box<dyn Device>; 3] = [Box::new(Motor::default()), Box::new(Audio::new(SERIAL)), Box::new(camera)];
    for (port, device) in (1..).zip(devices) {
        let place = Place { name: format!("1-1.{port}"), number: port + 2 };
        let node = Node::new(device, place.number, options.is_realtime);
        let plugged = node.and_then(|node| testbed.plug(&place, Arc::new(node)));
        plugged.map_err(|error| format!("{} can't be plugged in: {error}", place.name))?;
    }
    println!("{}", testbed.root().display());
    std::io::stdout().flush().map_err(|error| format!("the command can't be told: {error}"))?;
    poll(&mut [PollFd::new(&parent, PollFlags::IN)], None).map_err(|error| format!("the command can't be watched: {error}"))?;
    Ok(())
}

fn depth(view: &str) -> Result<Depth, String> {
    if let Some(scene) = view.strip_prefix("sim:") {
        return Depth::scene(scene, Ending::Again).map_err(|error| error.to_string());
    }
    let packets = capture::Packets::open(Path::new(view)).map_err(|error| format!("{view}: {error}"))?;
    Ok(Depth::recording(packets.map_err(|what| format!("{view}: {what}"))?))
}
