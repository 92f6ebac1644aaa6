//! Whatever is sampled and commanded.

use super::*;

#[derive(Clone, Debug)]
enum Action {
    Halls(Codes),
    Turn(f32),
    Command(u8, i16),
}

fn action() -> impl Strategy<Value = Action> {
    prop_oneof![
        1 => any::<Codes>().prop_map(Action::Halls),
        1 => proptest::array::uniform3(0..4096_u16).prop_map(Action::Halls),
        8 => (-0.06_f32..0.06).prop_map(Action::Turn),
        2 => (any::<u8>(), any::<i16>()).prop_map(|(kind, bits)| Action::Command(kind, bits)),
    ]
}

/// What the default settings leave for sampling the currents and for the dead time.
fn highest(bench: &Bench) -> u16 {
    crate::pwm::highest_compare(bench.config.period, 170e6, 1e-6, 500e-9)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(300))]
    /// Whatever is sampled and commanded: compare values stay in the limits, and the bridge is on only in a state that
    /// drives.
    #[test]
    fn no_sequence_leaves_the_limits(
        actions in proptest::collection::vec(action(), 1..400), block: bool, reversed: bool,
    ) {
        let commutation = if block { Commutation::Block } else { Commutation::Sinusoidal };
        let mut bench = Bench::running_with(&Settings { commutation, reversed, ..Settings::default() });
        let highest = highest(&bench);
        for action in actions {
            let output = match action {
                Action::Halls(halls) => bench.step_with(halls),
                Action::Turn(turns) => {
                    bench.rotor += ElectricalAngle::from_turns(turns);
                    bench.step()
                }
                Action::Command(kind, bits) => {
                    let command = match kind % 6 {
                        0 => Command::Arm,
                        1 => Command::Disarm,
                        2 => Command::Clear,
                        3 => Command::Calibrate,
                        _ => Command::Drive(Modulation::from_bits(bits)),
                    };
                    let _ = bench.service.send(command);
                    bench.step()
                }
            };
            while bench.service.poll().is_some() {}
            prop_assert_eq!(output.legs != Legs::NONE, bench.mode().drives());
            if output.legs != Legs::NONE {
                prop_assert!(output.compare.iter().all(|&compare| compare <= highest), "{:?}", output);
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    /// The same with current control, whatever is followed, with plausible and with impossible codes.
    #[test]
    fn no_sequence_leaves_the_limits_with_current_control(
        steps in prop::collection::vec(
            (any::<[u16; 3]>(), any::<[u16; 3]>(), any::<u16>(), 0..12_u8, any::<i32>()), 1..300,
        ),
        commutation in 0..3_usize, wild in any::<bool>(),
    ) {
        let commutation = [Commutation::FieldOriented, Commutation::Sinusoidal, Commutation::Block][commutation];
        let mut bench = with_control(commutation, |control| control.field_weakening_a = 2.0);
        let highest = highest(&bench);
        bench.command(Command::Arm).unwrap();
        for (halls, currents, bus, what, value) in steps {
            let command = match what {
                0 => Some(Command::Current(Current(value >> 18))),
                1 => Some(Command::Speed(Speed(value >> 6))),
                2 => Some(Command::Position(Position::from_bits(i64::from(value) << 8))),
                3 => Some(Command::Drive(Modulation::from_bits(value as i16))),
                4 => Some(Command::Clear),
                5 => Some(Command::Arm),
                6 => Some(impedance(&bench.config, Motion::to(f64::from(value >> 24)))),
                7 => Some(impedance(&bench.config, at_once(f64::from(value) / 4e9, (value >> 23) as f32))),
                8 => Some(impedance(&bench.config, Motion::Within { least_turns: None, most_turns: Some(-0.1) })),
                _ => None,
            };
            if let Some(command) = command {
                let _ = bench.service.send(command);
            }
            bench.rotor += ElectricalAngle::from_bits(value >> 8);
            // Codes within the allowed keep it running; any codes at all must do no harm either.
            let codes = |codes: [u16; 3]| codes.map(|code| if wild { code } else { 2048 + code % 1000 - 500 });
            let sample = Sample {
                halls: if wild { halls } else { bench.model.codes(bench.rotor) },
                currents: codes(currents),
                bus: if wild { bus } else { 1500 + bus % 2000 },
                ..healthy([0; 3])
            };
            let output = bench.drive.step(&sample);
            prop_assert!(output.compare.iter().all(|&compare| compare <= highest), "{output:?}");
            prop_assert!(bench.mode().drives() || output == Output::OFF);
            while bench.service.poll().is_some() {}
        }
    }
}
