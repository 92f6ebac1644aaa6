//! What register clients are told of the tasks' state.

use super::{SETTLED, Tasks};
use crate::encoder::Encoder;
use crate::measure;
use embedded_storage::nor_flash::NorFlash;
use hallservo::service::adaptation;
use hallservo_protocol::Activity;

/// What flows.
#[derive(Clone, Copy)]
pub struct Flow {
    /// Currents along d and q, A.
    pub current_a: [f32; 2],
    /// N·m.
    pub torque_nm: f32,
    /// Into the motor, W; not a number but under field-oriented control.
    pub power_w: f32,
}

impl<F: NorFlash, E: Encoder> Tasks<F, E> {
    /// Whether the bridge is off, nothing goes on, and no command is on its way.
    pub fn is_idle(&self) -> bool {
        !self.mode().drives() && self.activity() == Activity::None && self.ticks_since_command > SETTLED
    }

    /// Currents, torque and power; nothing flows while the bridge is off.
    pub fn flow(&self) -> Flow {
        let Some(control) = &self.service.config().control else {
            return Flow { current_a: [f32::NAN; 2], torque_nm: f32::NAN, power_w: f32::NAN };
        };
        let Some(measurement) = &self.measurement else {
            return Flow { current_a: [0.0; 2], torque_nm: 0.0, power_w: 0.0 };
        };
        let current_a = measurement.current_a(control);
        let voltage_v =
            self.settings.control.map_or([f32::NAN; 2], |control| measure::voltage_v(&control, measurement));
        let power_w = 1.5 * (current_a[0] * voltage_v[0] + current_a[1] * voltage_v[1]);
        Flow { current_a, torque_nm: adaptation::torque_nm(measurement, control), power_w }
    }

    /// Whether the windings may be shorted at this speed: the back-EMF drives no more than the largest current through
    /// their resistance alone. Then L·d|i|/dt ≤ e − R·|i| says that none grows beyond it, whatever the inductance is and
    /// whatever has flowed before.
    pub fn may_short(&self) -> bool {
        self.settings.control.as_ref().is_some_and(|control| {
            let speed_rad_s = f32::from(self.settings.pole_pairs) * self.speed_rad_s();
            control.flux_linkage_wb * speed_rad_s.abs() <= control.resistance_ohm * control.max_current_a
        })
    }

    /// The drive has cleared a fault: it gets what it refused meanwhile, before it is armed.
    pub fn on_cleared(&mut self) {
        self.install();
        self.relearn();
    }
}
