//! What explains the disagreements: surfaces that the camera does not see.

pub mod outline;
pub mod plane;
pub mod surfaces;
