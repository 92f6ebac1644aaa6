//! The vernier on the shaft of a running drive: calibrated by it, and the absolute reference beside its Halls.

use hallservo::angle::{ElectricalAngle, MechanicalAngle, PolePairs, Position};
use hallservo::board::Sample;
use hallservo::commutation::Modulation;
use hallservo::drive::Command;
use hallservo::drive::absolute::{self, AbsoluteChannels, AbsoluteDrive, AbsoluteTasks};
use hallservo::fault::Fault;
use hallservo::mode::Mode;
use hallservo::service::Service;
use hallservo::settings::Settings;
use hallservo::vernier::calibrate::Calibrator;
use hallservo::vernier::continuity::{self, State};
use hallservo::vernier::encoder::{Calibration, Encoder, Reading};
use hallservo::vernier::rings::Rings;
use hallservo::vernier::turns::{Disagreement, TurnCheck, TurnZero};
use plant::PlantParameters;
use plant::construction::Construction;
use rig::Rig;
use sim::experiment::vernier::{Build, read};

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
    let parameters = PlantParameters::imperfect(1);
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

/// A drive with the encoder in it, at a motor with rings on its shaft.
struct Absolute {
    plant: plant::Plant,
    drive: AbsoluteDrive<Encoder<2>>,
    service: Service,
    tasks: AbsoluteTasks<Encoder<2>>,
    construction: Construction,
    rings: Rings,
    period: u16,
    /// What becomes of what the heads read on the way to the drive.
    disturb: fn(Reading<2>) -> Reading<2>,
}

impl Absolute {
    fn new() -> Self {
        let build = Build { eccentricity: 0.05, head_angle: 40.0, pairs: true };
        let config = Settings::default().validate().unwrap();
        let (drive, service) = rig::connected(config);
        let (absolute_interrupt, absolute_tasks) = Box::leak(Box::new(AbsoluteChannels::new())).split();
        let mut plant = plant::Plant::new(&PlantParameters::imperfect(2), 2).unwrap();
        plant.place(1.0, 0.0).unwrap();
        Self {
            plant,
            drive: AbsoluteDrive::new(drive, absolute_interrupt, 40),
            service,
            tasks: absolute_tasks,
            construction: build.construction(2),
            rings: build.rings().unwrap(),
            period: config.period,
            disturb: |reading| reading,
        }
    }

    fn step(&mut self) {
        let shaft = self.plant.truth().mechanical_angle_rad;
        let reading = (self.disturb)(read(&self.rings, &mut self.construction, shaft));
        let output = self.drive.step(&Sample { halls: self.plant.sample().halls, ..Sample::default() }, reading);
        self.plant.advance(&rig::legs(&output, self.period));
    }

    /// Runs and serves the tasks; tells each sample of the encoder, and whether the Halls agree.
    fn seconds(
        &mut self,
        seconds: f64,
        mut see: impl FnMut(&Self, absolute::Absolute<Reading<2>, continuity::Fault>, bool),
    ) {
        for _ in 0..(seconds * 1000.0) as u32 {
            (0..40).for_each(|_| self.step());
            while self.service.poll().is_some() {}
            while let Some((sample, agreement)) = self.tasks.poll(&mut self.service) {
                see(self, sample, agreement.is_ok());
            }
        }
    }

    fn command(&mut self, command: Command) {
        self.service.send(command).unwrap();
        self.seconds(0.002, |_, _, _| ());
    }

    /// Calibrated Halls and encoder, running.
    fn running() -> Self {
        let mut machine = Self::new();
        machine.command(Command::Calibrate);
        while machine.drive.drive().mode() != Mode::Ready {
            machine.seconds(0.01, |_, _, _| ());
        }
        machine.command(Command::Arm);
        machine.command(Command::Drive(Modulation::from_num(0.12)));
        machine.seconds(1.0, |_, _, _| ());
        let mut calibrator = Calibrator::new(&machine.rings, &Calibration::ideal(&machine.rings));
        for _ in 0..400_000 {
            let shaft = machine.plant.truth().mechanical_angle_rad;
            let reading = read(&machine.rings, &mut machine.construction, shaft);
            machine.step();
            if calibrator.push(reading).unwrap() {
                break;
            }
        }
        let (calibration, _) = calibrator.finish().unwrap();
        let encoder = Encoder::new(&machine.rings, &calibration, MechanicalAngle::from_degrees(1.0)).unwrap();
        assert!(machine.tasks.install(Box::leak(Box::new(encoder))).is_ok());
        machine.seconds(0.01, |_, _, _| ());
        machine
    }

    /// Compares Halls and encoder from now on.
    fn watch(&mut self) {
        self.watch_from(ElectricalAngle::ZERO);
    }

    /// The same, as if the encoder had turned on the shaft by this much.
    fn watch_from(&mut self, turned: ElectricalAngle) {
        let mut offset = None;
        let pole_pairs = PolePairs::new(4).unwrap();
        self.seconds(0.002, |_, sample, _| {
            let angle = sample.angle.unwrap().unwrap();
            offset = Some(TurnCheck::offset(pole_pairs, angle, sample.halls.angle()));
        });
        let tolerance = ElectricalAngle::from_degrees(30.0);
        self.tasks.watch(Some(TurnCheck { pole_pairs, offset: offset.unwrap() + turned, tolerance }));
    }
}

#[test]
fn the_encoder_in_the_drive_is_absolute_and_checks_the_turns() {
    let mut machine = Absolute::running();
    machine.watch();
    machine.command(Command::Drive(Modulation::from_num(-0.3)));
    let mut worst = 0.0_f32;
    machine.seconds(1.0, |machine, sample, agree| {
        let angle = sample.angle.unwrap().expect("the encoder is healthy");
        let by_halls = machine.tasks.by_halls(sample.halls).expect("the zero is known from the first sample");
        worst = worst.max((by_halls - angle).to_degrees().abs());
        assert!(agree);
    });
    assert!(machine.drive.is_proven() && worst < 7.5, "{worst}");
    assert_eq!(machine.drive.drive().mode(), Mode::Running);
    // An encoder that has turned on the shaft by an eighth of a turn, half an electrical one.
    machine.watch_from(ElectricalAngle::HALF);
    machine.seconds(0.005, |_, _, _| ());
    assert_eq!(machine.drive.drive().mode(), Mode::Faulted(Fault::Turns));
}

#[test]
fn an_encoder_that_stays_wrong_switches_off_and_a_single_wrong_reading_does_not() {
    let mut machine = Absolute::running();
    machine.watch();
    let spoil = |reading: Reading<2>| Reading { vernier: reading.vernier.map(|x| x ^ 0x4000), ..reading };
    for _ in 0..8 {
        machine.disturb = spoil;
        machine.step();
        machine.disturb = |reading| reading;
        (0..100).for_each(|_| machine.step());
    }
    machine.seconds(0.01, |_, _, agree| assert!(agree));
    assert_eq!(machine.drive.drive().mode(), Mode::Running);
    machine.disturb = spoil;
    (0..9).for_each(|_| machine.step());
    assert_eq!(machine.drive.drive().mode(), Mode::Faulted(Fault::Encoder));
}
