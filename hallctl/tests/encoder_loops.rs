//! Which measurement closes speed and position loop better: the Halls or the encoder. The same motor, the same gains.

use crate::tool::rings::{CALIBRATED, calibrated};
use crate::tool::{arm, done, run};
use hallservo::mode::Mode;
use hallservo_protocol::Ask;
use simulator::Simulator;
use std::f64::consts::TAU;

const POLE_PAIRS: f64 = 4.0;
const PWM_HZ: f64 = 40e3;

/// A drive whose loops are closed by the encoder, or by the Halls.
fn drive(closes_loops: bool, seed: u64) -> Simulator {
    let mut drive = calibrated(1.0, seed);
    done(&mut drive, Ask::Set { name: "encoder_closes_loops", value: u8::from(closes_loops).into() });
    done(&mut drive, Ask::Set { name: "command_timeout_s", value: 60.0 });
    run(&mut drive, 60);
    drive
}

fn rms(values: &[f64]) -> f64 {
    (values.iter().map(|value| value * value).sum::<f64>() / values.len() as f64).sqrt()
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len() as f64
}

fn without_mean(values: &[f64]) -> Vec<f64> {
    let mean = mean(values);
    values.iter().map(|value| value - mean).collect()
}

fn shaft_deg(drive: &Simulator) -> f64 {
    drive.plant.truth().mechanical_angle_rad.to_degrees()
}

/// Mechanical degrees that the loops' position is ahead of the shaft.
fn ahead_deg(drive: &Simulator) -> f64 {
    let position = 360.0 * drive.drive().tracker().smoothed().to_turns() / POLE_PAIRS;
    let ahead = position - shaft_deg(drive);
    // The electrical zero is anywhere; a turn of it is 90° of the shaft.
    let turn = 360.0 / POLE_PAIRS;
    ahead - turn * (ahead / turn).round()
}

/// Mechanical rad/s that the loops see.
fn speed_rad_s(drive: &Simulator) -> f64 {
    f64::from(drive.drive().tracker().speed()) / 4_294_967_296.0 * PWM_HZ * TAU / POLE_PAIRS
}

/// What the loops see of the shaft.
#[derive(Debug)]
struct Seen {
    /// Noise at rest: position, mechanical degrees RMS, and speed, mechanical rad/s RMS.
    noise_deg: f64,
    noise_rad_s: f64,
    /// Error over the turn, RMS and at most, without its mean.
    error_deg: f64,
    largest_deg: f64,
    /// How much later than the shaft at constant speed, µs.
    delay_us: f64,
    /// Ripple of the speed that is seen then, rad/s RMS.
    ripple_rad_s: f64,
}

/// The shaft is held at angles all around, then turned steadily.
fn seen(closes_loops: bool) -> Seen {
    const ANGLES: usize = 24;
    const SPEED_RAD_S: f64 = 40.0;
    let (mut noise_deg, mut noise_rad_s, mut errors) = (Vec::new(), Vec::new(), Vec::new());
    let mut drive = drive(closes_loops, 1);
    // Slowly, so that the count goes with it.
    for _ in 0..ANGLES {
        drive.plant.set_dyno(Some(TAU / ANGLES as f64 / 0.1)).unwrap();
        run(&mut drive, 100);
        drive.plant.set_dyno(Some(0.0)).unwrap();
        run(&mut drive, 30);
        let (mut positions, mut speeds) = (Vec::new(), Vec::new());
        for _ in 0..60 {
            run(&mut drive, 1);
            positions.push(ahead_deg(&drive));
            speeds.push(speed_rad_s(&drive));
        }
        errors.push(mean(&positions));
        noise_deg.extend(without_mean(&positions));
        noise_rad_s.extend(speeds);
    }
    let zero = mean(&errors);
    let errors = without_mean(&errors);
    drive.plant.set_dyno(Some(SPEED_RAD_S)).unwrap();
    run(&mut drive, 100);
    let (mut late, mut speeds) = (Vec::new(), Vec::new());
    // Two turns.
    for _ in 0..(2.0 * TAU / SPEED_RAD_S * 1000.0) as u32 {
        run(&mut drive, 1);
        late.push((zero - ahead_deg(&drive)).to_radians() / SPEED_RAD_S * 1e6);
        speeds.push(speed_rad_s(&drive));
    }
    Seen {
        noise_deg: rms(&noise_deg),
        noise_rad_s: rms(&noise_rad_s),
        error_deg: rms(&errors),
        largest_deg: errors.iter().fold(0.0, |most: f64, error| most.max(error.abs())),
        delay_us: mean(&late),
        ripple_rad_s: rms(&without_mean(&speeds)),
    }
}

#[test]
fn the_encoder_sees_the_shaft_better_than_the_halls_and_no_later() {
    let (halls, encoder) = (seen(false), seen(true));
    println!("by the Halls   {halls:.5?}\nby the encoder {encoder:.5?}");
    assert!(encoder.noise_deg <= halls.noise_deg && encoder.noise_rad_s <= halls.noise_rad_s);
    assert!(encoder.error_deg <= 0.21 * halls.error_deg && encoder.largest_deg <= 0.21 * halls.largest_deg);
    assert!(encoder.delay_us.abs() <= halls.delay_us.abs() + 2.0);
    assert!(encoder.ripple_rad_s <= halls.ripple_rad_s);
}

/// A held position.
#[derive(Debug)]
struct Held {
    /// Motion of the shaft at rest, mechanical degrees RMS, and how far it is from the command.
    motion_deg: f64,
    off_deg: f64,
    /// Under a load that comes at once: how far it gives way at most, in the mean of [`LOADS`], and stays.
    gives_deg: f64,
    stays_deg: f64,
    /// Noise of the torque that holds it then, N·m RMS.
    torque_nm: f64,
}

const LOAD_NM: f64 = 0.02;
/// How often it comes.
const LOADS: usize = 5;

impl Held {
    fn stiffness_mnm(&self) -> f64 {
        1000.0 * LOAD_NM / self.gives_deg
    }
}

/// With bandwidths of tracker, speed and position loop, Hz.
fn held(closes_loops: bool, [tracking, speed, position]: [f32; 3]) -> Held {
    let mut drive = drive(closes_loops, 3);
    for (name, value) in
        [("tracking_bandwidth_hz", tracking), ("speed_bandwidth_hz", speed), ("position_bandwidth_hz", position)]
    {
        done(&mut drive, Ask::Set { name, value });
        run(&mut drive, 10);
    }
    let load_nm = drive.plant.truth().load_nm;
    arm(&mut drive);
    done(&mut drive, Ask::Position(0.3));
    run(&mut drive, 1500);
    let off = |drive: &Simulator| {
        let off = (drive.plant.truth().mechanical_angle_rad - CALIBRATED.1) / TAU - 0.3;
        360.0 * (off - off.round())
    };
    let watch = |drive: &mut Simulator, milliseconds: u32| -> [Vec<f64>; 2] {
        let (mut offs, mut torques) = (Vec::new(), Vec::new());
        for _ in 0..milliseconds {
            run(drive, 1);
            offs.push(off(drive));
            torques.push(drive.plant.truth().torque_nm);
        }
        [offs, torques]
    };
    let [at_rest, _] = watch(&mut drive, 1000);
    let off_deg = mean(&at_rest);
    // A load may come when the noise helps, or when it does not.
    let gives: [f64; LOADS] = std::array::from_fn(|_| {
        drive.plant.set_load(load_nm).unwrap();
        watch(&mut drive, 500);
        drive.plant.set_load(load_nm + LOAD_NM).unwrap();
        let [loaded, _] = watch(&mut drive, 500);
        loaded.iter().fold(0.0, |most: f64, off| most.max((off - off_deg).abs()))
    });
    let [settled, torque] = watch(&mut drive, 1000);
    assert_eq!(drive.drive().mode(), Mode::Running);
    Held {
        motion_deg: rms(&without_mean(&at_rest)),
        off_deg,
        gives_deg: mean(&gives),
        stays_deg: mean(&settled),
        torque_nm: rms(&without_mean(&torque)),
    }
}

#[test]
fn the_encoder_holds_a_position_at_least_as_quietly_and_stiffly_as_the_halls() {
    for bandwidths in [[280.0, 60.0, 15.0], [280.0, 120.0, 40.0]] {
        let (halls, encoder) = (held(false, bandwidths), held(true, bandwidths));
        println!(
            "tracker, speed and position loop of {bandwidths:?} Hz\n  by the Halls   {:.2} mN·m/° {halls:.5?}\n  by the \
             encoder {:.2} mN·m/° {encoder:.5?}",
            halls.stiffness_mnm(),
            encoder.stiffness_mnm()
        );
        assert!(encoder.motion_deg <= halls.motion_deg && encoder.torque_nm <= halls.torque_nm);
        assert!(encoder.gives_deg <= 1.02 * halls.gives_deg);
        assert!(encoder.off_deg.abs() < 0.01 && encoder.stays_deg.abs() < 0.01);
    }
}

/// What the encoder's quiet is worth: gains that the Halls' noise forbids.
#[test]
fn by_the_encoder_a_position_is_held_ten_times_as_stiffly_with_less_noise() {
    let usual = held(false, [280.0, 60.0, 15.0]);
    let stiff = [1000.0, 240.0, 100.0];
    let (halls, encoder) = (held(false, stiff), held(true, stiff));
    for (what, held) in [("the Halls, as shipped", &usual), ("the Halls", &halls), ("the encoder", &encoder)] {
        println!("{:.2} mN·m/° by {what}: {held:.5?}", held.stiffness_mnm());
    }
    assert!(encoder.stiffness_mnm() > 10.0 * usual.stiffness_mnm());
    assert!(encoder.torque_nm < usual.torque_nm && encoder.motion_deg < usual.motion_deg);
    assert!(halls.torque_nm > 3.0 * usual.torque_nm);
}
