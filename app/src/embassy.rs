//! The [`Supervisor`] under embassy: its three calls in one future.

mod clock;
mod line;

#[cfg(feature = "registers")]
use crate::bus::{Bus, LOOK_MS};
use crate::encoder::Encoder;
use crate::{Readings, Stop, Supervisor};
use clock::Clock;
#[cfg(feature = "registers")]
use core::cell::RefCell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::{Context, Poll};
#[cfg(feature = "registers")]
use embassy_futures::join::join;
#[cfg(feature = "registers")]
use embassy_futures::select::{Either, select};
#[cfg(feature = "registers")]
use embassy_futures::yield_now;
#[cfg(feature = "registers")]
use embassy_time::Timer;
use embedded_io_async::{Read, Write};
use embedded_storage::nor_flash::NorFlash;
use line::Line;

/// Runs a supervisor for ever. `rx` and `tx` are the serial line: at 460 800 baud, 8N1, where it is one. A read or a write
/// that is dropped before it is done has to leave its bytes to the next one, as those of buffered drivers do. `stop` is
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
    let (mut clock, mut line) = (Clock::new(readings, stop, feed), Line::new(rx, tx));
    for_ever(|context| {
        clock.poll(supervisor, context);
        line.poll(supervisor, context);
    })
    .await
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
    let (mut clock, mut line) = (Clock::new(readings, stop, feed), Line::new(rx, tx));
    let beside = for_ever(|context| {
        let supervisor = &mut shared.borrow_mut();
        clock.poll(supervisor, context);
        line.poll(supervisor, context);
    });
    join(beside, carry(&shared, bus)).await.0
}

/// Calls a function whenever one of those wakes it that it has given its context to.
// No futures that wait for each other's: the states of all of them took a kilobyte more of a chip's flash.
async fn for_ever(mut look: impl FnMut(&mut Context<'_>)) -> ! {
    let never: Infallible = poll_fn(|context| {
        look(context);
        Poll::Pending
    })
    .await;
    match never {}
}

/// One future, so a borrow that is not kept across an `await` meets no other.
#[cfg(feature = "registers")]
type Shared<'a, F, E> = RefCell<&'a mut Supervisor<F, E>>;

/// One frame after the other, each with its reply. While a flood lasts the other tasks come between any two.
#[cfg(feature = "registers")]
async fn carry<F: NorFlash, E: Encoder>(supervisor: &Shared<'_, F, E>, mut bus: impl Bus) -> ! {
    let mut listens = None;
    loop {
        let address = supervisor.borrow().bus_address();
        if listens != Some(address) {
            listens = Some(address);
            supervisor.borrow_mut().set_bus(address);
            bus.listen(address);
        }
        supervisor.borrow_mut().set_bus_health(bus.health());
        let Either::First(request) = select(bus.receive(), Timer::after_millis(LOOK_MS)).await else {
            bus.look_after();
            continue;
        };
        while supervisor.borrow().is_busy() {
            Timer::after_millis(1).await;
        }
        let reply = supervisor.borrow_mut().frame(&request);
        if let Some(reply) = reply {
            bus.send(&reply).await;
        }
        yield_now().await;
    }
}
