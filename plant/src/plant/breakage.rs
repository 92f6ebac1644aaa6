//! Breaks a plant at run time, and mends it.

use super::Plant;
use crate::error::{Error, finite};
use crate::fault::{AmplifierFault, Transistor, Wires};

impl Plant {
    /// Opens a winding (0 to 2), as a broken wire does, or closes it again. What flowed in it ends in an arc at once;
    /// the other two keep the flux that they link together.
    pub fn set_phase_open(&mut self, winding: usize, open: bool) {
        if let Some(cut) = self.faults.cut.get_mut(winding) {
            *cut = open;
            if open {
                self.motor.windings.cut(&self.faults.cut);
            }
        }
    }

    /// Lets a transistor of a leg (0 to 2) conduct no more, or mends the leg. Until then every edge is simulated,
    /// whatever the inverter's model.
    pub fn set_dead_transistor(&mut self, leg: usize, dead: Option<Transistor>) {
        if let Some(entry) = self.faults.dead.get_mut(leg) {
            *entry = dead;
        }
    }

    /// Connects the bridge's legs with the windings; the currents measured are the legs'. Meant for a motor without
    /// currents, as in life.
    pub fn set_motor_wires(&mut self, wires: Wires) {
        self.faults.motor_wires = wires;
    }

    /// Connects the converter's inputs with the Hall sensors.
    pub fn set_hall_wires(&mut self, wires: Wires) {
        self.faults.hall_wires = wires;
    }

    /// Turns the magnets that the Halls see on the shaft, or the Halls' board about it, by electrical radians from where
    /// they were: a joint that fails. Nothing else turns with them.
    ///
    /// # Errors
    /// The angle is not finite.
    pub fn set_slip(&mut self, electrical_rad: f64) -> Result<(), Error> {
        finite(electrical_rad, "electrical_rad")?;
        self.motor.slip(electrical_rad);
        Ok(())
    }

    /// Breaks the current amplifier of a leg (0 to 2), or mends it.
    ///
    /// # Errors
    /// A number in the fault is not finite.
    pub fn set_amplifier_fault(&mut self, leg: usize, fault: Option<AmplifierFault>) -> Result<(), Error> {
        if let Some(AmplifierFault::Frozen(value) | AmplifierFault::Gain(value)) = fault {
            finite(value, "amplifier")?;
        }
        if let Some(entry) = self.faults.amplifiers.get_mut(leg) {
            *entry = fault;
        }
        Ok(())
    }

    /// Periods in which nothing triggers the converter and nobody computes: the bridge goes on with the compare values
    /// that it has.
    pub fn advance_untriggered(&mut self, periods: u32) {
        for _ in 0..periods {
            let standing = self.preloaded;
            self.advance(&standing);
        }
    }

    /// Whether the supply takes current back from now on.
    ///
    /// # Errors
    /// It cannot be refused where the bus has no capacitance or the supply no resistance.
    pub fn set_regenerative(&mut self, regenerative: bool) -> Result<(), Error> {
        self.bus.set_regenerative(regenerative)
    }
}
