//! The bridge averaged over a switching period, dead time included.

use crate::inverter::{InverterParameters, Leg, Legs, clipped};
use crate::windings::Terminal;

/// The averaged bridge during one period.
#[derive(Clone, Copy, Debug)]
pub(crate) struct AveragedLegs {
    duty: [Option<f64>; 3],
    /// How far the current lies below (above) its mean at each leg's rising (falling) edge.
    ripple_a: [f64; 3],
}

/// The dead-time effect of an averaged bridge.
#[derive(Clone, Copy, Debug)]
pub(crate) struct DeadTime {
    /// Share of the period that one dead time takes.
    share: f64,
    /// What a phase current falls by during the dead time, per volt of bus.
    fall_per_v: f64,
    /// Current ripple per volt of bus and share of a period.
    ripple_per_v: f64,
    diode_v: f64,
}

impl DeadTime {
    pub fn new(parameters: &InverterParameters, inductance_h: f64) -> Self {
        let period_s = 1.0 / parameters.pwm_hz;
        Self {
            share: parameters.dead_time_s / period_s,
            // Star of three: the one phase sees two thirds of its terminal's step.
            fall_per_v: parameters.dead_time_s * (2.0 / 3.0) / inductance_h,
            ripple_per_v: 0.5 * period_s / inductance_h,
            diode_v: parameters.diode_v,
        }
    }

    /// Share of the full loss that a current causes, -1 to 1.
    ///
    /// Each edge's switch-on comes a dead time late. At the rising edge a current into the motor
    /// keeps the terminal low meanwhile; at the falling edge a current out of it keeps it high.
    /// The current at an edge is the mean less or plus the ripple, and where it is so small that it
    /// dies within the dead time, the terminal floats midway for the rest. So the loss runs over
    /// in two ramps, not in a jump. Without ripple the two ramps would coincide and be steeper
    /// than a step of a period can follow; there they are twice as wide as the dead time makes them.
    fn loss(&self, current_a: f64, ripple_a: f64, bus_v: f64) -> f64 {
        let fall_a = self.fall_per_v * bus_v;
        let width_a = (2.0 * fall_a - ripple_a).clamp(0.5 * fall_a, fall_a);
        let half = |edge_a: f64| {
            if edge_a >= width_a {
                0.5
            } else if edge_a <= -width_a {
                -0.5
            } else {
                0.5 * edge_a / width_a
            }
        };
        half(current_a - ripple_a) + half(current_a + ripple_a)
    }
}

impl AveragedLegs {
    /// `currents_a` at the start of the period decide how far the dead time shifts the pulses, and
    /// with them the ripple.
    pub fn new(legs: &Legs, dead_time: &DeadTime, currents_a: &[f64; 3], bus_v: f64) -> Self {
        let duty = legs.legs.map(|leg| match leg {
            Leg::Pwm(duty) if legs.enabled => Some(clipped(duty)),
            _ => None,
        });
        let mut ripple_a = [0.0; 3];
        if dead_time.share != 0.0 {
            let mut real = duty;
            for (duty, &current) in real.iter_mut().zip(currents_a) {
                if let Some(duty) = duty {
                    *duty = clipped(*duty - dead_time.share * dead_time.loss(current, 0.0, bus_v));
                }
            }
            ripple_a = edge_ripple(&real).map(|ripple| ripple * dead_time.ripple_per_v * bus_v);
        }
        Self { duty, ripple_a }
    }

    /// Mean terminal voltages at these phase currents.
    pub fn terminals(&self, dead_time: &DeadTime, currents_a: &[f64; 3], bus_v: f64) -> [Terminal; 3] {
        let mut terminals = [Terminal::Open; 3];
        for phase in 0..3 {
            if let Some(duty) = self.duty[phase] {
                let mut volts = duty * bus_v;
                if dead_time.share != 0.0 && duty > 0.0 && duty < 1.0 {
                    let loss = dead_time.loss(currents_a[phase], self.ripple_a[phase], bus_v);
                    volts -= loss * dead_time.share * (bus_v + 2.0 * dead_time.diode_v);
                    // A pulse shorter than the dead time vanishes; it does not turn round.
                    volts = volts.clamp(-dead_time.diode_v, bus_v + dead_time.diode_v);
                }
                terminals[phase] = Terminal::Driven(volts);
            }
        }
        terminals
    }

    /// Current that the switching legs draw from the bus.
    pub fn bus_a(&self, currents_a: &[f64; 3]) -> f64 {
        let mut sum = 0.0;
        for (duty, current) in self.duty.iter().zip(currents_a) {
            sum += duty.unwrap_or(0.0) * current;
        }
        sum
    }
}

/// Half of the ripple between a leg's rising and falling edge, in units of V·T/(2L).
///
/// The phase voltage is even about the middle of the period, so the ripple is odd about it: what
/// the phase sees while its leg is high, less the mean, is the rise from edge to edge. Leg j is
/// high for min(d_j, d_k) of the time that leg k is.
fn edge_ripple(duty: &[Option<f64>; 3]) -> [f64; 3] {
    let mut ripple = [0.0; 3];
    let each = 1.0 / duty.iter().flatten().count() as f64;
    for (phase, value) in ripple.iter_mut().enumerate() {
        if let Some(own) = duty[phase] {
            let (mut overlap, mut sum) = (0.0, 0.0);
            for &other in duty.iter().flatten() {
                overlap += if other < own { other } else { own };
                sum += other;
            }
            *value = (own - overlap * each) - own * (own - sum * each);
        }
    }
    ripple
}
