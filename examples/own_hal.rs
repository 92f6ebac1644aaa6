//! A port to a board of one's own: a control interrupt, a bare-metal main loop, and no runtime.
//!
//! ```console
//! $ cargo run --release --example own_hal
//! ```
//!
//! A port writes `Port`; calibration, adaptation, storage and protocol come with it. `world` is chip, motor and tool.

mod world;

use hallservo::drive::Drive;
use hallservo::settings::Error as BadSetting;
use hallservo_app::{Housekeeping, Identity, Memory, Supervisor};
use hallservo_protocol::Ask;
use static_cell::ConstStaticCell;
use std::error::Error;
use world::{Flash, Line, Motor, Tool};

static MEMORY: [ConstStaticCell<Memory<Flash>>; 2] = [const { ConstStaticCell::new(Memory::new()) }; 2];
static HOUSEKEEPING: Housekeeping = Housekeeping::new();

struct Port {
    motor: Motor,
    drive: &'static mut Drive,
    supervisor: &'static mut Supervisor<Flash>,
    now_ms: u64,
}

impl Port {
    fn power_up(motor: Motor, memory: &'static mut Memory<Flash>) -> Result<Self, BadSetting<'static>> {
        let identity = Identity { board: "my board", firmware: "1.0", serial: [1, 2, 3] };
        let (drive, supervisor) = Supervisor::start(identity, world::settings(), Flash::first(), 0, memory)?;
        Ok(Self { motor, drive, supervisor, now_ms: 0 })
    }

    /// At the end of the ADCs' conversions, once a PWM period.
    fn control_interrupt(&mut self) {
        let sample = self.motor.sample();
        HOUSEKEEPING.update(&sample);
        let output = self.drive.step(&sample);
        self.motor.turn(&output);
    }

    /// The main loop's share of a millisecond.
    fn main_loop(&mut self, line: &mut Line) {
        self.now_ms += 1;
        self.supervisor.tick(self.now_ms, HOUSEKEEPING.read());
        let taken = self.supervisor.receive(line.to_drive.make_contiguous());
        line.to_drive.drain(..taken);
        let mut bytes = [0; 64];
        let length = self.supervisor.transmit(&mut bytes);
        line.from_drive.extend(&bytes[..length]);
        // Here a board feeds its watchdog, if `self.supervisor.is_alive()`.
    }

    fn millisecond(&mut self, line: &mut Line) {
        (0..40).for_each(|_| self.control_interrupt());
        self.main_loop(line);
    }
}

fn main() -> Result<(), Box<dyn Error>> {
    let [first, second] = MEMORY.each_ref().map(ConstStaticCell::take);
    let motor = Motor::new(1, world::settings().validate()?.period)?;
    let (mut port, mut tool) = (Port::power_up(motor, first)?, Tool::default());
    tool.ask(Ask::Calibrate, |line| port.millisecond(line))?;
    println!("calibrated: {}", tool.wait(|line| port.millisecond(line))?.calibrated);
    // The power goes, and comes back: what was found is in the flash.
    let mut port = Port::power_up(port.motor, second)?;
    (0..100).for_each(|_| port.millisecond(&mut Line::default()));
    tool.ask(Ask::Arm, |line| port.millisecond(line))?;
    (0..1000).for_each(|_| port.millisecond(&mut Line::default())); // checks wires, amplifiers and commutation
    tool.ask(Ask::Speed(50.0), |line| port.millisecond(line))?;
    (0..500).for_each(|_| port.millisecond(&mut Line::default()));
    let speed = tool.status(|line| port.millisecond(line))?.speed_rad_s;
    println!("turns with {speed:.1} rad/s of 50");
    assert!((speed - 50.0).abs() < 2.0, "{speed}");
    tool.ask(Ask::Disarm, |line| port.millisecond(line)).map(|_| ())
}
