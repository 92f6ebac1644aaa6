//! A board at a motor that is not quite the one of its settings.

use super::board::{BOARDS, Board};
use anyhow::{Context, Result};
use hallservo::board::TemperatureCode;
use hallservo::settings::Settings;
use plant::{BusParameters, PlantParameters, SenseParameters, Thermistor, Unevenness};
use rand::RngExt;
use rand::seq::IndexedRandom;
use rand_pcg::Pcg64;
use std::f32::consts::TAU;

/// Reference of the boards' ADCs.
const REFERENCE_V: f64 = 3.3;
/// What a user sets for a motor that must not be fast, rad/s.
pub(super) const SLOW_RAD_S: f32 = 200.0;
/// Pole pairs of the motors; four are the most common. With one, the checks at arming move the shaft by up to 42°.
const POLE_PAIRS: [u8; 7] = [2, 4, 4, 7, 11, 15, 21];
/// How far the second of two Halls may be from the first, electrical degrees.
const APART_DEG: [f64; 5] = [90.0, -90.0, 120.0, -120.0, 60.0];
/// Magnets of the most uneven rotor; the field of the windings is meant at the boards' largest current.
const UNEVEN: Unevenness = Unevenness { rated_a: 3.0, ..Unevenness::CHEAP };
/// Longest time to come to rest that a user sets, s.
const STOP_S: f32 = 0.3;

/// Temperatures of bridge and motor when nothing is wrong, °C.
pub(super) const COOL: [f64; 2] = [35.0, 40.0];

/// Board, motor, supply and user.
pub(super) struct Bench {
    pub board: &'static Board,
    pub settings: Settings,
    pub parameters: PlantParameters,
    /// How uneven the magnets are, as a share of the most uneven ones.
    pub uneven: f64,
    /// Thermistors of bridge and motor, where the motor has one.
    pub thermistors: [Option<Thermistor>; 2],
    /// Their temperatures.
    pub celsius: [f64; 2],
}

impl Bench {
    /// One at random: a board as shipped, told of the motor what a data sheet says, which is wrong by so much as motors
    /// are; three sensors, or two, as in [`PlantParameters::imperfect`]; every other rotor with magnets up to as uneven as
    /// cheap ones are.
    pub fn draw(random: &mut Pcg64, seed: u64, halls: u8) -> Result<Self> {
        let board = BOARDS.choose(random).context("no board")?;
        let mut settings = board.settings()?;
        let pole_pairs = *POLE_PAIRS.choose(random).context("no motor")?;
        let uneven = random.random_range(-1.0_f64..1.0).max(0.0);
        let mut parameters = PlantParameters::imperfect(seed);
        settings.halls = halls;
        if halls == 2 {
            parameters = parameters.with_two_halls(*APART_DEG.choose(random).context("no spacing")?);
        }
        let mut parameters = parameters.with_pole_pairs(pole_pairs).with_unevenness(&UNEVEN.scaled(uneven), seed);
        settings.pole_pairs = pole_pairs;
        settings.reversed = random.random_bool(0.5);
        let control = settings.control.as_mut().context("a board without current sensing")?;
        control.flux_linkage_wb = parameters.motor.back_emf.flux_linkage_vs as f32;
        control.max_speed_rad_s = if random.random_bool(0.5) { SLOW_RAD_S } else { control.max_speed_rad_s };
        let fastest = 0.95 * TAU * settings.max_electrical_hz / f32::from(pole_pairs);
        control.max_speed_rad_s = control.max_speed_rad_s.min(fastest);
        control.guard.stop_s = STOP_S;

        let motor = &mut parameters.motor;
        motor.resistance_ohm *= random.random_range(0.75..1.25);
        motor.inductance_h *= random.random_range(0.75..1.25);
        motor.back_emf.flux_linkage_vs *= random.random_range(0.85..1.15);
        motor.inertia_kgm2 *= 2_f64.powf(random.random_range(-1.0..2.32));
        for hall in &mut parameters.halls {
            hall.noise *= random.random_range(0.3..1.5);
        }
        let gain = 0.5 * REFERENCE_V / f64::from(control.current_full_scale_a);
        let noise_v = random.random_range(0.3e-3..1.5e-3);
        parameters.current_sense = SenseParameters { gain, noise_v, ..parameters.current_sense };
        parameters.bus_sense.gain = REFERENCE_V / f64::from(control.bus_full_scale_v);
        parameters.inverter.dead_time_s = f64::from(settings.dead_time_s);
        let most_v = (f64::from(control.guard.over_voltage_v) - 6.0).min(36.0);
        // Three of four supplies take nothing back, as a laboratory's.
        let regenerative = random.random_bool(0.25);
        let supply_v = random.random_range(14.0..most_v);
        parameters.bus = BusParameters { supply_v, regenerative, ..parameters.bus };
        let thermistor = |ntc: hallservo::settings::Thermistor| Thermistor {
            pull_up_ohm: ntc.pull_up_ohm.into(),
            nominal_ohm: ntc.nominal_ohm.into(),
            beta_k: ntc.beta_k.into(),
            fault: None,
        };
        let motor_thermistor = random.random_bool(0.5).then(|| thermistor(control.guard.motor));
        let thermistors = [Some(thermistor(control.guard.bridge)), motor_thermistor];
        Ok(Self { board, settings, parameters, uneven, thermistors, celsius: COOL })
    }

    /// What the thermistors read.
    pub fn temperatures(&self) -> [TemperatureCode; 2] {
        [0, 1].map(|which| match self.thermistors[which] {
            Some(ntc) => TemperatureCode::new((ntc.ratio(self.celsius[which]) * 4096.0).min(4095.0) as u16),
            None => TemperatureCode::MISSING,
        })
    }

    /// Sensors of the drive.
    pub fn halls(&self) -> usize {
        self.settings.halls.into()
    }

    /// In words, for what went wrong at it.
    pub fn describe(&self) -> String {
        let motor = &self.parameters.motor;
        format!(
            "{}, {} pole pairs{}{}, R {:.2} Ω, λ {:.2} mWb, J {:.1} g·cm², {:.1} V{}{}",
            self.board.name,
            motor.pole_pairs,
            self.halls_apart(),
            if self.uneven > 0.0 { format!(", magnets {:.0} % uneven", 100.0 * self.uneven) } else { String::new() },
            motor.resistance_ohm,
            1e3 * motor.back_emf.flux_linkage_vs,
            1e7 * motor.inertia_kgm2,
            self.parameters.bus.supply_v,
            if self.parameters.bus.regenerative { " taking back" } else { "" },
            if self.settings.reversed { ", reversed" } else { "" },
        )
    }

    fn halls_apart(&self) -> String {
        if self.halls() == 3 {
            return String::new();
        }
        let [first, second, _] = self.parameters.halls.map(|hall| hall.placement_rad.to_degrees());
        format!(", Halls {:.0}° apart", second - first)
    }
}
