//! The memory that seeing works in: the caller's, or its own.

use super::shapes::CLOUDS;
use crate::detect::background::Stranger;
use crate::detect::ball::ROOM;
use crate::detect::cloud::Cloud;
use crate::detect::components::{Marks, Run};
use crate::kinect::disparity::{HEIGHT, WIDTH};
use core::ops::{Deref, DerefMut};

/// A slice that is borrowed or, with `std`, owned.
pub enum Slice<'b, T> {
    /// The caller's.
    Borrowed(&'b mut [T]),
    /// Our own.
    #[cfg(feature = "std")]
    Owned(std::vec::Vec<T>),
}

impl<T> Deref for Slice<'_, T> {
    type Target = [T];
    fn deref(&self) -> &[T] {
        match self {
            Self::Borrowed(slice) => slice,
            #[cfg(feature = "std")]
            Self::Owned(slice) => slice,
        }
    }
}

impl<T> DerefMut for Slice<'_, T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match self {
            Self::Borrowed(slice) => slice,
            #[cfg(feature = "std")]
            Self::Owned(slice) => slice,
        }
    }
}

impl<T> AsMut<[T]> for Slice<'_, T> {
    fn as_mut(&mut self) -> &mut [T] {
        self
    }
}

/// How many elements each buffer must have, at least.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Of `limits`, of `farthest` and of `strangers`.
    pub pixels: usize,
    /// Of `samples`: none where the images are not of the size that comes packed.
    pub samples: usize,
    /// Of `depths`.
    pub depths: usize,
    /// Of `marks`.
    pub rows: usize,
    /// Of `runs`; more of them, and more clutter is borne.
    pub runs: usize,
    /// Of `planes`.
    pub planes: usize,
    /// Of `clouds`: none where all objects are balls.
    pub clouds: usize,
}

/// The memory that [`Seeing`](super::Seeing) works in; what it holds at first does not matter.
pub struct Buffers<'b> {
    /// For each pixel, where the background begins.
    pub limits: Slice<'b, u16>,
    /// For each pixel, the farthest reading while the background is learned, and then the background.
    pub farthest: Slice<'b, u16>,
    /// For each pixel, what it has lately shown in place of that.
    pub strangers: Slice<'b, Stranger>,
    /// A packed frame's samples.
    pub samples: Slice<'b, u16>,
    /// Depth of each disparity.
    pub depths: Slice<'b, f32>,
    /// For each row, where it shows foreground.
    pub marks: Slice<'b, Marks>,
    /// Runs of foreground.
    pub runs: Slice<'b, Run>,
    /// What one ball's pixels show and should show.
    pub planes: Slice<'b, f32>,
    /// Views of things of any shape.
    pub clouds: Slice<'b, Cloud>,
}

impl Buffers<'_> {
    /// Sizes for images of `width` × `height` pixels.
    pub const fn required(width: usize, height: usize) -> Sizes {
        let samples = if width == WIDTH && height == HEIGHT { WIDTH * HEIGHT } else { 0 };
        Sizes { pixels: width * height, samples, depths: 2048, rows: height, runs: width * height / 16 + 64, planes: ROOM, clouds: CLOUDS }
    }
}

#[cfg(feature = "std")]
impl Buffers<'static> {
    /// Buffers of their own, for images of `width` × `height` pixels.
    pub fn owned(width: usize, height: usize) -> Self {
        let sizes = Self::required(width, height);
        Self {
            limits: Slice::Owned(std::vec![0; sizes.pixels]),
            farthest: Slice::Owned(std::vec![0; sizes.pixels]),
            strangers: Slice::Owned(std::vec![[0; 2]; sizes.pixels]),
            samples: Slice::Owned(std::vec![0; sizes.samples]),
            depths: Slice::Owned(std::vec![0.0; sizes.depths]),
            marks: Slice::Owned(std::vec![Marks::default(); sizes.rows]),
            runs: Slice::Owned(std::vec![Run::default(); sizes.runs]),
            planes: Slice::Owned(std::vec![0.0; sizes.planes]),
            clouds: Slice::Owned(std::vec![Cloud::default(); sizes.clouds]),
        }
    }
}
