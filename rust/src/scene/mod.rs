//! What explains the disagreements: surfaces that the camera does not see, a level that is none.

pub mod camera_motion;
pub mod level;
pub mod outline;
pub mod plane;
pub mod surfaces;
