//! What is done every millisecond, and the watchdog.

use crate::encoder::Encoder;
use crate::{Readings, Stop, Supervisor};
use core::future::Future;
use core::pin::Pin;
use core::task::Context;
use embassy_time::{Duration, Instant, Timer};
use embedded_storage::nor_flash::NorFlash;

/// From tick to tick.
const TICK: Duration = Duration::from_millis(1);
/// From check to check of the watchdog.
const CHECK: Duration = Duration::from_millis(20);

/// When a supervisor's next tick is due, and what it takes.
pub(super) struct Clock<'a, R, D> {
    readings: R,
    stop: &'a Stop,
    feed: D,
    /// The next tick, and what waits for it.
    tick: Instant,
    timer: Timer,
    /// The next look whether the watchdog may be fed.
    check: Instant,
}

impl<'a, R: Fn() -> Readings, D: FnMut()> Clock<'a, R, D> {
    pub fn new(readings: R, stop: &'a Stop, feed: D) -> Self {
        let now = Instant::now();
        let tick = now.saturating_add(TICK);
        Self { readings, stop, feed, tick, timer: Timer::at(tick), check: now.saturating_add(CHECK) }
    }

    /// Ticks if it is time to, and has the context woken for the next one.
    pub fn poll<F: NorFlash, E: Encoder>(&mut self, supervisor: &mut Supervisor<F, E>, context: &mut Context<'_>) {
        // A timer that has just been set is not ready, however late it is: the line comes between any two ticks.
        while Pin::new(&mut self.timer).poll(context).is_ready() {
            supervisor.tick(Instant::now().as_millis(), (self.readings)());
            if let Some(dealt) = supervisor.dealt_with() {
                self.stop.release(&dealt);
            }
            let now = Instant::now();
            if now >= self.check {
                self.check = now.saturating_add(CHECK);
                if supervisor.is_alive() {
                    (self.feed)();
                }
            }
            // Ticks missed in a stall are not made up for.
            self.tick = self.tick.saturating_add(TICK).max(now);
            self.timer = Timer::at(self.tick);
        }
    }
}
