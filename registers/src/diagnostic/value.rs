//! Types and values, as schemas and data of the telemetry format have them: little endian, without padding.

use super::piece::Piece;
use core::fmt::Write;

/// Type of a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Type<'a> {
    /// A byte: 0 or 1.
    Bool,
    /// An unsigned byte.
    U8,
    /// Unsigned, two bytes.
    U16,
    /// Unsigned, four bytes.
    U32,
    /// Unsigned, eight bytes.
    U64,
    /// Signed, four bytes.
    I32,
    /// Single precision.
    F32,
    /// Its length, one byte, then ASCII.
    Text,
    /// A byte: the number of one of these names, which `|` separates.
    Choice(&'a str),
    /// So many values of one type.
    Array(u8, &'a Type<'a>),
}

// Numbers of the types in a schema.
const END: u8 = 0;
const BOOLEAN: u8 = 2;
const FIXED_INT: u8 = 3;
const FIXED_UINT: u8 = 4;
const FLOAT32: u8 = 7;
const STRING: u8 = 10;
const OBJECT: u8 = 16;
const ENUM: u8 = 17;
const FIXED_ARRAY: u8 = 19;

/// What a schema of an object begins with: no flags.
pub(super) const BEGIN: [u8; 2] = [OBJECT, 0];
/// What it ends with: a field without flags, name, aliases, type and default.
pub(super) const FINAL: [u8; 5] = [0, 0, 0, END, 0];

impl Type<'_> {
    /// The type in a schema.
    #[inline(never)]
    fn declare(&self, piece: &mut Piece<'_>) {
        match *self {
            Self::Bool => piece.bytes(&[BOOLEAN]),
            Self::U8 => piece.bytes(&[FIXED_UINT, 1]),
            Self::U16 => piece.bytes(&[FIXED_UINT, 2]),
            Self::U32 => piece.bytes(&[FIXED_UINT, 4]),
            Self::U64 => piece.bytes(&[FIXED_UINT, 8]),
            Self::I32 => piece.bytes(&[FIXED_INT, 4]),
            Self::F32 => piece.bytes(&[FLOAT32]),
            Self::Text => piece.bytes(&[STRING]),
            Self::Choice(names) => {
                piece.bytes(&[ENUM, FIXED_UINT, 1, names.split('|').count() as u8]);
                for (number, name) in names.split('|').enumerate() {
                    piece.bytes(&[number as u8]);
                    piece.short_text(name);
                }
            }
            Self::Array(length, each) => {
                piece.bytes(&[FIXED_ARRAY, length]);
                each.declare(piece);
            }
        }
    }

    /// A field of an object in a schema: without flags, aliases and default.
    pub(super) fn field(&self, name: &str, piece: &mut Piece<'_>) {
        piece.bytes(&[0]);
        piece.short_text(name);
        piece.bytes(&[0]);
        self.declare(piece);
        piece.bytes(&[0]);
    }

    /// Bytes of a value, which is at the beginning of `data`.
    pub(super) fn size(&self, data: &[u8]) -> usize {
        match *self {
            Self::Bool | Self::U8 | Self::Choice(_) => 1,
            Self::U16 => 2,
            Self::U32 | Self::I32 | Self::F32 => 4,
            Self::U64 => 8,
            Self::Text => 1 + usize::from(data.first().copied().unwrap_or(0)),
            Self::Array(length, each) => usize::from(length) * each.size(data),
        }
    }

    /// The value at the beginning of `data`, as text: of an array, the first.
    #[inline(never)]
    pub(super) fn print(&self, data: &[u8], piece: &mut Piece<'_>) {
        let mut number = [0; 8];
        let size = self.size(data).min(number.len());
        for (to, from) in number.iter_mut().zip(data).take(size) {
            *to = *from;
        }
        let number = u64::from_le_bytes(number);
        // What has no room is left out.
        let _ = match *self {
            Self::F32 => number_text(f32::from_bits(number as u32), piece),
            Self::I32 => write!(piece, "{}", number as i32),
            Self::Text => {
                piece.bytes(data.get(1..self.size(data)).unwrap_or_default());
                Ok(())
            }
            Self::Array(_, each) => {
                each.print(data, piece);
                Ok(())
            }
            _ => write!(piece, "{number}"),
        };
    }
}

/// A number with as many digits as it has, in 15 bytes at most.
fn number_text(value: f32, piece: &mut Piece<'_>) -> core::fmt::Result {
    let plain = !value.is_finite() || value == 0.0 || (1e-4..1e9).contains(&value.abs());
    if plain { write!(piece, "{value}") } else { write!(piece, "{value:e}") }
}

/// What can be a field of a [record](super::record).
pub(super) trait Value {
    const TYPE: Type<'static>;

    fn write(&self, piece: &mut Piece<'_>);
}

macro_rules! values {
    ($($type:ty: $kind:ident),+) => {
        $(impl Value for $type {
            const TYPE: Type<'static> = Type::$kind;

            fn write(&self, piece: &mut Piece<'_>) {
                piece.bytes(&self.to_le_bytes());
            }
        })+
    };
}

values!(u8: U8, u16: U16, u32: U32, u64: U64, f32: F32);

impl Value for bool {
    const TYPE: Type<'static> = Type::Bool;

    fn write(&self, piece: &mut Piece<'_>) {
        piece.bytes(&[u8::from(*self)]);
    }
}

impl Value for &str {
    const TYPE: Type<'static> = Type::Text;

    fn write(&self, piece: &mut Piece<'_>) {
        piece.short_text(self);
    }
}

impl<T: Value, const N: usize> Value for [T; N] {
    const TYPE: Type<'static> = Type::Array(N as u8, &T::TYPE);

    fn write(&self, piece: &mut Piece<'_>) {
        self.iter().for_each(|each| each.write(piece));
    }
}
