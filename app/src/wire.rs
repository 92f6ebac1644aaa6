//! From the library's types to those of the protocol, [and back](back).

pub mod back;

use hallservo::control::identify;
use hallservo::control::settings::BadDemand;
use hallservo::drive;
use hallservo::hall::Channel;
use hallservo::hall::adapt::{self, Parameter};
use hallservo::hall::calibrate::report::{self, Finding};
use hallservo::hall::calibrate::{self, Sweep};
use hallservo::hall::estimate::BadModel;
use hallservo::service::procedure;
use hallservo::{commutation, mode};
use hallservo_protocol::{
    CalibrationError, Cause, Commutation, Mode, Motor, ProcedureError, Refusal, Report, SensorReport,
};

pub(crate) fn mode(mode: mode::Mode) -> Mode {
    match mode {
        mode::Mode::Unarmed => Mode::Unarmed,
        mode::Mode::Aligning => Mode::Aligning,
        mode::Mode::Calibrating => Mode::Calibrating,
        mode::Mode::Ready => Mode::Ready,
        mode::Mode::Running => Mode::Running,
        mode::Mode::Faulted(fault) => Mode::Faulted(fault.code()),
    }
}

pub(crate) fn commutation(commutation: commutation::Commutation) -> Commutation {
    match commutation {
        commutation::Commutation::Block => Commutation::Block,
        commutation::Commutation::Sinusoidal => Commutation::Sinusoidal,
        commutation::Commutation::FieldOriented => Commutation::FieldOriented,
    }
}

pub(crate) fn refusal(refusal: drive::Refusal) -> Refusal<'static> {
    match refusal {
        drive::Refusal::Mode(mode) => Refusal::Mode(self::mode(mode)),
        drive::Refusal::NotCalibrated => Refusal::NotCalibrated,
        drive::Refusal::NoAngle => Refusal::NoAngle,
        // What the drive would find too large is found so before.
        drive::Refusal::TooLarge => Refusal::Contradiction,
        drive::Refusal::HallLost => Refusal::HallLost,
        drive::Refusal::NoControl => Refusal::NoControl,
        drive::Refusal::Fault(fault) => Refusal::Fault(fault.code()),
    }
}

pub(crate) fn demand(bad: BadDemand) -> Refusal<'static> {
    Refusal::Beyond { value: bad.value as f32, most: bad.most as f32 }
}

pub(crate) fn report(report: &report::Report) -> Report {
    let sensor = |sensor: &report::SensorReport| SensorReport {
        swing: sensor.swing,
        offset: sensor.offset,
        placement_error_deg: sensor.placement_error.to_degrees(),
        third_pct: sensor.third_pct,
        fifth_pct: sensor.fifth_pct,
        noise_pct: sensor.noise_pct,
        at_rail: sensor.at_rail,
    };
    Report {
        sensors: report.sensors.each_ref().map(sensor),
        spacing: report.pattern.spacing,
        forward: report.pattern.forward,
        residual_pct: report.residual_pct,
        lag_deg: report.lag.to_degrees(),
        hunting_deg: report.hunting_deg,
        angle_noise_deg: report.angle_noise_deg,
    }
}

pub(crate) fn calibration_error(error: calibrate::Error) -> CalibrationError {
    use CalibrationError as Wire;
    match error {
        calibrate::Error::Incomplete(sweep) => Wire::Incomplete { forward: sweep == Sweep::Forward },
        calibrate::Error::NoSignal(Channel(channel)) => Wire::NoSignal(channel),
        calibrate::Error::NoFit => Wire::NoFit,
        calibrate::Error::Model(BadModel::AdcBits(bits)) => Wire::AdcBits(bits),
        calibrate::Error::Model(BadModel::Sensor(Channel(channel))) => Wire::Sensor(channel),
        calibrate::Error::Model(BadModel::Placement { noise_gain }) => Wire::Placement(noise_gain),
        calibrate::Error::Busy => Wire::Busy,
        calibrate::Error::Refused(finding) => match finding {
            Finding::TooFar(Channel(channel), swing) => Wire::TooFar(channel, swing),
            Finding::TooClose(Channel(channel)) => Wire::TooClose(channel),
            Finding::Unequal(ratio) => Wire::Unequal(ratio),
            Finding::Misplaced(Channel(channel), degrees) => Wire::Misplaced(channel, degrees),
            Finding::Noisy(Channel(channel), percent) => Wire::Noisy(channel, percent),
            Finding::Unexplained(percent) => Wire::Unexplained(percent),
            Finding::Lagging(degrees) => Wire::Lagging(degrees),
            Finding::Hunting(degrees) => Wire::Hunting(degrees),
        },
    }
}

/// Why a procedure cannot begin.
pub(crate) fn procedure(error: procedure::Error) -> Refusal<'static> {
    match error {
        procedure::Error::NoControl => Refusal::NoControl,
        procedure::Error::Demand(bad) => demand(bad),
        procedure::Error::Refused(refused) => refusal(refused),
        procedure::Error::Fault(fault) => Refusal::Fault(fault.code()),
        _ => Refusal::Contradiction,
    }
}

/// Why a procedure came to nothing.
pub(crate) fn procedure_error(error: procedure::Error) -> ProcedureError<'static> {
    match error {
        procedure::Error::Fault(fault) => ProcedureError::Fault(fault.code()),
        procedure::Error::Disarmed => ProcedureError::Disarmed,
        procedure::Error::Silent => ProcedureError::Silent,
        procedure::Error::Unreached => ProcedureError::Unreached,
        procedure::Error::Untold => ProcedureError::Untold,
        procedure::Error::NoTable => ProcedureError::NoTable,
        procedure::Error::Cancelled => ProcedureError::Cancelled,
        refused => ProcedureError::Refused(procedure(refused)),
    }
}

pub(crate) fn motor(report: &identify::Report) -> Motor {
    let of = |estimate: identify::Estimate| [estimate.value as f32, estimate.error as f32];
    let told = &report.told;
    Motor {
        resistance_ohm: of(report.resistance_ohm),
        inductance_h: of(report.inductance_h),
        flux_linkage_wb: of(report.flux_linkage_wb),
        inertia_kgm2: of(report.inertia_kgm2),
        coulomb_nm: of(report.coulomb_nm),
        viscous_nms: of(report.viscous_nms),
        load_nm: of(report.load_nm),
        leftover_v: of(report.leftover_v),
        told: [told.resistance_ohm, told.inductance_h, told.flux_linkage_wb, told.inertia_kgm2],
        pole_pairs: report.pole_pairs,
        samples: report.samples,
    }
}

/// Sensor and reason, as [`Cause::Sensor`] numbers them.
pub(crate) fn sensor(fault: adapt::Fault) -> Cause {
    let (channel, why) = match fault {
        adapt::Fault::AtRail(Channel(channel)) => (channel, 0),
        adapt::Fault::Lost(Channel(channel)) => (channel, 1),
        adapt::Fault::Drifted(Channel(channel), Parameter::Offset) => (channel, 2),
        adapt::Fault::Drifted(Channel(channel), Parameter::Amplitude) => (channel, 3),
        adapt::Fault::Drifted(Channel(channel), Parameter::Placement) => (channel, 4),
        adapt::Fault::Distorted => (3, 5),
        adapt::Fault::Contradiction => (3, 6),
    };
    Cause::Sensor { channel, why }
}
