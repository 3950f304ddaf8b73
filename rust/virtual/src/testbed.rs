//! The folder that umockdev's preloaded library shows to a program as `/sys` and `/dev`.

use crate::bus::{Bus, Place};
use crate::hotplug;
use crate::nature::Client;
use crate::node::Node;
use crate::preload::Caller;
use crate::usbfs;
use physinc::sim::kinect::descriptor::{Descriptors, Speed};
use std::fs::Permissions;
use std::os::unix::fs::{PermissionsExt, symlink};
use std::os::unix::net::{UnixListener, UnixStream};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::{fs, io, thread};

/// Where the devices' folders are, and their nodes.
const BUS: &str = "sys/bus/usb/devices";
const NODES: &str = "dev/bus/usb/001";
const SOCKETS: &str = "ioctl/dev/bus/usb/001";
/// The major number of usbfs nodes.
const MAJOR: u32 = 189;
/// MB that usbfs lends to programs, as Linux has it.
const MEMORY: (&str, &str) = ("sys/module/usbcore/parameters", "usbfs_memory_mb");

/// A folder of its own, which is removed when this is dropped.
pub struct Folder(PathBuf);

impl Folder {
    /// Empty.
    pub fn new() -> io::Result<Self> {
        let path = std::env::temp_dir().join(format!("virtual-kinect-{}", std::process::id()));
        fs::create_dir(&path)?;
        // Whoever the command runs as may listen here for devices that come and go.
        fs::set_permissions(&path, Permissions::from_mode(0o777))?;
        Ok(Self(path))
    }

    /// What `UMOCKDEV_DIR` must be.
    pub fn path(&self) -> &Path {
        &self.0
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Nobody is left to be told.
        let _ = fs::remove_dir_all(&self.0);
    }
}

/// Devices in a folder.
pub struct Testbed {
    root: PathBuf,
    /// Of the nodes.
    mode: u32,
}

impl Place {
    /// Its folder below `sys/devices`, in those of the hubs above it.
    fn folder(&self) -> PathBuf {
        let hubs = self.name.match_indices('.').map(|(end, _)| &self.name[..end]);
        let root = (self.name != "usb1").then_some("usb1");
        root.into_iter().chain(hubs).chain([&*self.name]).collect()
    }

    fn node(&self) -> String {
        format!("bus/usb/001/{:03}", self.address)
    }

    fn properties(&self, descriptors: &Descriptors) -> Vec<String> {
        let Self { address, .. } = self;
        let Descriptors { vendor, product, version, .. } = descriptors;
        [
            ("MAJOR", MAJOR.to_string()),
            ("MINOR", (address - 1).to_string()),
            ("DEVNAME", self.node()),
            ("DEVTYPE", "usb_device".into()),
            ("PRODUCT", format!("{vendor:x}/{product:x}/{version:x}")),
            ("BUSNUM", "001".into()),
            ("DEVNUM", format!("{address:03}")),
        ]
        .map(|(key, value)| format!("{key}={value}"))
        .into()
    }
}

impl Testbed {
    /// Without any device, and perhaps without a bus; the nodes will have this mode.
    pub fn new(folder: &Folder, has_bus: bool, mode: u32) -> io::Result<Self> {
        let testbed = Self { root: folder.path().into(), mode };
        let bus: &[&str] = if has_bus { &[BUS, NODES, SOCKETS, MEMORY.0, "dev/.node"] } else { &[] };
        for folder in ["sys/class", "sys/devices", "dev"].iter().chain(bus) {
            fs::create_dir_all(testbed.root.join(folder))?;
        }
        if has_bus {
            fs::write(testbed.root.join(MEMORY.0).join(MEMORY.1), "16\n")?;
        }
        Ok(testbed)
    }

    fn socket(&self, place: &Place) -> PathBuf {
        self.root.join("ioctl/dev").join(place.node())
    }

    fn announce(&self, action: &str, place: &Place, descriptors: &Descriptors) -> io::Result<()> {
        let mut properties = place.properties(descriptors);
        let devpath = Path::new("/devices").join(place.folder());
        properties.extend([
            format!("ACTION={action}"),
            format!("DEVPATH={}", devpath.display()),
            "SUBSYSTEM=usb".into(),
            "SEQNUM=1".into(),
        ]);
        hotplug::announce(&self.root, &properties)
    }

    /// The kernel's `driver` has the interface.
    fn bind(&self, place: &Place, driver: &str) -> io::Result<()> {
        let interface = self.root.join("sys/devices").join(place.folder()).join(format!("{}:1.0", place.name));
        fs::create_dir_all(&interface)?;
        symlink(format!("../drivers/{driver}"), interface.join("driver"))
    }

    /// Writes the device's folder in sysfs.
    fn describe(&self, place: &Place, descriptors: &Descriptors) -> io::Result<()> {
        let folder = place.folder();
        let path = self.root.join("sys/devices").join(&folder);
        fs::create_dir_all(&path)?;
        let speed = match descriptors.speed {
            Speed::Full => "12",
            Speed::High => "480",
        };
        let device = descriptors.device();
        let [manufacturer, product, serial] = descriptors.strings.clone();
        for (name, value) in [
            ("busnum", "1".into()),
            ("devnum", place.address.to_string()),
            ("devpath", place.name.split_once('-').map_or("0", |(_, ports)| ports).into()),
            ("speed", speed.into()),
            ("version", " 2.00".into()),
            ("idVendor", format!("{:04x}", descriptors.vendor)),
            ("idProduct", format!("{:04x}", descriptors.product)),
            ("bcdDevice", format!("{:04x}", descriptors.version)),
            ("bDeviceClass", format!("{:02x}", device[4])),
            ("bConfigurationValue", "1".into()),
            ("bNumConfigurations", "1".into()),
            ("bNumInterfaces", " 1".into()),
            ("manufacturer", manufacturer),
            ("product", product),
            ("serial", serial),
            ("dev", format!("{MAJOR}:{}", place.address - 1)),
            ("uevent", place.properties(descriptors).join("\n")),
        ] {
            if !value.is_empty() {
                fs::write(path.join(name), value + "\n")?;
            }
        }
        fs::write(path.join("descriptors"), [device, descriptors.configuration()].concat())?;
        let up = "../".repeat(folder.components().count() + 1);
        symlink(format!("{up}bus/usb"), path.join("subsystem"))?;
        symlink(Path::new("../../../devices").join(folder), self.root.join(BUS).join(&place.name))
    }
}

impl Bus for Testbed {
    fn plug(&self, place: &Place, node: &Arc<Node>) -> io::Result<()> {
        let (gate, plugs) = node.plug(place.address)?;
        let descriptors = node.descriptors();
        fs::set_permissions(&gate, Permissions::from_mode(self.mode))?;
        symlink(gate, self.root.join("dev").join(place.node()))?;
        symlink(format!("{MAJOR}:{}", place.address - 1), self.root.join("dev/.node").join(place.node().replace('/', "_")))?;
        let socket = self.socket(place);
        let listener = UnixListener::bind(&socket)?;
        fs::set_permissions(socket, Permissions::from_mode(0o777))?;
        let server = Arc::clone(node);
        thread::spawn(move || listen(&listener, &server, plugs));
        self.describe(place, &descriptors)?;
        if let Some(driver) = &node.state().driver {
            self.bind(place, driver)?;
        }
        self.announce("add", place, &descriptors)
    }

    fn pull(&self, place: &Place, node: &Node) -> io::Result<()> {
        node.pull();
        fs::remove_file(self.root.join(BUS).join(&place.name))?;
        fs::remove_dir_all(self.root.join("sys/devices").join(place.folder()))?;
        fs::remove_file(self.root.join("dev").join(place.node()))?;
        fs::remove_file(self.root.join("dev/.node").join(place.node().replace('/', "_")))?;
        // The listener wakes up and sees that its device is gone.
        let socket = self.socket(place);
        drop(UnixStream::connect(&socket));
        fs::remove_file(socket)?;
        self.announce("remove", place, &node.descriptors())
    }

    fn has(&self, place: &Place) -> bool {
        self.socket(place).exists()
    }
}

/// Serves programs until the device is pulled.
fn listen(listener: &UnixListener, node: &Arc<Node>, plugs: u64) {
    for (number, stream) in (0..).zip(listener.incoming()) {
        let (Ok(stream), client) = (stream, Client(plugs, number)) else { return };
        if !node.state().has(client) {
            return;
        }
        let node = Arc::clone(node);
        thread::spawn(move || {
            // A program that ends in the middle of a call is no error of ours.
            let _ = usbfs::serve(&node, client, &mut Caller::new(stream));
            node.close(client);
        });
    }
}
