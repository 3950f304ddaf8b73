//! Depth images as PNGs of 16 bits.

use super::folder::check_size;
use crate::geometry::camera::Camera;
use png::{BitDepth, ColorType, Decoder, DecodingError, Limits};
use std::format;
use std::io::{BufRead, ErrorKind, Seek};
use std::string::{String, ToString};

/// What a PNG may make its reader keep beside the samples: more than any needs.
const LIMITS: Limits = Limits { bytes: 1 << 20 };

/// Reads a 16-bit grey PNG of `camera`'s size into `samples`: row by row, two bytes a sample, the high one first. The header is looked at
/// before anything is allocated for what it claims.
///
/// # Errors
/// What is wrong with it, in words; `samples` may have been written to then.
pub fn read_png(image: impl BufRead + Seek, camera: &Camera, samples: &mut [u8]) -> Result<(), String> {
    let mut decoder = Decoder::new_with_limits(image, LIMITS);
    decoder.set_ignore_text_chunk(true);
    decoder.set_ignore_iccp_chunk(true);
    let header = decoder.read_header_info().map_err(explain)?;
    match (header.color_type, header.bit_depth) {
        (ColorType::Grayscale, BitDepth::Sixteen) => {}
        (color, depth) => return Err(format!("it is {color:?} of {} bits: 16-bit grey is expected", depth as u8)),
    }
    check_size(camera, [header.width.into(), header.height.into()])?;
    let mut reader = decoder.read_info().map_err(explain)?;
    let frame = reader.next_frame(samples).map_err(explain)?;
    // An animated one may have smaller frames.
    check_size(camera, [frame.width.into(), frame.height.into()])?;
    reader.finish().map_err(explain)
}

fn explain(error: DecodingError) -> String {
    match error {
        DecodingError::IoError(error) if error.kind() == ErrorKind::UnexpectedEof => "it ends too early: the file is cut".into(),
        DecodingError::Format(error) => format!("no PNG, or a broken one ({})", error.to_string().trim_end_matches('.')),
        error => format!("it can't be read ({error})"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::CameraConfig;
    use crate::geometry::camera::DepthCode;
    use proptest::prelude::*;
    use std::io::Cursor;
    use std::vec::Vec;

    /// What is read of a PNG by a camera of 16 × 16.
    fn read(content: &[u8]) -> Result<Vec<u8>, String> {
        let lens = CameraConfig { fx: Some(20.0), fy: Some(20.0), cx: Some(7.5), cy: Some(7.5), ..CameraConfig::default() };
        let keys = CameraConfig { width: Some(16), height: Some(16), ..lens };
        let camera = Camera::from_config(&keys, DepthCode::Depth { units_per_metre: 5000.0 }).unwrap();
        let mut samples = std::vec![0; 512];
        read_png(Cursor::new(content), &camera, &mut samples).map(|()| samples)
    }

    fn png(width: u32, height: u32, color: ColorType, depth: BitDepth) -> (Vec<u8>, Vec<u8>) {
        let mut content = Vec::new();
        let mut encoder = png::Encoder::new(&mut content, width, height);
        encoder.set_color(color);
        encoder.set_depth(depth);
        let bytes = width as usize * height as usize * color.samples() * depth as usize / 8;
        let samples: Vec<u8> = (0..bytes).map(|i| (i * i / 7) as u8).collect();
        encoder.write_header().unwrap().write_image_data(&samples).unwrap();
        (content, samples)
    }

    #[test]
    fn only_16_bit_grey_of_the_cameras_size_is_read() {
        let (content, samples) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
        assert_eq!(read(&content).unwrap(), samples);
        for (width, color, depth, expected) in [
            (16, ColorType::Grayscale, BitDepth::Eight, "Grayscale of 8 bits: 16-bit grey"),
            (16, ColorType::Rgb, BitDepth::Sixteen, "Rgb of 16 bits"),
            (16, ColorType::GrayscaleAlpha, BitDepth::Sixteen, "GrayscaleAlpha of 16 bits"),
            (17, ColorType::Grayscale, BitDepth::Sixteen, "17×16 px, the camera is 16×16"),
        ] {
            let message = read(&png(width, 16, color, depth).0).unwrap_err();
            assert!(message.contains(expected), "{message}");
        }
    }

    #[test]
    fn every_cut_is_an_error() {
        let (content, _) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
        for length in 0..content.len() {
            assert!(read(&content[..length]).is_err(), "{length}");
        }
    }

    proptest! {
        #[test]
        fn a_wrong_byte_never_panics(place: prop::sample::Index, byte: u8, junk: Vec<u8>) {
            let (mut content, _) = png(16, 16, ColorType::Grayscale, BitDepth::Sixteen);
            let place = place.index(content.len());
            content[place] = byte;
            let _ = (read(&content), read(&junk));
        }
    }
}
