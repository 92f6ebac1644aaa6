//! A tool in the same process as the simulated drive.

pub mod rings;

use hallservo_protocol::*;
use simulator::Simulator;
use simulator::flash::Flash;
use std::sync::LazyLock;

/// Milliseconds that a tool waits.
const PATIENCE: u32 = 300;

pub fn request(id: u16, ask: Ask<'_>) -> Vec<u8> {
    request_of(1, false, id, ask)
}

/// The same of one tool among several.
pub fn request_of(client: u32, unattended: bool, id: u16, ask: Ask<'_>) -> Vec<u8> {
    let mut frame = [0; FRAME];
    let length = encode(&Request { id, client, unattended, ask }, &mut frame).unwrap();
    frame[..length].to_vec()
}

/// Asks, and hands the answer to `understand`; lets the drive's time pass until it comes.
pub fn ask<R>(drive: &mut Simulator, ask: Ask<'_>, understand: impl FnOnce(Answer<'_>) -> R) -> R {
    ask_as(1, drive, ask, understand)
}

/// The same by one tool among several.
pub fn ask_as<R>(client: u32, drive: &mut Simulator, ask: Ask<'_>, understand: impl FnOnce(Answer<'_>) -> R) -> R {
    const ID: u16 = 0xabcd;
    drive.write(&request_of(client, false, ID, ask));
    let mut decoder = Decoder::new();
    for _ in 0..PATIENCE {
        drive.step();
        for byte in drive.read() {
            if let Some(Ok(Reply { id: ID, answer })) = decoder.push(byte) {
                return understand(answer);
            }
        }
    }
    panic!("no answer to {ask:?}");
}

pub fn done(drive: &mut Simulator, what: Ask<'_>) {
    ask(drive, what, |answer| {
        assert!(!matches!(answer, Answer::Refused(_)), "{what:?}: {answer:?}");
    });
}

/// Begins what goes on without a tool that looks at it.
pub fn begin(drive: &mut Simulator, what: Ask<'_>) {
    drive.write(&request_of(1, true, 1, what));
    run(drive, 3);
}

pub fn status(drive: &mut Simulator) -> Status {
    ask(drive, Ask::Status, |answer| match answer {
        Answer::Status(status) => status,
        other => panic!("{other:?}"),
    })
}

pub fn run(drive: &mut Simulator, milliseconds: u32) {
    (0..milliseconds).for_each(|_| drive.step());
}

/// Arms, and waits until wires, amplifiers and commutation have been checked.
pub fn arm(drive: &mut Simulator) {
    done(drive, Ask::Arm);
    while drive.drive().limits().contains(hallservo::fault::Limits::CHECKING) {
        run(drive, 5);
    }
}

/// Waits for what goes on.
pub fn wait(drive: &mut Simulator) {
    for _ in 0..2000 {
        if status(drive).activity == Activity::None {
            return;
        }
        run(drive, 20);
    }
    panic!("it goes on and on");
}

pub fn drive(flash: Flash) -> Simulator {
    Simulator::new(1, flash, Vec::new()).unwrap()
}

/// What the flash of a drive holds that has calibrated itself: one does it for all tests.
static CALIBRATED: LazyLock<Vec<u8>> = LazyLock::new(|| {
    let mut drive = drive(Flash::blank());
    run(&mut drive, 10);
    done(&mut drive, Ask::Calibrate);
    wait(&mut drive);
    drive.flash()
});

/// A drive that is calibrated, just powered up, and what its flash holds.
pub fn calibrated() -> (Simulator, Vec<u8>) {
    let mut drive = drive(Flash::of(CALIBRATED.clone()));
    run(&mut drive, 10);
    (drive, CALIBRATED.clone())
}
