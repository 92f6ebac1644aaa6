//! From the protocol's types back to the library's, for tools, which say everything in the library's words.

use hallservo::angle::ElectricalAngle;
use hallservo::control::Motor as Told;
use hallservo::control::identify::{self, Estimate};
use hallservo::hall::Channel;
use hallservo::hall::adapt::{self, Parameter};
use hallservo::hall::calibrate::report::{self, Finding, Pattern};
use hallservo::hall::calibrate::{self, Sweep};
use hallservo::hall::estimate::BadModel;
use hallservo_protocol::{CalibrationError, Motor, Report};

/// A calibration's report.
pub fn report(wire: &Report) -> report::Report {
    let sensors = wire.sensors.map(|sensor| report::SensorReport {
        swing: sensor.swing,
        offset: sensor.offset,
        placement_error: ElectricalAngle::from_degrees(sensor.placement_error_deg),
        third_pct: sensor.third_pct,
        fifth_pct: sensor.fifth_pct,
        noise_pct: sensor.noise_pct,
        at_rail: sensor.at_rail,
    });
    report::Report {
        sensors,
        pattern: Pattern { spacing: wire.spacing, forward: wire.forward },
        residual_pct: wire.residual_pct,
        lag: ElectricalAngle::from_degrees(wire.lag_deg),
        hunting_deg: wire.hunting_deg,
        angle_noise_deg: wire.angle_noise_deg,
    }
}

/// The motor as measured.
pub fn motor(wire: &Motor) -> identify::Report {
    let of = |[value, error]: [f32; 2]| Estimate { value: value.into(), error: error.into() };
    let [resistance_ohm, inductance_h, flux_linkage_wb, inertia_kgm2] = wire.told;
    identify::Report {
        resistance_ohm: of(wire.resistance_ohm),
        inductance_h: of(wire.inductance_h),
        flux_linkage_wb: of(wire.flux_linkage_wb),
        inertia_kgm2: of(wire.inertia_kgm2),
        coulomb_nm: of(wire.coulomb_nm),
        viscous_nms: of(wire.viscous_nms),
        load_nm: of(wire.load_nm),
        leftover_v: of(wire.leftover_v),
        told: Told { resistance_ohm, inductance_h, flux_linkage_wb, inertia_kgm2 },
        pole_pairs: wire.pole_pairs,
        samples: wire.samples,
    }
}

/// Why a calibration came to nothing; `None` where a command or a fault ended it.
pub fn calibration_error(error: CalibrationError) -> Option<calibrate::Error> {
    use CalibrationError as Wire;
    use calibrate::Error;
    let finding = Error::Refused;
    Some(match error {
        Wire::Ended => return None,
        Wire::Incomplete { forward: true } => Error::Incomplete(Sweep::Forward),
        Wire::Incomplete { forward: false } => Error::Incomplete(Sweep::Backward),
        Wire::NoSignal(channel) => Error::NoSignal(Channel(channel)),
        Wire::NoFit => Error::NoFit,
        Wire::AdcBits(bits) => Error::Model(BadModel::AdcBits(bits)),
        Wire::Sensor(channel) => Error::Model(BadModel::Sensor(Channel(channel))),
        Wire::Placement(noise_gain) => Error::Model(BadModel::Placement { noise_gain }),
        Wire::Busy => Error::Busy,
        Wire::TooFar(channel, swing) => finding(Finding::TooFar(Channel(channel), swing)),
        Wire::TooClose(channel) => finding(Finding::TooClose(Channel(channel))),
        Wire::Unequal(ratio) => finding(Finding::Unequal(ratio)),
        Wire::Misplaced(channel, degrees) => finding(Finding::Misplaced(Channel(channel), degrees)),
        Wire::Noisy(channel, percent) => finding(Finding::Noisy(Channel(channel), percent)),
        Wire::Unexplained(percent) => finding(Finding::Unexplained(percent)),
        Wire::Lagging(degrees) => finding(Finding::Lagging(degrees)),
        Wire::Hunting(degrees) => finding(Finding::Hunting(degrees)),
    })
}

/// Why a sensor is not learnt any more, from the numbers of a [`Cause::Sensor`](hallservo_protocol::Cause::Sensor).
pub fn sensor(channel: u8, why: u8) -> adapt::Fault {
    let hall = Channel(channel);
    match why {
        0 => adapt::Fault::AtRail(hall),
        1 => adapt::Fault::Lost(hall),
        2 => adapt::Fault::Drifted(hall, Parameter::Offset),
        3 => adapt::Fault::Drifted(hall, Parameter::Amplitude),
        4 => adapt::Fault::Drifted(hall, Parameter::Placement),
        5 => adapt::Fault::Distorted,
        _ => adapt::Fault::Contradiction,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire;
    use hallservo_protocol::{Cause, SensorReport};

    #[test]
    fn reports_come_back_in_every_field() {
        let sensor = |k: u8| SensorReport {
            swing: 400.0 + f32::from(k),
            offset: 2000.0 + f32::from(k),
            placement_error_deg: 11.25 * f32::from(k),
            third_pct: 5.0 + f32::from(k),
            fifth_pct: 1.0 + f32::from(k),
            noise_pct: 0.5 + f32::from(k),
            at_rail: u32::from(k),
        };
        let sent = Report {
            sensors: [0, 1, 2].map(sensor),
            spacing: 60,
            forward: true,
            residual_pct: 0.25,
            lag_deg: -22.5,
            hunting_deg: 0.75,
            angle_noise_deg: 0.375,
        };
        assert_eq!(wire::report(&report(&sent)), sent);
        let sent = Motor {
            resistance_ohm: [1.0, 0.1],
            inductance_h: [2.0, 0.2],
            flux_linkage_wb: [3.0, 0.3],
            inertia_kgm2: [4.0, 0.4],
            coulomb_nm: [5.0, 0.5],
            viscous_nms: [6.0, 0.6],
            load_nm: [7.0, 0.7],
            leftover_v: [8.0, 0.8],
            told: [9.0, 10.0, 11.0, 12.0],
            pole_pairs: 13,
            samples: 14,
        };
        assert_eq!(wire::motor(&motor(&sent)), sent);
    }

    #[test]
    fn every_reason_of_a_failed_calibration_comes_back() {
        use calibrate::Error;
        let hall = Channel(2);
        let findings = [
            Finding::TooFar(hall, 12.0),
            Finding::TooClose(hall),
            Finding::Unequal(2.5),
            Finding::Misplaced(hall, 24.0),
            Finding::Noisy(hall, 3.0),
            Finding::Unexplained(7.0),
            Finding::Lagging(70.0),
            Finding::Hunting(9.0),
        ];
        let models = [BadModel::AdcBits(17), BadModel::Sensor(hall), BadModel::Placement { noise_gain: 1.7 }];
        let others = [
            Error::Incomplete(Sweep::Forward),
            Error::Incomplete(Sweep::Backward),
            Error::NoSignal(hall),
            Error::NoFit,
            Error::Busy,
        ];
        let all = findings.map(Error::Refused).into_iter().chain(models.map(Error::Model)).chain(others);
        for error in all {
            assert_eq!(calibration_error(wire::calibration_error(error)), Some(error));
        }
        assert_eq!(calibration_error(CalibrationError::Ended), None);
    }

    #[test]
    fn every_reason_not_to_learn_a_sensor_comes_back() {
        use adapt::Fault;
        let of_one = [
            Fault::AtRail,
            Fault::Lost,
            |hall| Fault::Drifted(hall, Parameter::Offset),
            |hall| Fault::Drifted(hall, Parameter::Amplitude),
            |hall| Fault::Drifted(hall, Parameter::Placement),
        ];
        let of_all = [Fault::Distorted, Fault::Contradiction];
        for fault in of_one.map(|fault: fn(Channel) -> Fault| fault(Channel(1))).into_iter().chain(of_all) {
            let Cause::Sensor { channel, why } = wire::sensor(fault) else { panic!("{fault:?}") };
            assert_eq!(sensor(channel, why), fault);
        }
    }
}
