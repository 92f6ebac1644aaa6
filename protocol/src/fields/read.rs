//! From bytes to a message. Whether there were enough, and whether they were what a message has, is looked at once, in the
//! end: 320 bytes of a chip's flash less than behind every field.

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
    /// Whether no byte was missing so far, and none was what no message has.
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

    /// Of so many bits, seven a byte, the lowest first; the eighth tells that more follow.
    #[inline(never)]
    fn number(&mut self, bits: u32) -> u32 {
        let mut number = 0;
        for shift in (0..bits).step_by(7) {
            let byte = self.byte();
            number |= u32::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                self.whole &= byte >> (bits - shift).min(7) == 0;
                return number;
            }
        }
        self.whole = false;
        number
    }

    /// The same of 64 bits, which no drive is sent.
    fn long_number(&mut self) -> u64 {
        let mut number = 0;
        for shift in (0..64).step_by(7) {
            let byte = self.byte();
            number |= u64::from(byte & 0x7F) << shift;
            if byte < 0x80 {
                self.whole &= shift < 63 || byte < 2;
                return number;
            }
        }
        self.whole = false;
        number
    }

    #[inline(never)]
    fn text(&mut self) -> &'a [u8] {
        let length = self.number(32) as usize;
        let Some((text, rest)) = self.bytes.split_at_checked(length) else {
            self.whole = false;
            return &[];
        };
        self.bytes = rest;
        text
    }

    /// No or yes.
    fn flag(&mut self) -> bool {
        let byte = self.byte();
        self.whole &= byte < 2;
        byte != 0
    }
}

/// The sign is in the lowest bit.
const fn signed(number: u32) -> i32 {
    (number >> 1) as i32 ^ -((number & 1) as i32)
}

impl<'a> Deserializer<'a> for &mut Fields<'a> {
    type Error = Meaningless;

    fn deserialize_bool<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_bool(self.flag())
    }

    fn deserialize_u8<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u8(self.byte())
    }

    fn deserialize_i8<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i8(self.byte() as i8)
    }

    fn deserialize_u16<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u16(self.number(16) as u16)
    }

    fn deserialize_u32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u32(self.number(32))
    }

    fn deserialize_u64<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_u64(self.long_number())
    }

    fn deserialize_i16<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i16(signed(self.number(16)) as i16)
    }

    fn deserialize_i32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_i32(signed(self.number(32)))
    }

    fn deserialize_f32<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_f32(f32::from_bits(self.word()))
    }

    fn deserialize_f64<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        let low = self.word();
        visitor.visit_f64(f64::from_bits(u64::from(low) | u64::from(self.word()) << 32))
    }

    fn deserialize_str<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_borrowed_str(core::str::from_utf8(self.text()).map_err(|_| Meaningless)?)
    }

    fn deserialize_bytes<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        visitor.visit_borrowed_bytes(self.text())
    }

    fn deserialize_option<V: Visitor<'a>>(self, visitor: V) -> Result<V::Value, Meaningless> {
        if self.flag() { visitor.visit_some(self) } else { visitor.visit_none() }
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
        let number: U32Deserializer<Meaningless> = self.number(32).into_deserializer();
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
