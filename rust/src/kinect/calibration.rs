//! What the device says of its own optics: the zero plane, from which raw disparity becomes depth.

use super::le16;
use crate::geometry::camera::disparity_law;

/// Bytes of the reply to command 0x04, its status word counted, from a model 1414.
const FIXED_PARAMETERS: usize = 322;
/// Where in the reply to command 0x04 the zero plane stands, its status word counted.
const ZERO_PLANE: usize = 94;
/// Where in the reply to command 0x16, parameter 0, the shift stands, its status word counted.
const SHIFT: usize = 2;

/// The plane at which the device's disparity was set to zero.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ZeroPlane {
    /// Between projector and infra-red camera, cm.
    pub emitter_cm: f32,
    /// Between colour and infra-red camera, cm.
    pub rcmos_cm: f32,
    /// How far away the plane is, cm.
    pub reference_cm: f32,
    /// Size of a pixel of the infra-red image on that plane, two of which span a pixel of depth, cm.
    pub pixel_cm: f32,
    /// The disparity there, in quarters of which raw counts.
    pub shift: u16,
}

impl ZeroPlane {
    /// From the replies (status word and payload) to command 0x04 and to command 0x16, parameter 0; `None` where they are too short
    /// or the numbers can't be a Kinect's: lengths that are not positive, or not finite.
    pub fn parse(fixed_parameters: &[u8], shift: &[u8]) -> Option<Self> {
        let mut lengths = [0.0; 4];
        let (bytes, _) = fixed_parameters.get(ZERO_PLANE..)?.first_chunk::<16>()?.as_chunks::<4>();
        for (length, bytes) in lengths.iter_mut().zip(bytes) {
            *length = f32::from_le_bytes(*bytes);
        }
        shift.get(SHIFT..SHIFT + 2)?;
        let [emitter_cm, rcmos_cm, reference_cm, pixel_cm] = lengths;
        let possible = lengths.iter().all(|length| length.is_finite() && *length > 0.0);
        possible.then_some(Self { emitter_cm, rcmos_cm, reference_cm, pixel_cm, shift: le16(shift, SHIFT) })
    }

    /// What follows the status words of the replies from which [`ZeroPlane::parse`] reads it; what else the first one tells is left at 0.
    pub fn replies(&self) -> ([u8; FIXED_PARAMETERS - 2], [u8; 2]) {
        let mut fixed_parameters = [0; FIXED_PARAMETERS - 2];
        let lengths = [self.emitter_cm, self.rcmos_cm, self.reference_cm, self.pixel_cm];
        for (bytes, length) in fixed_parameters[ZERO_PLANE - 2..].chunks_exact_mut(4).zip(lengths) {
            bytes.copy_from_slice(&length.to_le_bytes());
        }
        (fixed_parameters, self.shift.to_le_bytes())
    }

    /// `[c0, c1]` of 1/z = c0 + c1 · raw, in 1/m.
    pub fn law(&self) -> [f64; 2] {
        let [emitter, reference, pixel] = [self.emitter_cm, self.reference_cm, self.pixel_cm].map(f64::from);
        disparity_law(emitter, reference, pixel, f64::from(self.shift))
    }

    /// Focal length of the depth image, px.
    pub fn focal_length_px(&self) -> f64 {
        f64::from(self.reference_cm) / (2.0 * f64::from(self.pixel_cm))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::geometry::camera::{DepthCode, KINECT_DISPARITY_LAW};
    use std::{vec, vec::Vec};

    fn parse(lengths: [f32; 4]) -> Option<ZeroPlane> {
        let mut fixed = vec![0; ZERO_PLANE];
        fixed.extend(lengths.iter().flat_map(|length| length.to_le_bytes()));
        ZeroPlane::parse(&fixed, &[0, 0, 200, 0])
    }

    #[test]
    fn what_is_written_is_read() {
        let plane = parse([7.5, 2.3, 120.0, 0.1042]).unwrap();
        let (fixed, shift) = plane.replies();
        let with_status = |payload: &[u8]| [&[0, 0], payload].concat();
        assert_eq!(ZeroPlane::parse(&with_status(&fixed), &with_status(&shift)), Some(plane));
    }

    /// Depths of KINECT.md's unit, by libfreenect's formula rounded to mm.
    #[test]
    fn raw_becomes_the_depth_that_libfreenect_gives() {
        let plane = parse([7.5, 2.3, 120.0, 0.1042]).unwrap();
        let code = DepthCode::Disparity { law: plane.law() };
        for (raw, depth_mm) in [(600, 705.0), (700, 887.0), (800, 1193.0), (900, 1824.0), (1000, 3864.0), (1050, 8767.0)] {
            let z = code.depth(raw).unwrap() * 1000.0;
            // Rounded, and libfreenect cuts some off.
            assert!((z - depth_mm).abs() < 1.0, "{raw}: {z}");
        }
        assert_eq!(code.depth(1092), None, "behind the camera");
        assert!((plane.focal_length_px() - 575.8).abs() < 0.05);
        let relative = plane.law().iter().zip(KINECT_DISPARITY_LAW).map(|(a, b)| (a / b - 1.0).abs()).fold(0.0, f64::max);
        assert!(relative < 1e-7, "{relative}: floats of 32 bits");
    }

    #[test]
    fn lengths_that_cannot_be_are_none() {
        for bad in [0.0, -1.0, f32::NAN, f32::INFINITY] {
            assert_eq!(parse([7.5, 2.3, 120.0, bad]), None);
        }
        let short: Vec<u8> = vec![1; ZERO_PLANE + 15];
        assert_eq!(ZeroPlane::parse(&short, &[0; 4]), None);
        assert_eq!(ZeroPlane::parse(&[0x3f; 400], &[0; 3]), None);
    }
}
