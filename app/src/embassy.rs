//! The [`Supervisor`] under embassy: its three calls as one future.

#[cfg(feature = "registers")]
use crate::bus::{Bus, LOOK_MS};
use crate::encoder::Encoder;
use crate::{Readings, Stop, Supervisor};
use core::cell::RefCell;
use core::future::Future;
use core::pin::pin;
#[cfg(feature = "registers")]
use embassy_futures::join::join;
use embassy_futures::join::join4;
use embassy_futures::select::{Either, select};
#[cfg(feature = "registers")]
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer};
use embedded_io_async::{Read, Write};
use embedded_storage::nor_flash::NorFlash;

/// From tick to tick.
const TICK: Duration = Duration::from_millis(1);
/// From check to check of the watchdog. A direction of the line that waits shows as often that it is served.
const CHECK: Duration = Duration::from_millis(20);
/// Bytes read or written at once.
const PIECE: usize = 64;

/// One future, so a borrow that is not kept across an `await` meets no other.
type Shared<'a, F, E> = RefCell<&'a mut Supervisor<F, E>>;

/// Runs a supervisor for ever. `rx` and `tx` are the serial line: at 460 800 baud, 8N1, where it is one; `stop` is
/// what a [`Listener`](crate::Listener) there reports to, if there is one; `readings` is what the control interrupt has
/// noted last, such as [`Housekeeping::read`](crate::Housekeeping::read). `feed` feeds
/// the watchdog, about every 20 ms as long as the control interrupt and all tasks run; a calibration's fit and a write
/// to the flash stall them for up to a quarter of a second, so a watchdog needs half a second at least.
pub async fn run<F: NorFlash, E: Encoder>(
    supervisor: &mut Supervisor<F, E>,
    rx: impl Read,
    tx: impl Write,
    readings: impl Fn() -> Readings,
    stop: &Stop,
    feed: impl FnMut(),
) -> ! {
    let shared = RefCell::new(supervisor);
    let shared = &shared;
    let (never, ..) =
        join4(tick(shared, readings, stop), receive(shared, rx), transmit(shared, tx), watch(shared, feed)).await;
    never
}

/// The same beside a bus.
#[cfg(feature = "registers")]
pub async fn run_with_bus<F: NorFlash, E: Encoder>(
    supervisor: &mut Supervisor<F, E>,
    (rx, tx): (impl Read, impl Write),
    readings: impl Fn() -> Readings,
    stop: &Stop,
    feed: impl FnMut(),
    bus: impl Bus,
) -> ! {
    let shared = RefCell::new(supervisor);
    let shared = &shared;
    let line = join4(tick(shared, readings, stop), receive(shared, rx), transmit(shared, tx), watch(shared, feed));
    let ((never, ..), _) = join(line, carry(shared, bus)).await;
    never
}

/// One frame after the other, each with its reply. While a flood lasts the other tasks come between any two.
#[cfg(feature = "registers")]
async fn carry<F: NorFlash, E: Encoder>(supervisor: &Shared<'_, F, E>, mut bus: impl Bus) -> ! {
    let mut listens = None;
    loop {
        let address = supervisor.borrow().bus_address();
        if listens != Some(address) {
            listens = Some(address);
            supervisor.borrow_mut().set_bus(address, bus.serial());
            bus.listen(address);
        }
        supervisor.borrow_mut().set_bus_health(bus.health());
        let Either::First(request) = select(bus.receive(), after(Duration::from_millis(LOOK_MS))).await else {
            bus.look_after();
            continue;
        };
        while supervisor.borrow().is_busy() {
            after(TICK).await;
        }
        let reply = supervisor.borrow_mut().frame(&request);
        if let Some(reply) = reply {
            bus.send(&reply).await;
        }
        yield_now().await;
    }
}

async fn tick<F: NorFlash, E: Encoder>(
    supervisor: &Shared<'_, F, E>,
    readings: impl Fn() -> Readings,
    stop: &Stop,
) -> ! {
    let mut next = now();
    loop {
        // Ticks missed in a stall are not made up for, and the other tasks come first: the watchdog among them.
        next = (next + TICK).max(now() + Duration::from_ticks(1));
        Timer::at(next).await;
        let mut supervisor = supervisor.borrow_mut();
        supervisor.tick(now().as_millis(), readings());
        if let Some(dealt) = supervisor.dealt_with() {
            stop.release(&dealt);
        }
    }
}

async fn receive<F: NorFlash, E: Encoder>(supervisor: &Shared<'_, F, E>, mut rx: impl Read) -> ! {
    let mut piece = [0; PIECE];
    loop {
        // Noise on the line is no byte.
        let length = waiting(rx.read(&mut piece), || _ = supervisor.borrow_mut().receive(&[])).await.unwrap_or(0);
        let mut bytes = piece.get(..length).unwrap_or_default();
        while !bytes.is_empty() {
            let taken = supervisor.borrow_mut().receive(bytes);
            bytes = bytes.get(taken..).unwrap_or_default();
            if !bytes.is_empty() {
                after(TICK).await;
            }
        }
        if length == 0 {
            supervisor.borrow_mut().receive(&[]);
            after(TICK).await;
        }
    }
}

async fn transmit<F: NorFlash, E: Encoder>(supervisor: &Shared<'_, F, E>, mut tx: impl Write) -> ! {
    let mut piece = [0; PIECE];
    loop {
        let length = supervisor.borrow_mut().transmit(&mut piece);
        let bytes = piece.get(..length).unwrap_or_default();
        let served = || _ = supervisor.borrow_mut().transmit(&mut []);
        let sent = async { if bytes.is_empty() { tx.flush().await } else { tx.write_all(bytes).await } };
        // A tool that is gone asks again when it is back.
        let _ = waiting(sent, served).await;
        if bytes.is_empty() {
            after(TICK).await;
        }
    }
}

async fn watch<F: NorFlash, E: Encoder>(supervisor: &Shared<'_, F, E>, mut feed: impl FnMut()) -> ! {
    loop {
        after(CHECK).await;
        if supervisor.borrow_mut().is_alive() {
            feed();
        }
    }
}

/// One copy of what would be inlined wherever it is called.
#[inline(never)]
fn after(duration: Duration) -> Timer {
    Timer::after(duration)
}

/// The same.
#[inline(never)]
fn now() -> Instant {
    Instant::now()
}

/// Waits for a future, calling `served` from time to time.
async fn waiting<T>(future: impl Future<Output = T>, mut served: impl FnMut()) -> T {
    let mut future = pin!(future);
    loop {
        if let Either::First(output) = select(future.as_mut(), after(CHECK)).await {
            return output;
        }
        served();
    }
}
