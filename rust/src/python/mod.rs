//! The Python module `physinc._physinc`: a thin layer that converts, waits with the interpreter released, and raises.

mod array;
mod camera;
mod config;
mod disparity;
mod error;
mod event;
mod frame;
mod functions;
mod iterable;
mod law;
mod planes;
mod recording;
mod result;
mod samples;
mod scale;
mod simulation;
mod stream;
mod video;
mod waiting;

use pyo3::prelude::*;

#[pymodule]
mod _physinc {
    #[pymodule_export]
    use super::camera::{camera_file, level_pose};
    #[pymodule_export]
    use super::config::dump_config;
    #[pymodule_export]
    use super::disparity::unpack_disparity;
    #[pymodule_export]
    use super::event::{
        Above, Activity, CameraModel, CameraMotion, CameraOrientation, Contact, Counters, Disconnected, Gap, Inconsistency,
        LevelDisagreement, Position, Reconnected, StreamEnded, StreamStarted, Surface, TrackEnded, TrackStarted, event_from_toml,
        part_from_toml,
    };
    #[pymodule_export]
    use super::frame::Frame;
    #[pymodule_export]
    use super::functions::{accelerations, find_inconsistencies, fit_flight, fit_sphere, solve_contact};
    #[pymodule_export]
    use super::planes::fit_planes;
    #[pymodule_export]
    use super::recording::{Recording, open_recording};
    #[pymodule_export]
    use super::result::{ContactFit, FlightFit, Inconsistencies, PlaneFit, ScaleFit, SphereFit, fit_from_toml};
    #[pymodule_export]
    use super::scale::{fit_scale, read_positions, split_flights};
    #[pymodule_export]
    use super::simulation::{scenes, simulate, truth};
    #[pymodule_export]
    use super::stream::{Stream, Track, open_iterable, open_source};
    #[pymodule_export]
    use super::video::VideoFrame;
    use pyo3::prelude::*;

    #[pymodule_init]
    fn init(module: &Bound<'_, PyModule>) -> PyResult<()> {
        module.add("__version__", env!("CARGO_PKG_VERSION"))?;
        module.add("PAPER_SIDE", crate::physics::paper::SIDE)
    }
}
