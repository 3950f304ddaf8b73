//! Packed disparity: samples of 11 or 10 bits, most significant bit first, so that 8 samples fill 11 or 10 bytes.
//!
//! All ones is no reading: 2047, and in 10 bits 1023 (no source settles the latter), which is unpacked to 2047 as well.

use super::packet::DEPTH_PAYLOAD;
use crate::geometry::camera::NO_DISPARITY;
use crate::simd::{self, Path};

/// Columns of a depth frame, px.
pub const WIDTH: usize = 640;
/// Rows of a depth frame, px.
pub const HEIGHT: usize = 480;

/// How many bits a sample has.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Packing {
    /// 11 bits: 422,400 bytes a frame, in 242 packets.
    #[default]
    Eleven,
    /// 10 bits: 384,000 bytes a frame, in 220 packets.
    Ten,
}

/// The samples aren't as many as the packed bytes hold, or not in groups of 8.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PackingError {
    /// Packed bytes.
    pub bytes: usize,
    /// Samples.
    pub samples: usize,
}

impl core::fmt::Display for PackingError {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        write!(f, "{} samples do not pack into {} bytes", self.samples, self.bytes)
    }
}

impl core::error::Error for PackingError {}

impl Packing {
    /// Bits of a sample, which is also the bytes of 8.
    pub const fn bits(self) -> usize {
        match self {
            Self::Eleven => 11,
            Self::Ten => 10,
        }
    }

    /// Packed bytes of a frame.
    pub const fn frame_bytes(self) -> usize {
        WIDTH * HEIGHT / 8 * self.bits()
    }

    /// Packets of a frame.
    pub const fn packets(self) -> usize {
        self.frame_bytes().div_ceil(DEPTH_PAYLOAD)
    }

    /// Unpacks `packed` into `samples`, row by row as the frame is.
    ///
    /// # Errors
    /// Sizes that don't belong together.
    pub fn unpack(self, packed: &[u8], samples: &mut [u16]) -> Result<(), PackingError> {
        self.check(packed.len(), samples.len())?;
        self.unpack_by(Path::best(), packed, 0, samples);
        Ok(())
    }

    /// Unpacks only as many samples as `samples` has room for, from number `first` on; both are multiples of 8.
    ///
    /// # Errors
    /// They are not, or `packed` has no such samples.
    pub fn unpack_part(self, packed: &[u8], first: usize, samples: &mut [u16]) -> Result<(), PackingError> {
        let end = first.saturating_add(samples.len());
        if !first.is_multiple_of(8) || !end.is_multiple_of(8) || packed.len() / self.bits() < end / 8 {
            return Err(PackingError { bytes: packed.len(), samples: end });
        }
        self.unpack_by(Path::best(), packed, first / 8, samples);
        Ok(())
    }

    /// From group `first` on.
    fn unpack_by(self, path: Path, packed: &[u8], first: usize, samples: &mut [u16]) {
        match self {
            Self::Eleven => unpack_groups::<11>(path, packed, first, samples),
            Self::Ten => unpack_groups::<10>(path, packed, first, samples),
        }
    }

    /// Packs the low bits of each of `samples` into `packed`.
    ///
    /// # Errors
    /// Sizes that don't belong together.
    pub fn pack(self, samples: &[u16], packed: &mut [u8]) -> Result<(), PackingError> {
        self.check(packed.len(), samples.len())?;
        let bits = self.bits();
        for (group, eight) in packed.chunks_exact_mut(bits).zip(samples.chunks_exact(8)) {
            let mask = (1_u128 << bits) - 1;
            let all = eight.iter().fold(0, |all, sample| all << bits | u128::from(*sample) & mask);
            group.copy_from_slice(&all.to_be_bytes()[16 - bits..]);
        }
        Ok(())
    }

    fn check(self, bytes: usize, samples: usize) -> Result<(), PackingError> {
        let fit = samples.is_multiple_of(8) && (samples / 8).checked_mul(self.bits()) == Some(bytes);
        if fit { Ok(()) } else { Err(PackingError { bytes, samples }) }
    }
}

fn unpack_groups<const BITS: usize>(path: Path, packed: &[u8], first: usize, samples: &mut [u16]) {
    let groups = first..first + samples.len() / 8;
    let done = simd::unpack::<BITS>(path, packed, groups.clone(), samples);
    let (packed, samples) = (packed.as_chunks::<BITS>().0, samples.as_chunks_mut::<8>().0);
    for part in [groups.start..done.start, done.end..groups.end] {
        let (Some(packed), Some(samples)) = (packed.get(part.clone()), samples.get_mut(part.start - first..part.end - first)) else {
            continue;
        };
        for (group, eight) in packed.iter().zip(samples) {
            *eight = unpack_group(group);
        }
    }
}

/// The first samples from the group's first 8 bytes as a number, the others from its last 8.
#[inline]
fn unpack_group<const BITS: usize>(group: &[u8; BITS]) -> [u16; 8] {
    let word = |bytes: Option<&[u8; 8]>| bytes.map_or(0, |bytes| u64::from_be_bytes(*bytes));
    let (head, tail) = (word(group.first_chunk()), word(group.last_chunk()));
    let none = (1 << BITS) - 1;
    core::array::from_fn(|i| {
        let end = BITS * (i + 1);
        let bits = if end <= 64 { head >> (64 - end) } else { tail >> (8 * BITS - end) } as u16 & none;
        if BITS == 10 && bits == none { NO_DISPARITY } else { bits }
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use std::{vec, vec::Vec};

    /// Bit by bit, as the definition says.
    fn sample(packed: &[u8], bits: usize, i: usize) -> u16 {
        (i * bits..(i + 1) * bits).fold(0, |value, bit| value << 1 | u16::from(packed[bit / 8] >> (7 - bit % 8) & 1))
    }

    #[test]
    fn sizes_are_the_devices() {
        let eleven = Packing::Eleven;
        assert_eq!((eleven.frame_bytes(), eleven.packets(), eleven.frame_bytes() - 241 * DEPTH_PAYLOAD), (422_400, 242, 1132));
        assert_eq!((Packing::Ten.frame_bytes(), Packing::Ten.packets()), (384_000, 220));
    }

    #[test]
    fn known_bytes() {
        let mut packed = [0; 11];
        Packing::Eleven.pack(&[1, 0, 2047, 0, 0, 0, 0, 1024], &mut packed).unwrap();
        assert_eq!(packed, [0x00, 0x20, 0x03, 0xff, 0x80, 0, 0, 0, 0, 0x04, 0x00]);
        assert_eq!(Packing::Eleven.pack(&[0; 7], &mut packed), Err(PackingError { bytes: 11, samples: 7 }));
        assert_eq!(Packing::Ten.unpack(&packed, &mut [0; 8]), Err(PackingError { bytes: 11, samples: 8 }));
    }

    proptest! {
        #[test]
        fn every_path_unpacks_as_defined_and_what_is_packed_again_is_the_same(
            groups in prop::collection::vec(prop::array::uniform11(prop_oneof![any::<u8>(), Just(255)]), 0..40),
            part in (0_usize..40, 0_usize..40).prop_map(|(start, length)| start..start + length),
        ) {
            for packing in [Packing::Eleven, Packing::Ten] {
                let packed: Vec<u8> = groups.iter().flat_map(|group| group[..packing.bits()].to_vec()).collect();
                let mut samples = vec![0; groups.len() * 8];
                packing.unpack(&packed, &mut samples).unwrap();
                for path in [Path::Avx2, Path::Ssse3, Path::Neon, Path::Portable] {
                    let mut same = vec![0; samples.len()];
                    packing.unpack_by(path, &packed, 0, &mut same);
                    prop_assert_eq!(&same, &samples, "{:?}", path);
                    let part = 8 * part.start.min(groups.len())..8 * part.end.min(groups.len());
                    let mut some = vec![1234; part.len()];
                    packing.unpack_by(path, &packed, part.start / 8, &mut some);
                    prop_assert_eq!(&some[..], &samples[part.clone()], "{:?}", path);
                }
                for (i, got) in samples.iter().enumerate() {
                    let bits = sample(&packed, packing.bits(), i);
                    prop_assert_eq!(*got, if packing == Packing::Ten && bits == 1023 { 2047 } else { bits });
                }
                let mut again = vec![0; packed.len()];
                packing.pack(&samples, &mut again).unwrap();
                prop_assert_eq!(again, packed);
            }
        }
    }
}
