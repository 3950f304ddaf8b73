//! The process that is the Kinect, as long as the command lives.

use crate::bus::{Bus, Place};
use crate::nature::Nature;
use crate::node::Node;
use crate::options::Options;
use crate::testbed::{Folder, Testbed};
use crate::vhci::Vhci;
use physinc::capture;
use physinc::sim::kinect::{Audio, Camera, Depth, Device, Hub, Model, Motor};
use rustix::event::{PollFd, PollFlags, poll};
use rustix::process::{PidfdFlags, getppid, pidfd_open};
use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Write};
use std::path::Path;
use std::sync::atomic::{AtomicU8, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::sync::{Arc, Mutex};
use std::thread;

/// A Kinect's devices, hub first, and where they are.
type Kinect = Vec<(Place, Arc<Node>)>;

/// Says on stdout where the folder is, and serves until the parent ends.
pub fn serve(arguments: &[OsString]) -> Result<(), String> {
    let options = Options::parse(arguments)?;
    let parent = getppid().ok_or("the command is gone already")?;
    let parent = pidfd_open(parent, PidfdFlags::empty()).map_err(|error| format!("the command can't be watched: {error}"))?;
    let folder = Folder::new().map_err(|error| format!("no folder to work in: {error}"))?;
    let bus: Arc<dyn Bus> = if options.is_kernels {
        Arc::new(Vhci::default())
    } else {
        let testbed = Testbed::new(&folder, options.has_bus, if options.is_denied { 0 } else { 0o666 });
        Arc::new(testbed.map_err(|error| format!("{}: {error}", folder.path().display()))?)
    };
    if options.has_bus {
        populate(&bus, &options)?;
    }
    println!("{}", folder.path().display());
    io::stdout().flush().map_err(|error| format!("the command can't be told: {error}"))?;
    poll(&mut [PollFd::new(&parent, PollFlags::IN)], None).map_err(|error| format!("the command can't be watched: {error}"))?;
    Ok(())
}

fn populate(bus: &Arc<dyn Bus>, options: &Options) -> Result<(), String> {
    let truth = options.truth.as_ref().map(|path| File::create(path).map_err(|error| format!("{}: {error}", path.display())));
    let truth = Arc::new(truth.transpose()?.map(Mutex::new));
    let addresses = Arc::new(AtomicU8::new(0));
    let failed = |error: io::Error| format!("nothing can be plugged in: {error}");
    let root = vec![("usb1".to_owned(), Arc::new(Node::new(Box::new(Hub::root()), nature(options))))];
    plug(&**bus, &root, &addresses).map_err(failed)?;
    for number in 0..if options.has_devices { options.count } else { 0 } {
        let (sender, receiver) = channel();
        let devices = devices(options, number, &truth, &sender)?;
        let kinect = plug(&**bus, &devices, &addresses).map_err(failed)?;
        let (bus, addresses, options) = (Arc::clone(bus), Arc::clone(&addresses), options.clone());
        thread::spawn(move || pull_and_plug(&*bus, kinect, &addresses, &options, &receiver));
    }
    Ok(())
}

/// The devices of Kinect `number` by their places' names.
fn devices(
    options: &Options,
    number: u8,
    truth: &Arc<Option<Mutex<File>>>,
    pulled: &Sender<()>,
) -> Result<Vec<(String, Arc<Node>)>, String> {
    let serial = format!("V0000000000100{}A", char::from(b'A' + number % 26));
    let mut devices = vec![(Box::new(Hub::inside()) as Box<dyn Device>, nature(options))];
    let has = |part: &str| !options.without.iter().any(|other| other == part);
    if has("motor") {
        devices.push((Box::new(if options.model == Model::M1414 { Motor::default() } else { Motor::silent() }), nature(options)));
    }
    if has("audio") {
        devices.push((Box::new(Audio::new(&serial)), nature(options)));
    }
    if has("camera") {
        let camera = Camera::new(options.model, &serial, depth(options)?, options.reply);
        let (truth, pulled) = (Arc::clone(truth), pulled.clone());
        let on_frame = move |frame: &_| {
            if let Some(Ok(mut file)) = truth.as_ref().as_ref().map(Mutex::lock) {
                // A truth that can't be written will be missed by who reads it.
                let _ = writeln!(file, "{}", serde_json::json!({"device": number, "sent": frame}));
            }
        };
        let nature = Nature {
            driver: options.driver.clone(),
            is_busy: options.is_busy,
            pull: options.unplug.map(|unplug| unplug.at),
            refuse: options.refuse,
            on_frame: Box::new(on_frame),
            on_pull: Box::new(move || _ = pulled.send(())),
            ..nature(options)
        };
        devices.push((Box::new(camera), nature));
    }
    let hub = format!("1-{}", number + 1);
    let names = std::iter::once(hub.clone()).chain((1..).map(|port| format!("{hub}.{port}")));
    let nodes = devices.into_iter().map(|(device, nature)| {
        let node = Arc::new(Node::new(device, nature));
        let keeper = Arc::clone(&node);
        thread::spawn(move || keeper.keep_time());
        node
    });
    Ok(names.zip(nodes).collect())
}

/// Of a device to which nothing happens.
fn nature(options: &Options) -> Nature {
    Nature {
        pace: options.pace,
        driver: None,
        is_busy: false,
        pull: None,
        refuse: None,
        on_frame: Box::new(|_| ()),
        on_pull: Box::new(|| ()),
    }
}

fn plug(bus: &dyn Bus, devices: &[(String, Arc<Node>)], addresses: &AtomicU8) -> io::Result<Kinect> {
    let plug = |(name, node): &(String, Arc<Node>)| {
        // The next that is free, round and round, as the kernel does.
        let next = || Place { name: name.clone(), address: addresses.fetch_add(1, Ordering::Relaxed) % 126 + 1 };
        let place = std::iter::repeat_with(next).find(|place| !bus.has(place)).unwrap_or_else(next);
        bus.plug(&place, node)?;
        Ok((place, Arc::clone(node)))
    };
    devices.iter().map(plug).collect()
}

/// Pulls a Kinect whenever its camera says so, and plugs it in again.
fn pull_and_plug(bus: &dyn Bus, mut kinect: Kinect, addresses: &AtomicU8, options: &Options, pulled: &Receiver<()>) {
    let Some(unplug) = options.unplug else { return };
    for _ in 0..unplug.times {
        if pulled.recv().is_err() {
            return;
        }
        // The innermost first, as their folders are.
        let gone = kinect.iter().rev().try_for_each(|(place, node)| bus.pull(place, node));
        let Some(back) = unplug.back else { return };
        thread::sleep(back);
        let devices: Vec<_> = kinect.into_iter().map(|(place, node)| (place.name, node)).collect();
        match gone.and_then(|()| plug(bus, &devices, addresses)) {
            Ok(plugged) => kinect = plugged,
            Err(error) => return eprintln!("virtual-kinect: it can't be plugged in again: {error}"),
        }
    }
}

fn depth(options: &Options) -> Result<Depth, String> {
    let (view, faults) = (&*options.view, options.faults.clone());
    if let Some(scene) = view.strip_prefix("sim:") {
        return Depth::scene(scene, faults).map_err(|error| error.to_string());
    }
    let packets = capture::Packets::open(Path::new(view)).map_err(|error| format!("{view}: {error}"))?;
    Ok(Depth::recording(packets.map_err(|what| format!("{view}: {what}"))?, faults))
}
