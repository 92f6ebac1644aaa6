//! The supply of the inverter.

use crate::error::{Error, finite, not_negative, positive, require};

/// The supply and its capacitor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct BusParameters {
    /// Open-circuit voltage of the supply, V.
    pub supply_v: f64,
    /// Resistance of the supply and its wires, Ω.
    pub source_ohm: f64,
    /// Capacitance of the bus, F; with 0 the bus follows the current of the last step at once.
    pub capacitance_f: f64,
    /// Whether the supply takes current back, as a battery does; otherwise braking pumps the bus
    /// up. Without capacitance it has to.
    pub regenerative: bool,
    /// What the board's electronics draw, A, which empties a bus that is pumped up; as long as the supply gives it,
    /// `supply_v` allows for it.
    pub electronics_a: f64,
}

impl BusParameters {
    /// Stiff.
    #[must_use]
    pub const fn ideal(supply_v: f64) -> Self {
        Self { supply_v, source_ohm: 0.0, capacitance_f: 0.0, regenerative: true, electronics_a: 0.0 }
    }

    pub(crate) fn check(&self) -> Result<(), Error> {
        supply(self.supply_v)?;
        not_negative(self.source_ohm, "bus.source_ohm")?;
        not_negative(self.capacitance_f, "bus.capacitance_f")?;
        not_negative(self.electronics_a, "bus.electronics_a")?;
        require(
            self.regenerative || (self.capacitance_f > 0.0 && self.source_ohm > 0.0),
            "bus.regenerative",
            "true where source_ohm or capacitance_f is zero",
        )
    }
}

fn supply(volts: f64) -> Result<(), Error> {
    finite(volts, "bus.supply_v")?;
    not_negative(volts, "bus.supply_v")
}

#[derive(Clone, Debug)]
pub(crate) struct Bus {
    parameters: BusParameters,
    /// Conductance of a resistor across the bus, S.
    brake_s: f64,
    pub volts: f64,
}

impl Bus {
    pub fn new(parameters: &BusParameters) -> Result<Self, Error> {
        parameters.check()?;
        Ok(Self { parameters: *parameters, brake_s: 0.0, volts: parameters.supply_v })
    }

    pub fn set_supply(&mut self, supply_v: f64) -> Result<(), Error> {
        supply(supply_v)?;
        self.parameters.supply_v = supply_v;
        let BusParameters { source_ohm, regenerative, .. } = self.parameters;
        // Turned down, a laboratory supply empties the capacitor, though it takes nothing back from a motor.
        if source_ohm == 0.0 || (!regenerative && self.volts > supply_v) {
            self.volts = supply_v;
        }
        Ok(())
    }

    pub fn set_regenerative(&mut self, regenerative: bool) -> Result<(), Error> {
        let parameters = BusParameters { regenerative, ..self.parameters };
        parameters.check()?;
        self.parameters = parameters;
        Ok(())
    }

    /// Connects a resistor across the bus, or none.
    pub fn set_brake(&mut self, brake_ohm: Option<f64>) -> Result<(), Error> {
        self.brake_s = match brake_ohm {
            None => 0.0,
            Some(ohm) => {
                positive(ohm, "brake_ohm")?;
                1.0 / ohm
            }
        };
        Ok(())
    }

    /// Lets the bridge draw a current for a span.
    pub fn draw(&mut self, current_a: f64, span_s: f64) {
        let BusParameters { supply_v, source_ohm, capacitance_f, regenerative, electronics_a } = self.parameters;
        if source_ohm == 0.0 {
            return;
        }
        let brake_s = self.brake_s;
        let settled_v = supply_v - source_ohm * current_a;
        if capacitance_f == 0.0 {
            self.volts = settled_v / (1.0 + source_ohm * brake_s);
            return;
        }
        if !regenerative && self.volts > supply_v {
            let drawn_a = current_a + electronics_a;
            self.volts = (self.volts - drawn_a * span_s / capacitance_f) / (1.0 + brake_s * span_s / capacitance_f);
            return;
        }
        // Implicit, so that a small capacitor cannot make it swing.
        let relative = span_s / (source_ohm * capacitance_f);
        self.volts = (self.volts + relative * settled_v) / (1.0 + relative * (1.0 + source_ohm * brake_s));
    }
}
