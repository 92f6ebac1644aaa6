//! The board with rings over its heads, calibrated, and what is asked of it.

use crate::common::{self, NUCLEO, run};
use chip::{Chip, Disturbance};
use cortex::Machine;
use hallservo_protocol::{
    Activity, Answer, Ask, Decoder, EncoderAsk, EncoderCalibration, EncoderStatus, Problem, Reply, Status,
};
use plant::PlantParameters;
use std::f64::consts::TAU;
use std::sync::OnceLock;
use virtual_board::firmware;
use virtual_board::outcome::Outcome;
use virtual_board::session::Session;

fn powered_up() -> Session {
    static ELF: OnceLock<Vec<u8>> = OnceLock::new();
    let built = || std::fs::read(firmware::build_with_encoder(NUCLEO).expect("the firmware builds"));
    let elf = ELF.get_or_init(|| built().expect("it is there")).clone();
    Session::new(&common::board(NUCLEO), elf, &PlantParameters::imperfect(1), 1).expect("a session")
}

pub fn disturb(session: &mut Session, disturbance: &Disturbance) {
    let now = session.machine.now();
    session.machine.system.disturb(disturbance, now).expect("the board can");
}

/// Asks, and lets the board's time pass until the answer is there.
fn ask<R>(session: &mut Session, what: Ask<'_>, understand: impl Fn(Answer<'_>) -> R) -> R {
    const ID: u16 = 0x1234;
    session.receive(common::frame(ID, what)).expect("a port");
    let mut decoder = Decoder::new();
    let most_s = session.seconds() + 0.5;
    while session.seconds() < most_s {
        for byte in session.slice(most_s).expect("a run") {
            if let Some(Ok(Reply { id: ID, answer })) = decoder.push(byte) {
                return understand(answer);
            }
        }
    }
    panic!("no answer to {what:?}: {:#?}", session.lines);
}

pub fn done(session: &mut Session, what: Ask<'_>) {
    ask(session, what, |answer| assert!(!matches!(answer, Answer::Refused(_)), "{what:?}: {answer:?}"));
}

pub fn status(session: &mut Session) -> Status {
    ask(session, Ask::Status, |answer| match answer {
        Answer::Status(status) => status,
        other => panic!("{other:?}"),
    })
}

pub fn encoder(session: &mut Session) -> EncoderStatus {
    ask(session, Ask::Encoder(EncoderAsk::Status), |answer| match answer {
        Answer::Encoder(status) => status,
        other => panic!("{other:?}"),
    })
}

fn wait(session: &mut Session) {
    while status(session).activity != Activity::None {
        run(session, 0.05);
        assert!(session.seconds() < 60.0, "it goes on and on");
    }
}

pub fn shaft_rad(session: &Session) -> f64 {
    session.machine.system.truth().mechanical_angle_rad
}

/// A board with Halls, rings and zero calibrated.
pub struct Calibrated {
    pub session: Session,
    /// The shaft's angle at the zero.
    pub zero_rad: f64,
}

impl Calibrated {
    /// It calibrates once for all tests.
    pub fn new() -> Self {
        static DONE: OnceLock<(Machine<Chip>, f64)> = OnceLock::new();
        let (machine, zero_rad) = DONE.get_or_init(calibrate);
        let mut session = powered_up();
        session.machine = machine.clone();
        Self { session, zero_rad: *zero_rad }
    }

    /// The same board, to go another way from here, with its shaft free.
    pub fn fork(&self) -> Session {
        self.session.fork()
    }

    /// The board after a power cycle with something broken since before, the shaft held at an angle.
    pub fn powered_up_at(&self, shaft_rad: f64, broken: Option<plant::heads::Defect>) -> Session {
        let mut session = self.fork();
        if broken.is_some() {
            disturb(&mut session, &Disturbance::Encoder(broken));
        }
        disturb(&mut session, &Disturbance::Hold(Some(shaft_rad)));
        disturb(&mut session, &Disturbance::PowerCycle);
        run(&mut session, 0.05);
        session
    }

    /// Mechanical degrees that the position is off, whole turns aside.
    pub fn error_deg(&self, session: &mut Session) -> f64 {
        let position = status(session).position_turns;
        let error = position - (shaft_rad(session) - self.zero_rad) / TAU;
        360.0 * (error - error.round())
    }
}

fn calibrate() -> (Machine<Chip>, f64) {
    let mut session = powered_up();
    run(&mut session, 0.03);
    done(&mut session, Ask::Calibrate);
    wait(&mut session);
    done(&mut session, Ask::Encoder(EncoderAsk::Calibrate { by_hand: false }));
    wait(&mut session);
    let found = encoder(&mut session);
    assert!(matches!(found.calibration, EncoderCalibration::Done(_)), "{found:?}");
    done(&mut session, Ask::Encoder(EncoderAsk::Zero));
    let zero_rad = shaft_rad(&session);
    run(&mut session, 0.2);
    let found = encoder(&mut session);
    assert!(found.absolute && found.stored == Problem::None, "{found:?}");
    println!("calibrated at {:.1} s: {found:?}", session.seconds());
    assert_eq!(Outcome::of(&session).faults, [""; 0]);
    (session.machine, zero_rad)
}
