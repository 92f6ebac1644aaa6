//! The scope, with the feature `scope`; without, nothing of it is left in the image.

#[cfg(not(feature = "scope"))]
mod none;
#[cfg(feature = "scope")]
mod recording;

#[cfg(not(feature = "scope"))]
pub(crate) use none::{ScopeMemory, ScopeTasks};
#[cfg(feature = "scope")]
pub(crate) use recording::{From, ScopeMemory, ScopeTasks};
