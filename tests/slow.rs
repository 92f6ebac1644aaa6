//! Settings with a small largest speed, as behind a gear, and what is left to a motor that is told nothing.

use crate::supply;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::settings::Control;
use plant::{Cogging, Friction};
use rig::Rig;

/// Length of the current vector, A.
fn length([a, b, c]: [f64; 3]) -> f64 {
    ((a * a + b * b + c * c) * 2.0 / 3.0).sqrt()
}

/// The short form has every other of the largest speeds.
#[test]
fn an_armed_drive_with_a_small_largest_speed_is_at_rest() {
    for case in [supply::default_motor(), supply::drone(), supply::hub()] {
        for (max_speed_rad_s, free) in [0.2, 0.5, 1.0, 2.0, 5.0, 20.0]
            .into_iter()
            .step_by(sim::of(2, 1))
            .flat_map(|max| [(max, false), (max, true)])
        {
            let mut plant = case.plant;
            if free {
                (plant.motor.friction, plant.motor.cogging) = (Friction::NONE, [Cogging::NONE; 2]);
            }
            let control = case.settings.control.map(|control| Control { max_speed_rad_s, ..control });
            let mut rig = Rig::new(&plant, &hallservo::settings::Settings { control, ..case.settings }, 1).unwrap();
            rig.calibrate(|_| ()).unwrap();
            // A hand stops it.
            rig.plant.set_dyno(Some(0.0)).unwrap();
            rig.wait(0.3);
            rig.plant.set_dyno(None).unwrap();
            rig.command(Command::Arm).unwrap();
            rig.command(Command::Current(rig.control().unwrap().current(0.0).unwrap())).unwrap();
            rig.wait(0.02);
            let (mut square, mut fastest, mut count) = (0.0, 0.0_f64, 0.0);
            rig.run(0.8, |_, period| {
                square += length(period.truth.currents_a).powi(2);
                fastest = fastest.max(period.truth.speed_rad_s.abs());
                count += 1.0;
            });
            let share = (square / count).sqrt() / f64::from(control.unwrap().max_current_a);
            let what = format!("{} up to {max_speed_rad_s} rad/s, free {free}", case.name);
            println!("{what}: current {share:.3} of the largest, speed {fastest:.2} rad/s");
            assert_eq!(rig.drive.mode(), Mode::Running, "{what}");
            assert!(share < 0.1, "{what}: {share}");
        }
    }
}
