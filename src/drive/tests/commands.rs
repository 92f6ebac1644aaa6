//! Arming, disarming, voltages and settings.

use super::*;

#[test]
fn nothing_moves_before_a_calibration() {
    let mut bench = Bench::new(&Settings::default());
    assert_eq!(bench.command(Command::Arm), Err(Refusal::NotCalibrated));
    assert_eq!(bench.command(Command::Drive(Modulation::from_num(0.5))), Err(Refusal::Mode(Mode::Unarmed)));
    for _ in 0..100 {
        assert_eq!(bench.step(), Output::OFF);
    }
    assert_eq!(bench.mode(), Mode::Unarmed);
}

#[test]
fn arms_drives_and_disarms() {
    let mut bench = Bench::running();
    let idle = bench.step();
    assert_eq!((idle.legs, idle.compare), (Legs::ALL, [1062; 3]));
    bench.command(Command::Drive(Modulation::from_num(0.5))).unwrap();
    // At 10° the field stands at 100°: A just below one half, B above, C below.
    let [a, b, c] = bench.step().compare;
    assert!(a < 1062 && b > 1400 && c < 900, "{a} {b} {c}");
    bench.command(Command::Drive(Modulation::from_num(-0.5))).unwrap();
    let [a, b, c] = bench.step().compare;
    assert!(a > 1062 && b < 700 && c > 1200, "{a} {b} {c}");
    bench.command(Command::Disarm).unwrap();
    assert_eq!((bench.step(), bench.mode()), (Output::OFF, Mode::Ready));
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.step().compare, [1062; 3], "the old command is forgotten");
}

#[test]
fn arming_needs_an_angle() {
    let mut bench = Bench::new(&Settings::default());
    bench.install().unwrap();
    for _ in 0..20 {
        bench.step_with([0; 3]);
    }
    bench.service.send(Command::Arm).unwrap();
    for _ in 0..2 {
        assert_eq!(bench.step_with([0; 3]), Output::OFF);
    }
    assert_eq!(bench.reply(), Err(Refusal::NoAngle));
    // When the Halls are back, wherever the rotor is by now, so is the drive.
    bench.rotor = ElectricalAngle::from_degrees(140.0);
    for _ in 0..20 {
        bench.step();
    }
    bench.command(Command::Arm).unwrap();
    assert!((bench.drive.tracker().angle() - bench.rotor).to_degrees().abs() < 0.2);
}

#[test]
fn a_command_beyond_the_limit_is_refused_and_changes_nothing() {
    let mut bench = Bench::running_with(&Settings { max_modulation: 0.5, ..Settings::default() });
    bench.command(Command::Drive(Modulation::from_num(0.4))).unwrap();
    let before = bench.step();
    for modulation in [0.51, -0.51, -1.0] {
        assert_eq!(bench.command(Command::Drive(Modulation::from_num(modulation))), Err(Refusal::TooLarge));
    }
    assert_eq!(bench.step(), before);
}

#[test]
fn the_duty_limit_is_reported() {
    let mut bench = Bench::running();
    bench.command(Command::Drive(Modulation::from_num(0.5))).unwrap();
    assert!(!bench.drive.limits().contains(Limits::DUTY));
    bench.command(Command::Drive(Modulation::MAX)).unwrap();
    assert!(bench.drive.limits().contains(Limits::DUTY));
}

#[test]
fn phase_advance_leads_in_both_directions() {
    let [mut plain, mut ahead] = [0.0, 20.0]
        .map(|phase_advance_deg| Bench::running_with(&Settings { phase_advance_deg, ..Settings::default() }));
    for (modulation, turned) in [(0.5, 20.0), (-0.5, -20.0)] {
        for bench in [&mut plain, &mut ahead] {
            bench.command(Command::Drive(Modulation::from_num(modulation))).unwrap();
        }
        let field = |bench: &mut Bench| {
            let [a, b, c] = bench.step().compare.map(|compare| f32::from(compare) - 1062.0);
            ElectricalAngle::from_radians(libm::atan2f((b - c) / libm::sqrtf(3.0), a))
        };
        let difference = (field(&mut ahead) - field(&mut plain)).to_degrees();
        assert!((difference - turned).abs() < 0.2, "{modulation} {difference}");
    }
}

#[test]
fn block_commutation_opens_one_leg() {
    let mut bench = Bench::running_with(&Settings { commutation: Commutation::Block, ..Settings::default() });
    bench.command(Command::Drive(Modulation::from_num(0.4))).unwrap();
    let mut opened = Vec::new();
    for k in 0..3600 {
        bench.rotor = ElectricalAngle::from_degrees(k as f32 / 10.0);
        let output = bench.step();
        let open: Vec<_> = (0..3).filter(|&leg| !output.legs.contains(leg)).collect();
        assert_eq!(open.len(), 1);
        if opened.last() != Some(&open[0]) {
            opened.push(open[0]);
        }
    }
    // A is at rest first; six steps and the beginning of the first again.
    assert!(opened.windows(2).all(|pair| pair[1] == (pair[0] + 2) % 3), "{opened:?}");
    assert!((6..=7).contains(&opened.len()), "{opened:?}");
}

#[test]
fn other_settings_are_taken_up_while_the_bridge_is_off_only() {
    let mut bench = Bench::running();
    let first = bench.config;
    let other = Settings { max_modulation: 0.25, ..Settings::default() }.validate().unwrap();
    bench.service.configure(Box::leak(Box::new(other))).unwrap();
    // One at a time.
    assert!(bench.service.configure(Box::leak(Box::new(other))).is_err());
    assert_eq!(bench.reply(), Err(Refusal::Mode(Mode::Running)));
    assert_eq!(*bench.service.config(), first);
    // They come back as they went.
    let refused = bench.service.unused_config().unwrap();
    assert_eq!(*refused, other);

    bench.command(Command::Disarm).unwrap();
    bench.service.configure(refused).unwrap();
    assert_eq!(bench.reply(), Ok(()));
    assert_eq!(*bench.service.config(), other);
    assert!(bench.service.unused_config().is_some());
    bench.command(Command::Arm).unwrap();
    assert_eq!(bench.command(Command::Drive(Modulation::from_num(0.3))), Err(Refusal::TooLarge));
}

#[test]
fn seven_commands_wait_and_no_more() {
    let mut bench = Bench::new(&Settings::default());
    for _ in 0..7 {
        bench.service.send(Command::Disarm).unwrap();
    }
    assert!(bench.service.send(Command::Disarm).is_err());
    // One is carried out, and there is room for another.
    bench.step();
    bench.step();
    bench.service.send(Command::Disarm).unwrap();
}
