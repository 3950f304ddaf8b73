//! One depth image, in any of the forms that it may come in.

use crate::kinect::disparity::{HEIGHT, Packing, WIDTH};
use crate::simd::fetch;
use core::ops::Range;

/// One depth image, row by row.
#[derive(Clone, Copy, Debug)]
pub enum Image<'a> {
    /// Samples as the camera's code says: disparity, or depth in its units.
    U16(&'a [u16]),
    /// Metres; NaN, 0 or less is no reading.
    F32(&'a [f32]),
    /// Disparity as a Kinect v1 packs it, of a frame of its size.
    Packed {
        /// [`Packing::frame_bytes`] bytes.
        packed: &'a [u8],
        /// How it is packed.
        packing: Packing,
    },
}

/// Why an image can't be seen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum SeeError {
    /// It does not have width × height samples.
    Size {
        /// Samples it should have.
        expected: usize,
        /// Samples it has.
        found: usize,
    },
    /// It does not have the bytes of a packed frame.
    Bytes {
        /// Bytes it should have.
        expected: usize,
        /// Bytes it has.
        found: usize,
    },
    /// It is packed, but the camera's images are not disparity of 640 × 480 pixels.
    Packed,
    /// The stream began with the other kind of samples.
    Kind,
    /// The engine has no camera: it was made for positions.
    NoCamera,
    /// The engine was made for frames or positions, not for packets.
    NoPackets,
}

impl core::fmt::Display for SeeError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        match self {
            Self::Size { expected, found } => write!(f, "the image has {found} samples, the camera {expected} pixels"),
            Self::Bytes { expected, found } => write!(f, "the packed frame has {found} bytes instead of {expected}"),
            Self::Packed => write!(f, "only a camera of {WIDTH} × {HEIGHT} pixels of disparity packs its samples"),
            Self::Kind => write!(f, "a stream of integer samples can't change to floating point, nor back"),
            Self::NoCamera => write!(f, "an image for an engine without a camera: make it with `Engine::for_frames`"),
            Self::NoPackets => write!(f, "a packet for an engine that takes none: make it with `Engine::for_packets`"),
        }
    }
}

impl core::error::Error for SeeError {}

/// An image that can be read part by part.
pub(super) trait Source<S> {
    /// The samples of some columns of a row.
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[S];
    /// The same, of which nothing is kept: [`Source::samples`] may stay wrong there.
    fn glance(&mut self, row: usize, columns: Range<usize>) -> &[S];
    /// Asks memory for what [`Source::glance`] reads.
    fn fetch(&self, row: usize, columns: &Range<usize>);
    /// All samples; those that were not read by now may be wrong.
    fn samples(&self) -> &[S];
}

pub(super) struct Plain<'a, S> {
    pub samples: &'a [S],
    pub width: usize,
}

impl<S> Source<S> for Plain<'_, S> {
    #[inline]
    fn fetch(&self, row: usize, columns: &Range<usize>) {
        fetch(self.samples.get(row * self.width + columns.start..row * self.width + columns.end).unwrap_or_default());
    }

    #[inline]
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[S] {
        self.samples.get(row * self.width + columns.start..row * self.width + columns.end).unwrap_or_default()
    }

    #[inline]
    fn glance(&mut self, row: usize, columns: Range<usize>) -> &[S] {
        self.part(row, columns)
    }

    fn samples(&self) -> &[S] {
        self.samples
    }
}

pub(super) struct Packed<'a> {
    pub bytes: &'a [u8],
    pub packing: Packing,
    pub samples: &'a mut [u16],
    /// Room for what is only glanced at: it stays in the nearest cache.
    pub glanced: [u16; WIDTH],
}

/// Bytes of some columns of a row.
fn bytes<'b>(packed: &'b [u8], packing: Packing, row: usize, columns: &Range<usize>) -> &'b [u8] {
    let (start, end) = (row * WIDTH + columns.start, row * WIDTH + columns.end);
    packed.get(start / 8 * packing.bits()..end.div_ceil(8) * packing.bits()).unwrap_or_default()
}

impl Source<u16> for Packed<'_> {
    #[inline]
    fn fetch(&self, row: usize, columns: &Range<usize>) {
        fetch(bytes(self.bytes, self.packing, row, columns));
    }

    #[inline]
    fn glance(&mut self, row: usize, columns: Range<usize>) -> &[u16] {
        let Some(glanced) = self.glanced.get_mut(..columns.len()) else { return &[] };
        match self.packing.unpack_part(self.bytes, row * WIDTH + columns.start, glanced) {
            Ok(()) => glanced,
            // Columns are whole groups.
            Err(_) => &[],
        }
    }

    #[inline]
    fn part(&mut self, row: usize, columns: Range<usize>) -> &[u16] {
        let first = row * WIDTH + columns.start;
        let Some(part) = self.samples.get_mut(first..first + columns.len()) else { return &[] };
        match self.packing.unpack_part(self.bytes, first, part) {
            Ok(()) => part,
            // Columns are whole groups.
            Err(_) => &[],
        }
    }

    fn samples(&self) -> &[u16] {
        self.samples
    }
}
