//! Links the core without an allocator and without the operating system's start-up code, runs it once, and ends with 0.
//!
//! With the feature `with_vec` it owns one `Vec`, and must not build: that shows that the proof can fail.
#![no_std]
#![no_main]

use core::hint::black_box;
use physinc::config::{CameraConfig, Config};
use physinc::detect::Blob;
use physinc::engine::Engine;
use physinc::event::{Event, Kind};
use physinc::geometry::camera::{Camera, DepthCode};
use physinc::kinect::disparity::Packing;
use physinc::kinect::packet::{DEPTH_PAYLOAD, HEADER, Header, Place, Stream};
use physinc::math::{Mat3, Vec3, sqrt};
use physinc::seeing::{Buffers, Image, Seeing, Sizes, Slice};
use physinc::stream::assembler::Assembler;
use physinc::track::Measurement;

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
const PIXELS: usize = WIDTH * HEIGHT;
const SIZES: Sizes = Buffers::required(WIDTH, HEIGHT);
const BACKGROUND: u16 = 2000;
/// Of the ball, m.
const DEPTH: f64 = 1.2;

/// What a microcontroller would do; false where an answer is not as it must be.
fn core_works() -> bool {
    assembles_a_frame() == Some(true) && sees_a_ball() == Some(true) && feels_a_floor() == Some(true) && owns_a_vec()
}

/// Puts a frame together of which one packet was lost.
fn assembles_a_frame() -> Option<bool> {
    let packing = Packing::Eleven;
    let mut assembler = Assembler::new(packing, [0; Packing::Eleven.frame_bytes()]).ok()?;
    let (packets, mut packet, mut holes) = (packing.packets(), [0; HEADER + DEPTH_PAYLOAD], None);
    for index in (0..packets).filter(|index| *index != 7) {
        let place = if index == 0 {
            Place::First
        } else if index + 1 == packets {
            Place::Last
        } else {
            Place::Middle
        };
        let payload = DEPTH_PAYLOAD.min(packing.frame_bytes() - index * DEPTH_PAYLOAD);
        let header = Header { stream: Stream::Depth, place, sequence: black_box(index as u8), timestamp_ticks: 6_000_000 };
        packet.first_chunk_mut().map(|start| *start = header.emit(payload as u16))?;
        assembler
            .push(packet.get(..HEADER + payload)?, 0, &mut |frame| holes = Some((frame.timestamp_ns, frame.missing().count(), frame.lost)));
    }
    Some(holes? == (100_000_000, 1, 1))
}

/// Learns a wall, then finds the default ball before it.
fn sees_a_ball() -> Option<bool> {
    let config = black_box(Config::default());
    let (width, height) = (Some(WIDTH as u32), Some(HEIGHT as u32));
    let keys = CameraConfig { width, height, fx: Some(575.8), fy: Some(575.8), cx: Some(31.5), cy: Some(23.5), ..CameraConfig::default() };
    let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 1000.0 }).ok()?;
    let (mut limits, mut farthest, mut depths) = ([0; SIZES.pixels], [0; SIZES.pixels], [0.0; SIZES.depths]);
    let (mut runs, mut planes) = ([Default::default(); SIZES.runs], [0.0; SIZES.planes]);
    let mut marks = [Default::default(); SIZES.rows];
    let mut strangers = [[0; 2]; SIZES.pixels];
    let buffers = Buffers {
        limits: Slice::Borrowed(&mut limits),
        farthest: Slice::Borrowed(&mut farthest),
        strangers: Slice::Borrowed(&mut strangers),
        samples: Slice::Borrowed(&mut []),
        depths: Slice::Borrowed(&mut depths),
        marks: Slice::Borrowed(&mut marks),
        runs: Slice::Borrowed(&mut runs),
        planes: Slice::Borrowed(&mut planes),
        clouds: Slice::Borrowed(&mut []),
    };
    let mut seeing = Seeing::new(&camera, &config.object, 3, buffers).ok()?;
    let mut detections = Default::default();
    for _ in 0..3 {
        seeing.see(Image::U16(&[BACKGROUND; PIXELS]), &mut detections).ok()?;
    }
    seeing.see(Image::U16(&ball(&camera, config.object.radius.as_slice()[0])), &mut detections).ok()?;
    let [ball] = detections.as_slice() else { return None };
    Some(ball.blob == Blob::Whole && ball.center.xy().norm() < 0.005 && (ball.center.z - DEPTH).abs() < 0.005)
}

/// Learns from positions alone that a ball touched something at a height of 0.
fn feels_a_floor() -> Option<bool> {
    let mut config = Config::default();
    config.laws.drag = false;
    config.object.contact_duration = 0.0;
    let mut engine = Engine::for_positions(&config).ok()?;
    let (mut lowest, fall, rebound) = (None, 0.45, 3.3);
    let mut listen = |event: Event| {
        if let Kind::Contact(contact) = event.kind {
            lowest = Some(contact.center[2]);
        }
    };
    for i in 0..28 {
        let t = f64::from(i) * 0.033;
        let z = if t < fall { 4.905 * (fall * fall - t * t) } else { (t - fall) * (rebound - 4.905 * (t - fall)) };
        let measurement = Measurement {
            time_ns: (t * 1e9) as i64,
            center: Vec3::new(0.8 * t, 0.1 * t, z),
            covariance: Some(Mat3::identity() * 1e-6),
            drift: Mat3::zeros(),
            center_in_camera: None,
            label: None,
            radius: 0.033,
            points: None,
            residual_rms: None,
            whole: true,
        };
        engine.positions(measurement.time_ns, &[measurement], &mut listen);
    }
    engine.finish(&mut listen);
    Some(lowest?.abs() < 0.005)
}

/// A ball at [`DEPTH`] on the optical axis, before the wall, mm.
fn ball(camera: &Camera, radius: f64) -> [u16; PIXELS] {
    core::array::from_fn(|i| {
        let ray = camera.deproject((i % WIDTH) as f64, (i / WIDTH) as f64, 1.0);
        let (a, b) = (ray.norm_squared(), DEPTH);
        let under_root = b * b - a * (DEPTH * DEPTH - radius * radius);
        if under_root < 0.0 { BACKGROUND } else { ((b - sqrt(under_root)) / a * 1000.0) as u16 }
    })
}

#[cfg(not(feature = "with_vec"))]
fn owns_a_vec() -> bool {
    true
}

#[cfg(feature = "with_vec")]
fn owns_a_vec() -> bool {
    extern crate alloc;
    !black_box(alloc::vec![1_u8]).is_empty()
}

unsafe extern "C" {
    safe fn _exit(status: i32) -> !;
}

extern "C" fn run() -> ! {
    _exit(i32::from(!core_works()))
}

// The kernel enters with an aligned stack, a function expects to be called: hence the call.
#[cfg(target_arch = "x86_64")]
core::arch::global_asm!(".globl _start", "_start:", "xor ebp, ebp", "call {run}", run = sym run);
#[cfg(target_arch = "aarch64")]
core::arch::global_asm!(".globl _start", "_start:", "bl {run}", run = sym run);

/// `core` as it is shipped was compiled to unwind and names this; here nothing unwinds.
#[unsafe(no_mangle)]
extern "C" fn rust_eh_personality() {}

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    _exit(2)
}
