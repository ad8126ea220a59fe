//! Short text of fixed size, as plain bytes; the words of enums.

/// Gives names to the values of an enum, which count from 0.
#[macro_export]
macro_rules! words {
    ($kind:ident: $($word:literal)+) => {
        impl $kind {
            /// The names by number.
            pub const NAMES: [&str; [$($word),+].len()] = [$($word),+];

            /// The name in files, reports and messages, and on the command line.
            pub fn name(self) -> &'static str {
                Self::NAMES[self as usize]
            }
        }
    };
}
pub(crate) use words;

/// Like [`words!`], and lists the values.
#[macro_export]
macro_rules! values {
    ($kind:ident: $($value:ident $word:literal)+) => {
        $crate::words!($kind: $($word)+);

        impl $kind {
            /// All values, in the order of their numbers.
            pub const ALL: [$kind; $kind::NAMES.len()] = [$($kind::$value),+];

            /// By its name.
            pub fn from_name(name: &str) -> Option<$kind> {
                $kind::ALL.into_iter().find(|value| value.name() == name)
            }
        }
    };
}
pub(crate) use values;

/// UTF-8 padded with NUL. `Text` only reads and writes byte arrays: the payloads contain `[u8; N]`.
pub struct Text;

impl Text {
    /// Cut at a character border when longer than `N` bytes.
    pub fn pack<const N: usize>(text: &str) -> [u8; N] {
        let mut end = text.len().min(N);
        while !text.is_char_boundary(end) {
            end -= 1;
        }
        let mut bytes = [0; N];
        bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
        bytes
    }

    /// Up to the first NUL; `None` when it is not UTF-8.
    pub fn unpack(bytes: &[u8]) -> Option<&str> {
        let end = bytes.iter().position(|&b| b == 0).unwrap_or(bytes.len());
        std::str::from_utf8(&bytes[..end]).ok()
    }
}
