//! The vernier on the shaft of a running drive: calibrated by it, and the absolute reference beside its Halls.

use hallservo::angle::{ElectricalAngle, MechanicalAngle, PolePairs, Position};
use hallservo::drive::Command;
use hallservo::settings::Settings;
use hallservo::vernier::calibrate::Calibrator;
use hallservo::vernier::continuity::State;
use hallservo::vernier::encoder::{Calibration, Encoder};
use hallservo::vernier::rings::Rings;
use hallservo::vernier::turns::{Disagreement, TurnCheck, TurnZero};
use plant::PlantParameters;
use plant::construction::Construction;
use sim::experiment::vernier::{Build, read};
use sim::rig::Rig;

/// A motor with rings on its shaft.
struct Machine {
    rig: Rig,
    construction: Construction,
    rings: Rings,
}

impl Machine {
    fn step<T>(&mut self, mut see: impl FnMut(&Rig, hallservo::vernier::encoder::Reading<2>) -> T) -> T {
        let shaft = self.rig.plant.truth().mechanical_angle_rad;
        let reading = read(&self.rings, &mut self.construction, shaft);
        self.rig.step();
        see(&self.rig, reading)
    }

    fn seconds(&mut self, seconds: f64, mut see: impl FnMut(&Rig, hallservo::vernier::encoder::Reading<2>)) {
        for number in 0..self.rig.periods(seconds) {
            self.step(&mut see);
            if number % 40 == 0 {
                self.rig.serve();
            }
        }
    }
}

#[test]
fn the_drive_calibrates_its_encoder_and_the_encoder_its_turn_counter() {
    let build = Build { eccentricity: 0.05, head_angle: 40.0, pairs: true };
    let parameters = PlantParameters::unkind(1);
    let pole_pairs = PolePairs::new(parameters.motor.pole_pairs).unwrap();
    let rig = Rig::new(&parameters, &Settings::default(), 1).unwrap();
    let mut machine = Machine { rig, construction: build.construction(1), rings: build.rings().unwrap() };
    machine.rig.calibrate(|_| {}).unwrap();
    machine.rig.command(Command::Arm).unwrap();

    // The calibration run: a slow turn under voltage control, with the motor's own cogging and friction.
    machine.rig.drive_with(0.12).unwrap();
    machine.seconds(1.0, |_, _| {});
    let mut calibrator = Calibrator::new(&machine.rings, &Calibration::ideal(&machine.rings));
    let mut done = false;
    machine.seconds(5.0, |_, reading| done = done || calibrator.push(reading).unwrap());
    let (calibration, report) = calibrator.finish().unwrap();
    println!("{report:?}, speed {:.1} rad/s", machine.rig.plant.truth().speed_rad_s);
    assert!(report.worst_residual * 5 < report.margin, "{report:?}");

    // The next power-up: nothing remembered but the calibration and the offset of the Halls.
    let encoder = Encoder::new(&machine.rings, &calibration, MechanicalAngle::from_degrees(1.0)).unwrap();
    let mut state = State::default();
    let mut zero = TurnZero::default();
    let offset = machine
        .step(|rig, reading| TurnCheck::offset(pole_pairs, encoder.decode(reading).angle, rig.drive.tracker().angle()));
    let check = TurnCheck { pole_pairs, offset, tolerance: ElectricalAngle::from_degrees(30.0) };
    machine.rig.drive_with(-0.3).unwrap();
    let (mut samples, mut worst_deg) = (0, 0.0_f32);
    machine.seconds(1.5, |rig, reading| {
        let angle = encoder.step(&mut state, reading).expect("the encoder is healthy").angle;
        let halls = rig.drive.tracker().position();
        check.check(&mut zero, angle, halls).expect("Halls and encoder agree");
        let by_halls = check.absolute(zero, halls).expect("the zero is known from the first sample");
        worst_deg = worst_deg.max((by_halls - angle).to_degrees().abs());
        samples += 1;
    });
    println!("{samples} samples, the Halls at most {worst_deg:.2}° from the encoder");
    assert!(state.is_proven());
    // A few electrical degrees of a seventh of a turn.
    assert!(worst_deg < 30.0 / f32::from(pole_pairs.get()));

    // A counter that has lost a turn is found out.
    let result = machine.step(|rig, reading| {
        let angle = encoder.step(&mut state, reading).unwrap().angle;
        let slipped = Position::from_bits(rig.drive.tracker().position().to_bits() - (1 << 32));
        check.check(&mut zero, angle, slipped)
    });
    assert_eq!(result, Err(Disagreement::Slipped(-1)));
}
