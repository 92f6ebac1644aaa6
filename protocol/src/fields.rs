//! Between a message and its bytes, which are those of `postcard`: numbers of more than a byte seven bits at a time, floats
//! as they are, an option behind a byte, a variant behind its number. Of what is wrong nothing is told but that it is, which
//! is less code than a crate for everyone's needs.

mod read;
mod write;

use core::fmt;
pub(crate) use read::read;
pub(crate) use write::{Bytes, write};

/// These are no message's.
#[derive(Debug)]
pub(crate) struct Meaningless;

impl fmt::Display for Meaningless {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "no message")
    }
}

impl core::error::Error for Meaningless {}

impl serde::de::Error for Meaningless {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Self
    }
}

impl serde::ser::Error for Meaningless {
    fn custom<T: fmt::Display>(_: T) -> Self {
        Self
    }
}
