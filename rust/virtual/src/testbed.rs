//! The folder that umockdev's preloaded library shows to a program as `/sys` and `/dev`.

use crate::node::Node;
use crate::preload::Caller;
use crate::usbfs;
use physinc::sim::kinect::descriptor::{Descriptors, Speed};
use std::os::unix::fs::symlink;
use std::os::unix::net::UnixListener;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io, thread};

/// Where the devices' folders are.
const BUS: &str = "sys/bus/usb/devices";
/// The major number of usbfs nodes.
const MAJOR: u32 = 189;

/// It is removed when this is dropped.
pub struct Testbed {
    root: PathBuf,
}

/// Where a device is plugged in: its name in sysfs, and its address.
#[derive(Clone, Debug)]
pub struct Place {
    /// `1-1.3`: bus 1, port 1 of the root hub, port 3 of the hub there.
    pub name: String,
    /// Its number at the bus.
    pub number: u8,
}

impl Testbed {
    /// Without any device.
    pub fn new() -> io::Result<Self> {
        let root = std::env::temp_dir().join(format!("virtual-kinect-{}", std::process::id()));
        let testbed = Self { root };
        for folder in [BUS, "sys/class", "dev/.node", "dev/bus/usb/001", "ioctl/dev/bus/usb/001"] {
            fs::create_dir_all(testbed.root.join(folder))?;
        }
        Ok(testbed)
    }

    /// What `UMOCKDEV_DIR` must be.
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// Plugs a device in and serves it to whoever opens its node.
    pub fn plug(&self, place: &Place, node: Arc<Node>) -> io::Result<()> {
        let folder = self.describe(place, &node.descriptors())?;
        let at = format!("bus/usb/001/{:03}", place.number);
        symlink(node.gate.path(), self.root.join("dev").join(&at))?;
        symlink(format!("{MAJOR}:{}", place.number - 1), self.root.join("dev/.node").join(at.replace('/', "_")))?;
        let listener = UnixListener::bind(self.root.join("ioctl/dev").join(&at))?;
        symlink(Path::new("../../../devices").join(folder), self.root.join(BUS).join(&place.name))?;
        let keeper = Arc::clone(&node);
        thread::spawn(move || keeper.keep_time());
        thread::spawn(move || {
            for (client, stream) in listener.incoming().enumerate() {
                let (Ok(stream), node) = (stream, Arc::clone(&node)) else { return };
                thread::spawn(move || {
                    let client = client as u64;
                    // A program that ends in the middle of a call is no error of ours.
                    let _ = usbfs::serve(&node, client, &mut Caller::new(stream));
                    node.close(client);
                });
            }
        });
        Ok(())
    }

    /// Writes the device's folder in sysfs and returns its path below `devices`.
    fn describe(&self, place: &Place, descriptors: &Descriptors) -> io::Result<PathBuf> {
        let above: PathBuf = place.name.match_indices(['-', '.']).skip(1).map(|(end, _)| &place.name[..end]).collect();
        let folder = Path::new("usb1").join(above).join(&place.name);
        let path = self.root.join("sys/devices").join(&folder);
        fs::create_dir_all(&path)?;
        let speed = match descriptors.speed {
            Speed::Full => "12",
            Speed::High => "480",
        };
        let device = descriptors.device();
        let uevent = format!(
            "MAJOR={MAJOR}\nMINOR={}\nDEVNAME=bus/usb/001/{number:03}\nDEVTYPE=usb_device\nDRIVER=usb\nPRODUCT=45e/{:x}/{:x}\nBUSNUM=001\nDEVNUM={number:03}\n",
            place.number - 1,
            descriptors.product,
            descriptors.version,
            number = place.number,
        );
        let devpath = place.name.split_once('-').map_or("0", |(_, ports)| ports);
        for (name, value) in [
            ("busnum", "1".into()),
            ("devnum", place.number.to_string()),
            ("devpath", devpath.into()),
            ("speed", speed.into()),
            ("version", " 2.00".into()),
            ("maxchild", "0".into()),
            ("idVendor", format!("{:02x}{:02x}", device[9], device[8])),
            ("idProduct", format!("{:04x}", descriptors.product)),
            ("bcdDevice", format!("{:04x}", descriptors.version)),
            ("bDeviceClass", format!("{:02x}", device[4])),
            ("bConfigurationValue", "1".into()),
            ("bNumConfigurations", "1".into()),
            ("bNumInterfaces", " 1".into()),
            ("manufacturer", descriptors.strings[0].clone()),
            ("product", descriptors.strings[1].clone()),
            ("serial", descriptors.strings[2].clone()),
            ("dev", format!("{MAJOR}:{}", place.number - 1)),
        ] {
            if !value.is_empty() {
                fs::write(path.join(name), value + "\n")?;
            }
        }
        fs::write(path.join("uevent"), uevent)?;
        fs::write(path.join("descriptors"), [device, descriptors.configuration()].concat())?;
        let up = "../".repeat(folder.components().count() + 1);
        symlink(format!("{up}bus/usb"), path.join("subsystem"))?;
        Ok(folder)
    }
}

impl Drop for Testbed {
    fn drop(&mut self) {
        // Nobody is left to be told.
        let _ = fs::remove_dir_all(&self.root);
    }
}
