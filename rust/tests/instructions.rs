//! How many instructions a frame takes, packed bytes to position: `cargo test --release --test instructions`.
//!
//! Unlike times, these are the same on every machine that has the same instructions; callgrind counts them in a child process. For aarch64
//! `rust/tests/aarch64/count` does, under qemu-user.

mod skipping;

use std::path::Path as File;
use std::process::Command;

use physinc::config::{CameraConfig, ObjectConfig};
use physinc::detect::Detection;
use physinc::geometry::camera::{Camera, DepthCode, KINECT_DISPARITY_LAW};
use physinc::kinect::disparity::{HEIGHT, Packing, WIDTH};
use physinc::math::{Vec3, sqrt};
use physinc::seeing::{Area, Band, Buffers, Image, Scope, Seeing};
use physinc::simd::Path;

/// Instructions a frame with AVX2, of the whole image and of a band around a tracked ball, as rustc 1.95 builds it.
const RECORDED: [u64; 2] = [468_985, 329_738];
const COMPILER: &str = "rustc 1.95";
/// Each ball here is a different one for the fit, by its noise and its place between pixels.
const BALLS: usize = 8;
const BACKGROUND_FRAMES: usize = 3;
const RADIUS: f64 = 0.033;
/// Width of the noise of one pixel, before it is averaged: half a unit remains.
const NOISE: f64 = 12.0;
const OF: &str = "PHYSINC_INSTRUCTIONS_OF";
/// How often the balls are seen: who can't count [`counted_frame`] alone takes the difference of two runs.
const ROUNDS: &str = "PHYSINC_INSTRUCTIONS_ROUNDS";

fn camera() -> Camera {
    Camera::from_config(&CameraConfig::default(), DepthCode::Disparity { law: KINECT_DISPARITY_LAW }).expect("a Kinect's keys")
}

/// A wall at 2.5 m, and a tennis ball before it whose readings are means over a matching window, their noise included.
fn packed(camera: &Camera, center: Option<Vec3>, random: &mut u32) -> Vec<u8> {
    let raw = |z: f64| (1.0 / z - KINECT_DISPARITY_LAW[0]) / KINECT_DISPARITY_LAW[1];
    let mut noise = || {
        *random = random.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        f64::from(*random >> 8) / f64::from(1 << 24) - 0.5
    };
    let cap = |i: usize| {
        let (center, ray) = (center?, camera.deproject((i % WIDTH) as f64, (i / WIDTH) as f64, 1.0));
        let (a, b) = (ray.norm_squared(), ray.dot(&center));
        let square = b * b - a * (center.norm_squared() - RADIUS * RADIUS);
        (square > 0.0).then(|| raw((b - sqrt(square)) / a) + NOISE * noise())
    };
    let caps: Vec<Option<f64>> = (0..WIDTH * HEIGHT).map(cap).collect();
    let mean = |i: usize| {
        let (x, y) = (i % WIDTH, i / WIDTH);
        let indices = (y.saturating_sub(3)..y + 4).flat_map(|y| (x.saturating_sub(4)..x + 5).map(move |x| y * WIDTH + x));
        let window = indices.filter_map(|i| *caps.get(i)?);
        let (sum, count) = window.fold((0.0, 0.0), |(sum, count), raw| (sum + raw, count + 1.0));
        sum / count
    };
    let reading = |i: usize| if caps[i].is_some() { mean(i) } else { raw(2.5) };
    let samples: Vec<u16> = (0..WIDTH * HEIGHT).map(|i| (reading(i) + 0.5) as u16).collect();
    let mut packed = vec![0; Packing::Eleven.frame_bytes()];
    Packing::Eleven.pack(&samples, &mut packed).expect("a frame");
    packed
}

/// What is counted: callgrind knows it by its name.
#[inline(never)]
fn counted_frame(seeing: &mut Seeing, packed: &[u8], bands: &[Band], detections: &mut heapless::Vec<Detection, 16>) -> bool {
    let scope = Scope { bands, ..Scope::default() };
    seeing.see_in(Image::Packed { packed, packing: Packing::Eleven }, scope, detections).expect("the camera's image")
}

#[test]
#[ignore = "run by the test below, under callgrind"]
fn work() {
    let tracked = std::env::var(OF).is_ok_and(|of| of == "tracked");
    let (camera, mut random) = (camera(), 1);
    let frames: Vec<_> = (0..=BACKGROUND_FRAMES).map(|_| packed(&camera, None, &mut random)).collect();
    let object = ObjectConfig::default();
    let mut seeing = Seeing::new(&camera, &object, BACKGROUND_FRAMES as u32, Buffers::owned(WIDTH, HEIGHT)).expect("its buffers");
    let mut detections = heapless::Vec::new();
    // The background is learned from some frames, and surveyed in some more.
    for packed in frames.iter().chain(std::iter::repeat_n(&frames[0], 20)) {
        seeing.see(Image::Packed { packed, packing: Packing::Eleven }, &mut detections).expect("the camera's image");
    }
    assert!(seeing.surveyed().is_some());
    let balls: Vec<_> = (0..BALLS)
        .map(|i| {
            let center = Vec3::new(-0.2 + 0.0613 * i as f64, 0.1 - 0.0417 * i as f64, 1.5);
            let (column, row) = camera.project(&center).expect("in view");
            let around = |pixel: f64| pixel as usize - 40..pixel as usize + 40;
            (
                center,
                Band { area: Area { rows: around(row), columns: around(column) }, balls: 1 },
                packed(&camera, Some(center), &mut random),
            )
        })
        .collect();
    // Balls settle over how many pixels the camera matches.
    for (_, _, frame) in balls.iter().chain(&balls) {
        seeing.see(Image::Packed { packed: frame, packing: Packing::Eleven }, &mut detections).expect("the camera's image");
    }
    let rounds = std::env::var(ROUNDS).map_or(1, |rounds| rounds.parse().expect("a number"));
    for (center, band, frame) in (0..rounds).flat_map(|_| &balls) {
        let whole = counted_frame(&mut seeing, frame, if tracked { std::slice::from_ref(band) } else { &[] }, &mut detections);
        assert!(whole != tracked && detections.len() == 1 && (detections[0].center - center).norm() < 0.005, "{detections:?}");
    }
}

/// Instructions a frame of [`work`]; `None` where callgrind is not here.
fn count(of: &str) -> Option<u64> {
    let out = File::new(env!("CARGO_TARGET_TMPDIR")).join(format!("callgrind.{of}"));
    let run = Command::new("valgrind")
        .args(["--tool=callgrind", "--collect-atstart=no", "--toggle-collect=*counted_frame*"])
        .arg(format!("--callgrind-out-file={}", out.display()))
        .arg(std::env::current_exe().expect("this test has a path"))
        .args(["--exact", "work", "--ignored", "--test-threads=1"])
        .env(OF, of)
        .output()
        .ok()?;
    assert!(run.status.success(), "{}{}", String::from_utf8_lossy(&run.stdout), String::from_utf8_lossy(&run.stderr));
    let counts = std::fs::read_to_string(out).expect("callgrind's file");
    let totals = counts.lines().find_map(|line| line.strip_prefix("totals: ")).expect("callgrind's sum");
    Some(totals.trim().parse::<u64>().expect("a number") / BALLS as u64)
}

#[test]
fn a_frame_takes_as_many_instructions_as_recorded() {
    if cfg!(debug_assertions) || !Path::Avx2.is_here() {
        return skipping::skip("recorded are instructions of release builds with AVX2");
    }
    let counts: Vec<u64> = ["whole", "tracked"].into_iter().filter_map(count).collect();
    println!("instructions a frame, whole and tracked: {counts:?}");
    if counts.is_empty() {
        skipping::miss("there is no valgrind, which counts instructions");
    }
    let version = Command::new("rustc").arg("--version").output().map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    // Another compiler makes other instructions.
    let within = if version.is_ok_and(|version| version.starts_with(COMPILER)) { 0.03 } else { 0.2 };
    let as_recorded = |(now, recorded): (&u64, u64)| (*now as f64 / recorded as f64 - 1.0).abs() < within;
    assert!(counts.iter().zip(RECORDED).all(as_recorded), "{counts:?} instructions a frame, {RECORDED:?} recorded");
}
