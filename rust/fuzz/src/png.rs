//! Any bytes as a recording's PNG: read, or refused with a reason, and never with more memory than the camera's images need.
#![no_main]

use libfuzzer_sys::fuzz_target;
use physinc::config::CameraConfig;
use physinc::geometry::camera::{Camera, DepthCode};
use physinc::source::read_png;
use std::io::Cursor;

fuzz_target!(|bytes: &[u8]| {
    let keys = CameraConfig {
        width: Some(16),
        height: Some(16),
        fx: Some(20.0),
        fy: Some(20.0),
        cx: Some(7.5),
        cy: Some(7.5),
        ..CameraConfig::default()
    };
    let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 5000.0 }).expect("a camera");
    match read_png(Cursor::new(bytes), &camera, &mut [0; 512]) {
        Ok(()) => (),
        Err(why) => assert!(!why.is_empty()),
    }
});
