//! No diagnostic channel.

use super::super::axis::Drive;
use hallservo_registers::NoTunnel;

/// Nobody listens.
pub(in super::super) struct Channel(NoTunnel);

impl Channel {
    pub const fn new() -> Self {
        Self(NoTunnel)
    }

    pub const fn tunnel(&mut self) -> &mut NoTunnel {
        &mut self.0
    }

    #[inline(always)]
    pub fn serve<F, E>(&mut self, _: &mut Drive<'_, F, E>) {}

    #[inline(always)]
    pub fn tick<F, E>(&mut self, _: &mut Drive<'_, F, E>) {}
}

/// No settings are changed.
pub(in super::super) struct Pending;

impl Pending {
    pub const fn new() -> Self {
        Self
    }

    #[inline(always)]
    pub const fn waits(&self) -> bool {
        false
    }
}
