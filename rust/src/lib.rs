//! physinc watches a depth camera and reports what *happened*, physically: it predicts every tracked ball by the laws of physics, and
//! where measurement and prediction disagree it says why. After "Exploiting Physical Inconsistencies for 3D Scene Understanding".
//!
//! ```text
//! a Kinect's packets ─ kinect ─ stream ─┐
//! depth frames ─────────────────────────┴─ detect ─ (seeing) ─┐
//!                                                             ├─ track ─ scene ─ (reasoning) ─ events
//! positions by any tracker ───────────────────────────────────┘
//!            (engine: all of it)        capture, source ─ run ─ python: where input comes from, where events go
//!            geometry: below all of it; physics: below track and scene
//! ```
//!
//! [`stream::assembler::Assembler`] turns packets into frames, [`seeing::Seeing`] frames into positions, [`reasoning::Reasoning`] positions
//! into [`event::Event`]s, [`engine::Engine`] does it all. They are handed their input with its time and hand events to a sink: they open nothing, read no clock and allocate nothing, so
//! the same input gives the same events to the last bit. A layer uses only those on its left and below it; `CONTRIBUTING.md` has the table.
//!
//! ```
//! use physinc::{config::Config, engine::Engine, event::Kind, seeing::Image};
//! # #[cfg(feature = "sim")] {
//! let scene = physinc::sim::Scene::parse("bounce?throws=1").unwrap();
//! let mut engine = Engine::new(&Config::default(), Some(&scene.camera())).unwrap();
//! let mut bounces = 0;
//! let mut sink = |event: physinc::event::Event| bounces += usize::from(event.is_final && matches!(event.kind, Kind::Contact(_)));
//! let mut frames = scene.frames();
//! while let Some(frame) = frames.next_frame() {
//!     engine.frame(frame.timestamp_ns, Image::U16(frame.samples), &mut sink).unwrap();
//! }
//! engine.finish(&mut sink);
//! assert!(bounces > 0);
//! # }
//! ```
//!
//! # Frames and units
//! Metres, seconds, m/s, radians, kilograms; anything else says so in its name (`_ns`, `_px`). A time that identifies is an integer
//! `timestamp_ns` on the stream's own clock. Camera frame: x right, y down, z forward, pixel centers at integers. World: z up; a bare
//! position is in the world. Covariances are of what the user sees, in the same frame and SI units squared.
//!
//! # Features
//! - none: the core, `no_std` and without an allocator.
//! - `std`: configuration files, recordings, streams.
//! - `sim`: simulated scenes with their truth; it shares no code with the estimators.
//! - `usb`: live Kinects, by a libusb of its own, which is built with the C compiler (LGPL-2.1-or-later).
//! - `python`: the extension module, with all of the above.
#![no_std]

#[cfg(feature = "std")]
extern crate std;

pub mod attention;
#[cfg(feature = "std")]
pub mod capture;
pub mod config;
#[cfg(feature = "std")]
pub mod config_file;
pub mod detect;
pub mod engine;
pub mod error;
pub mod event;
pub mod geometry;
pub mod kinect;
pub mod math;
#[cfg(feature = "std")]
pub mod mesh_file;
pub mod physics;
#[cfg(feature = "python")]
mod python;
pub mod reasoning;
#[cfg(feature = "std")]
pub mod run;
pub mod scene;
pub mod seeing;
#[cfg(feature = "sim")]
pub mod sim;
pub mod simd;
#[cfg(feature = "std")]
pub mod source;
pub mod stream;
pub mod time;
pub mod timeline;
pub mod track;
