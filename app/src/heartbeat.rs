//! What the control interrupt tells the tasks beside its queues: that it lives, and what changes slowly.

use core::sync::atomic::{AtomicU32, Ordering};
use hallservo::board::{Sample, TemperatureCode};

/// Counts control periods; the application feeds the watchdog only while it moves and all its tasks do.
#[derive(Debug, Default)]
pub struct Heartbeat {
    periods: AtomicU32,
    bus_and_bridge: AtomicU32,
    motor: AtomicU32,
}

/// What the ADCs said last of what changes slowly, in codes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Sensed {
    pub bus: u16,
    /// Bridge and motor.
    pub temperatures: [TemperatureCode; 2],
}

impl Heartbeat {
    /// Before the first period.
    pub const fn new() -> Self {
        Self { periods: AtomicU32::new(0), bus_and_bridge: AtomicU32::new(0), motor: AtomicU32::new(0) }
    }

    /// To be called by the control interrupt, and by nobody else, once a period: a load and three stores.
    #[inline(always)]
    pub fn beat(&self, sample: &Sample) {
        let [bridge, motor] = sample.temperatures.map(|code| u32::from(code.to_bits()));
        self.bus_and_bridge.store(u32::from(sample.bus) << 16 | bridge, Ordering::Relaxed);
        self.motor.store(motor, Ordering::Relaxed);
        // There is one writer, so this needs no exchange, which a Cortex-M0 does not have.
        self.periods.store(self.periods.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }

    /// Control periods so far, wrapping.
    pub fn periods(&self) -> u32 {
        self.periods.load(Ordering::Relaxed)
    }

    pub(crate) fn sensed(&self) -> Sensed {
        let word = self.bus_and_bridge.load(Ordering::Relaxed);
        let motor = self.motor.load(Ordering::Relaxed) as u16;
        Sensed { bus: (word >> 16) as u16, temperatures: [word as u16, motor].map(TemperatureCode::from_bits) }
    }
}
