//! Simulated scenes: bodies under the laws of physics, seen by a model of the sensor, with their truth.
//!
//! Nothing here is shared with an estimator but the camera's geometry: what is found in a simulated scene was found, not put in.

pub mod body;
mod car;
mod carried;
pub mod impact;
pub mod kinect;
mod many;
pub mod moves;
pub mod noise;
pub mod packets;
pub mod parameters;
pub mod path;
pub mod recording;
pub mod rig;
pub mod rigid;
mod robot;
pub mod scene;
pub mod sensor;
mod throws;
pub mod truth;
mod witness;

pub use packets::Packets;
pub use parameters::{Parameters, SCENES};
pub use recording::{Plan, Summary, simulate};
pub use scene::{Frame, Frames, Position, Scene};
pub use truth::Truth;

use std::path::PathBuf;
use std::string::String;

/// Why a scene could not be made.
#[derive(Debug, thiserror::Error)]
pub enum SimError {
    /// No scene of this name.
    #[error("there is no scene {name:?}; choose one of {known}")]
    UnknownScene {
        /// As told.
        name: String,
        /// All there are.
        known: String,
    },
    /// No key of this name.
    #[error("a scene has no key {key:?}; the keys are {known}")]
    UnknownKey {
        /// As told.
        key: String,
        /// All there are.
        known: String,
    },
    /// A value that can't be.
    #[error("{key}={value}: {why}")]
    BadValue {
        /// Which key.
        key: String,
        /// As told.
        value: String,
        /// What is wrong with it.
        why: String,
    },
    /// The geometry leaves no room for a throw.
    #[error(
        "no throw fits into view with these keys (tried {tried}); bring distance, height, tilt_deg and whatever else is told nearer to their defaults"
    )]
    NoThrow {
        /// Throws tried.
        tried: u32,
    },
    /// A recording must be one of those.
    #[error("{0}: a simulated recording is written as OUT.npz or OUT.pcapng (also .gz, .zst); give a name that ends so")]
    Unwritable(PathBuf),
    /// What is no simulation is not overwritten.
    #[error("{0}: there is something already that was not simulated, and is not overwritten: name a new file")]
    Occupied(PathBuf),
    /// A file could not be written.
    #[error("{path}: {source}; check that the folder exists, can be written, and has room")]
    Write {
        /// Which.
        path: PathBuf,
        /// Why.
        source: std::io::Error,
    },
}
