//! Any bytes as packed samples, in either packing: bit by bit as defined, and packed again the same bytes.
#![no_main]

use libfuzzer_sys::fuzz_target;
use physinc::kinect::disparity::Packing;

fuzz_target!(|bytes: &[u8]| {
    for packing in [Packing::Eleven, Packing::Ten] {
        let bits = packing.bits();
        let packed = &bytes[..bytes.len() / bits * bits];
        let mut samples = vec![0; packed.len() / bits * 8];
        packing.unpack(packed, &mut samples).expect("whole groups");
        for (i, sample) in samples.iter().enumerate() {
            let expected = (i * bits..(i + 1) * bits).fold(0, |value, bit| value << 1 | u16::from(packed[bit / 8] >> (7 - bit % 8) & 1));
            assert_eq!(*sample, if expected == (1 << bits) - 1 { 2047 } else { expected });
        }
        let mut again = vec![0; packed.len()];
        packing.pack(&samples, &mut again).expect("whole groups");
        assert_eq!(again, packed);
    }
});
