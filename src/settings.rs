//! What a person sets, in SI units; validated once into the integers that the interrupt works with.

use crate::angle::{ElectricalAngle, PolePairs};
use crate::commutation::sinusoidal::PhaseOrder;
use crate::commutation::{self, Commutation, Modulation};
use crate::control;
use crate::drive::{RECORDS, open_loop};
use crate::hall::track;
use crate::pwm;
use core::fmt;

/// Settings of a drive. The default is the motor of Simpkins and Todorov (four pole pairs, 3.75 Ω, 0.36 mH) on a timer of
/// 170 MHz.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Settings {
    /// Resolution of the ADC, 8 to 16.
    pub adc_bits: u8,
    /// Clock of the PWM timer, 1 MHz to 1 GHz.
    pub timer_hz: f32,
    /// Switching frequency and rate of the control interrupt, 1 to 200 kHz. [`pwm::FrequencyNeeds`] chooses one.
    pub pwm_hz: f32,
    /// Dead time of a leg, 0 to a tenth of the PWM period.
    pub dead_time_s: f32,
    /// Time before and after the valley that sampling needs the lower transistors to conduct, 0 to 20 µs in all.
    pub sampling_window_s: f32,
    /// Pole pairs of the rotor, 1 to 64.
    pub pole_pairs: u8,
    /// Counts positive against the order of the phases A, B, C.
    pub reversed: bool,
    /// How the phases are driven.
    pub commutation: Commutation,
    /// ρ: how far ahead of the quarter turn the field is set in the direction of the command, −60° to 60°.
    pub phase_advance_deg: f32,
    /// Largest magnitude of a command, 0 to 1.
    pub max_modulation: f32,
    /// Natural frequency of the tracker, 5 to 5000 Hz; it is rounded to the next octave.
    pub tracking_bandwidth_hz: f32,
    /// From a sample to the middle of the PWM period that acts on it, in PWM periods, 0 to 16: 1.5 with preloaded
    /// compare registers.
    pub delay_periods: f32,
    /// Faster is a fault; 1 Hz to a twentieth of the PWM frequency.
    pub max_electrical_hz: f32,
    /// Successive samples without a plausible angle that are extrapolated over, 0 to 100; one more is a fault.
    pub tolerated_samples: u8,
    /// Whether a running drive that loses a Hall runs on from the other two, with a limit reported, until it is stopped;
    /// otherwise the loss is a fault.
    pub run_on_two_halls: bool,
    /// Modulation of the calibration's field, 0.01 to 0.5. A tenth of 24 V drives 0.3 A through the default motor.
    pub calibration_modulation: f32,
    /// Time to raise the field, and again to let the rotor settle, 0.05 to 10 s.
    pub calibration_align_s: f32,
    /// Speed of the turning field, 0.5 to 50 Hz electrical. Where the calibration finds that the rotor swings about the field,
    /// another one helps: slower with one pole pair, faster with more than twenty.
    pub calibration_hz: f32,
    /// Least electrical turns to record in each direction, 2 to 64; rounded up to whole mechanical turns.
    pub calibration_turns: u8,
    /// Rate of the records to the tasks while running, 1 Hz to half the PWM frequency. With `control`, they come every 16 steps or
    /// the nearest multiple: 1250 Hz for 1 kHz at 40 kHz.
    pub record_hz: f32,
    /// The same while calibrating, 1 Hz to the PWM frequency.
    pub calibration_record_hz: f32,
    /// Sensing of currents and bus, the motor and the loops; `None`: only a voltage can be commanded, and nothing but the
    /// Halls is watched.
    pub control: Option<control::settings::Settings>,
}

impl Default for Settings {
    fn default() -> Self {
        Self {
            adc_bits: 12,
            timer_hz: 170e6,
            pwm_hz: 40e3,
            dead_time_s: 500e-9,
            sampling_window_s: 1e-6,
            pole_pairs: 4,
            reversed: false,
            commutation: Commutation::Sinusoidal,
            phase_advance_deg: 0.0,
            max_modulation: 1.0,
            tracking_bandwidth_hz: 280.0,
            delay_periods: 1.5,
            max_electrical_hz: 2000.0,
            tolerated_samples: 8,
            run_on_two_halls: false,
            calibration_modulation: 0.15,
            calibration_align_s: 0.3,
            calibration_hz: 10.0,
            calibration_turns: 12,
            record_hz: 1e3,
            calibration_record_hz: 40e3,
            control: None,
        }
    }
}

/// A setting that cannot be.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Error {
    /// Name, value and allowed range.
    OutOfRange {
        /// Name of the field.
        field: &'static str,
        /// What it is.
        value: f32,
        /// Least allowed.
        min: f32,
        /// Most allowed.
        max: f32,
    },
    /// The PWM settings contradict each other.
    Pwm(pwm::Error),
    /// Field-oriented commutation needs `control`.
    NoControl,
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::OutOfRange { field, value, min, max } => {
                write!(f, "{field} is {value}, but must be from {min} to {max}")
            }
            Self::Pwm(error) => error.fmt(f),
            Self::NoControl => write!(f, "field-oriented commutation needs the settings of the current control"),
        }
    }
}

impl core::error::Error for Error {}

impl From<pwm::Error> for Error {
    fn from(error: pwm::Error) -> Self {
        Self::Pwm(error)
    }
}

/// [`Settings`] in the units of the interrupt: counts, turns and samples. In the order of haste, as [`Drive`](crate::drive::Drive).
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[repr(C)]
pub struct Config {
    pub(crate) tracking: track::Config,
    pub(crate) fastest: i32,
    pub(crate) record_every: u32,
    /// Auto-reload value of the timer.
    pub period: u16,
    /// Dead time in timer counts.
    pub dead_time: u16,
    /// Resolution of the ADC.
    pub adc_bits: u8,
    /// Pole pairs of the rotor.
    pub pole_pairs: PolePairs,
    /// Whether positive is against the phases.
    pub reversed: bool,
    pub(crate) commutation: Commutation,
    pub(crate) limits: pwm::Limits,
    pub(crate) max_modulation: Modulation,
    pub(crate) advance: ElectricalAngle,
    pub(crate) tolerated: u16,
    pub(crate) run_on_two_halls: bool,
    pub(crate) calibration_record_every: u32,
    pub(crate) open_loop: open_loop::Config,
    /// Currents, torque, speed and position.
    pub control: Option<control::settings::Config>,
}

impl Config {
    /// Steps from record to record while not calibrating.
    pub const fn record_every(&self) -> u32 {
        self.record_every
    }

    pub(crate) const fn order(&self) -> PhaseOrder {
        if self.reversed { PhaseOrder::REVERSED } else { PhaseOrder::FORWARD }
    }

    /// Records that both sweeps of a calibration deliver.
    pub(crate) const fn calibration_records(&self) -> u32 {
        let steps = ((2 * self.open_loop.turns as u64) << 32) / self.open_loop.speed as u64;
        (steps / self.calibration_record_every as u64) as u32
    }
}

/// Checks many fields and keeps the first error: much shorter in the flash than to return at each.
#[derive(Default)]
pub(crate) struct Check(Option<Error>);

impl Check {
    /// `value` if it is from `min` to `max`, otherwise `min` and an error to [tell](Self::done).
    #[inline(never)]
    pub fn within(&mut self, field: &'static str, value: f32, min: f32, max: f32) -> f32 {
        // Not a number is in no range.
        if (min..=max).contains(&value) {
            return value;
        }
        self.0.get_or_insert(Error::OutOfRange { field, value, min, max });
        min
    }

    /// The first error.
    pub const fn done(&self) -> Result<(), Error> {
        match self.0 {
            Some(error) => Err(error),
            None => Ok(()),
        }
    }
}

impl Settings {
    /// Checks every field.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first field that is out of its range, [`Error::Pwm`] what does not fit together.
    pub fn validate(&self) -> Result<Config, Error> {
        let Self { timer_hz, pwm_hz, .. } = *self;
        let check = &mut Check::default();
        check.within("adc_bits", self.adc_bits.into(), 8.0, 16.0);
        check.within("timer_hz", timer_hz, 1e6, 1e9);
        check.within("pwm_hz", pwm_hz, 1e3, 200e3);
        check.within("sampling_window_s", self.sampling_window_s, 0.0, 20e-6);
        check.within("pole_pairs", self.pole_pairs.into(), 1.0, PolePairs::MAX.into());
        check.within("max_electrical_hz", self.max_electrical_hz, 1.0, pwm_hz / 20.0);
        // The rest is computed from these.
        check.done()?;
        let period = pwm::period_counts(timer_hz, pwm_hz)?;
        let dead_time = pwm::dead_time_counts(timer_hz, pwm_hz, self.dead_time_s)?;
        let highest = pwm::highest_compare(period, timer_hz, self.sampling_window_s, self.dead_time_s);
        let limits = pwm::Limits::new(period, 0, highest)?;
        let frame = control::settings::Frame {
            adc_bits: self.adc_bits,
            pole_pairs: self.pole_pairs,
            pwm_hz,
            period,
            dead_time,
            limits,
            max_electrical_hz: self.max_electrical_hz,
            reversed: self.reversed,
        };
        let control = self.control.map(|control| control.validate(&frame, check)).transpose()?;
        if control.is_none() && self.commutation == Commutation::FieldOriented {
            return Err(Error::NoControl);
        }
        let config = Config {
            control,
            period,
            dead_time,
            adc_bits: self.adc_bits,
            pole_pairs: PolePairs::new(self.pole_pairs).unwrap_or(PolePairs::ONE),
            reversed: self.reversed,
            commutation: self.commutation,
            limits,
            max_modulation: commutation::modulation(check.within("max_modulation", self.max_modulation, 0.0, 1.0)),
            advance: ElectricalAngle::from_degrees(check.within(
                "phase_advance_deg",
                self.phase_advance_deg,
                -60.0,
                60.0,
            )),
            tracking: self.tracking(check)?,
            fastest: (self.max_electrical_hz / pwm_hz * 4_294_967_296.0) as i32,
            tolerated: check.within("tolerated_samples", self.tolerated_samples.into(), 0.0, 100.0) as u16,
            run_on_two_halls: self.run_on_two_halls,
            record_every: self.record_every(check),
            calibration_record_every: self.every(check, "calibration_record_hz", self.calibration_record_hz, pwm_hz),
            open_loop: self.open_loop(check),
        };
        check.done().map(|()| config)
    }

    fn every(&self, check: &mut Check, field: &'static str, hz: f32, highest: f32) -> u32 {
        libm::roundf(self.pwm_hz / check.within(field, hz, 1.0, highest)) as u32
    }

    /// With current control, records have their slots in the drive's schedule.
    fn record_every(&self, check: &mut Check) -> u32 {
        let every = self.every(check, "record_hz", self.record_hz, self.pwm_hz / 2.0);
        let slotted = |every: u32| ((every + RECORDS / 2 - 1) / RECORDS).max(1) * RECORDS;
        if self.control.is_some() { slotted(every) } else { every }
    }

    fn tracking(&self, check: &mut Check) -> Result<track::Config, Error> {
        let bandwidth = check.within("tracking_bandwidth_hz", self.tracking_bandwidth_hz, 5.0, 5000.0);
        let delay = check.within("delay_periods", self.delay_periods, 0.0, 16.0);
        // Noise and an estimate off by some degrees on top of the fastest turning.
        let jump =
            ElectricalAngle::from_turns(self.max_electrical_hz / self.pwm_hz) + ElectricalAngle::from_degrees(20.0);
        let smoothing = track::Config::smoothing_for(bandwidth, self.pwm_hz);
        let out_of_range = Error::OutOfRange { field: "delay_periods", value: delay, min: 0.0, max: 16.0 };
        track::Config::new(smoothing, jump, delay).ok_or(out_of_range)
    }

    fn open_loop(&self, check: &mut Check) -> open_loop::Config {
        let modulation = check.within("calibration_modulation", self.calibration_modulation, 0.01, 0.5);
        let align_s = check.within("calibration_align_s", self.calibration_align_s, 0.05, 10.0);
        let hz = check.within("calibration_hz", self.calibration_hz, 0.5, 50.0);
        let turns = check.within("calibration_turns", self.calibration_turns.into(), 2.0, 64.0);
        let mechanical = libm::ceilf(turns / f32::from(self.pole_pairs));
        open_loop::Config {
            modulation: commutation::modulation(modulation),
            rise: ((modulation * 2_147_483_648.0 / (align_s * self.pwm_hz)) as i32).max(1),
            stand: (align_s * self.pwm_hz) as u32,
            speed: (hz / self.pwm_hz * 4_294_967_296.0) as i32,
            turns: mechanical as u32 * u32::from(self.pole_pairs),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    type Change = fn(&mut Settings);

    #[test]
    fn the_default_is_valid() {
        let config = Settings::default().validate().unwrap();
        assert_eq!((config.period, config.dead_time), (2125, 85));
        assert_eq!(config.record_every, 40);
        assert_eq!(config.open_loop.turns, 12);
    }

    #[test]
    fn every_field_out_of_range_is_named() {
        let cases: [(&str, Change); 30] = [
            ("adc_bits", |s| s.adc_bits = 7),
            ("adc_bits", |s| s.adc_bits = 17),
            ("timer_hz", |s| s.timer_hz = f32::NAN),
            ("timer_hz", |s| s.timer_hz = 1e10),
            ("pwm_hz", |s| s.pwm_hz = 999.0),
            ("pwm_hz", |s| s.pwm_hz = f32::INFINITY),
            ("sampling_window_s", |s| s.sampling_window_s = -1e-6),
            ("pole_pairs", |s| s.pole_pairs = 0),
            ("pole_pairs", |s| s.pole_pairs = 65),
            ("phase_advance_deg", |s| s.phase_advance_deg = 61.0),
            ("phase_advance_deg", |s| s.phase_advance_deg = f32::NAN),
            ("max_modulation", |s| s.max_modulation = 1.01),
            ("max_modulation", |s| s.max_modulation = -0.1),
            ("tracking_bandwidth_hz", |s| s.tracking_bandwidth_hz = 0.0),
            ("tracking_bandwidth_hz", |s| s.tracking_bandwidth_hz = f32::NAN),
            ("delay_periods", |s| s.delay_periods = 17.0),
            ("delay_periods", |s| s.delay_periods = f32::NAN),
            ("max_electrical_hz", |s| s.max_electrical_hz = 2001.0),
            ("max_electrical_hz", |s| s.max_electrical_hz = 0.0),
            ("tolerated_samples", |s| s.tolerated_samples = 101),
            ("calibration_modulation", |s| s.calibration_modulation = 0.6),
            ("calibration_align_s", |s| s.calibration_align_s = 0.0),
            ("calibration_align_s", |s| s.calibration_align_s = 11.0),
            ("calibration_hz", |s| s.calibration_hz = 51.0),
            ("calibration_hz", |s| s.calibration_hz = f32::NAN),
            ("calibration_turns", |s| s.calibration_turns = 1),
            ("calibration_turns", |s| s.calibration_turns = 65),
            ("record_hz", |s| s.record_hz = 0.0),
            ("record_hz", |s| s.record_hz = 20_001.0),
            ("calibration_record_hz", |s| s.calibration_record_hz = f32::NAN),
        ];
        for (name, change) in cases {
            let mut settings = Settings::default();
            change(&mut settings);
            match settings.validate() {
                Err(Error::OutOfRange { field, .. }) => assert_eq!(field, name),
                other => panic!("{name}: {other:?}"),
            }
        }
    }

    #[test]
    fn contradictions_are_told() {
        let cases: [Change; 4] = [
            |s| (s.timer_hz, s.pwm_hz) = (1e6, 200e3),
            |s| s.dead_time_s = 3e-6,
            |s| s.dead_time_s = f32::NAN,
            |s| s.sampling_window_s = 20e-6,
        ];
        for change in cases {
            let mut settings = Settings::default();
            change(&mut settings);
            assert!(matches!(settings.validate(), Err(Error::Pwm(_))), "{settings:?}");
        }
    }

    #[test]
    fn all_pole_pairs_record_whole_mechanical_turns() {
        for pole_pairs in 1..=64 {
            let config = Settings { pole_pairs, ..Settings::default() }.validate().unwrap();
            assert!(config.open_loop.turns >= 12 && config.open_loop.turns.is_multiple_of(pole_pairs.into()));
        }
    }
}
