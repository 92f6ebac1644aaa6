//! From bytes to a message. Whether there were enough is looked at once, in the end.

use super::Meaningless;
use serde::de::{
    DeserializeSeed, Deserializer, EnumAccess, IntoDeserializer, SeqAccess, VariantAccess, Visitor,
    value::U32Deserializer,
};
use serde::{Deserialize, forward_to_deserialize_any};

/// The message that bytes are, all of them.
pub(crate) fn read<'a, T: Deserialize<'a>>(bytes: &'a [u8]) -> Option<T> {
    let mut fields = Fields { bytes, whole: true };
    let message = T::deserialize(&mut fields).ok()?;
    (fields.whole && fields.bytes.is_empty()).then_some(message)
}

/// Gives every field its bytes, and zeros where there are none left: a message has no lists of any length, which would take
/// zeros without end.
struct Fields<'a> {
    bytes: &'a [u8],
    /// Whether no byte was missing so far.
    whole: bool,
}

impl<'a> Fields<'a> {
    #[inline(never)]
    fn byte(&mut self) -> u8 {
        let Some((byte, rest)) = self.bytes.split_first() else {
            self.whole = false;
            return 0;
        };
        self.bytes = rest;
        *byte
    }

    #[inline(never)]
    fn word(&mut self) -> u32 {
        (0..4).fold(0, |word, k| word | u32::from(self.byte()) << (8 * k))
    }

    /// Seven bits a byte, the lowest first; the eighth tells that more follow.
    #[inline(never)]
    fn number(&mut self, most_bytes: u32) -> Result<u32, Meaningless> {
        let mut number = 0;
        for shift in (0..most_bytes).map(|k| 7 * k) {
            let byte = self.byte();
            number |= u32::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return if shift < 28 || byte < 16 { Ok(number) } else { Err(Meaningless) };
            }
        }
        Err(Meaningless)
    }

    /// The same of 64 bits, which no drive is sent.
    fn long_number(&mut self) -> Result<u64, Meaningless> {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte();
            number |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                return if shift < 63 || byte < 2 { Ok(number) } else { Err(Meaningless) };
            }
        }
        Err(Meaningless)
    }

    #[inline(never)]
    fn text(&mut self) -> Result<&'a [u8], Meaningless> {
        let length = self.number(5)? as usize;
        let (text, rest) = self.bytes.split_at_checked(length).ok_or(Meaningless)?;
        self.bytes = rest;
        Ok(text)
    }

    /// No or yes.
    fn flag(&mut self) -> Result<bool, Meaningless> {
        match self.byte() {
            0 => Ok(false),
            1 => Ok(true),
            _ => Err(Meaningless),
        }
    }
}

/// The sign is in the lowest bit.
const fn signed(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

impl<'a> Deserializer<'a> for &mut Fields<'a> {
    type Error = Meaningless;

    fn deserialize_bool<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_bool(self.flag()?)
    }

    fn deserialize_u8<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u8(self.byte())
    }

    fn deserialize_i8<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i8(self.byte() as i8)
    }

    fn deserialize_u16<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u16(self.number(3)?.try_into().map_err(|_| Meaningless)?)
    }

    fn deserialize_u32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u32(self.number(5)?)
    }

    fn deserialize_u64<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u64(self.long_number()?)
    }

    fn deserialize_i16<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i16(signed(self.number(3)?).try_into().map_err(|_| Meaningless)?)
    }

    fn deserialize_i32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i32(signed(self.number(5)?))
    }

    fn deserialize_f32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_f32(f32::from_bits(self.word()))
    }

    fn deserialize_f64<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        let low = self.word();
        visitor.visit_f64(f64::from_bits(u64::from(low) | u64::from(self.word()) << 32))
    }

    fn deserialize_str<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_borrowed_str(core::str::from_utf8(self.text()?).map_err(|_| Meaningless)?)
    }

    fn deserialize_bytes<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_borrowed_bytes(self.text()?)
    }

    fn deserialize_option<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        if self.flag()? { visitor.visit_some(self) } else { visitor.visit_none() }
    }

    fn deserialize_unit<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_unit()
    }

    fn deserialize_unit_struct<V: Visitor<'a>>(self, _: &'static str, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_unit()
    }

    fn deserialize_newtype_struct<V: Visitor<'a>>(self, _: &'static str, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_tuple<V: Visitor<'a>>(self, _: usize, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_seq(self)
    }

    fn deserialize_tuple_struct<V: Visitor<'a>>(
        self,
        _: &'static str,
        _: usize,
        visitor: V,
    ) -> Result<V::Value, Meaningless> {
        visitor.visit_seq(self)
    }

    fn deserialize_struct<V: Visitor<'a>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Meaningless> {
        visitor.visit_seq(self)
    }

    fn deserialize_enum<V: Visitor<'a>>(
        self,
        _: &'static str,
        _: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, Meaningless> {
        visitor.visit_enum(self)
    }

    /// What no message has.
    fn deserialize_any<V: Visitor<'a>>(self, _: V) -> Result<V::Value, Meaningless> {
        Err(Meaningless)
    }

    forward_to_deserialize_any! { <W: Visitor<'a>> i64 i128 u128 char string byte_buf seq map identifier ignored_any }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// As many as are asked for.
impl<'a> SeqAccess<'a> for &mut Fields<'a> {
    type Error = Meaningless;

    fn next_element_seed<S: DeserializeSeed<'a>>(&mut self, seed: S) -> Result<Option<S::Value>, Meaningless> {
        seed.deserialize(&mut **self).map(Some)
    }
}

impl<'a> EnumAccess<'a> for &mut Fields<'a> {
    type Error = Meaningless;
    type Variant = Self;

    fn variant_seed<S: DeserializeSeed<'a>>(self, seed: S) -> Result<(S::Value, Self), Meaningless> {
        let number: U32Deserializer<Meaningless> = self.number(5)?.into_deserializer();
        Ok((seed.deserialize(number)?, self))
    }
}

impl<'a> VariantAccess<'a> for &mut Fields<'a> {
    type Error = Meaningless;

    fn unit_variant(self) -> Result<(), Meaningless> {
        Ok(())
    }

    fn newtype_variant_seed<S: DeserializeSeed<'a>>(self, seed: S) -> Result<S::Value, Meaningless> {
        seed.deserialize(self)
    }

    fn tuple_variant<V: Visitor<'a>>(self, _: usize, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_seq(self)
    }

    fn struct_variant<V: Visitor<'a>>(self, _: &'static [&'static str], visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_seq(self)
    }
}
