//! The drive measures its motor, against what the simulated motor is.

use hallservo::commutation::Commutation;
use hallservo::control::identify::Report;
use hallservo::control::settings::Settings as Control;
use hallservo::mode::Mode;
use hallservo::service::identification::Plan;
use hallservo::settings::Settings;
use plant::PlantParameters;
use sim::rig::Rig;

/// The drive is told parameters that are off by a fifth.
fn told() -> Control {
    Control {
        resistance_ohm: 4.5,
        inductance_h: 0.3e-3,
        flux_linkage_wb: 4e-3,
        inertia_kgm2: 0.8e-5,
        ..Control::default()
    }
}

fn calibrated(plant: &PlantParameters, control: Control, seed: u64) -> Rig {
    let settings = Settings { control: Some(control), ..Settings::default() };
    let mut rig = Rig::new(plant, &settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig
}

fn identified(plant: &PlantParameters, control: Control, seed: u64) -> Report {
    let mut rig = calibrated(plant, control, seed);
    let report = rig.identify(&Plan::new(&rig.config).unwrap()).unwrap();
    assert_eq!((rig.drive.mode(), rig.drive.commutation()), (Mode::Ready, Commutation::Sinusoidal));
    report
}

#[test]
fn the_drive_measures_its_motor() {
    for seed in 0..4 {
        let report = identified(&PlantParameters::unkind(seed), told(), seed);
        println!("{report}");
    }
}
