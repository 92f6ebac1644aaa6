//! Voltage vectors for which one phase at a time cannot be sampled: the simulated amplifiers show anything of it, and its
//! current follows from the other two.

use crate::supply::{Case, speed};
use crate::weakening::{armed, broken, defects, drone, hub, paper, torque_nm, watch};
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::settings::Control;
use plant::AmplifierFault;
use rig::Rig;

/// The three motors on a board whose amplifiers take 4 µs, with 0.8 µs of dead time, as the B-G431B-ESC1 has them.
fn cases() -> [Case; 3] {
    [paper(), drone(), hub()].map(|mut case| {
        case.settings.sampling_window_s = 4e-6;
        case.settings.dead_time_s = 0.8e-6;
        case.plant.inverter.dead_time_s = 0.8e-6;
        case.with(|control: &mut Control| control.field_weakening_a = 0.0)
    })
}

impl Case {
    /// All the voltage that two currents allow.
    fn with_two_currents(mut self) -> Self {
        self.settings.least_low_side_s = 1e-6;
        self
    }
}

#[test]
fn the_top_speed_is_a_seventh_higher() {
    for case in cases() {
        let [sampled, two] = [case, case.with_two_currents()].map(|case| {
            let mut reached = 0.0;
            for direction in [1.0, -1.0] {
                let mut rig = armed(&case);
                speed(&mut rig, direction * case.speed_rad_s);
                rig.wait(3.0);
                let there = watch(&mut rig, 0.5);
                assert_eq!(rig.drive.mode(), Mode::Running, "{}", case.name);
                println!("{}: {there:.2?}", case.name);
                reached += 0.5 * there.mean_rad_s * f64::from(direction);
            }
            reached
        });
        println!("{}: {sampled:.0} rad/s with three currents, {two:.0} with two", case.name);
        assert!(two > 1.14 * sampled);
    }
}

#[test]
fn a_reversal_a_load_and_a_stop_at_the_longest_vectors() {
    for case in cases().map(Case::with_two_currents) {
        let mut rig = armed(&case);
        let check = |what: &str, rig: &mut Rig, seconds: f64| {
            let stretch = watch(rig, seconds);
            println!("{} {what}: {stretch:.2?}", case.name);
            assert_eq!(rig.drive.mode(), Mode::Running, "{} {what}: {stretch:?}", case.name);
            assert!(stretch.bus_v < case.over_v() && stretch.current_a < 1.15 * case.most_a(), "{what}: {stretch:?}");
        };
        for sign in [1.0, -1.0, 1.0] {
            speed(&mut rig, sign * case.speed_rad_s);
            check("turn", &mut rig, 3.0);
        }
        speed(&mut rig, 0.0);
        check("stop", &mut rig, 4.0);
        rig.command(Command::Disarm).unwrap();
    }
}

#[test]
fn what_breaks_there_is_named_or_does_no_harm() {
    for (number, case) in cases().map(Case::with_two_currents).into_iter().enumerate() {
        for (name, breaks) in defects(number) {
            broken(&case, name, breaks);
        }
    }
}

/// The sum of the currents is watched in what samples have all three, which are few there; but with all of the voltage in use the
/// current cannot rise. The amplifier is named when the vectors are shorter. The short form has one of three.
#[test]
fn an_amplifier_that_fades_does_no_harm_there_and_is_named_below() {
    for case in cases() {
        for phase in (0..3).step_by(sim::of(3, 1)) {
            let [three, two] = [case, case.with_two_currents()].map(|case| {
                let mut rig = armed(&case);
                speed(&mut rig, case.speed_rad_s);
                rig.wait(2.5);
                let most_rad_s = rig.plant.truth().speed_rad_s as f32;
                speed(&mut rig, 0.97 * most_rad_s);
                rig.wait(0.5);
                rig.plant.set_load(torque_nm(&case, 0.2)).unwrap();
                rig.wait(0.1);
                assert_eq!(rig.drive.mode(), Mode::Running, "{}", case.name);
                rig.plant.set_amplifier_fault(phase, Some(AmplifierFault::Gain(0.2))).unwrap();
                let there = watch(&mut rig, 0.4);
                if rig.drive.mode() == Mode::Running {
                    speed(&mut rig, 0.6 * most_rad_s);
                    rig.wait(1.0);
                }
                (rig.drive.mode(), there.current_a / case.most_a())
            });
            println!("{} {phase}: {three:.2?} {two:.2?}", case.name);
            assert!(two.1 < 1.35 * three.1 + 0.02, "{} {phase}: {three:?} {two:?}", case.name);
            assert_eq!(two.0 == Mode::Running, three.0 == Mode::Running, "{} {phase}: {three:?} {two:?}", case.name);
        }
    }
}
