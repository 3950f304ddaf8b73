//! physinc watches a depth camera and reports what *happened*, physically.
#![no_std]

#[cfg(feature = "std")]
extern crate std;

pub mod config;
#[cfg(feature = "std")]
pub mod config_file;
pub mod detect;
pub mod engine;
pub mod error;
pub mod event;
pub mod geometry;
pub mod math;
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
#[cfg(feature = "std")]
pub mod source;
pub mod time;
pub mod timeline;
pub mod track;
