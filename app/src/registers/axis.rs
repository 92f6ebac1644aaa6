//! The drive in the protocol's units.

use super::channel::Pending;
use super::goal::{Goal, fixed, turns};
use super::sequence::Sequence;
use crate::encoder::Encoder;
use crate::tasks::Tasks;
use core::f32::consts::TAU;
use embedded_storage::nor_flash::NorFlash;
use hallservo::crc::crc32;
use hallservo::fault::{Fault, Limits};
use hallservo::mode::Mode;
use hallservo_registers::axis::{self, Axis, BusHealth, Command, Identity, Refused, State};

/// The tasks, as a client sees them.
pub(super) struct Drive<'a, F, E> {
    pub tasks: &'a mut Tasks<F, E>,
    pub sequence: &'a mut Sequence,
    /// On the bus.
    #[cfg_attr(not(feature = "diagnostic"), expect(dead_code))]
    pub id: u8,
    pub bus: BusHealth,
    /// The change of the settings that is on its way.
    #[cfg_attr(not(feature = "diagnostic"), expect(dead_code))]
    pub pending: &'a mut Pending,
}

impl<F: NorFlash, E: Encoder> Axis for Drive<'_, F, E> {
    fn identity(&self) -> Identity {
        let crate::Identity { board, firmware, serial } = self.tasks.identity;
        let model = crc32(board.as_bytes());
        Identity { model, firmware: version(firmware), serial }
    }

    #[inline(never)]
    fn state(&self) -> State {
        let Self { tasks, sequence, .. } = self;
        let status = tasks.status();
        let known = status.calibrated;
        let or_nan = |value: f32| if known { value } else { f32::NAN };
        let position = or_nan(turns(tasks.position_fixed().wrapping_sub(sequence.zero)));
        let velocity = or_nan(status.speed_rad_s / TAU);
        let flow = tasks.flow();
        let (control, torques, trajectory_complete) = self.followed(position);
        let [temperature, motor_temperature] = status.temperatures_c;
        State {
            mode: self.mode(),
            fault: self.fault(),
            position,
            velocity,
            torque: flow.torque_nm,
            current: flow.current_a,
            power: flow.power_w,
            voltage: status.bus_v,
            temperature,
            motor_temperature,
            trajectory_complete,
            home: if sequence.is_homed { 2 } else { 0 },
            halls: [position, velocity],
            encoder: [f32::NAN; 2],
            control,
            torques,
            milliseconds: tasks.now_ms as u32,
            bus: self.bus,
        }
    }

    fn command(&mut self, command: &Command) -> Result<(), Refused> {
        match command {
            Command::Stop => {
                self.sequence.stop(self.tasks);
                Ok(())
            }
            command => self.sequence.wish(Goal::of(command)?, self.tasks),
        }
    }

    fn set_output(&mut self, position: f32, nearest: bool) -> Result<(), Refused> {
        let ahead = self.tasks.position_fixed().wrapping_sub(fixed(position).ok_or(Refused)?);
        const HALF: i64 = 1 << 31;
        self.sequence.zero = if nearest { ahead.wrapping_add(HALF) & !0xffff_ffff } else { ahead };
        self.sequence.is_homed = true;
        Ok(())
    }

    fn require_reindex(&mut self) -> Result<(), Refused> {
        (self.sequence.zero, self.sequence.is_homed) = (0, false);
        Ok(())
    }

    fn recapture(&mut self) -> Result<(), Refused> {
        self.sequence.recapture(self.tasks)
    }
}

impl<F: NorFlash, E: Encoder> Drive<'_, F, E> {
    fn mode(&self) -> axis::Mode {
        let Self { tasks, sequence, .. } = self;
        match tasks.mode() {
            _ if sequence.refused.is_some() => axis::Mode::Fault,
            _ if sequence.timed_out => axis::Mode::Timeout,
            Mode::Faulted(_) => axis::Mode::Fault,
            _ if sequence.prepares() => axis::Mode::Preparing,
            Mode::Unarmed | Mode::Ready => axis::Mode::Stopped,
            Mode::Aligning | Mode::Calibrating => axis::Mode::Preparing,
            Mode::Running if tasks.limits().contains(Limits::CHECKING) => axis::Mode::Preparing,
            // Another tool's motion is a position as well.
            Mode::Running => sequence.doing.map_or(axis::Mode::Position, |doing| doing.goal.mode()),
        }
    }

    fn fault(&self) -> u8 {
        match (self.sequence.refused, self.tasks.mode()) {
            (Some(code), _) => code,
            (None, Mode::Faulted(fault)) => fault_code(fault),
            (None, Mode::Running) => limit_code(self.tasks.limits()),
            (None, _) => 0,
        }
    }

    /// What is followed: position, velocity and torque; the torques of its parts; and whether it has arrived.
    fn followed(&self, position: f32) -> ([f32; 3], [f32; 4], bool) {
        let Self { tasks, sequence, .. } = self;
        const NOTHING: ([f32; 3], [f32; 4]) = ([f32::NAN; 3], [f32::NAN; 4]);
        let Some(with) = sequence.doing.as_ref().and_then(|doing| doing.goal.spring()) else {
            return (NOTHING.0, NOTHING.1, sequence.is_settled());
        };
        let Some(state) = tasks.reference() else { return (NOTHING.0, NOTHING.1, false) };
        let gains = tasks.service.config().default_impedance();
        let (kp, kd) = gains.map_or((f32::NAN, f32::NAN), |gains| (gains.kp_nm_rad, gains.kd_nms_rad));
        let control = [position + state.position_error_turns, state.speed_rad_s / TAU, state.torque_nm];
        let torques = [
            kp * with.kp_scale * TAU * state.position_error_turns,
            0.0,
            kd * with.kd_scale * state.speed_error_rad_s,
            with.torque,
        ];
        (control, torques, state.complete && sequence.is_settled())
    }
}

/// The number of a fault: theirs where it means the same, else its own, those from 32 on higher by 20.
pub(super) fn fault_code(fault: Fault) -> u8 {
    match fault {
        Fault::Calibration => 32,
        Fault::GateDriver => 33,
        Fault::OverVoltage => 34,
        Fault::Hall(_) | Fault::Encoder => 35,
        Fault::Deadline => 37,
        Fault::BridgeHot | Fault::MotorHot => 38,
        Fault::PositionBounds => 39,
        Fault::UnderVoltage => 40,
        Fault::FollowingError => 49,
        fault => match fault.code() {
            code @ ..32 => code,
            code => code.saturating_add(20),
        },
    }
}

/// The number of what limits the drive.
fn limit_code(limits: Limits) -> u8 {
    const CODES: [(Limits, u8); 4] =
        [(Limits::SUPPLY, 97), (Limits::DUTY, 98), (Limits::CURRENT, 99), (Limits::HEAT, 100)];
    CODES.iter().find(|(limit, _)| limits.contains(*limit)).map_or(0, |(_, code)| *code)
}

/// A version as three bytes: `1.3.4` is 0x010304.
fn version(text: &str) -> u32 {
    let numbers = text.split(|letter: char| !letter.is_ascii_digit()).take(3);
    numbers.fold(0, |version, number| version << 8 | number.parse::<u8>().map_or(0, u32::from))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn faults_keep_apart() {
        let theirs = |code| (32..=50).contains(&code) || (96..=103).contains(&code);
        for fault in Fault::all() {
            let code = fault_code(fault);
            assert!((1..=i8::MAX as u8).contains(&code), "{fault:?}");
            let same = Fault::all().filter(|other| fault_code(*other) == code).count();
            assert!(same == 1 || theirs(code), "{fault:?} {code}");
        }
        assert_eq!(version("0.1.0"), 0x0000_0100);
        assert_eq!(version("1.3.4-rc1"), 0x0001_0304);
    }
}
