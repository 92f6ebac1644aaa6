//! The length of the current's vector is what is commanded, whatever the commutation and the speed.

use crate::commissioned::here_turns;
use crate::known;
use crate::supply::wheel;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::PlantParameters;
use rig::Rig;

/// A motor with its settings, and its full speed.
type Case = (&'static str, PlantParameters, Settings, f64);

fn default_motor() -> Case {
    // What is commanded once has to hold.
    let guard = GuardSettings { arming_check: false, command_timeout_s: 60.0, ..GuardSettings::default() };
    let control = Control { continuous_current_a: 3.0, max_regeneration_a: 100.0, guard, ..Control::default() };
    ("default", PlantParameters::imperfect(1), Settings { control: Some(control), ..Settings::default() }, 500.0)
}

/// 0.1 Ω and 0.2 mH: at full speed its reactance is as large as its resistance.
fn hub() -> Case {
    let mut plant = wheel();
    plant.current_sense.gain = 1.65 / 60.0;
    let guard = GuardSettings {
        over_current_a: 35.0,
        imbalance_a: 5.0,
        offset_a: 3.0,
        arming_check: false,
        command_timeout_s: 60.0,
        ..GuardSettings::default()
    };
    let control = Control {
        current_full_scale_a: 60.0,
        resistance_ohm: 0.12,
        inductance_h: 0.2e-3,
        flux_linkage_wb: 0.018,
        inertia_kgm2: 0.05,
        max_current_a: 25.0,
        continuous_current_a: 25.0,
        bridge_continuous_a: 50.0,
        max_regeneration_a: 100.0,
        max_speed_rad_s: 40.0,
        max_acceleration_rad_s2: 150.0,
        speed_bandwidth_hz: 5.0,
        position_bandwidth_hz: 1.0,
        dead_time_ramp_a: 0.5,
        guard,
        ..Control::default()
    };
    let settings = Settings {
        pole_pairs: 15,
        calibration_modulation: 0.12,
        calibration_hz: 5.0,
        control: Some(control),
        ..Settings::default()
    };
    ("hub", plant, settings, 38.0)
}

fn armed((_, plant, settings, _): &Case, commutation: Commutation) -> Rig {
    let mut plant = *plant;
    plant.bus.regenerative = true;
    let mut rig = known::rig(&plant, &Settings { commutation, ..*settings }, 1).unwrap();
    rig.wait(0.2);
    rig.command(Command::Arm).unwrap();
    rig
}

const COMMUTATIONS: [Commutation; 3] = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block];

#[test]
fn the_vector_is_no_longer_than_what_is_commanded() {
    for case in [default_motor(), hub()] {
        let amperes = f64::from(case.2.control.unwrap().max_current_a) * 0.6;
        for commutation in COMMUTATIONS {
            for direction in [1.0, -1.0] {
                let mut rig = armed(&case, commutation);
                let current = rig.control().unwrap().current((direction * amperes) as f32).unwrap();
                rig.command(Command::Current(current)).unwrap();
                let mut ratios = Vec::new();
                for percent in 0..=100 {
                    rig.plant.set_dyno(Some(direction * 0.01 * f64::from(percent) * case.3)).unwrap();
                    rig.wait(0.01);
                    if percent % 10 == 0 {
                        let (mut sum, periods) = (0.0, f64::from(rig.periods(0.1)));
                        rig.run(0.1, |_, period| {
                            sum += period.truth.currents_a.iter().map(|i| i * i).sum::<f64>() / 1.5;
                        });
                        ratios.push((sum / periods).sqrt() / amperes);
                    }
                }
                let worst = ratios.iter().copied().fold(0.0, f64::max);
                println!("{} {commutation:?} {direction}: {worst:.3}, {ratios:.3?}", case.0);
                assert_eq!(rig.drive.mode(), Mode::Running);
                assert!(worst <= 1.05, "{worst}");
            }
        }
    }
}

#[test]
fn a_wheel_moves_to_a_position_without_an_over_current() {
    for commutation in COMMUTATIONS {
        let mut rig = armed(&hub(), commutation);
        let here = here_turns(&rig);
        rig.command(Command::Position(rig.control().unwrap().position(here + 8.0).unwrap())).unwrap();
        let mut longest = 0.0_f64;
        rig.run(4.0, |_, period| {
            longest = longest.max((period.truth.currents_a.iter().map(|i| i * i).sum::<f64>() / 1.5).sqrt());
        });
        let there = here_turns(&rig);
        println!("{commutation:?}: {longest:.1} A, {:.4} turns, {:?}", there - here, rig.drive.mode());
        assert_eq!(rig.drive.mode(), Mode::Running);
    }
}
