//! The settings in the units of the control interrupt: counts, turns and samples.

use crate::angle::{ElectricalAngle, PolePairs, Position, TURN};
use crate::commutation::sinusoidal::PhaseOrder;
use crate::commutation::{self, Commutation, Modulation};
use crate::control;
use crate::control::config::SPEED_NOISE_HZ;
use crate::hall::{Halls, track};
use crate::pwm;
use crate::schedule::{RECORDS, coarse};
use crate::settings::{Control, Error, Settings};
use core::mem::MaybeUninit;

/// [`Settings`] in the units of the interrupt. What the shortest steps need comes first, as in
/// [`Drive`](crate::drive::Drive).
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
    /// Where there is no current control, which knows it, too.
    reversed: bool,
    pub(crate) commutation: Commutation,
    pub(crate) limits: pwm::Limits,
    pub(crate) max_modulation: Modulation,
    pub(crate) advance: ElectricalAngle,
    pub(crate) tolerated: u16,
    pub(crate) run_on_two_halls: bool,
    pub(crate) halls: Halls,
    pub(crate) calibration_record_every: u32,
    pub(crate) open_loop: OpenLoop,
    /// Currents, torque, speed and position.
    pub control: Option<control::Config>,
}

/// The calibration's motion, open loop, in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct OpenLoop {
    /// Strength of the field.
    pub modulation: Modulation,
    /// What its share of the full field rises by in a step, in 2⁻³¹; positive.
    pub rise: i32,
    /// Steps to stand with the full field.
    pub stand: u32,
    /// Speed in 2⁻³² electrical turns a step; positive.
    pub speed: i32,
    /// Turns to record each way; at least one.
    pub turns: u32,
    /// Makes the strength follow a current, with current sensing.
    pub regulator: Option<Regulator>,
}

/// The regulator of the field's current, in the units of the interrupt.
///
/// The winding sees a voltage that changes slowly, so a rotor that swings about the field is damped by the currents
/// that it induces, which a current held constant would not do.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Regulator {
    /// Current of the full field, in 2⁻¹⁵ of the full scale; positive.
    pub current: i32,
    /// Change of the modulation, in 2⁻³¹ a step, per difference of the currents' squares; in 2⁻¹⁶.
    pub gain: i32,
    /// Largest change in a step, in 2⁻³¹.
    pub slew: i32,
    /// The same of a [measurement at standstill](crate::drive::standstill).
    pub slow: i32,
    /// What the dead time takes from a leg, in counts.
    pub dead_time: i32,
    /// Slope of its compensation over a phase's current: counts in 2⁻¹⁶ per 2⁻¹⁵ of the full scale.
    pub slope: i32,
}

impl Regulator {
    fn new(settings: &Settings, control: &Control, dead_time: u16) -> Self {
        let per_ampere = 32_768.0 / control.current_full_scale_a;
        let current_a = match control.calibration_current_a {
            0.0 => (control.max_current_a / 3.0).min(control.continuous_current_a),
            chosen => chosen,
        };
        let current = (current_a * per_ampere).max(1.0);
        // A modulation of one is half the bus, in 2⁻³¹, and a step's share of a second.
        let per_volt_s = 2.0 * 2_147_483_648.0 / control.bus_full_scale_v / settings.pwm_hz;
        let volts_per_ampere_s = SETTLING_PER_S * control.resistance_ohm;
        // The difference of the squares is twice the current times the difference of the currents.
        let gain = volts_per_ampere_s * per_volt_s / per_ampere / (2.0 * current) * 65_536.0;
        // Where the current changes its sign, the dead time's effect changes over a range that the inductance makes
        // wide; corrected too steeply there, the current would run away from zero.
        let ramp = (current / 12.0).max(1.5 * control.dead_time_ramp_a * per_ampere).max(LEAST_RAMP);
        let dead_time = f32::from(dead_time) / 2.0;
        Self {
            current: current as i32,
            gain: (gain as i32).max(1),
            slew: (SLEW_V_S * per_volt_s) as i32,
            slow: (SLOW_V_S * per_volt_s) as i32,
            dead_time: dead_time as i32,
            slope: (dead_time / ramp * 65_536.0) as i32,
        }
    }
}

/// Least range of the dead time's compensation, in 2⁻¹⁵ of the full scale, for which no product overflows.
const LEAST_RAMP: f32 = 256.0;
/// Bandwidth of the regulator in rad/s, for the resistance of the settings; a motor whose resistance is less makes it
/// faster, which the largest slew keeps from mattering.
const SETTLING_PER_S: f32 = 60.0;
/// Largest slew of the voltage: 12 V in a third of a second. At 20 mΩ and 8 µH the current overshoots by 0.8 A.
const SLEW_V_S: f32 = 40.0;
/// The same while nothing is known of the motor.
const SLOW_V_S: f32 = 8.0;

impl Config {
    /// Memory for [`Settings::validate_into`].
    // Inlined, it is made in its place, and takes no stack.
    #[inline(always)]
    pub const fn blank() -> Self {
        Self {
            tracking: track::Config::BLANK,
            fastest: 0,
            record_every: 0,
            period: 0,
            dead_time: 0,
            adc_bits: 0,
            pole_pairs: PolePairs::ONE,
            reversed: false,
            commutation: Commutation::Block,
            limits: pwm::Limits::BLANK,
            max_modulation: Modulation::ZERO,
            advance: ElectricalAngle::ZERO,
            tolerated: 0,
            run_on_two_halls: false,
            halls: Halls::Three,
            calibration_record_every: 0,
            open_loop: OpenLoop {
                modulation: Modulation::ZERO,
                rise: 0,
                stand: 0,
                speed: 0,
                turns: 0,
                regulator: None,
            },
            control: None,
        }
    }

    /// The same in its place, in one copy for all.
    #[inline(never)]
    pub const fn blank_in(place: &mut MaybeUninit<Self>) -> &mut Self {
        place.write(Self::blank())
    }

    /// Moves the bounds of the position, where that is zero at an electrical position of its own.
    pub fn shift_bounds(&mut self, origin: Position) {
        if let Some(control) = &mut self.control {
            let way = coarse(origin).to_bits();
            control.motion.bounds = control.motion.bounds.map(|bound| bound.saturating_add(way));
        }
    }

    /// Takes over the gains of one whose settings differ in those that are [tunable](crate::settings::Entry::is_tunable).
    pub(crate) fn retune(&mut self, other: &Self) {
        self.tracking = other.tracking;
        if let (Some(control), Some(other)) = (&mut self.control, &other.control) {
            control.retune(other);
        }
    }

    /// Steps from record to record while not calibrating.
    pub const fn record_every(&self) -> u32 {
        self.record_every
    }

    /// The share of the noise of single samples that the tracked angle has at constant speed.
    pub fn tracked_noise(&self) -> f32 {
        self.tracking.noise_gain()
    }

    /// Whether positive is against the phases. There is one place that says so.
    #[cfg_attr(feature = "small", inline(never))]
    pub const fn is_reversed(&self) -> bool {
        match &self.control {
            Some(control) => control.modulator.is_reversed(),
            None => self.reversed,
        }
    }

    pub(crate) const fn order(&self) -> PhaseOrder {
        if self.is_reversed() { PhaseOrder::REVERSED } else { PhaseOrder::FORWARD }
    }

    /// Records that both sweeps of a calibration deliver.
    pub(crate) const fn calibration_records(&self) -> u32 {
        let steps = ((2 * self.open_loop.turns as u64) << 32) / self.open_loop.speed as u64;
        (steps / self.calibration_record_every as u64) as u32
    }
}

/// What the field of a calibration turns by in the time of a turn. In that of a whole one, each turn would have its records
/// at the same places of the bins, and their mean beside the bins' middles: 0.02° of the alignment.
const ALMOST_A_TURN: f32 = TURN * (1.0 - 1.0 / 48_001.0);

impl Settings {
    /// Checks all settings together and makes what the interrupt works with of them.
    ///
    /// # Errors
    /// [`Error::OutOfRange`] names the first setting that is out of its range, [`Error::Pwm`] what does not fit
    /// together.
    pub fn validate(&self) -> Result<Config, Error<'static>> {
        let mut config = Config::blank();
        self.validate_into(&mut config)?;
        Ok(config)
    }

    /// The same, written to its place, which spares a small stack a copy or two; half of it may be after an error.
    ///
    /// # Errors
    /// As [`Self::validate`].
    #[inline(never)]
    pub fn validate_into(&self, place: &mut Config) -> Result<(), Error<'static>> {
        if self.control.is_none() && self.commutation == Commutation::FieldOriented {
            return Err(Error::NoControl);
        }
        self.check()?;
        let Self { timer_hz, pwm_hz, .. } = *self;
        // Each to its place: a whole one would be made on the stack.
        let Config {
            tracking,
            fastest,
            record_every,
            period,
            dead_time,
            adc_bits,
            pole_pairs,
            reversed,
            commutation,
            limits,
            max_modulation,
            advance,
            tolerated,
            run_on_two_halls,
            halls,
            calibration_record_every,
            open_loop,
            control,
        } = place;
        *period = pwm::period_counts(timer_hz, pwm_hz)?;
        *dead_time = pwm::dead_time_counts(timer_hz, pwm_hz, self.dead_time_s)?;
        *limits = self.limits(*period)?;
        *adc_bits = self.adc_bits;
        *pole_pairs = PolePairs::new(self.pole_pairs).unwrap_or(PolePairs::ONE);
        *reversed = self.reversed;
        *commutation = self.commutation;
        *max_modulation = commutation::modulation(self.max_modulation);
        *advance = ElectricalAngle::from_degrees(self.phase_advance_deg);
        *tracking = self.tracking()?;
        *fastest = (self.fastest_hz() / pwm_hz * TURN) as i32;
        *tolerated = self.tolerated_samples.into();
        *run_on_two_halls = self.run_on_two_halls;
        *halls = if self.halls == 2 { Halls::Two } else { Halls::Three };
        *record_every = self.record_every();
        *calibration_record_every = self.every(self.calibration_record_hz);
        *open_loop = self.open_loop(*dead_time);
        *control = None;
        if let Some(settings) = &self.control {
            let frame = control::config::Frame {
                adc_bits: *adc_bits,
                pole_pairs: self.pole_pairs,
                pwm_hz,
                period: *period,
                dead_time: *dead_time,
                dead_time_s: self.dead_time_s,
                limits: *limits,
                max_electrical_hz: self.max_electrical_hz,
                tracking_hz: self.tracking_bandwidth_hz,
                reversed: *reversed,
            };
            control::Config::make(control, settings, &frame)?;
        }
        Ok(())
    }

    /// Whether they are valid together, in a stack frame of its own.
    ///
    /// # Errors
    /// As [`Self::validate`].
    #[inline(never)]
    pub fn verify(&self) -> Result<(), Error<'static>> {
        self.validate_into(Config::blank_in(&mut MaybeUninit::uninit()))
    }

    /// Electrical frequency that is a fault: a fifth above the largest speed, and what the speed's noise may add.
    fn fastest_hz(&self) -> f32 {
        let by_speed = self.control.as_ref().map_or(f32::INFINITY, |control| {
            1.2 * control.max_speed_rad_s * f32::from(self.pole_pairs) / core::f32::consts::TAU + SPEED_NOISE_HZ
        });
        self.max_electrical_hz.min(by_speed)
    }

    fn every(&self, hz: f32) -> u32 {
        (crate::float::nearest(self.pwm_hz / hz) as u32).max(1)
    }

    /// The range of compare values with so many counts in half a PWM period.
    ///
    /// # Errors
    /// No room for a voltage.
    #[inline]
    pub fn limits(&self, period: u16) -> Result<pwm::Limits, pwm::Error> {
        let highest = |window_s: f32| pwm::highest_compare(period, self.timer_hz, window_s, self.dead_time_s);
        let limits = pwm::Limits::new(period, 0, highest(self.sampling_window_s))?;
        #[cfg(not(feature = "small"))]
        if self.least_low_side_s > 0.0 {
            return Ok(limits.with_top(highest(self.least_low_side_s)));
        }
        Ok(limits)
    }

    /// With current control, records have their places in the drive's schedule.
    fn record_every(&self) -> u32 {
        let every = self.every(self.record_hz);
        let scheduled = |every: u32| ((every + RECORDS / 2 - 1) / RECORDS).max(1) * RECORDS;
        if self.control.is_some() { scheduled(every) } else { every }
    }

    fn tracking(&self) -> Result<track::Config, Error<'static>> {
        let Self { halls_held_s: held, pwm_hz, .. } = *self;
        let delay = 1.5 - held * pwm_hz;
        // Noise and an estimate off by some degrees on top of the fastest turning.
        let jump =
            ElectricalAngle::from_turns(self.max_electrical_hz / self.pwm_hz) + ElectricalAngle::from_degrees(20.0);
        let smoothing = track::Config::smoothing_for(self.tracking_bandwidth_hz, self.pwm_hz);
        let out_of_range = Error::OutOfRange { field: "halls_held_s", value: held, min: -20e-6, max: 20e-6 };
        track::Config::new(smoothing, jump, delay).ok_or(out_of_range)
    }

    fn open_loop(&self, dead_time: u16) -> OpenLoop {
        let Self { calibration_modulation: modulation, calibration_align_s: align_s, .. } = *self;
        let mechanical = crate::float::ceil(f32::from(self.calibration_turns) / f32::from(self.pole_pairs));
        let turns = mechanical as u32 * u32::from(self.pole_pairs);
        OpenLoop {
            modulation: commutation::modulation(modulation),
            rise: ((2_147_483_648.0 / (align_s * self.pwm_hz)) as i32).max(1),
            stand: (align_s * self.pwm_hz) as u32,
            speed: (self.calibration_hz / self.pwm_hz * ALMOST_A_TURN) as i32,
            turns,
            regulator: self.control.as_ref().map(|control| Regulator::new(self, control, dead_time)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::hall::track::Tracker;

    #[test]
    fn the_default_is_valid() {
        let config = Settings::default().validate().unwrap();
        assert_eq!((config.period, config.dead_time), (2125, 85));
        assert_eq!(config.record_every, 40);
        assert_eq!(config.open_loop.turns, 12);
    }

    /// An input that is held a tenth of a period after the valley, and the same before it: the period that acts on it is
    /// nearer, or farther.
    #[test]
    fn the_prediction_is_from_where_the_halls_are_held() {
        for (pwm_hz, held_s, periods) in
            [(40e3, 0.0, 1.5), (40e3, 2.5e-6, 1.4), (40e3, -2.5e-6, 1.6), (80e3, 2.5e-6, 1.3)]
        {
            let tracking =
                Settings { pwm_hz, halls_held_s: held_s, ..Settings::default() }.validate().unwrap().tracking;
            let mut rotor = Tracker::at(ElectricalAngle::ZERO);
            for step in 1..4000 {
                rotor.step(&tracking, ElectricalAngle::from_degrees((2 * step % 360) as f32)).unwrap();
            }
            let ahead = (rotor.predicted(&tracking) - rotor.angle()).to_degrees() / 2.0;
            assert!((ahead - periods).abs() < 0.01, "{ahead} of {periods} periods");
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
