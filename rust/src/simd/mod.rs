//! Wide registers, chosen at run time: AVX2 or SSSE3 on x86-64, NEON on aarch64, none elsewhere. Every path gives the same bits.
#![allow(unsafe_code)] // The only such module of the core: instructions that not every processor has.

#[cfg(target_arch = "aarch64")]
mod neon;
#[cfg(target_arch = "x86_64")]
mod x86;

use core::ops::Range;

#[cfg(target_arch = "x86_64")]
cpufeatures::new!(has_avx2, "avx2");
#[cfg(target_arch = "x86_64")]
cpufeatures::new!(has_ssse3, "ssse3");

/// A set of instructions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Path {
    /// x86-64 with AVX2: 32 bytes at once.
    Avx2,
    /// x86-64 with SSSE3, of which not every processor is: 16 bytes.
    Ssse3,
    /// Every aarch64: 16 bytes.
    Neon,
    /// What the language has.
    Portable,
}

impl Path {
    /// Whether this processor has it.
    #[inline]
    pub fn is_here(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Self::Avx2 => has_avx2::get(),
            #[cfg(target_arch = "x86_64")]
            Self::Ssse3 => has_ssse3::get(),
            Self::Neon => cfg!(target_arch = "aarch64"),
            Self::Portable => true,
            #[cfg(not(target_arch = "x86_64"))]
            Self::Avx2 | Self::Ssse3 => false,
        }
    }

    /// The fastest that this processor has.
    #[inline]
    pub fn best() -> Self {
        [Self::Avx2, Self::Ssse3, Self::Neon].into_iter().find(|path| path.is_here()).unwrap_or(Self::Portable)
    }
}

/// Runs `work`, compiled for the widest registers where it can be inlined: mark it `#[inline(always)]`, and give it plain loops.
#[inline]
pub fn widest<R>(work: impl FnOnce() -> R) -> R {
    #[cfg(test)]
    if NARROW.get() {
        return work();
    }
    #[cfg(target_arch = "x86_64")]
    if Path::Avx2.is_here() {
        // SAFETY: the processor has AVX2.
        return unsafe { x86::with_avx2(work) };
    }
    work()
}

#[cfg(test)]
std::thread_local! {
    /// Whether [`widest`] takes what the language has on this thread.
    pub(crate) static NARROW: core::cell::Cell<bool> = const { core::cell::Cell::new(false) };
}

/// Asks memory for `cells`, which are read soon: only a hint, and none where the language has no such instruction.
#[inline]
pub fn fetch<T>(cells: &[T]) {
    #[cfg(target_arch = "x86_64")]
    for line in cells.chunks((LINE / size_of::<T>().max(1)).max(1)) {
        // SAFETY: every x86-64 has it, and a hint reads nothing.
        unsafe { core::arch::x86_64::_mm_prefetch::<{ core::arch::x86_64::_MM_HINT_T0 }>(line.as_ptr().cast()) };
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (cells, LINE);
}

/// Bytes that come from memory together.
const LINE: usize = 64;

/// Unpacks samples of `BITS` (10 or 11) bits: each of `groups` is 8 of them, in `BITS` bytes of `packed`, most significant bit first; `samples` begins with the
/// first one's. Returns which of `groups` it has done: those at the ends may be left, as may all.
#[inline]
pub fn unpack<const BITS: usize>(path: Path, packed: &[u8], groups: Range<usize>, samples: &mut [u16]) -> Range<usize> {
    // Only groups that are there.
    let groups = groups.start..groups.end.min(packed.len() / BITS).min(groups.start + samples.len() / 8).max(groups.start);
    let none = groups.start..groups.start;
    match path {
        _ if !path.is_here() => none,
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has AVX2, and the groups are in both slices.
        Path::Avx2 => unsafe { x86::unpack_avx2::<BITS>(packed, &groups, samples) },
        #[cfg(target_arch = "x86_64")]
        // SAFETY: the processor has SSSE3, and the groups are in both slices.
        Path::Ssse3 => unsafe { x86::unpack_ssse3::<BITS>(packed, &groups, samples) },
        #[cfg(target_arch = "aarch64")]
        // SAFETY: every aarch64 has NEON, and the groups are in both slices.
        Path::Neon => unsafe { neon::unpack::<BITS>(packed, &groups, samples) },
        _ => none,
    }
}

/// Those of `groups` that can be read 16 bytes at a time.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
fn readable<const BITS: usize>(packed: &[u8], groups: &Range<usize>) -> Range<usize> {
    let readable = packed.len().checked_sub(16).map_or(0, |last| last / BITS + 1);
    groups.start..groups.end.min(readable).max(groups.start)
}

/// How 8 samples of `BITS` bits lie in their bytes. Sample i begins in byte ⌊i · BITS/8⌋ and there at bit s, from the most significant one;
/// where s + BITS > 16 its last bits are in a third byte.
#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
struct Layout<const BITS: usize>;

#[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
impl<const BITS: usize> Layout<BITS> {
    /// For each sample's low and high byte, where its first two bytes are: the later one first.
    const PAIRS: [u8; 16] = {
        let mut bytes = [0; 16];
        let mut i = 0;
        while i < 8 {
            let first = (i * BITS / 8) as u8;
            (bytes[2 * i], bytes[2 * i + 1]) = (first + 1, first);
            i += 1;
        }
        bytes
    };

    /// Likewise its third byte, as its low one; no byte of 16 where it has none.
    const THIRDS: [u8; 16] = {
        let mut bytes = [0x80; 16];
        let mut i = 0;
        while i < 8 {
            if i * BITS % 8 + BITS > 16 {
                bytes[2 * i] = (i * BITS / 8) as u8 + 2;
            }
            i += 1;
        }
        bytes
    };

    /// The product with 2^s, in 16 bits, begins with the sample's first bit; the upper half of that of its third byte is what follows there.
    const FACTORS: [u16; 8] = {
        let mut factors = [1; 8];
        let mut i = 0;
        while i < 8 {
            factors[i] <<= i * BITS % 8;
            i += 1;
        }
        factors
    };
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_best_path_is_here() {
        assert!(Path::best().is_here());
        assert!(Path::Portable.is_here());
        assert!(!(Path::Avx2.is_here() && Path::Neon.is_here()));
        #[cfg(target_arch = "x86_64")]
        assert_eq!(
            (Path::Avx2.is_here(), Path::Ssse3.is_here()),
            (std::is_x86_feature_detected!("avx2"), std::is_x86_feature_detected!("ssse3"))
        );
    }

    #[test]
    fn work_for_wide_registers_is_done() {
        assert_eq!(widest(|| (0..100_u32).sum::<u32>()), 4950);
    }
}
