//! All integration tests as one program: the same code of the protocol is compiled once.

mod diagnostic;
mod golden;
mod hostile;
mod page;
