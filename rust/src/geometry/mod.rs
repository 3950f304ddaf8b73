//! Cameras, clouds and planes: what is where, without time.

pub mod camera;
pub mod environment;
pub mod motion;
