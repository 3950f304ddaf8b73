//! Links the core without an allocator and without the operating system's start-up code, runs it once, and ends with 0.
//!
//! With the feature `with_vec` it owns one `Vec`, and must not build: that shows that the proof can fail.
#![no_std]
#![no_main]

use core::hint::black_box;
use physinc::config::{CameraConfig, Config};
use physinc::geometry::camera::{Camera, DepthCode};

/// What a microcontroller would do; false where an answer is not as it must be.
fn core_works() -> bool {
    let config = black_box(Config::default());
    let camera = Camera::from_config(&CameraConfig::default(), DepthCode::Depth { units_per_metre: 1000.0 });
    let centered = camera.is_ok_and(|camera| camera.deproject(camera.cx, camera.cy, 2.0).z == 2.0);
    config.validate().is_ok() && centered && owns_a_vec()
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

#[panic_handler]
fn panic(_: &core::panic::PanicInfo) -> ! {
    _exit(2)
}
