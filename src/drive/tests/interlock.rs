use super::*;
use crate::board::Interlock;

const COMMUTATIONS: [Commutation; 3] = [Commutation::Block, Commutation::Sinusoidal, Commutation::FieldOriented];

impl Bench {
    fn step_off(&mut self, interlock: Interlock) -> Output {
        let halls = self.model.codes(self.rotor);
        let sample = if self.healthy { healthy(halls) } else { Sample { halls, ..Sample::default() } };
        self.drive.step_off(&sample, interlock)
    }

    /// The answer to a command while an interlock holds; the bridge is off in each step until it comes.
    fn command_off(&mut self, command: Command, interlock: Interlock) -> Reply {
        self.service.send(command).unwrap();
        for _ in 0..100 {
            assert_eq!(self.step_off(interlock), Output::OFF);
            assert!(!self.mode().drives());
            if let Some(service::Event::Reply(reply)) = self.service.poll() {
                return reply;
            }
        }
        panic!("no answer");
    }
}

/// Running by a voltage without currents, and following a speed in each commutation.
fn running() -> Vec<Bench> {
    let mut benches: Vec<_> = COMMUTATIONS.map(|commutation| with_control(commutation, |_| {})).into();
    for bench in &mut benches {
        bench.command(Command::Arm).unwrap();
        bench.command(Command::Speed(Speed(1 << 20))).unwrap();
    }
    benches.push(Bench::running());
    for bench in &mut benches {
        (0..100).for_each(|_| _ = bench.step());
        assert_eq!(bench.mode(), Mode::Running);
        assert_ne!(bench.step(), Output::OFF);
    }
    benches
}

#[test]
fn a_stop_disarms_in_the_same_step_and_nothing_arms_while_it_holds() {
    for mut bench in running() {
        assert_eq!(bench.step_off(Interlock::Stop), Output::OFF);
        assert_eq!(bench.mode(), Mode::Ready);
        // What was asked for before has its turn, and moves nothing.
        bench.command_off(Command::Arm, Interlock::Stop).unwrap();
        assert_eq!(bench.mode(), Mode::Ready);
        (0..50).for_each(|_| assert_eq!(bench.step(), Output::OFF));
        bench.command(Command::Arm).unwrap();
        assert_eq!(bench.mode(), Mode::Running);
    }
}

#[test]
fn a_stop_breaks_a_calibration_off() {
    let mut bench = Bench::new(&Settings::default());
    bench.command(Command::Calibrate).unwrap();
    (0..100).for_each(|_| _ = bench.step());
    assert!(bench.mode().drives());
    assert_eq!(bench.step_off(Interlock::Stop), Output::OFF);
    assert_eq!(bench.mode(), Mode::Unarmed);
}

#[test]
fn a_stop_forgives_no_fault() {
    let mut bench = Bench::running();
    bench.command(Command::Trip(Fault::OverSpeed)).unwrap();
    bench.step_off(Interlock::Stop);
    assert_eq!(bench.mode(), Mode::Faulted(Fault::OverSpeed));
}

#[test]
fn without_enable_a_running_drive_fails_and_one_that_is_off_stays_off() {
    for mut bench in running() {
        assert_eq!(bench.step_off(Interlock::Disabled), Output::OFF);
        assert_eq!(bench.mode(), Mode::Faulted(Fault::Disabled));
        bench.command_off(Command::Clear, Interlock::Disabled).unwrap();
        for command in [Command::Arm, Command::Calibrate] {
            let refused = Err(Refusal::Fault(Fault::Disabled));
            assert_eq!(bench.command_off(command, Interlock::Disabled), refused);
        }
        assert_eq!(bench.mode(), Mode::Ready, "off, and no fault");
        bench.command(Command::Arm).unwrap();
        assert_eq!(bench.mode(), Mode::Running);
    }
}

#[test]
fn the_angle_is_followed_meanwhile() {
    let mut bench = Bench::running();
    let before = bench.drive.tracker().position();
    for _ in 0..1800 {
        bench.rotor += ElectricalAngle::from_degrees(2.0);
        bench.step_off(Interlock::Stop);
    }
    let error = (bench.drive.tracker().angle() - bench.rotor).to_degrees();
    assert!(error.abs() < 2.0, "{error}");
    assert_eq!((bench.drive.tracker().position().to_bits() - before.to_bits() + (1 << 31)) >> 32, 10, "turns");
}

/// Arming takes some steps, and a stop or a missing enable that lasts one of them is enough.
#[test]
fn an_arming_that_has_begun_ends_with_the_interlock() {
    for commutation in COMMUTATIONS {
        for (steps, interlock) in (0..8).flat_map(|steps| [(steps, Interlock::Stop), (steps, Interlock::Disabled)]) {
            let mut bench = with_control(commutation, |_| {});
            bench.service.send(Command::Arm).unwrap();
            (0..steps).for_each(|_| _ = bench.step());
            let armed = bench.mode() == Mode::Running;
            assert_eq!(bench.step_off(interlock), Output::OFF);
            for _ in 0..100 {
                assert_eq!(bench.step(), Output::OFF, "{commutation:?}, {interlock:?} after {steps} steps");
            }
            let expected =
                if armed && interlock == Interlock::Disabled { Mode::Faulted(Fault::Disabled) } else { Mode::Ready };
            assert_eq!(bench.mode(), expected, "{commutation:?}, {interlock:?} after {steps} steps");
            // Arming is answered, and can be asked for again.
            let armed = |event| matches!(event, service::Event::Reply(_));
            assert!(std::iter::from_fn(|| bench.service.poll()).any(armed));
            if bench.mode() != Mode::Ready {
                bench.command(Command::Clear).unwrap();
            }
            bench.command(Command::Arm).unwrap();
            assert_eq!(bench.mode(), Mode::Running);
        }
    }
}
