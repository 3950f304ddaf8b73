//! physinc watches a depth camera and reports what *happened*, physically.
#![no_std]

#[cfg(feature = "std")]
extern crate std;

pub mod config;
pub mod detect;
pub mod engine;
pub mod error;
pub mod event;
pub mod geometry;
pub mod math;
pub mod physics;
pub mod reasoning;
pub mod scene;
pub mod seeing;
#[cfg(feature = "sim")]
pub mod sim;
pub mod time;
pub mod timeline;
pub mod track;
