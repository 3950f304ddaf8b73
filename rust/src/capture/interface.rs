//! What records come from: link types, and the units of their stamps.

use super::order::Order;
use std::format;
use std::string::String;

/// What usbmon writes: a header of 48 bytes, or of 64.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Link {
    /// Link type 189.
    Usb48,
    /// Link type 220.
    Usb64,
}

impl Link {
    pub(super) fn new(link_type: u16) -> Option<Self> {
        match link_type {
            189 => Some(Self::Usb48),
            220 => Some(Self::Usb64),
            _ => None,
        }
    }
}

/// Where records come from.
#[derive(Clone, Copy, Debug)]
pub(super) struct Interface {
    pub(super) link_type: u16,
    pub(super) snap_length: u32,
    pub(super) resolution: Resolution,
    pub(super) offset_s: i64,
}

/// Units of a stamp in a second.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Resolution {
    Decimal(u8),
    Binary(u8),
}

impl Resolution {
    pub(super) fn nanoseconds(self, stamp: u64) -> i128 {
        let ns = u128::from(stamp) * 1_000_000_000;
        match self {
            Self::Decimal(digits) => 10_u128.checked_pow(digits.into()).map_or(0, |units| (ns / units) as i128),
            Self::Binary(bits) => (ns >> bits.min(127)) as i128,
        }
    }
}

impl Interface {
    /// What an interface description says; options beyond its end are not there.
    pub(super) fn parse(order: Order, body: &[u8]) -> Self {
        let (link_type, snap_length) = (order.u16(body, 0), order.u32(body, 4));
        let mut interface = Self { link_type, snap_length, resolution: Resolution::Decimal(6), offset_s: 0 };
        let mut options = body.get(8..).unwrap_or_default();
        while options.len() >= 4 {
            let (code, length) = (order.u16(options, 0), usize::from(order.u16(options, 2)));
            let Some(value) = options.get(4..4 + length).filter(|_| code != 0) else { break };
            match (code, value) {
                (9, [resolution]) if resolution >> 7 == 0 => interface.resolution = Resolution::Decimal(*resolution),
                (9, [resolution]) => interface.resolution = Resolution::Binary(resolution & 0x7f),
                (14, [_, _, _, _, _, _, _, _]) => interface.offset_s = order.i64(value, 0),
                _ => {}
            }
            options = options.get(4 + length.next_multiple_of(4)..).unwrap_or_default();
        }
        interface
    }
}

/// What to say of a link type that is not usbmon's.
pub(super) fn foreign(link_type: u16) -> String {
    let name = match link_type {
        1 => " (Ethernet)",
        101 => " (raw IP)",
        105 | 127 => " (Wi-Fi)",
        113 | 276 => " (Linux cooked)",
        249 => " (USBPcap, of Windows)",
        266 => " (USB of macOS)",
        _ => "",
    };
    format!(
        "its link type is {link_type}{name}: captures of Linux's usbmon are read, 189 or 220 (tcpdump -i usbmonN -s 245824 -w FILE.pcap)"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_of_any_resolution_are_nanoseconds() {
        for (resolution, stamp, ns) in [
            (Resolution::Decimal(6), 1_500_000, 1_500_000_000),
            (Resolution::Decimal(9), 7, 7),
            (Resolution::Decimal(0), 3, 3_000_000_000),
            (Resolution::Decimal(12), 1999, 1),
            (Resolution::Decimal(127), u64::MAX, 0),
            (Resolution::Binary(10), 1536, 1_500_000_000),
            (Resolution::Binary(127), u64::MAX, 0),
        ] {
            assert_eq!(resolution.nanoseconds(stamp), ns, "{resolution:?}");
        }
    }

    #[test]
    fn options_are_read_as_far_as_they_go() {
        let with = |options: &[u8]| Interface::parse(Order::Little, &[&[220, 0, 0, 0, 0, 0, 4, 0], options].concat());
        let found = with(&[2, 0, 3, 0, b'a', b'b', b'c', 0, 9, 0, 1, 0, 9, 0, 0, 0, 14, 0, 8, 0, 5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]);
        assert_eq!((found.resolution, found.offset_s, found.snap_length), (Resolution::Decimal(9), 5, 1 << 18));
        assert_eq!(with(&[9, 0, 1, 0, 0x8a, 0, 0, 0]).resolution, Resolution::Binary(10));
        for cut in [&[][..], &[9, 0, 1], &[9, 0, 1, 0], &[9, 0, 0xff, 0xff, 1], &[0, 0, 0, 0, 9, 0, 1, 0, 9]] {
            assert_eq!(with(cut).resolution, Resolution::Decimal(6), "{cut:?}");
        }
        assert_eq!(Interface::parse(Order::Little, &[1]).link_type, 0);
    }
}
