//! Several tools at one drive, by way of the hub: who is answered, who gets how much telemetry, and what happens when
//! one vanishes. The drive is in this process, and its time is counted.

use crate::tool::{calibrated, drive, request_of, run};
use hallctl::hub::{Hub, To, Tool};
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo_protocol::{Answer, Ask, Decoder, Refusal, Reply};
use simulator::Simulator;
use simulator::flash::Flash;
use std::collections::BTreeMap;

/// A drive, the hub, and what each tool has heard.
struct Bench {
    drive: Simulator,
    hub: Hub,
    heard: BTreeMap<Tool, Vec<u8>>,
    /// Milliseconds until a motor that is being braked is switched off.
    later_ms: Option<u32>,
}

impl Bench {
    fn ready() -> Self {
        let (_, flash) = calibrated();
        let mut drive = drive(Flash::of(flash));
        run(&mut drive, 10);
        Self { drive, hub: Hub::new(), heard: BTreeMap::new(), later_ms: None }
    }

    fn attach(&mut self) -> Tool {
        self.hub.attach().0
    }

    fn ask(&mut self, tool: Tool, id: u16, ask: Ask<'_>) {
        let to = self.hub.ask(tool, request_of(tool, false, id, ask));
        self.carry(to);
    }

    fn detach(&mut self, tool: Tool) {
        let out = self.hub.detach(tool);
        self.carry(out);
    }

    fn carry(&mut self, out: impl IntoIterator<Item = To>) {
        for to in out {
            match to {
                To::Drive(frame) => self.drive.write(&frame),
                To::Later => self.later_ms = Some(60),
                To::Answered(tool, frame) | To::Told(tool, frame) => self.heard.entry(tool).or_default().extend(frame),
            }
        }
    }

    fn pass(&mut self, milliseconds: u32) {
        for _ in 0..milliseconds {
            self.drive.step();
            let bytes = self.drive.read();
            let out = self.hub.hear(&bytes);
            self.carry(out);
            self.later_ms = self.later_ms.map(|left| left - 1);
            if self.later_ms.take_if(|left| *left == 0).is_some() {
                let off = self.hub.braked();
                self.carry(off);
            }
        }
    }

    /// Hands what a tool has heard since the last call to `take`.
    fn hear(&mut self, tool: Tool, mut take: impl FnMut(u16, Answer<'_>)) {
        let mut decoder = Decoder::new();
        for byte in self.heard.remove(&tool).unwrap_or_default() {
            if let Some(reply) = decoder.push::<Reply<'_>>(byte) {
                let Reply { id, answer } = reply.unwrap();
                take(id, answer);
            }
        }
    }

    /// Numbers and steps of the telemetry that a tool has heard under a number.
    fn telemetry(&mut self, tool: Tool, wanted: u16) -> Vec<(u32, u32)> {
        let mut frames = Vec::new();
        self.hear(tool, |id, answer| {
            if let Answer::Telemetry(telemetry) = answer {
                assert_eq!(id, wanted);
                frames.push((telemetry.number, telemetry.step));
            }
        });
        frames
    }

    fn mode(&self) -> Mode {
        self.drive.drive().mode()
    }
}

#[test]
fn answers_go_to_whom_they_belong() {
    let mut bench = Bench::ready();
    let tools = [bench.attach(), bench.attach(), bench.attach()];
    // All with the same number.
    bench.ask(tools[0], 7, Ask::Hello);
    bench.ask(tools[1], 7, Ask::Get("pole_pairs"));
    bench.ask(tools[2], 7, Ask::Arm);
    bench.pass(20);
    let mut kinds = Vec::new();
    for tool in tools {
        bench.hear(tool, |id, answer| {
            kinds.push((
                id,
                match answer {
                    Answer::Hello(_) => 0,
                    Answer::Setting(_) => 1,
                    Answer::Done => 2,
                    _ => 3,
                },
            ));
        });
    }
    assert_eq!(kinds, [(7, 0), (7, 1), (7, 2)]);
}

#[test]
fn each_has_the_telemetry_that_it_wants_and_none_is_missing() {
    let mut bench = Bench::ready();
    let (slow, fast) = (bench.attach(), bench.attach());
    bench.ask(slow, 1, Ask::Telemetry(100.0));
    bench.pass(500);
    bench.ask(fast, 2, Ask::Telemetry(1000.0));
    bench.pass(500);
    // Another one comes and wants none, and goes.
    let third = bench.attach();
    bench.ask(third, 3, Ask::Telemetry(0.0));
    bench.pass(500);
    bench.detach(fast);
    bench.pass(500);
    for (tool, id, frames) in [(slow, 1, 195..=205), (fast, 2, 985..=1001)] {
        let heard = bench.telemetry(tool, id);
        assert!(frames.contains(&heard.len()), "{}", heard.len());
        assert!(heard.windows(2).all(|pair| pair[1].0 == pair[0].0 + 1 && pair[1].1 > pair[0].1));
    }
    assert_eq!(bench.telemetry(third, 3).len(), 0);
    // The last one ends it.
    bench.detach(slow);
    bench.detach(third);
    bench.pass(20);
    bench.drive.read();
    run(&mut bench.drive, 100);
    assert!(bench.drive.read().is_empty());
}

#[test]
fn the_motor_rests_and_the_bridge_is_off_soon_after_the_tool_that_controls_has_vanished() {
    let mut bench = Bench::ready();
    let (watcher, turner) = (bench.attach(), bench.attach());
    bench.ask(turner, 1, Ask::Arm);
    bench.pass(20);
    while bench.drive.drive().limits().contains(Limits::CHECKING) {
        bench.pass(10);
    }
    bench.ask(turner, 2, Ask::Speed(50.0));
    // Another one tries, and must not count as the one that controls.
    bench.ask(watcher, 1, Ask::Speed(-50.0));
    bench.pass(200);
    let mut refused = false;
    bench.hear(watcher, |_, answer| refused |= matches!(answer, Answer::Refused(Refusal::Controlled)));
    assert!(refused);
    bench.detach(watcher);
    bench.pass(20);
    assert_eq!(bench.mode(), Mode::Running);
    bench.detach(turner);
    bench.pass(63);
    assert_eq!(bench.mode(), Mode::Ready);
    let speed_rad_s = bench.drive.plant.truth().speed_rad_s;
    assert!(speed_rad_s.abs() < 2.0, "{speed_rad_s}");
}

#[test]
fn a_motor_that_is_braked_is_not_switched_off_under_the_next_tool() {
    let mut bench = Bench::ready();
    let (first, second) = (bench.attach(), bench.attach());
    bench.ask(first, 1, Ask::Arm);
    bench.pass(20);
    bench.ask(first, 2, Ask::Speed(50.0));
    bench.pass(20);
    bench.detach(first);
    bench.pass(30);
    // Another one stops it, and begins anew.
    bench.ask(second, 1, Ask::Disarm);
    bench.pass(10);
    bench.ask(second, 2, Ask::Arm);
    bench.pass(100);
    assert_eq!(bench.mode(), Mode::Running);
}

#[test]
fn what_waited_does_not_arm_after_a_stop() {
    let mut bench = Bench::ready();
    let (first, second, third) = (bench.attach(), bench.attach(), bench.attach());
    bench.ask(first, 1, Ask::Arm);
    bench.pass(20);
    bench.detach(first);
    bench.ask(second, 1, Ask::Arm);
    bench.ask(third, 1, Ask::Disarm);
    bench.pass(1000);
    assert_eq!(bench.mode(), Mode::Ready);
    let mut heard = Vec::new();
    bench.hear(second, |id, answer| heard.push((id, matches!(answer, Answer::Refused(Refusal::Controlled)))));
    assert_eq!(heard, [(1, true)]);
}

#[test]
fn the_next_tool_waits_until_the_one_that_vanished_controls_no_more() {
    let mut bench = Bench::ready();
    let (first, second, third) = (bench.attach(), bench.attach(), bench.attach());
    bench.ask(first, 1, Ask::Arm);
    bench.pass(20);
    bench.detach(first);
    bench.ask(second, 1, Ask::Arm);
    // One that has gone itself wants nothing any more, and a look waits for nobody.
    bench.ask(third, 1, Ask::Speed(50.0));
    bench.detach(third);
    bench.ask(second, 2, Ask::Status);
    bench.pass(50);
    let mut answers = Vec::new();
    bench.hear(second, |id, _| answers.push(id));
    assert_eq!(answers, [2]);
    bench.pass(30);
    bench.hear(second, |id, answer| assert!(id == 1 && answer == Answer::Done, "{answer:?}"));
    bench.pass(500);
    assert_eq!(bench.mode(), Mode::Running);
    let speed_rad_s = bench.drive.plant.truth().speed_rad_s;
    assert!(speed_rad_s.abs() < 2.0, "{speed_rad_s}");
}

#[test]
fn what_turns_the_motor_by_itself_is_braked_as_well() {
    for (ask, speed_rad_s) in
        [(Ask::Identify, 50.0), (Ask::LearnCogging, 2.0), (Ask::Swing, 10.0), (Ask::Calibrate, 14.0)]
    {
        let mut bench = Bench::ready();
        let tool = bench.attach();
        bench.ask(tool, 1, ask);
        let turns = |bench: &Bench| bench.drive.plant.truth().speed_rad_s.abs();
        let waited = (0..5000).find(|_| {
            bench.pass(1);
            // The check at arming turns it, too.
            turns(&bench) > speed_rad_s && !bench.drive.drive().limits().contains(Limits::CHECKING)
        });
        assert!(waited.is_some(), "{ask:?}");
        bench.detach(tool);
        bench.pass(30);
        // It is braked all the while, and not let go.
        assert!(bench.mode().drives(), "{ask:?}");
        bench.pass(33);
        assert!(!bench.mode().drives(), "{ask:?}");
        assert!(turns(&bench) < 2.0, "{ask:?}: {}", turns(&bench));
    }
}

#[test]
fn one_that_has_released_the_control_is_not_missed() {
    let mut bench = Bench::ready();
    let turner = bench.attach();
    bench.ask(turner, 1, Ask::Arm);
    bench.pass(20);
    bench.ask(turner, 2, Ask::Speed(50.0));
    bench.pass(5);
    bench.ask(turner, 3, Ask::Release);
    bench.pass(5);
    bench.detach(turner);
    bench.pass(100);
    assert_eq!(bench.mode(), Mode::Running);
}

#[test]
fn one_that_vanishes_before_its_answer_has_come_is_missed() {
    let mut bench = Bench::ready();
    let turner = bench.attach();
    bench.ask(turner, 1, Ask::Calibrate);
    bench.detach(turner);
    bench.pass(63);
    assert!(!bench.mode().drives(), "{:?}", bench.mode());
}

#[test]
fn garbage_from_the_drive_is_everybodys_and_ends_nothing() {
    let mut bench = Bench::ready();
    let tools = [bench.attach(), bench.attach()];
    let out = bench.hub.hear(&[1, 2, 3, 0]);
    assert_eq!(out.len(), 2);
    // Without an end it is passed on all the same, in pieces.
    let out = bench.hub.hear(&[9; 5000]);
    let passed: usize = out.iter().map(|to| if let To::Told(_, frame) = to { frame.len() } else { 0 }).sum();
    assert!((2 * 4000..=2 * 5000).contains(&passed), "{passed}");
    bench.hub.hear(&[0]);
    bench.ask(tools[0], 5, Ask::Hello);
    bench.pass(5);
    let mut greeted = false;
    bench.hear(tools[0], |id, answer| greeted |= id == 5 && matches!(answer, Answer::Hello(_)));
    assert!(greeted);
}
