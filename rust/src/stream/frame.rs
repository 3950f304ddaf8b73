//! A frame as it is packed, and which of it is missing.

use core::ops::Range;

use crate::kinect::disparity::Packing;
use crate::kinect::layout::Layout;

/// Which of a frame's packets are here; a frame has fewer than 256.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct PacketSet([u64; 4]);

impl PacketSet {
    /// Whether packet `index` is in it.
    pub fn contains(&self, index: u8) -> bool {
        self.0[usize::from(index / 64)] >> (index % 64) & 1 != 0
    }

    pub(super) fn insert(&mut self, index: u8) {
        self.0[usize::from(index / 64)] |= 1 << (index % 64);
    }

    pub(super) fn remove(&mut self, index: u8) {
        self.0[usize::from(index / 64)] &= !(1 << (index % 64));
    }

    /// How many are in it.
    pub fn len(&self) -> usize {
        self.0.iter().map(|word| word.count_ones() as usize).sum()
    }

    /// Whether none is in it.
    pub fn is_empty(&self) -> bool {
        self.0 == [0; 4]
    }
}

/// A frame as the device packs it. Missing samples are all ones: of depth, no reading.
#[derive(Clone, Copy, Debug)]
pub struct Frame<'a, L = Packing> {
    /// The last packet's time on the device's clock, ns. Where that packet is missing, that of the nearest before it that has one.
    pub timestamp_ns: i64,
    /// When its newest packet arrived, on the host's clock, ns.
    pub arrival_ns: i64,
    /// [`Layout::frame_bytes`] bytes, for [`Packing::unpack`].
    pub packed: &'a [u8],
    /// How it is packed.
    pub packing: L,
    /// The packets that are in it.
    pub present: PacketSet,
    /// Packets lost since the frame that was handed out before, its own missing ones counted.
    pub lost: u64,
}

/// A depth frame's missing samples are so many ranges at most: every second packet of the longest frame.
pub const MOST_HOLES: usize = Packing::Eleven.packets().div_ceil(2);

impl<L: Layout> Frame<'_, L> {
    /// Whether every sample is the device's.
    pub fn is_whole(&self) -> bool {
        self.present.len() == self.packing.packets()
    }

    /// The ranges of samples that are missing, ascending, apart from each other. A sample that is half in a missing packet is missing.
    pub fn missing(&self) -> impl Iterator<Item = Range<usize>> {
        missing(self.packing, self.present)
    }
}

pub(super) fn missing<L: Layout>(packing: L, present: PacketSet) -> impl Iterator<Item = Range<usize>> {
    let (packets, bits) = (packing.packets(), packing.bits());
    let mut next = 0;
    core::iter::from_fn(move || {
        let is_present = |index: &usize| present.contains(*index as u8);
        let start = (next..packets).find(|index| !is_present(index))?;
        let end = (start..packets).find(is_present).unwrap_or(packets);
        next = end;
        let bytes = start * L::PAYLOAD..(end * L::PAYLOAD).min(packing.frame_bytes());
        Some(bytes.start * 8 / bits..(bytes.end * 8).div_ceil(bits))
    })
}

/// Sets the bits of `samples` to ones.
pub(super) fn erase<L: Layout>(packed: &mut [u8], packing: L, samples: &Range<usize>) {
    let (start, end) = (samples.start * packing.bits(), samples.end * packing.bits());
    let (first, last) = (start / 8, end / 8);
    // The bits of the byte at `start` from it on; of that at `end`, those before it.
    let (head, tail) = (0xff_u8 >> (start % 8), !(0xff_u8 >> (end % 8)));
    if let Some(whole) = packed.get_mut(first..last) {
        let before = whole.first().map_or(0, |byte| byte | head);
        whole.fill(0xff);
        if let Some(byte) = whole.first_mut() {
            *byte = before;
        }
    }
    if let Some(byte) = packed.get_mut(last) {
        *byte |= if first == last { head & tail } else { tail };
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::{vec, vec::Vec};

    proptest! {
        #[test]
        fn only_the_samples_named_are_erased(start in 0_usize..32, length in 0_usize..32, ten in any::<bool>()) {
            let packing = if ten { Packing::Ten } else { Packing::Eleven };
            let range = start..(start + length).min(32);
            let mut packed = vec![0; 4 * packing.bits()];
            if range.start < range.end {
                erase(&mut packed, packing, &range);
            }
            let mut samples = [0; 32];
            packing.unpack(&packed, &mut samples).unwrap();
            for (i, sample) in samples.iter().enumerate() {
                prop_assert_eq!(*sample, if range.contains(&i) { 2047 } else { 0 });
            }
        }
    }

    #[test]
    fn missing_packets_are_ranges_of_samples() {
        let mut present = PacketSet::default();
        (0..242).for_each(|index| present.insert(index));
        assert_eq!(missing(Packing::Eleven, present).count(), 0);
        for index in [0, 100, 101, 241] {
            present.remove(index);
        }
        let ranges: Vec<_> = missing(Packing::Eleven, present).collect();
        // 1748 × 8 / 11 = 1271.3 samples a packet.
        assert_eq!(ranges, [0..1272, 127_127..129_670, 306_376..307_200]);
    }
}
