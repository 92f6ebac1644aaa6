//! All integration tests as one program: the same code of the messages is compiled once.

mod encoding;
mod frames;
