//! What the video endpoint sends: colour, or what the infra-red camera sees.

use super::disparity::{HEIGHT, Packing, PackingError, WIDTH};

/// Rows of an infra-red image, px: more than depth has, which is made from it.
const INFRARED_HEIGHT: usize = 488;

/// The two, 30 images a second; the camera sends one at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Video {
    /// Colour as a Bayer mosaic of 8 bits (green, red; blue, green), 640 × 480.
    Color,
    /// Infra-red, 10 bits, packed most significant bit first, 640 × 488.
    Infrared,
}

impl Video {
    /// Rows and columns, px.
    pub const fn shape(self) -> [usize; 2] {
        match self {
            Self::Color => [HEIGHT, WIDTH],
            Self::Infrared => [INFRARED_HEIGHT, WIDTH],
        }
    }

    /// Bits of a sample.
    pub const fn bits(self) -> usize {
        match self {
            Self::Color => 8,
            Self::Infrared => 10,
        }
    }

    /// Packed bytes of an image.
    pub const fn frame_bytes(self) -> usize {
        let [rows, columns] = self.shape();
        rows * columns / 8 * self.bits()
    }

    /// Unpacks an image into `samples`, row by row.
    ///
    /// # Errors
    /// Sizes that don't belong together.
    pub fn unpack(self, packed: &[u8], samples: &mut [u16]) -> Result<(), PackingError> {
        match self {
            Self::Color if packed.len() == samples.len() => {
                for (sample, byte) in samples.iter_mut().zip(packed) {
                    *sample = (*byte).into();
                }
                Ok(())
            }
            Self::Color => Err(PackingError { bytes: packed.len(), samples: samples.len() }),
            Self::Infrared => {
                Packing::Ten.unpack(packed, samples)?;
                // Light knows no lack of a reading: all ones are as bright as it gets.
                for sample in samples {
                    *sample = (*sample).min(1023);
                }
                Ok(())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::kinect::layout::Layout;

    #[test]
    fn images_are_cut_as_the_wire_shows() {
        assert_eq!((Video::Color.packets(), Video::Infrared.packets()), (162, 205));
        assert_eq!(Video::Color.frame_bytes() - 161 * Video::PAYLOAD, 12);
    }

    #[test]
    fn samples_are_unpacked() {
        let mut samples = [0; 8];
        Video::Infrared.unpack(&[0xff, 0xc0, 0x10, 0, 0, 0, 0, 0, 0, 1], &mut samples).unwrap();
        assert_eq!(samples, [1023, 1, 0, 0, 0, 0, 0, 1]);
        Video::Color.unpack(&[0, 1, 2, 3, 4, 5, 6, 255], &mut samples).unwrap();
        assert_eq!(samples, [0, 1, 2, 3, 4, 5, 6, 255]);
        assert!(Video::Color.unpack(&[0; 7], &mut samples).is_err() && Video::Infrared.unpack(&[0; 9], &mut samples).is_err());
    }
}
