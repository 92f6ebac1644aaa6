//! What the tasks get to see.

use super::*;

#[test]
fn records_are_decimated_and_numbered() {
    let mut bench = Bench::running();
    let mut sequences = Vec::new();
    for _ in 0..4000 {
        bench.step();
        while let Some(event) = bench.service.poll() {
            if let service::Event::Record(record) = event {
                sequences.push(record.sequence);
            }
        }
    }
    assert!((99..=101).contains(&sequences.len()), "{}", sequences.len());
    assert!(sequences.windows(2).all(|pair| pair[1] - pair[0] == 40));
}

#[test]
fn a_fault_is_told_at_once_and_the_numbers_stay_right() {
    for extra in 0..80 {
        let mut bench = Bench::running();
        let mut steps = 0_u32;
        let mut last = None;
        let mut number = |bench: &mut Bench, halls: Option<Codes>| {
            let halls = halls.unwrap_or_else(|| bench.model.codes(bench.rotor));
            bench.step_with(halls);
            steps += 1;
            while let Some(event) = bench.service.poll() {
                if let service::Event::Record(record) = event {
                    if let Some((sequence, at)) = last {
                        assert_eq!(record.sequence - sequence, steps - at, "{extra}");
                    }
                    last = Some((record.sequence, steps));
                }
            }
            (bench.mode(), last)
        };
        for _ in 0..100 + extra {
            number(&mut bench, None);
        }
        let mut told = None;
        for k in 0..200 {
            let (mode, record) = number(&mut bench, Some([0; 3]));
            if mode != Mode::Running && told.is_none() {
                told = Some(k + 1);
                continue;
            }
            if told == Some(k) {
                // By the step that found it, or the next.
                let at = record.map_or(0, |(_, at)| at);
                assert!((100 + extra + k..=100 + extra + k + 1).contains(&at), "{extra} {k} {at}");
            }
        }
        assert!(told.is_some());
    }
}

#[test]
fn records_while_following_are_numbered_and_come_as_often() {
    for end in [Command::Disarm, Command::Trip(Fault::Encoder)] {
        let mut bench = with_control(Commutation::FieldOriented, |_| ());
        bench.command(Command::Arm).unwrap();
        let (mut rotors, mut records, mut states) = (Vec::new(), Vec::new(), Vec::new());
        let mut run = |bench: &mut Bench, count: u32| {
            for _ in 0..count {
                bench.rotor += ElectricalAngle::from_degrees(1.0);
                bench.step();
                let now = rotors.len() as u32;
                rotors.push(*bench.drive.tracker());
                while let Some(event) = bench.service.poll() {
                    if let service::Event::Record(record) = event {
                        records.push((record, now));
                    }
                }
                while let Some(measurement) = bench.service.measurement() {
                    states.push((measurement, now));
                }
            }
        };
        run(&mut bench, 100);
        // The rotor turns whatever is commanded, and no current flows.
        bench.service.send(Command::Current(Current(0))).unwrap();
        run(&mut bench, 8000);
        assert_eq!(bench.drive.mode(), Mode::Running);
        bench.service.send(end).unwrap();
        run(&mut bench, 900);
        // Following from arming on, the first record is told in the next step, too.
        let start = records[0].1.wrapping_sub(1).wrapping_sub(records[0].0.sequence);
        let index = |sequence: u32| sequence.wrapping_add(start) as usize;
        // The number is that of the step whose rotor it is; while following, it is told in the next.
        for (record, now) in &records {
            assert!((0..=1).contains(&(*now as usize - index(record.sequence))), "{record:?} {now}");
            assert_eq!(record.rotor, rotors[index(record.sequence)], "{record:?}");
        }
        // Regularly, from arming on to the end; a fault is told at once.
        let irregular =
            records.windows(2).filter(|pair| pair[1].0.sequence.wrapping_sub(pair[0].0.sequence) != CYCLE).count();
        assert!(irregular <= 1, "{records:?}");
        assert!((281..=283).contains(&records.len()), "{}", records.len());
        // Noted down in slot 13, of the step before, and handed over in slot 31.
        for (measurement, now) in states.iter().skip(5) {
            assert_eq!(*now as usize - index(measurement.sequence), 19);
            assert_eq!(measurement.rotor, rotors[index(measurement.sequence)], "{measurement:?}");
        }
        assert!((250..=254).contains(&states.len()), "{}", states.len());
    }
}
