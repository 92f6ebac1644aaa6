//! Floods the tasks with critical sections and log frames while the drive turns the motor, and fails when a single
//! control period is late or lost.
//!
//! With the feature `primask` the tasks mask interrupts as they usually do on a Cortex-M; the check then has to fail.
#![no_std]
#![no_main]

use core::hint::black_box;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use cortex_m_rt::entry;
use defmt::{error, info, println};
use embassy_futures::join::join;
use embassy_futures::yield_now;
use embassy_time::{Duration, Instant, Timer};
use hallservo::drive::Command;
use hallservo::service::Service;
use mps2_an386::control::{STATISTICS, instructions};
use mps2_an386::{Machine, failure, success, tasks, time};

/// At least, in the motor's time: 2000 control periods.
const TIME: Duration = Duration::from_millis(50);

/// Between the timer's event and the reading of its count: the rest of the interrupted instruction and the first ones
/// of the handler. An interrupt that a mask has held back is later than that, as a rule by thousands.
const PROMPT: u32 = 20;

/// Length of a critical section, in additions: some thousand instructions.
const HOLD: u32 = 2000;

static SECTIONS: AtomicU32 = AtomicU32::new(0);
static FRAMES: AtomicU32 = AtomicU32::new(0);

#[entry]
fn main() -> ! {
    let Machine { service, urgent, background, .. } = Machine::start();
    let (Ok(serve), Ok(flood)) = (serve(service), flood()) else { failure() };
    urgent.spawn(serve);
    background.spawn(flood);
    tasks::idle()
}

#[embassy_executor::task]
async fn flood() {
    join(sections(), frames()).await;
}

/// Critical sections without end.
async fn sections() {
    loop {
        hold();
        SECTIONS.fetch_add(1, Relaxed);
        yield_now().await;
    }
}

fn hold() {
    let work = || (0..HOLD).for_each(|i| _ = black_box(i));
    if cfg!(feature = "primask") {
        cortex_m::interrupt::free(|_| work());
    } else {
        critical_section::with(|_| work());
    }
}

/// Log frames without end; each is written in a critical section.
async fn frames() {
    let bytes = [0xA5_u8; 32];
    loop {
        info!("flood {=[u8]:x}", bytes);
        FRAMES.fetch_add(1, Relaxed);
        yield_now().await;
    }
}

/// Starts the motor, serves the drive and judges.
#[embassy_executor::task]
async fn serve(service: &'static mut Service) {
    if service.send(Command::Calibrate).is_err() {
        failure();
    }
    let begin = Instant::now();
    while begin.elapsed() < TIME {
        while service.poll().is_some() {}
        hold();
        Timer::after_micros(500).await;
    }
    let (periods, elapsed) = (STATISTICS.periods.load(Relaxed), begin.elapsed());
    let lost = STATISTICS.lost.load(Relaxed);
    let latest = instructions(STATISTICS.latest.load(Relaxed));
    println!(
        "{} control periods under {} critical sections and {} log frames: {} lost, none later than {} instructions",
        periods,
        SECTIONS.load(Relaxed),
        FRAMES.load(Relaxed),
        lost,
        latest
    );
    let expected = elapsed.as_micros() as u32 / (1_000_000 / time::CONTROL_HZ);
    if lost == 0 && latest <= PROMPT && periods.abs_diff(expected) <= 2 {
        success()
    }
    error!("the control interrupt was held back");
    failure()
}
