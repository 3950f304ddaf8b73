//! A live Kinect as a source of packets.

use super::camera::{OpenCamera, Wanted};
use super::devices::{Identity, attached, meant};
use super::error::{DeviceError, Problem};
use super::ffi::{Fault, Packet, UsbError};
use crate::config::CameraConfig;
use crate::event::{DisconnectReason, ReconnectReason};
use crate::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use crate::kinect::disparity::Packing;
use crate::kinect::session::Calibration;
use crate::kinect::video::Video;
use crate::source::{Input, Kinect, LatestVideo, Source, SourceError};
use crate::stream::assembler::Assembler;
use core::time::Duration;
use std::boxed::Box;
use std::format;
use std::string::{String, ToString};
use std::sync::Arc;
use std::time::{Instant, SystemTime, UNIX_EPOCH};
use std::vec::Vec;

/// Whoever reads hears so often that there is nothing to hear.
const SILENCE: Duration = Duration::from_millis(50);

/// What came over the wire.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Traffic {
    /// How often the host woke up for it.
    pub wakeups: u64,
    /// Packets with something in them.
    pub packets: u64,
    /// Packets of length zero, of which there are some between any two frames.
    pub empty: u64,
    /// Packets that were garbled, or never answered.
    pub garbled: u64,
    /// Packets that were too long.
    pub overflowed: u64,
    /// Packets with another fault.
    pub faulty: u64,
}

/// A Kinect, its depth flowing.
pub struct Live {
    name: String,
    camera: Camera,
    wanted: Wanted,
    video: Option<LiveVideo>,
    calibration: Calibration,
    /// By what it is recognised when it comes back, and for how long that is awaited.
    identity: Identity,
    patience: Option<Duration>,
    link: Link,
    traffic: Traffic,
    /// A moment on the host's two clocks: steady, and of the day, ns.
    epoch: (Instant, i64),
    newest_ns: i64,
}

/// What becomes of video.
struct LiveVideo {
    assembler: Assembler<Vec<u8>, Video>,
    latest: Arc<LatestVideo>,
}

impl LiveVideo {
    fn new(video: Video) -> Option<Self> {
        let assembler = Assembler::new(video, std::vec![0; video.frame_bytes()]).ok()?;
        Some(Self { assembler, latest: Arc::default() })
    }
}

enum Link {
    Up(Box<OpenCamera>),
    Away { since: Instant, evidence: String },
}

/// What there is to be handed on.
enum Next {
    Packet { arrival: Instant },
    Silence,
    Disconnected(DisconnectReason),
    Reconnected,
}

impl Live {
    /// Opens what `name` names: `kinect` (the first, and no other if another program has it), `kinect:SERIAL`, `kinect:PLACE` or
    /// `kinect:INDEX`, and behind a `?` perhaps `transfers=16` (how many are out at once), `packets=64` (how many each has, 125 µs apart:
    /// fewer come sooner, more wake the host less often) and `video=color` or `video=infrared`.
    /// The camera is as `keys` say, else as the device itself tells.
    ///
    /// # Errors
    /// There is none, or it can't be had.
    pub fn open(name: &str, keys: &CameraConfig) -> Result<Self, SourceError> {
        let (device, wanted) = parse(name).map_err(|what| SourceError::unknown(name, what))?;
        let open = connect(device, wanted).map_err(|problem| DeviceError::new(name, problem))?;
        let calibration = open.calibration;
        let plane = calibration.zero_plane;
        let law = plane.map_or(KINECT_DISPARITY_LAW, |plane| plane.law());
        let focal_length = plane.map(|plane| plane.focal_length_px());
        let keys = CameraConfig { fx: keys.fx.or(focal_length), fy: keys.fy.or(focal_length), ..keys.clone() };
        let camera = Camera::from_config(&keys, DepthCode::Disparity { law })?;
        let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |now| now.as_nanos() as i64);
        Ok(Self {
            name: name.into(),
            camera,
            wanted,
            video: wanted.video.and_then(LiveVideo::new),
            calibration,
            identity: open.identity.clone(),
            patience: None,
            link: Link::Up(open),
            traffic: Traffic::default(),
            epoch: (Instant::now(), now),
            newest_ns: i64::MIN,
        })
    }

    /// What the device said of itself on opening.
    pub fn calibration(&self) -> &Calibration {
        &self.calibration
    }

    /// What came over the wire so far.
    pub fn traffic(&self) -> Traffic {
        self.traffic
    }

    /// Waits for something to hand on.
    fn wait(&mut self) -> Result<Next, SourceError> {
        let mut waiting = None;
        loop {
            let open = match &mut self.link {
                Link::Up(open) => open,
                Link::Away { .. } => return self.look_for_it(),
            };
            let outcome = match open.depth.advance() {
                Ok(true) => match self.traffic.count(open) {
                    Some(arrival) => return Ok(Next::Packet { arrival }),
                    None => continue,
                },
                Ok(false) if waiting.is_some_and(|since: Instant| since.elapsed() >= SILENCE) => return Ok(Next::Silence),
                Ok(false) => {
                    waiting.get_or_insert_with(Instant::now);
                    self.traffic.wakeups += 1;
                    let outcome = open.handle.context().handle_events(SILENCE);
                    outcome.and_then(|()| self.watch_video())
                }
                Err(error) => Err(error),
            };
            if let Err(error) = outcome {
                let reason = if error.is_gone() { DisconnectReason::Unplugged } else { DisconnectReason::UsbError };
                // The device is let go of here.
                self.link = Link::Away { since: Instant::now(), evidence: error.to_string() };
                return Ok(Next::Disconnected(reason));
            }
        }
    }

    /// Puts together what came of video.
    fn watch_video(&mut self) -> Result<(), UsbError> {
        let (Link::Up(open), Some(LiveVideo { assembler, latest })) = (&mut self.link, &mut self.video) else { return Ok(()) };
        let Some(ring) = &mut open.video else { return Ok(()) };
        let epoch = self.epoch;
        while ring.advance()? {
            if let Some(Packet { bytes: Ok(bytes), arrival }) = ring.packet() {
                assembler.push(bytes, nanoseconds(epoch, arrival), &mut |frame| latest.put(&frame));
            }
        }
        Ok(())
    }

    /// Looks whether the device is back.
    fn look_for_it(&mut self) -> Result<Next, SourceError> {
        let Link::Away { since, evidence } = &self.link else { return Ok(Next::Silence) };
        if self.patience.is_none_or(|patience| since.elapsed() > patience) {
            let problem = Problem::Gone { evidence: evidence.clone() };
            return Err(DeviceError::new(&self.name, problem).into());
        }
        std::thread::sleep(SILENCE);
        // It comes in steps, and permission last.
        let Ok(open) = connect(self.identity.name(), self.wanted) else { return Ok(Next::Silence) };
        self.link = Link::Up(open);
        if let Some(video) = &mut self.video {
            video.assembler.begin_anew();
        }
        Ok(Next::Reconnected)
    }
}

/// `moment` on the day's clock, by a moment on both, ns.
fn nanoseconds((instant, ns): (Instant, i64), moment: Instant) -> i64 {
    let since = moment.checked_duration_since(instant).unwrap_or_default();
    ns.saturating_add(since.as_nanos() as i64)
}

impl Traffic {
    /// Counts the packet that the ring came to; when it arrived, if there is something in it.
    fn count(&mut self, open: &OpenCamera) -> Option<Instant> {
        let packet = open.depth.packet()?;
        let counter = match packet.bytes {
            Ok([]) => &mut self.empty,
            Ok(_) => &mut self.packets,
            Err(Fault::Garbled) => &mut self.garbled,
            Err(Fault::Overflow) => &mut self.overflowed,
            Err(Fault::Other) => &mut self.faulty,
        };
        *counter += 1;
        packet.bytes.is_ok_and(|bytes| !bytes.is_empty()).then_some(packet.arrival)
    }
}

impl Source for Live {
    fn name(&self) -> &str {
        &self.name
    }

    fn camera(&self) -> Option<Camera> {
        Some(self.camera)
    }

    fn kinect(&self) -> Option<Kinect> {
        Some(Kinect { packing: Packing::Eleven, zero_plane: self.calibration.zero_plane })
    }

    fn is_live(&self) -> bool {
        true
    }

    fn video(&self) -> Option<Arc<LatestVideo>> {
        self.video.as_ref().map(|video| Arc::clone(&video.latest))
    }

    fn wait_for_return(&mut self, patience: Duration) {
        self.patience = Some(patience);
    }

    fn remarks(&self) -> Vec<String> {
        let Traffic { garbled, overflowed, faulty, .. } = self.traffic;
        let mut remarks = Vec::new();
        if self.calibration.zero_plane.is_none() {
            remarks.push("its own calibration makes no sense: depth is that of a typical Kinect".into());
        }
        if garbled + overflowed + faulty > 0 {
            let counts = format!("{garbled} garbled, {overflowed} too long, {faulty} otherwise");
            remarks.push(format!("packets that USB lost: {counts}; another port, a shorter cable or no hub may help"));
        }
        remarks
    }

    fn next_input(&mut self) -> Result<Option<Input<'_>>, SourceError> {
        let arrival = match self.wait()? {
            Next::Packet { arrival } => arrival,
            Next::Silence => return Ok(Some(Input::Silence)),
            Next::Disconnected(reason) => return Ok(Some(Input::Disconnected(reason))),
            Next::Reconnected => {
                return Ok(Some(Input::Reconnected(match self.identity {
                    Identity::Serial(_) => ReconnectReason::SameSerial,
                    Identity::Place(_) => ReconnectReason::SamePort,
                })));
            }
        };
        // It never goes back, however the host's threads are woken.
        self.newest_ns = self.newest_ns.max(nanoseconds(self.epoch, arrival));
        let packet = match &self.link {
            Link::Up(open) => open.depth.packet(),
            Link::Away { .. } => None,
        };
        let bytes = packet.and_then(|packet| packet.bytes.ok()).unwrap_or_default();
        Ok(Some(Input::Packet { bytes, arrival_ns: self.newest_ns }))
    }
}

/// Opens the one that `name` means.
fn connect(name: &str, wanted: Wanted) -> Result<Box<OpenCamera>, Problem> {
    OpenCamera::start(&meant(name, attached()?)?, wanted).map(Box::new)
}

/// Which device, and what is asked of it.
fn parse(name: &str) -> Result<(&str, Wanted), String> {
    let (device, keys) = name.split_once('?').unwrap_or((name, ""));
    let device = device.trim_start_matches("kinect").trim_start_matches(':');
    let mut wanted = Wanted { transfers: 16, packets: 64, video: None };
    for pair in keys.split('&').filter(|pair| !pair.is_empty()) {
        let (key, value) = pair.split_once('=').unwrap_or((pair, ""));
        let (place, most) = match key {
            "transfers" => (&mut wanted.transfers, 256),
            "packets" => (&mut wanted.packets, 128),
            "video" => {
                wanted.video = Some(match value {
                    "color" => Video::Color,
                    "infrared" => Video::Infrared,
                    _ => return Err(format!("{pair}: expected color or infrared")),
                });
                continue;
            }
            _ => return Err(format!("{key} is no key of a Kinect; there are transfers, packets and video")),
        };
        *place = value.parse().ok().filter(|count| (1..=most).contains(count)).ok_or_else(|| format!("{pair}: expected 1 to {most}"))?;
    }
    Ok((device, wanted))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_say_which_and_how() {
        let default = Wanted { transfers: 16, packets: 64, video: None };
        assert_eq!(parse("kinect"), Ok(("", default)));
        assert_eq!(parse("kinect:A00362A12345"), Ok(("A00362A12345", default)));
        assert_eq!(parse("kinect:1-2.1?packets=16&transfers=8"), Ok(("1-2.1", Wanted { transfers: 8, packets: 16, ..default })));
        assert_eq!(parse("kinect?video=infrared"), Ok(("", Wanted { video: Some(Video::Infrared), ..default })));
        for wrong in ["kinect?video=red", "kinect?packets=129", "kinect?packets=0", "kinect?transfers=", "kinect?lose=1"] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }
}
