//! From a message to bytes.

use super::Meaningless;
use serde::ser::{
    Impossible, Serialize, SerializeStruct, SerializeStructVariant, SerializeTuple, SerializeTupleStruct,
    SerializeTupleVariant, Serializer,
};

/// Adds a message; false for one that has something of a kind that no message has.
pub(crate) fn write<T: Serialize>(message: &T, bytes: &mut Bytes<'_>) -> bool {
    message.serialize(bytes).is_ok()
}

/// Takes every byte, and counts those that have no room as well: no field has to look whether the one before was taken,
/// which would be a kilobyte of code on a chip.
pub(crate) struct Bytes<'a> {
    bytes: &'a mut [u8],
    length: usize,
}

impl<'a> Bytes<'a> {
    pub const fn new(bytes: &'a mut [u8]) -> Self {
        Self { bytes, length: 0 }
    }

    pub const fn length(&self) -> usize {
        self.length
    }

    #[inline(never)]
    pub fn push(&mut self, byte: u8) {
        if let Some(place) = self.bytes.get_mut(self.length) {
            *place = byte;
        }
        self.length += 1;
    }

    #[inline(never)]
    pub fn push_all(&mut self, bytes: &[u8]) {
        for byte in bytes {
            self.push(*byte);
        }
    }

    /// Most numbers have four bytes, and a register takes less code than an address: 176 bytes of a chip's flash.
    #[inline(never)]
    pub fn push_word(&mut self, word: u32) {
        self.push_all(&word.to_le_bytes());
    }

    /// From a place on.
    pub fn written(&mut self, from: usize) -> &mut [u8] {
        self.bytes.get_mut(from..self.length).unwrap_or_default()
    }

    /// Seven bits a byte, the lowest first; the eighth tells that more follow.
    #[inline(never)]
    fn push_number(&mut self, mut number: u32) {
        while number >= 0x80 {
            self.push(number as u8 | 0x80);
            number >>= 7;
        }
        self.push(number as u8);
    }

    #[inline(never)]
    fn push_long_number(&mut self, mut number: u64) {
        while number >= 0x80 {
            self.push(number as u8 | 0x80);
            number >>= 7;
        }
        self.push(number as u8);
    }

    /// With the sign in the lowest bit.
    fn push_signed(&mut self, number: i32) {
        self.push_number((number << 1 ^ number >> 31) as u32);
    }

    #[inline(never)]
    fn push_text(&mut self, text: &[u8]) {
        self.push_number(text.len() as u32);
        self.push_all(text);
    }
}

type Done = Result<(), Meaningless>;

impl Serializer for &mut Bytes<'_> {
    type Ok = ();
    type Error = Meaningless;
    type SerializeSeq = Impossible<(), Meaningless>;
    type SerializeTuple = Self;
    type SerializeTupleStruct = Self;
    type SerializeTupleVariant = Self;
    type SerializeMap = Impossible<(), Meaningless>;
    type SerializeStruct = Self;
    type SerializeStructVariant = Self;

    fn serialize_bool(self, value: bool) -> Done {
        self.push(value.into());
        Ok(())
    }

    fn serialize_u8(self, value: u8) -> Done {
        self.push(value);
        Ok(())
    }

    fn serialize_i8(self, value: i8) -> Done {
        self.push(value as u8);
        Ok(())
    }

    fn serialize_u16(self, value: u16) -> Done {
        self.push_number(value.into());
        Ok(())
    }

    fn serialize_u32(self, value: u32) -> Done {
        self.push_number(value);
        Ok(())
    }

    fn serialize_u64(self, value: u64) -> Done {
        self.push_long_number(value);
        Ok(())
    }

    fn serialize_i16(self, value: i16) -> Done {
        self.push_signed(value.into());
        Ok(())
    }

    fn serialize_i32(self, value: i32) -> Done {
        self.push_signed(value);
        Ok(())
    }

    fn serialize_f32(self, value: f32) -> Done {
        self.push_word(value.to_bits());
        Ok(())
    }

    fn serialize_f64(self, value: f64) -> Done {
        self.push_all(&value.to_le_bytes());
        Ok(())
    }

    fn serialize_str(self, value: &str) -> Done {
        self.push_text(value.as_bytes());
        Ok(())
    }

    fn serialize_bytes(self, value: &[u8]) -> Done {
        self.push_text(value);
        Ok(())
    }

    fn serialize_none(self) -> Done {
        self.push(0);
        Ok(())
    }

    fn serialize_some<T: Serialize + ?Sized>(self, value: &T) -> Done {
        self.push(1);
        value.serialize(self)
    }

    fn serialize_unit(self) -> Done {
        Ok(())
    }

    fn serialize_unit_struct(self, _: &'static str) -> Done {
        Ok(())
    }

    fn serialize_unit_variant(self, _: &'static str, number: u32, _: &'static str) -> Done {
        self.push_number(number);
        Ok(())
    }

    fn serialize_newtype_struct<T: Serialize + ?Sized>(self, _: &'static str, value: &T) -> Done {
        value.serialize(self)
    }

    fn serialize_newtype_variant<T: Serialize + ?Sized>(
        self,
        _: &'static str,
        number: u32,
        _: &'static str,
        value: &T,
    ) -> Done {
        self.push_number(number);
        value.serialize(self)
    }

    fn serialize_tuple(self, _: usize) -> Result<Self, Meaningless> {
        Ok(self)
    }

    fn serialize_tuple_struct(self, _: &'static str, _: usize) -> Result<Self, Meaningless> {
        Ok(self)
    }

    fn serialize_tuple_variant(
        self,
        _: &'static str,
        number: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self, Meaningless> {
        self.push_number(number);
        Ok(self)
    }

    fn serialize_struct(self, _: &'static str, _: usize) -> Result<Self, Meaningless> {
        Ok(self)
    }

    fn serialize_struct_variant(
        self,
        _: &'static str,
        number: u32,
        _: &'static str,
        _: usize,
    ) -> Result<Self, Meaningless> {
        self.push_number(number);
        Ok(self)
    }

    // What no message has.

    fn serialize_i64(self, _: i64) -> Done {
        Err(Meaningless)
    }

    fn serialize_char(self, _: char) -> Done {
        Err(Meaningless)
    }

    fn serialize_seq(self, _: Option<usize>) -> Result<Self::SerializeSeq, Meaningless> {
        Err(Meaningless)
    }

    fn serialize_map(self, _: Option<usize>) -> Result<Self::SerializeMap, Meaningless> {
        Err(Meaningless)
    }

    fn collect_str<T: core::fmt::Display + ?Sized>(self, _: &T) -> Done {
        Err(Meaningless)
    }

    fn is_human_readable(&self) -> bool {
        false
    }
}

/// The parts of what has several, one after the other.
macro_rules! parts {
    ($($trait:ident: $add:ident($($name:ty)?);)+) => {
        $(impl $trait for &mut Bytes<'_> {
            type Ok = ();
            type Error = Meaningless;

            fn $add<T: Serialize + ?Sized>(&mut self, $(_: $name,)? value: &T) -> Done {
                value.serialize(&mut **self)
            }

            fn end(self) -> Done {
                Ok(())
            }
        })+
    };
}

parts! {
    SerializeTuple: serialize_element();
    SerializeTupleStruct: serialize_field();
    SerializeTupleVariant: serialize_field();
    SerializeStruct: serialize_field(&'static str);
    SerializeStructVariant: serialize_field(&'static str);
}
