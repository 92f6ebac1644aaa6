//! The tasks, joined in one future: the supervision once a millisecond, the link both ways, the watchdog.

use crate::Heartbeat;
use crate::request::Step;
use crate::supervisor::Supervisor;
use core::cell::{Cell, RefCell};
use core::future::Future;
use core::pin::pin;
use embassy_futures::join::join4;
use embassy_futures::select::{Either, select};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::channel::Channel;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use embedded_storage::nor_flash::NorFlash;
use hallservo_protocol::{Answer, Decoder, Error, FRAME, Reply, Request, encode};
use heapless::Vec;

/// From tick to tick.
const TICK: Duration = Duration::from_millis(1);
/// From look to look of the watchdog; and how often who waits shows that it lives.
const LOOK: Duration = Duration::from_millis(20);
/// Ticks until a drive that does not answer is given up.
const PATIENCE: u32 = 100;
/// Frames on their way out.
const OUTBOX: usize = 3;

type Frame = Vec<u8, FRAME>;
type Outbox = Channel<NoopRawMutex, Frame, OUTBOX>;

/// The tasks of a drive, to be run. They are one future, so a borrow that is not kept across an `await` meets no other.
pub struct App<F> {
    supervisor: RefCell<Supervisor<F>>,
    outbox: Outbox,
    pulse: Pulse,
}

/// Which tasks have moved since the watchdog was fed last.
#[derive(Default)]
struct Pulse(Cell<u8>);

#[derive(Clone, Copy)]
enum Task {
    Supervision = 1,
    Receiving = 2,
    Sending = 4,
}

impl Pulse {
    const ALL: u8 = 7;

    fn mark(&self, task: Task) {
        self.0.set(self.0.get() | task as u8);
    }

    /// Waits, and shows that it does.
    async fn wait<T>(&self, task: Task, future: impl Future<Output = T>) -> T {
        let mut future = pin!(future);
        loop {
            self.mark(task);
            if let Either::First(output) = select(future.as_mut(), Timer::after(LOOK)).await {
                return output;
            }
        }
    }
}

impl<F: NorFlash> App<F> {
    pub(crate) fn new(supervisor: Supervisor<F>) -> Self {
        Self { supervisor: RefCell::new(supervisor), outbox: Channel::new(), pulse: Pulse::default() }
    }

    /// Before it runs.
    pub(crate) fn supervisor(&mut self) -> &mut Supervisor<F> {
        self.supervisor.get_mut()
    }

    /// Runs everything, for ever. `rx` and `tx` are the serial line: at 460 800 baud, 8N1, where it is one. `feed` feeds the watchdog,
    /// about every 20 ms as long as the control interrupt beats and all tasks move; a calibration's fit and a save keep
    /// them for up to a quarter of a second, so a watchdog needs half a second at least.
    pub async fn run(&self, rx: impl Read, tx: impl Write, alive: &'static Heartbeat, feed: impl FnMut()) -> ! {
        let (never, ..) = join4(self.supervise(alive), self.receive(rx), self.send(tx), self.watch(alive, feed)).await;
        never
    }

    async fn supervise(&self, alive: &Heartbeat) -> ! {
        let mut next = Instant::now();
        loop {
            // After a stall there is no hurry to make up for what was missed, and the others come first: the watchdog among them.
            next = (next + TICK).max(Instant::now() + Duration::from_ticks(1));
            Timer::at(next).await;
            let telemetry = {
                let mut supervisor = self.supervisor.borrow_mut();
                supervisor.tick(Instant::now().as_millis(), alive.sensed());
                supervisor.telemetry()
            };
            if let Some((id, telemetry)) = telemetry {
                let frame = frame(&Reply { id, answer: Answer::Telemetry(telemetry) });
                if self.outbox.try_send(frame).is_err() {
                    let mut supervisor = self.supervisor.borrow_mut();
                    supervisor.lost_frames = supervisor.lost_frames.saturating_add(1);
                }
            }
            self.pulse.mark(Task::Supervision);
        }
    }

    async fn receive(&self, mut rx: impl Read) -> ! {
        let mut decoder = Decoder::new();
        let mut bytes = [0; 64];
        loop {
            match self.pulse.wait(Task::Receiving, rx.read(&mut bytes)).await {
                Ok(length) if length > 0 => {
                    for &byte in bytes.iter().take(length) {
                        if let Some(message) = decoder.push(byte) {
                            self.understand(message).await;
                        }
                    }
                }
                // Noise on the line, or nobody at the other end.
                _ => self.pulse.wait(Task::Receiving, Timer::after(TICK)).await,
            }
        }
    }

    async fn understand(&self, message: Result<Request<'_>, Error>) {
        let reply = match message {
            Ok(Request { id, ask }) => Reply { id, answer: self.answer(id, ask).await },
            Err(error) => {
                let mut supervisor = self.supervisor.borrow_mut();
                supervisor.garbage = supervisor.garbage.saturating_add(1);
                if !matches!(error, Error::Version { .. }) {
                    return;
                }
                // Its version is what the other side has to know.
                Reply { id: 0, answer: supervisor.hello() }
            }
        };
        self.pulse.wait(Task::Receiving, self.outbox.send(frame(&reply))).await;
    }

    async fn answer(&self, id: u16, ask: hallservo_protocol::Ask<'_>) -> Answer<'static> {
        let step = self.supervisor.borrow_mut().begin(id, ask);
        for _ in 0..PATIENCE {
            let answer = match step {
                Step::Answer(answer) => return answer,
                Step::Obeyed(after) => self.supervisor.borrow_mut().obeyed(after),
                Step::Saved => self.supervisor.borrow().kept(),
            };
            if let Some(answer) = answer {
                return answer;
            }
            self.pulse.wait(Task::Receiving, Timer::after(TICK)).await;
        }
        if matches!(step, Step::Obeyed(_)) {
            self.supervisor.borrow_mut().give_up();
        }
        Answer::Refused(hallservo_protocol::Refusal::Silent)
    }

    async fn send(&self, mut tx: impl Write) -> ! {
        loop {
            let frame = self.pulse.wait(Task::Sending, self.outbox.receive()).await;
            // A tool that is gone asks again when it is back.
            if self.pulse.wait(Task::Sending, tx.write_all(&frame)).await.is_ok() {
                let _ = self.pulse.wait(Task::Sending, tx.flush()).await;
            }
        }
    }

    async fn watch(&self, alive: &Heartbeat, mut feed: impl FnMut()) -> ! {
        let mut periods = alive.periods();
        loop {
            Timer::after(LOOK).await;
            if self.pulse.0.get() == Pulse::ALL && alive.periods() != periods {
                periods = alive.periods();
                self.pulse.0.set(0);
                feed();
            }
        }
    }
}

fn frame(reply: &Reply<'_>) -> Frame {
    let mut bytes = [0; FRAME];
    // Every reply fits, which a test shows.
    let length = encode(reply, &mut bytes).unwrap_or(0);
    Vec::from_slice(bytes.get(..length).unwrap_or_default()).unwrap_or_default()
}
