//! Makes the packaged demo and `fixtures/` anew, byte for byte: `make recordings`.
#![allow(missing_docs)]

mod usbmon;

use physinc::capture::Writer;
use physinc::config::Config;
use physinc::kinect::disparity::Packing;
use physinc::sim::packets::zero_plane;
use physinc::sim::simulate;
use physinc::source::{Input, open};
use std::error::Error;
use std::fs;
use std::path::Path;

const DEMO: &str = "bounce?seed=1";
/// One throw: a bounce on the floor, one on the box.
const THROW: &str = "bounce?throws=1&seed=5";
/// As small as zstd makes it.
const LEVEL: Option<u8> = Some(19);
/// Names, and the faults that happened.
const FAULTS: [(&str, &str); 9] = [
    ("lost", "lose=0.05&seed=1"),
    ("bursts", "lose=0.05&burst=20&seed=2"),
    ("empty", "empty=0.02&seed=3"),
    ("short", "short=0.02&seed=4"),
    ("doubled", "double=0.02&seed=5"),
    ("foreign", "foreign=0.005&seed=6"),
    ("late", "late=0.02&seed=7"),
    ("flipped", "flip=0.02&seed=8"),
    ("silence", "silence=0.0001&seed=2"),
];

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    make_demo(&root.join("python/physinc"))?;
    make_fixtures(&root.join("fixtures"))
}

/// The camera is asked of the file; what really happened is no user's business.
fn make_demo(package: &Path) -> Result<(), Box<dyn Error>> {
    let [demo, camera] = ["demo.pcapng.zst", "demo.camera.toml"].map(|name| package.join(name));
    fs::remove_file(&demo).and_then(|()| fs::remove_file(camera))?;
    let made = simulate(DEMO, &demo)?;
    Ok(fs::remove_file(made.truth)?)
}

fn make_fixtures(folder: &Path) -> Result<(), Box<dyn Error>> {
    let clean = folder.join("clean.pcapng.zst");
    fs::remove_file(&clean)?;
    let made = simulate(THROW, &clean)?;
    fs::rename(made.camera, folder.join("camera.toml"))?;
    fs::rename(made.truth, folder.join("truth.json"))?;
    let clean = clean.to_str().ok_or("the path is no text")?;
    for (name, faults) in FAULTS {
        let mut writer = Writer::create(&folder.join(format!("{name}.pcapng.zst")), LEVEL)?;
        let mut introduced = false;
        each_packet(&format!("{clean}?{faults}"), |bytes, arrival_ns| {
            if !std::mem::replace(&mut introduced, true) {
                writer.introduce(Some(&zero_plane()), Packing::Eleven, arrival_ns)?;
            }
            Ok(writer.packet(bytes, arrival_ns)?)
        })?;
        writer.close()?;
    }
    let whole = fs::read(clean)?;
    fs::write(folder.join("cut.pcapng.zst"), &whole[..whole.len() * 3 / 4])?;
    usbmon::write(&folder.join("big_endian_189.pcap.gz"), |write| each_packet(clean, write))
}

fn each_packet(name: &str, mut write: impl FnMut(&[u8], i64) -> Result<(), Box<dyn Error>>) -> Result<(), Box<dyn Error>> {
    let mut source = open(name, &Config::default(), None)?;
    while let Some(input) = source.next_input()? {
        if let Input::Packet { bytes, arrival_ns } = input {
            write(bytes, arrival_ns)?;
        }
    }
    Ok(())
}
