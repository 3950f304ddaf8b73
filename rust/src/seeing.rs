//! Frames to positions.

/// A depth image, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// Samples as the camera's [`DepthCode`](crate::geometry::camera::DepthCode) tells.
    U16(&'a [u16]),
    /// Depth z in metres; NaN is no reading.
    F32(&'a [f32]),
}
