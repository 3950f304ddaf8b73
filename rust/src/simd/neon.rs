//! Unpacking by table look-ups, which bring each sample's bytes to its place, and multiplications, which shift each sample by its own count.

use super::Layout;
use core::arch::aarch64::{
    vandq_u16, vceqq_u16, vdupq_n_u16, vld1q_u8, vld1q_u16, vmulq_u16, vorrq_u16, vqtbl1q_u8, vreinterpretq_u16_u8, vshrq_n_u16, vst1q_u16,
};
use core::ops::Range;

/// # Safety
/// `groups` are in `packed`, and as many in `samples`.
#[target_feature(enable = "neon")]
pub unsafe fn unpack<const BITS: usize>(packed: &[u8], groups: &Range<usize>, samples: &mut [u16]) -> Range<usize> {
    let first = groups.start;
    // SAFETY: each table has the 16 bytes that are read.
    let (pairs, thirds, left) = unsafe {
        let [pairs, thirds] = [Layout::<BITS>::PAIRS, Layout::<BITS>::THIRDS].map(|table| vld1q_u8(table.as_ptr()));
        (pairs, thirds, vld1q_u16(Layout::<BITS>::FACTORS.as_ptr()))
    };
    let groups = super::readable::<BITS>(packed, groups);
    for group in groups.clone() {
        // SAFETY: the group is readable.
        let bytes = unsafe { vld1q_u8(packed.as_ptr().add(group * BITS)) };
        let shifted = vmulq_u16(vreinterpretq_u16_u8(vqtbl1q_u8(bytes, pairs)), left);
        let eight = if BITS == 11 {
            let beyond = vshrq_n_u16::<8>(vmulq_u16(vreinterpretq_u16_u8(vqtbl1q_u8(bytes, thirds)), left));
            vshrq_n_u16::<5>(vorrq_u16(shifted, beyond))
        } else {
            let ten = vshrq_n_u16::<6>(shifted);
            vorrq_u16(ten, vandq_u16(vceqq_u16(ten, vdupq_n_u16(1023)), vdupq_n_u16(1024)))
        };
        // SAFETY: the group is in `samples`.
        unsafe { vst1q_u16(samples.as_mut_ptr().add((group - first) * 8), eight) };
    }
    groups
}
