//! Which devices are Kinects, and in what they differ.

/// Microsoft.
pub const VENDOR: u16 = 0x045e;
/// Products that are the camera of a Kinect for Xbox 360, and of a Kinect for Windows.
const CAMERAS: [u16; 2] = [0x02ae, 0x02bf];
/// Products that are the microphones beside such a camera.
const AUDIO: [u16; 4] = [0x02ad, 0x02be, 0x02c3, 0x02bb];
/// bcdDevice of model 1414; whatever else behaves as model 1473.
const OLDEST: u16 = 0x010b;

/// Endpoint of video: colour or infra-red.
pub const VIDEO_ENDPOINT: u8 = 0x81;
/// Endpoint of depth.
pub const DEPTH_ENDPOINT: u8 = 0x82;
/// Bytes of an isochronous packet at most, on both endpoints.
pub const SLOT: usize = 1920;

/// The models of the Kinect v1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Model {
    /// The first, for Xbox 360.
    M1414,
    /// The later one, for Xbox 360.
    M1473,
    /// For Windows (K4W).
    Windows,
}

impl Model {
    /// The camera's model by its vendor, product and bcdDevice; `None`: it is no Kinect's camera.
    pub fn of(vendor: u16, product: u16, bcd_device: u16) -> Option<Self> {
        let [xbox, windows] = CAMERAS;
        match (vendor, product) {
            (VENDOR, product) if product == xbox => Some(if bcd_device == OLDEST { Self::M1414 } else { Self::M1473 }),
            (VENDOR, product) if product == windows => Some(Self::Windows),
            _ => None,
        }
    }

    /// The alternate setting of interface 0 that has the endpoints.
    pub fn alternate_setting(self) -> u8 {
        u8::from(self == Self::Windows)
    }

    /// Bytes of the reply to command 0x04, its status word counted.
    pub fn fixed_parameters_bytes(self) -> usize {
        if self == Self::M1414 { 322 } else { 334 }
    }
}

impl core::fmt::Display for Model {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.write_str(match self {
            Self::M1414 => "1414",
            Self::M1473 => "1473",
            Self::Windows => "Kinect for Windows",
        })
    }
}

/// Whether it is the microphones of a Kinect; theirs is the serial number where the camera's is zeros.
pub fn is_audio(vendor: u16, product: u16) -> bool {
    vendor == VENDOR && AUDIO.contains(&product)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn models_are_known_by_product_and_release() {
        assert_eq!(Model::of(VENDOR, 0x02ae, 0x010b), Some(Model::M1414));
        assert_eq!(Model::of(VENDOR, 0x02ae, 0x0200), Some(Model::M1473));
        assert_eq!(Model::of(VENDOR, 0x02bf, 0x010b), Some(Model::Windows));
        assert_eq!(Model::of(VENDOR, 0x02b0, 0x010b), None, "the motor");
        assert_eq!(Model::of(0x1234, 0x02ae, 0x010b), None);
        assert!(is_audio(VENDOR, 0x02ad) && !is_audio(VENDOR, 0x02ae));
    }
}
