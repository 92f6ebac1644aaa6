//! An interrupt and a loop that share nothing but the drive's lock-free queues, as in RTIC: here, two threads.
//!
//! ```console
//! $ cargo run --release --example rtic_like
//! ```
//!
//! In an RTIC application, `drive` and `motor` are the `local` resources of the task bound to the ADC's interrupt, at
//! the highest priority; `supervisor` is that of a low one, started each millisecond. Nothing is locked between them.

mod world;

use hallservo::drive::Drive;
use hallservo_app::{Housekeeping, Identity, Memory, Supervisor};
use hallservo_protocol::Ask;
use static_cell::ConstStaticCell;
use std::error::Error;
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use world::{Flash, Line, Motor, Tool};

static MEMORY: ConstStaticCell<Memory<Flash>> = ConstStaticCell::new(Memory::new());
static HOUSEKEEPING: Housekeeping = Housekeeping::new();

/// The task of the ADC's interrupt. The timer of the simulated chip starts it 40 times a millisecond.
fn control_interrupt(drive: &mut Drive, motor: &mut Motor) {
    let sample = motor.sample();
    HOUSEKEEPING.update(&sample);
    let output = drive.step(&sample);
    motor.turn(&output);
}

/// The task of each millisecond.
fn tasks(supervisor: &mut Supervisor<Flash>, now_ms: u64, line: &mut Line) {
    supervisor.tick(now_ms, HOUSEKEEPING.read());
    let taken = supervisor.receive(line.to_drive.make_contiguous());
    line.to_drive.drain(..taken);
    let mut bytes = [0; 64];
    let length = supervisor.transmit(&mut bytes);
    line.from_drive.extend(&bytes[..length]);
}

fn main() -> Result<(), Box<dyn Error>> {
    let settings = world::settings();
    let identity = Identity { board: "my board", firmware: "1.0", serial: [1, 2, 3] };
    let (drive, supervisor) = Supervisor::start(identity, settings, Flash::second(), 0, MEMORY.take())?;
    let motor = Motor::new(2, settings.validate()?.period)?;
    // The clock of the simulated chip: a millisecond begins for both at once, and both are done before the next.
    let (clock, ticks) = sync_channel(0);
    std::thread::scope(|scope| {
        scope.spawn(move || interrupts(drive, motor, &ticks));
        converse(supervisor, clock)
    })
}

fn interrupts(drive: &mut Drive, mut motor: Motor, ticks: &Receiver<()>) {
    while ticks.recv().is_ok() {
        (0..40).for_each(|_| control_interrupt(drive, &mut motor));
    }
}

fn converse(supervisor: &mut Supervisor<Flash>, clock: SyncSender<()>) -> Result<(), Box<dyn Error>> {
    let (mut tool, mut now_ms) = (Tool::default(), 0);
    let mut millisecond = move |line: &mut Line| {
        now_ms += 1;
        // A clock that nobody listens to any more shows as a drive that does not answer.
        let _ = clock.send(());
        tasks(supervisor, now_ms, line);
    };
    tool.ask(Ask::Calibrate, &mut millisecond)?;
    let calibrated = tool.wait(&mut millisecond)?.calibrated;
    tool.ask(Ask::Arm, &mut millisecond)?;
    for _ in 0..1500 {
        tool.ask(Ask::Position(3.0), &mut millisecond)?; // it holds for a second
    }
    let turns = tool.status(&mut millisecond)?.position_turns;
    println!("calibrated: {calibrated}; at {turns:.3} turns of 3");
    assert!((turns - 3.0).abs() < 0.01, "{turns}");
    tool.ask(Ask::Disarm, &mut millisecond)?;
    Ok(())
}
