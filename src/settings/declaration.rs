//! The declaration of every setting. A name that has been in a release is never given to another setting.

use super::Kind::{Choice, Real, Switch, Whole};
use super::entry::{BOARD, Entry, Field, TUNABLE, kind, unit};
#[cfg(not(feature = "small"))]
use super::guard::largest_rise_k;
use super::guard::{NOISE, OFFSET};
use super::{Ceiling, Feedback, OnStopFailure, OnTimeout};
use crate::commutation::Commutation;
use crate::control::config::SLOWEST_SPEED_HZ;

/// The structures, their defaults, the table and the descriptions. A row: `field: type = default, least => most, unit,
/// kind, whether it is the board's, description`, behind `[cfg(…)]` where not every drive has it; the range may depend
/// on all settings, `s`, and those of the current control, `c`. Behind `with` are fields that are no settings
/// themselves. `rows of` are the settings of what a structure has several of.
macro_rules! settings {
    (
        |$s:ident, $c:ident|
        $(
            $(#[$struct_meta:meta])*
            struct $struct:ident from $part:ident {
                $(
                    $(#[$meta:meta])*
                    $([$only:meta])?
                    $field:ident: $type:ty = $default:expr, $min:expr => $max:expr,
                        $unit:literal, $kind:expr, $fixed:expr, $about:literal;
                )*
            } with {
                $($(#[$other_meta:meta])* $other:ident: $other_type:ty = $other_default:expr;)*
            }
        )*
        $(
            rows of $row_part:ident {
                $(
                    $row_name:literal, $row_field:ident, $row_min:expr => $row_max:expr,
                        $row_unit:literal, $row_kind:expr, $row_fixed:expr, $row_about:literal;
                )*
            }
        )*
    ) => {
        $(
            $(#[$struct_meta])*
            #[derive(Clone, Copy, Debug, PartialEq)]
            #[cfg_attr(feature = "defmt", derive(defmt::Format))]
            pub struct $struct {
                $(
                    #[doc = concat!($about, "; `", stringify!($min), "` to `", stringify!($max), "` ", $unit)]
                    #[doc = ""]
                    $(#[$meta])*
                    $(#[$only])?
                    pub $field: $type,
                )*
                $($(#[$other_meta])* pub $other: $other_type,)*
            }

            impl $struct {
                /// The default, as a constant.
                pub const DEFAULT: Self = Self { $($(#[$only])? $field: $default,)* $($other: $other_default,)* };
            }

            impl Default for $struct {
                fn default() -> Self {
                    Self::DEFAULT
                }
            }

            mod $part {
                #[derive(Clone, Copy)]
                #[allow(non_camel_case_types)]
                pub enum Row { $($(#[$only])? $field,)* }
            }
        )*
        $(
            mod $row_part {
                #[derive(Clone, Copy)]
                #[allow(non_camel_case_types)]
                pub enum Row { $($row_field,)* }
            }
        )*

        /// Which setting: the part that has it, and its field.
        // Two functions of all settings take half the flash of two for each.
        #[derive(Clone, Copy)]
        #[allow(non_camel_case_types)]
        pub(super) enum Row {
            $($part($part::Row),)*
            $($row_part($row_part::Row),)*
        }

        impl Row {
            /// The field; `None` without current control. One function to read and to write, for the sake of the flash.
            #[inline(never)]
            pub fn field(self, settings: &mut Settings) -> Option<Field<'_>> {
                Some(match self {
                    $(Self::$part(row) => {
                        let part = $part(settings)?;
                        match row { $($(#[$only])? $part::Row::$field => Field::from(&mut part.$field),)* }
                    })*
                    $(Self::$row_part(row) => {
                        let part = $row_part(settings)?;
                        match row { $($row_part::Row::$row_field => Field::from(&mut part.$row_field),)* }
                    })*
                })
            }

            /// Least and most, as the other settings are; `None` without current control.
            #[inline(never)]
            pub fn range(self, $s: &Settings) -> Option<(f32, f32)> {
                Some(match self {
                    $(Self::$part(row) => {
                        let $c = beside::$part($s)?;
                        _ = $c;
                        match row { $($(#[$only])? $part::Row::$field => ($min, $max),)* }
                    })*
                    $(Self::$row_part(row) => {
                        let $c = beside::$row_part($s)?;
                        match row { $($row_part::Row::$row_field => ($row_min, $row_max),)* }
                    })*
                })
            }
        }

        /// Every setting. Those that a range depends on come first, so that the first one out of its range is to blame.
        pub static TABLE: &[Entry] = &[
            $($($(#[$only])? Entry {
                name: stringify!($field), row: Row::$part($part::Row::$field), unit: unit($unit), kind: kind($kind) | $fixed,
            },)*)*
            $($(Entry {
                name: $row_name, row: Row::$row_part($row_part::Row::$row_field), unit: unit($row_unit),
                kind: kind($row_kind) | $row_fixed,
            },)*)*
        ];

        /// Names and descriptions. A list of its own, for a chip has no use for it.
        pub static ABOUT: &[(&str, &str)] =
            &[$($($(#[$only])? (stringify!($field), $about),)*)* $($(($row_name, $row_about),)*)*];
    };
}

/// Marks a setting that is not the board's.
const FREE: u8 = 0;

const fn drive(settings: &mut Settings) -> Option<&mut Settings> {
    Some(settings)
}

const fn control(settings: &mut Settings) -> Option<&mut Control> {
    settings.control.as_mut()
}

/// The current control, where a setting's range may depend on it.
mod beside {
    use super::{Control, Settings};

    pub const fn drive(_: &Settings) -> Option<()> {
        Some(())
    }

    pub const fn control(settings: &Settings) -> Option<&Control> {
        settings.control.as_ref()
    }

    pub use control as guard;
    pub use control as bridge;
    pub use control as motor;
}

#[cfg(not(feature = "small"))]
fn weakens_field(control: Option<&Control>) -> bool {
    control.is_some_and(|control| control.field_weakening_a > 0.0)
}

fn guard(settings: &mut Settings) -> Option<&mut GuardSettings> {
    control(settings).map(|control| &mut control.guard)
}

fn bridge(settings: &mut Settings) -> Option<&mut Thermistor> {
    guard(settings).map(|guard| &mut guard.bridge)
}

fn motor(settings: &mut Settings) -> Option<&mut Thermistor> {
    guard(settings).map(|guard| &mut guard.motor)
}

settings! {
    |s, c|

    /// Settings of a drive and its tasks. The default is the motor of Simpkins and Todorov (four pole pairs, 3.75 Ω,
    /// 0.36 mH) on a timer of 170 MHz.
    struct Settings from drive {
        adc_bits: u8 = 12, 8.0 => 16.0, "bit", Whole, BOARD, "Resolution of the ADC";
        timer_hz: f32 = 170e6, 1e6 => 1e9, "Hz", Real, BOARD, "Clock of the PWM timer";
        /// [`FrequencyNeeds`](crate::pwm::FrequencyNeeds) chooses one.
        /// A board whose timer takes up the [period](crate::drive::Drive::period) of the drive names a ceiling up to which
        /// it may be set.
        pwm_hz: f32 = 40e3, 20e3 => 200e3, "Hz", Real, BOARD, "Switching frequency and rate of the control";
        dead_time_s: f32 = 500e-9, 0.0 => 0.1 / s.pwm_hz, "s", Real, BOARD, "Dead time of a leg";
        /// Before and after the valley, in all.
        sampling_window_s: f32 = 1e-6, 0.0 => 20e-6, "s", Real, BOARD,
            "Time for which sampling needs the lower transistors to conduct";
        /// With more than 0 a field-oriented drive makes longer voltage vectors: the current of the phase on top follows from
        /// the other two, and its lower transistor conducts in each valley for this long alone. It is what the driver takes
        /// to charge its bootstrap capacitor through R, at standstill for ever: the capacitor lacks the gate's charge times
        /// `pwm_hz` times R over the share of the period. Not with [`field_weakening_a`](Control::field_weakening_a), whose
        /// current rises where the voltage ends: an amplifier that fails there has to show in the sum of three.
        [cfg(not(feature = "small"))]
        least_low_side_s: f32 = 0.0, 0.0 => if weakens_field(s.control.as_ref()) { 0.0 } else { s.sampling_window_s },
            "s", Real, FREE,
            "Shortest on-time of the low side whose current is calculated; 0: three are sampled";
        /// A period and a half after the valley is the middle of the period that acts on it.
        halls_held_s: f32 = 0.0, -20e-6 => (1.5 / s.pwm_hz).min(20e-6), "s", Real, BOARD,
            "From the valley to where the ADC holds the Halls; negative: before";
        /// With current control, records come every 32 steps or the nearest multiple: 1250 Hz for 1 kHz at 40 kHz.
        record_hz: f32 = 1e3, 1.0 => s.pwm_hz / 2.0, "Hz", Real, BOARD, "Rate of the records to the tasks";
        calibration_record_hz: f32 = 40e3, 1.0 => 200e3, "Hz", Real, BOARD,
            "Rate of the records while calibrating, at most the control's";
        pole_pairs: u8 = 4, 1.0 => 64.0, "", Whole, FREE, "Pole pairs of the rotor";
        reversed: bool = false, 0.0 => 1.0, "", Switch, FREE, "Count positive against the order of the phases A, B, C";
        commutation: Commutation = Commutation::Sinusoidal, 0.0 => if s.control.is_some() { 2.0 } else { 1.0 },
            "", Choice("block|sinusoidal|field-oriented"), FREE, "Commutation";
        /// ρ, in the direction of the command.
        phase_advance_deg: f32 = 0.0, -60.0 => 60.0, "°", Real, FREE, "Phase advance beyond a quarter turn, electrical";
        max_modulation: f32 = 1.0, 0.0 => 1.0, "", Real, FREE, "Largest voltage command";
        tracking_bandwidth_hz: f32 = 280.0, 5.0 => 5000.0, "Hz", Real, TUNABLE,
            "Natural frequency of the tracker, rounded to the nearest of a series of octaves";
        max_electrical_hz: f32 = 2000.0, 1.0 => s.pwm_hz / 20.0, "Hz", Real, FREE, "A faster rotor is a fault";
        tolerated_samples: u8 = 8, 0.0 => 100.0, "", Whole, FREE,
            "Successive samples without an angle that are bridged; one more is a fault";
        /// Of two, the third input is not looked at; a change of it is followed by a calibration.
        halls: u8 = 3, 2.0 => 3.0, "", Whole, FREE, "Hall sensors: 3, or 2 that are 60°, 90° or 120° apart, electrical";
        /// With a limit reported; otherwise the loss is a fault.
        run_on_two_halls: bool = false, 0.0 => 1.0, "", Switch, FREE,
            "A running drive that loses a Hall runs on until it is stopped";
        /// A tenth of 24 V drives 0.3 A through the default motor.
        calibration_modulation: f32 = 0.15, 0.01 => 0.5, "", Real, FREE, "Voltage of the calibration's field, without current sensing";
        calibration_align_s: f32 = 0.3, 0.05 => 10.0, "s", Real, FREE,
            "Time to raise the field, and again to let the rotor settle";
        /// Where the calibration finds that the rotor swings about the field, another one helps: slower with one pole
        /// pair, faster with more than twenty.
        calibration_hz: f32 = 10.0, 0.5 => 50.0, "Hz", Real, FREE, "Speed of the calibration's field, electrical";
        /// Rounded up to whole mechanical turns.
        calibration_turns: u8 = 12, 2.0 => 64.0, "", Whole, FREE,
            "Least electrical turns to calibrate by in each direction";
        adaptation: bool = true, 0.0 => 1.0, "", Switch, FREE, "Adapt the sensors' model while the motor turns";
        anti_cogging: bool = true, 0.0 => 1.0, "", Switch, FREE, "Compensate the cogging, once it has been learnt";
        /// Every drive listens to 127, too.
        bus_id: u8 = 1, 1.0 => 126.0, "", Whole, FREE, "Where the drive is on a bus that carries registers";
        /// 13 bits.
        bus_prefix: f32 = 0.0, 0.0 => 8191.0, "", Whole, FREE, "Bits of a bus identifier above the lowest sixteen";
    } with {
        /// What the board's parts stand: no setting exceeds it.
        ceilings: &'static [Ceiling] = &[];
        /// Sensing of currents and bus, the motor and the loops; `None`: only a voltage can be commanded, and nothing
        /// but the Halls is monitored.
        control: Option<Control> = None;
    }

    /// Current and bus sensing, the motor, the loops and their limits. The default is the motor of Simpkins and Todorov
    /// on 24 V, with amplifiers of 0.2 V/A about the middle of 3.3 V, and a divider of eleven.
    struct Control from control {
        /// From its middle.
        current_full_scale_a: f32 = 8.25, 0.1 => 1000.0, "A", Real, BOARD, "Current at the end of the ADC's range";
        bus_full_scale_v: f32 = 36.3, 5.0 => 1000.0, "V", Real, BOARD, "Bus voltage at the end of the ADC's range";
        resistance_ohm: f32 = 3.75, 1e-4 => 1000.0, "Ω", Real, FREE, "Resistance of a phase, star";
        inductance_h: f32 = 0.36e-3, 1e-7 => 1.0, "H", Real, FREE,
            "Inductance of a phase, star; along the magnets' field";
        /// Above 1 where magnets lie inside the rotor's iron. Then a torque is made with a current along −d, too: of all
        /// pairs of currents the one with the least losses.
        saliency: f32 = 1.0, 0.25 => 8.0, "", Real, FREE,
            "Inductance across the magnets' field over the one along it";
        flux_linkage_wb: f32 = 5e-3, 1e-6 => 10.0, "Wb", Real, FREE,
            "Flux linkage of a phase: back-EMF per electrical rad/s";
        inertia_kgm2: f32 = 1e-5, 1e-9 => 100.0, "kg·m²", Real, FREE, "Inertia of all that turns";
        current_bandwidth_hz: f32 = 1000.0, 10.0 => s.pwm_hz / 20.0, "Hz", Real, TUNABLE,
            "Bandwidth of the current control";
        feedback: Feedback = Feedback::Pi, 0.0 => 3.0, "", Choice("p|pi|pd|pid"), FREE,
            "Current feedback with block and sinusoidal commutation";
        speed_bandwidth_hz: f32 = 60.0, SLOWEST_SPEED_HZ => c.current_bandwidth_hz / 4.0, "Hz", Real, TUNABLE,
            "Bandwidth of the speed control";
        position_bandwidth_hz: f32 = 15.0, 0.1 => c.speed_bandwidth_hz / 2.0, "Hz", Real, TUNABLE,
            "Bandwidth of the position control";
        dead_time_ramp_a: f32 = 0.05, 1e-3 => c.current_full_scale_a, "A", Real, FREE,
            "Current below which the dead time acts in part only";
        max_current_a: f32 = 3.0, 0.01 => 0.9 * c.current_full_scale_a, "A", Real, FREE, "Largest current";
        /// What the winding stands for ever; more than this flows until it is warm.
        continuous_current_a: f32 = 1.5, 0.01 => 0.9 * c.current_full_scale_a, "A", Real, FREE,
            "Continuous current of the motor";
        winding_time_s: f32 = 30.0, 0.1 => 1e4, "s", Real, FREE, "Thermal time constant of the winding";
        housing_time_s: f32 = 900.0, 1.0 => 1e5, "s", Real, FREE, "Thermal time constant of the motor's housing";
        /// At rest one half bridge carries all of it.
        bridge_continuous_a: f32 = 6.0, 0.1 => 1000.0, "A", Real, BOARD, "Continuous current of the bridge";
        max_supply_a: f32 = 30.0, 0.01 => 1000.0, "A", Real, FREE, "Largest current from the supply";
        /// A laboratory supply or one behind a diode: 0. A battery: what it may be charged with.
        max_regeneration_a: f32 = 0.0, 0.0 => 1000.0, "A", Real, FREE, "Largest current back into the supply";
        /// 0: a third of `max_current_a`, at most `continuous_current_a`. Takes the place of `calibration_modulation`.
        calibration_current_a: f32 = 0.0, 0.0 => c.max_current_a, "A", Real, FREE,
            "Current of the calibration's field; 0: derived from the largest";
        /// For speeds beyond what the supply's voltage gives, under field-oriented commutation. Up to eight tenths of the
        /// current that takes all of the magnets' flux off a winding. The voltage of a motor that is switched off at such a
        /// speed reaches the supply through the bridge's diodes: `max_speed_rad_s` is limited to where that is below
        /// [`over_voltage_v`](GuardSettings::over_voltage_v).
        field_weakening_a: f32 = 0.0, 0.0 => (0.875 * c.max_current_a).min(0.8 * c.flux_linkage_wb / c.inductance_h), "A", Real, FREE,
            "Largest current against the magnets' field, for higher speeds; 0: none";
        hold_current_a: f32 = 1000.0, 0.0 => 1000.0, "A", Real, FREE, "Largest current while a position is held";
        min_position_turns: f32 = -1e6, -1e6 => 1e6, "turns", Real, FREE, "Least position, mechanical";
        max_position_turns: f32 = 1e6, c.min_position_turns => 1e6, "turns", Real, FREE, "Largest position, mechanical";
        following_error_turns: f32 = 1.0, 1e-3 => 1e6, "turns", Real, FREE,
            "A rotor farther from its reference is a fault";
        following_error_rad_s: f32 = 100.0, 1.0 => 1e6, "rad/s", Real, FREE,
            "A speed farther from its reference for stall_s is a fault";
        /// A commanded torque ends a tenth beyond it, or where that is little, up to 5 Hz electrical beyond: nearer, the noise
        /// of the speed would be a current.
        max_speed_rad_s: f32 = 500.0, 0.1 => super::guard::largest_speed_rad_s(s, c), "rad/s", Real, FREE,
            "Largest speed of a command, mechanical";
        max_acceleration_rad_s2: f32 = 5000.0, 0.01 => 1e6, "rad/s²", Real, FREE,
            "Largest acceleration of a trajectory, mechanical";
        /// Bandwidth of the sensors, filters, and what the converter samples them earlier or later than the currents.
        hall_delay_us: f32 = 0.0, -20.0 => 200.0, "µs", Real, FREE, "Delay of the Halls' signals";
        /// The field of the windings beside the magnets'; electrical. At the largest current 30° at most.
        hall_coil_deg_a: f32 = 0.0, -30.0 / c.max_current_a.max(0.1) => 30.0 / c.max_current_a.max(0.1), "°/A", Real, FREE,
            "Angle by which a current along q turns what the Halls see";
    } with {
        /// Thresholds of the faults.
        guard: GuardSettings = GuardSettings::DEFAULT;
    }

    /// Thresholds of the faults.
    struct GuardSettings from guard {
        under_voltage_v: f32 = 12.0, c.bus_full_scale_v / 20.0 => 0.9 * c.bus_full_scale_v, "V", Real, FREE,
            "A lower bus voltage is a fault";
        over_voltage_v: f32 = 32.0, c.guard.under_voltage_v => 0.95 * c.bus_full_scale_v, "V", Real, FREE,
            "A higher bus voltage is a fault";
        /// Below where over-voltage limits the braking, and above `under_voltage_v` with its hysteresis. What the
        /// resistor takes at this voltage may be a part of `max_regeneration_a`.
        [cfg(not(feature = "no-chopper"))]
        chopper_v: f32 = 0.0, super::chopper::least(c) => super::chopper::most(c), "V", Real, FREE,
            "Bus voltage from which on the brake resistor is on; 0: there is none";
        [cfg(not(feature = "no-chopper"))]
        chopper_on_s: f32 = 0.5, 0.01 => 60.0, "s", Real, FREE, "Longest time that the brake resistor is on in one go";
        /// Of its rated power over its power at [`chopper_v`](Self::chopper_v).
        [cfg(not(feature = "no-chopper"))]
        chopper_share: f32 = 0.1, 0.01 => 1.0, "", Real, FREE, "Largest share of the time that the brake resistor may be on in the long run";
        /// Above `max_current_a` by noise and overshoot.
        over_current_a: f32 = 6.0, 1.088 * c.max_current_a => 0.99 * c.current_full_scale_a, "A", Real, FREE,
            "A larger phase current is a fault";
        /// At two checks, eight steps apart: an amplifier is wrong. [`GuardSettings::for_full_scale`] says what it
        /// follows from.
        imbalance_a: f32 = NOISE * 8.25, 0.0 => c.current_full_scale_a, "A", Real, FREE,
            "A sum of the phase currents larger by this than 4 % of max_current_a is a fault";
        offset_a: f32 = OFFSET * 8.25, 0.0 => c.current_full_scale_a, "A", Real, FREE,
            "Largest reading of an amplifier while no current flows";
        /// Under speed or position control.
        stall_s: f32 = 0.5, 0.01 => 5.0, "s", Real, FREE, "At rest at the largest current for longer is a fault";
        /// Also how long a tool controls the drive without a request, and, but for 0.1 s at least, a procedure goes on.
        command_timeout_s: f32 = 1.0, 1e-3 => 60.0, "s", Real, FREE, "How long a command holds";
        /// After [`stop_s`](Self::stop_s) without coming to rest.
        if_stop_fails: OnStopFailure = OnStopFailure::Off, 0.0 => 1.0, "", Choice("off|brake"), FREE,
            "If a stop fails: bridge off, or the windings shorted first";
        stop_s: f32 = 1.0, 0.01 => 60.0, "s", Real, FREE, "Longest time to come to rest when a command times out";
        /// Takes up to 0.35 s and turns the rotor by some 30 electrical degrees and back; longer, and by more, where cogging carries it on.
        arming_check: bool = true, 0.0 => 1.0, "", Switch, FREE,
            "Check phases, amplifiers and commutation when the bridge is switched on";
        /// The default needs nothing that may be wrong. A drive whose control has been tried is better stopped.
        on_timeout: OnTimeout = OnTimeout::Fault, 0.0 => 1.0, "", Choice("fault|stop"), FREE,
            "Reaction when no command came for command_timeout_s";
        /// Measured by the rise of the resistance over `resistance_ohm`, of a winding that was as cold as its surroundings
        /// when `hallctl commission` measured that. 0: it is not measured, and the model by currents is all there is.
        /// Leave it where `resistance_ohm` was not measured on this board: 10 % are 26 K. From three quarters of it on,
        /// the current is reduced. Under field-oriented commutation only; where `max_current_a` at `resistance_ohm` is
        /// no voltage of eight times the dead time's, nothing but 0 is in the range.
        ///
        /// Off by up to 20 K where all of these meet at the least current that is measured by: the amplifiers' gains by
        /// 2 % since then (5 K), a fifth of the dead time's voltage (9 K), the flux linkage by 15 % (5 K). At rest it is
        /// the resistance of the phases that carry the current, which may differ from the mean.
        [cfg(not(feature = "small"))]
        max_winding_rise_k: f32 = 0.0, 0.0 => largest_rise_k(s, c), "K", Real, FREE,
            "Largest rise of the winding since resistance_ohm was measured; more is a fault; 0: none";
    } with {
        /// Thermistor of the bridge.
        bridge: Thermistor = Thermistor::ntc_10k(80.0, 100.0);
        /// Thermistor of the motor.
        motor: Thermistor = Thermistor::ntc_10k(100.0, 120.0);
    }

    rows of bridge {
        "bridge_pull_up_ohm", pull_up_ohm, 10.0 => 1e7, "Ω", Real, BOARD, "Pull-up of the bridge's thermistor";
        "bridge_nominal_ohm", nominal_ohm, 10.0 => 1e7, "Ω", Real, BOARD,
            "Resistance of the bridge's thermistor at 25 °C";
        "bridge_beta_k", beta_k, 1e3 => 1e4, "K", Real, BOARD, "B of the bridge's thermistor";
        "bridge_warn_c", warn_c, -40.0 => 199.0, "°C", Real, FREE, "A hotter bridge gets less current";
        "bridge_max_c", max_c, c.guard.bridge.warn_c + 1.0 => 200.0, "°C", Real, FREE, "A hotter bridge is a fault";
    }

    rows of motor {
        "motor_pull_up_ohm", pull_up_ohm, 10.0 => 1e7, "Ω", Real, BOARD, "Pull-up of the motor's thermistor";
        "motor_nominal_ohm", nominal_ohm, 10.0 => 1e7, "Ω", Real, FREE, "Resistance of the motor's thermistor at 25 °C";
        "motor_beta_k", beta_k, 1e3 => 1e4, "K", Real, FREE, "B of the motor's thermistor";
        "motor_warn_c", warn_c, -40.0 => 199.0, "°C", Real, FREE, "A hotter motor gets less current";
        "motor_max_c", max_c, c.guard.motor.warn_c + 1.0 => 200.0, "°C", Real, FREE, "A hotter motor is a fault";
    }
}

/// An NTC between the ADC's pin and ground, pulled up to the reference: `R = R₂₅ · exp(B (1/T − 1/298.15 K))`.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Thermistor {
    /// Pull-up, Ω.
    pub pull_up_ohm: f32,
    /// Resistance at 25 °C, Ω.
    pub nominal_ohm: f32,
    /// B, K.
    pub beta_k: f32,
    /// Above, the largest current is reduced, linearly down to nothing at `max_c`, °C.
    pub warn_c: f32,
    /// Above, a fault, °C.
    pub max_c: f32,
}
