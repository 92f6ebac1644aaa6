//! A simulated motor: calibrated by its drive, armed, turned by a voltage, and looked at.
//!
//! ```console
//! $ cargo run --release --example hello
//! ```

mod world;

use hallservo::commutation::modulation;
use hallservo::drive::{Channels, Command, Drive};
use hallservo::hall::estimate::Estimator;
use hallservo::service::{Event, Service};
use hallservo::settings::Settings;
use static_cell::ConstStaticCell;
use std::error::Error;

static CHANNELS: ConstStaticCell<Channels> = ConstStaticCell::new(Channels::new());
static ESTIMATORS: [ConstStaticCell<Estimator>; 2] = [const { ConstStaticCell::new(Estimator::blank()) }; 2];

fn main() -> Result<(), Box<dyn Error>> {
    let config = Settings { pole_pairs: 4, ..Settings::default() }.validate()?;
    let (interrupt, tasks) = CHANNELS.take().split();
    let mut drive = Drive::new(config, interrupt);
    let mut service = Service::new(config, tasks, ESTIMATORS.each_ref().map(ConstStaticCell::take));
    let mut motor = world::Motor::new(1, config.period)?;

    service.send(Command::Calibrate)?;
    for millisecond in 0..5000 {
        // The control interrupt, 40 times a millisecond.
        for _ in 0..40 {
            let output = drive.step(&motor.sample());
            motor.turn(&output);
        }
        // A task: once the drive works with what the calibration has found, it turns the motor.
        while let Some(event) = service.poll() {
            if let Event::Installed(answer) = event {
                answer?;
                service.send(Command::Arm)?;
                service.send(Command::Drive(modulation(0.3)))?;
            }
        }
        if millisecond % 500 == 499 {
            println!("{:3.1} s: {:?}, {:6.2} turns", millisecond as f32 * 1e-3, drive.mode(), motor.turns());
        }
    }
    assert!(motor.turns() > 10.0, "it does not turn");
    Ok(())
}
