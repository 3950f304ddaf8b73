//! Integers in the byte order of the machine that captured.

/// A byte order.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) enum Order {
    /// Least significant byte first.
    #[default]
    Little,
    /// Most significant byte first.
    Big,
}

/// A reader of one integer type: 0 beyond the end.
macro_rules! integers {
    ($($name:ident: $type:ty),*) => {
        $(pub(super) fn $name(self, bytes: &[u8], at: usize) -> $type {
            let found = bytes.get(at..).and_then(<[u8]>::first_chunk).copied().unwrap_or_default();
            match self {
                Self::Little => <$type>::from_le_bytes(found),
                Self::Big => <$type>::from_be_bytes(found),
            }
        })*
    };
}

impl Order {
    integers!(u16: u16, u32: u32, i32: i32, i64: i64);
}
