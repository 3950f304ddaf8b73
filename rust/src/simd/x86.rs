//! Unpacking by shuffles and multiplications: shuffles bring each sample's bytes to its place, multiplications shift each by its own count.

use super::Layout;
#[allow(clippy::wildcard_imports)] // Some thirty names that say whose they are.
use core::arch::x86_64::*;
use core::ops::Range;

/// Runs `work`, compiled for AVX2 where it is inlined.
#[target_feature(enable = "avx2")]
#[inline]
pub fn with_avx2<R>(work: impl FnOnce() -> R) -> R {
    work()
}

/// 16 bytes of a table.
#[target_feature(enable = "ssse3")]
#[inline]
fn table<T, const N: usize>(values: &[T; N]) -> __m128i {
    const { assert!(size_of::<[T; N]>() == 16) };
    // SAFETY: 16 bytes are there.
    unsafe { _mm_loadu_si128(values.as_ptr().cast()) }
}

/// A table of bytes for both halves of a register: the first half's bytes come as late as a group can end.
const fn late<const BITS: usize>(bytes: [u8; 16]) -> [u8; 32] {
    let mut both = [0; 32];
    let mut i = 0;
    while i < 16 {
        both[i] = if bytes[i] < 16 { bytes[i] + 16 - BITS as u8 } else { bytes[i] };
        both[16 + i] = bytes[i];
        i += 1;
    }
    both
}

/// # Safety
/// The processor has SSSE3; `groups` are in `packed`, and as many in `samples`.
#[target_feature(enable = "ssse3")]
pub unsafe fn unpack_ssse3<const BITS: usize>(packed: &[u8], groups: &Range<usize>, samples: &mut [u16]) -> Range<usize> {
    let first = groups.start;
    let (pairs, thirds) = (table(&Layout::<BITS>::PAIRS), table(&Layout::<BITS>::THIRDS));
    let left = table(&Layout::<BITS>::FACTORS);
    let groups = super::readable::<BITS>(packed, groups);
    for group in groups.clone() {
        // SAFETY: the group is readable.
        let bytes = unsafe { _mm_loadu_si128(packed.as_ptr().add(group * BITS).cast()) };
        let shifted = _mm_mullo_epi16(_mm_shuffle_epi8(bytes, pairs), left);
        let eight = if BITS == 11 {
            let beyond = _mm_srli_epi16::<8>(_mm_mullo_epi16(_mm_shuffle_epi8(bytes, thirds), left));
            _mm_srli_epi16::<5>(_mm_or_si128(shifted, beyond))
        } else {
            let ten = _mm_srli_epi16::<6>(shifted);
            let none = _mm_cmpeq_epi16(ten, _mm_set1_epi16(1023));
            _mm_or_si128(ten, _mm_and_si128(none, _mm_set1_epi16(1024)))
        };
        // SAFETY: the group is in `samples`.
        unsafe { _mm_storeu_si128(samples.as_mut_ptr().add((group - first) * 8).cast(), eight) };
    }
    groups
}

/// # Safety
/// The processor has AVX2; `groups` are in `packed`, and as many in `samples`.
#[target_feature(enable = "avx2")]
pub unsafe fn unpack_avx2<const BITS: usize>(packed: &[u8], groups: &Range<usize>, samples: &mut [u16]) -> Range<usize> {
    let first = groups.start;
    // Of the 32 bytes that are read, the first half ends with one group, and the second begins with the next.
    let early = 16 - BITS;
    let tables = const { [late::<BITS>(Layout::<BITS>::PAIRS), late::<BITS>(Layout::<BITS>::THIRDS)] };
    // SAFETY: each table has 32 bytes.
    let [pairs, thirds] = [0, 1].map(|i: usize| unsafe { _mm256_loadu_si256(tables[i].as_ptr().cast()) });
    let left = _mm256_broadcastsi128_si256(table(&Layout::<BITS>::FACTORS));
    let readable = super::readable::<BITS>(packed, groups);
    let start = readable.start.max(usize::from(readable.start < readable.end));
    let groups = start..readable.end.max(start) - (readable.end.max(start) - start) % 4;
    for four in groups.clone().step_by(4) {
        for group in [four, four + 2] {
            // SAFETY: this group, which is not the first, and the next can each be read 16 bytes at a time.
            let bytes = unsafe { _mm256_loadu_si256(packed.as_ptr().add(group * BITS - early).cast()) };
            let shifted = _mm256_mullo_epi16(_mm256_shuffle_epi8(bytes, pairs), left);
            let sixteen = if BITS == 11 {
                let beyond = _mm256_srli_epi16::<8>(_mm256_mullo_epi16(_mm256_shuffle_epi8(bytes, thirds), left));
                _mm256_srli_epi16::<5>(_mm256_or_si256(shifted, beyond))
            } else {
                let ten = _mm256_srli_epi16::<6>(shifted);
                let none = _mm256_cmpeq_epi16(ten, _mm256_set1_epi16(1023));
                _mm256_or_si256(ten, _mm256_and_si256(none, _mm256_set1_epi16(1024)))
            };
            // SAFETY: both groups are in `samples`.
            unsafe { _mm256_storeu_si256(samples.as_mut_ptr().add((group - first) * 8).cast(), sixteen) };
        }
    }
    groups
}
