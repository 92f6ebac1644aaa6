//! Three linear Halls to an angle, and nothing else: no motor control, no drive, no tasks.
//!
//! ```console
//! $ cargo run --release --example estimator
//! ```
//!
//! The rotor is turned by hand, or by any other motor, once in each direction past a reference angle (here: the
//! simulated bench, which knows where it is). From then on the three sensors alone give the electrical angle.

use hallservo::angle::ElectricalAngle;
use hallservo::hall::Halls;
use hallservo::hall::calibrate::{Collector, Sweep};
use hallservo::hall::estimate::Estimator;
use plant::{Bench, BenchParameters, PlantParameters};
use std::error::Error;

const ADC_BITS: u8 = 12;

fn main() -> Result<(), Box<dyn Error>> {
    // Three imperfect sensors: misplaced by up to 8°, unequal, offset, distorted and noisy, at 1 kHz.
    let motor = PlantParameters::imperfect(1);
    let parameters = BenchParameters {
        halls: motor.halls,
        magnets: motor.magnets,
        adc: motor.adc,
        period_s: 1e-3,
        pole_pairs: 4,
        inertia_kgm2: 1e-5,
        damping_nms: 0.0,
        torque_noise_nm_rthz: 0.0,
    };
    let mut bench = Bench::new(&parameters, 0.0, 0.0, 1)?;

    // 1. Turn both ways and collect: a sample, and the reference angle at which it was taken.
    let mut collector = Collector::new(ADC_BITS);
    for (sweep, speed_rad_s) in [(Sweep::Forward, 3.0), (Sweep::Backward, -3.0)] {
        bench.set_speed(speed_rad_s);
        for number in 0..25_000 {
            let codes = bench.step(0.0);
            collector.push(sweep, angle(bench.angle_rad()), &codes, number);
        }
    }

    // 2. Fit offset, amplitude, placement and harmonics of each sensor; make the integer estimator of them.
    let calibration = collector.finish(Halls::Three, false)?;
    for (k, sensor) in calibration.report.sensors.iter().enumerate() {
        let placement_deg = sensor.placement_error.to_degrees();
        println!("Hall {}: swing {:.0} codes, {placement_deg:+.1}° misplaced", k + 1, sensor.swing);
    }
    let estimator = Estimator::new(&calibration.model, ADC_BITS)?;

    // 3. From now on: three ADC codes in, an angle out, in some 40 instructions, or the reason why there is none.
    let (mut sum, samples) = (0.0, 10_000);
    for _ in 0..samples {
        let codes = bench.step(0.0);
        let estimated = estimator.angle(&codes)?;
        sum += (estimated - angle(bench.angle_rad())).to_degrees().powi(2);
    }
    let rms = (sum / samples as f32).sqrt();
    println!("error of single samples: {rms:.2}° RMS, electrical");
    assert!(rms < 0.6, "{rms}");
    Ok(())
}

/// An integer angle: full scale is one turn, and it wraps.
fn angle(radians: f64) -> ElectricalAngle {
    ElectricalAngle::from_radians(radians as f32)
}
