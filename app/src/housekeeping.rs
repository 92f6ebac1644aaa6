//! What the control interrupt reports to the tasks beside its queues: that it runs, and what changes slowly.

use core::sync::atomic::{AtomicU32, Ordering};
use hallservo::board::{Sample, TemperatureCode};

/// Counts control periods and keeps the latest bus voltage and temperatures. A static: the control interrupt writes it,
/// the tasks read it.
#[derive(Debug, Default)]
pub struct Housekeeping {
    periods: AtomicU32,
    bus_and_bridge: AtomicU32,
    motor: AtomicU32,
}

/// The housekeeping of one moment, for [`Supervisor::tick`](crate::Supervisor::tick).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Readings {
    /// Control periods so far, wrapping; or anything else that each of them changes.
    pub periods: u32,
    /// Bus voltage, ADC codes.
    pub bus: u16,
    /// Temperatures of bridge and motor, ADC codes.
    pub temperatures: [TemperatureCode; 2],
}

impl Housekeeping {
    /// Before the first period.
    pub const fn new() -> Self {
        Self { periods: AtomicU32::new(0), bus_and_bridge: AtomicU32::new(0), motor: AtomicU32::new(0) }
    }

    /// To be called by the control interrupt, and by nobody else, once a period: a load and three stores.
    #[inline(always)]
    pub fn update(&self, sample: &Sample) {
        let [bridge, motor] = sample.temperatures.map(|code| u32::from(code.to_bits()));
        self.bus_and_bridge.store(u32::from(sample.bus) << 16 | bridge, Ordering::Relaxed);
        self.motor.store(motor, Ordering::Relaxed);
        // There is one writer, so this needs no exchange, which a Cortex-M0 does not have.
        self.periods.store(self.periods.load(Ordering::Relaxed).wrapping_add(1), Ordering::Relaxed);
    }

    /// As of now.
    pub fn read(&self) -> Readings {
        let word = self.bus_and_bridge.load(Ordering::Relaxed);
        let motor = self.motor.load(Ordering::Relaxed) as u16;
        let periods = self.periods.load(Ordering::Relaxed);
        let temperatures = [word as u16, motor].map(TemperatureCode::from_bits);
        Readings { periods, bus: (word >> 16) as u16, temperatures }
    }
}
