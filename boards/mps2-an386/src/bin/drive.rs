//! The whole drive as Arm machine code: calibrates an imperfect motor, arms, and spins it both ways.
//!
//! Three priorities, as on a board: the control interrupt; the service task, which must not be late, on an interrupt
//! executor; the log on another. `twin` repeats the run on the host and compares it to the bit.
#![no_std]
#![no_main]

use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use cortex_m_rt::entry;
use defmt::{Display2Format, error, info, println};
use embassy_sync::blocking_mutex::raw::CriticalSectionRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::{Duration, Instant, Timer};
use hallservo::commutation::Modulation;
use hallservo::drive::Command;
use hallservo::hall::calibrate::Calibration;
use hallservo::service::{Event, Service};
use hallservo::telemetry::Record;
use heapless::spsc::Consumer;
use mps2_an386::control::{self, Checkpoint, STATISTICS, instructions};
use mps2_an386::{Machine, failure, success, tasks, time};
use twin::log::{Entry, What};

/// Modulation and time of each part of the run.
const SCRIPT: [(f32, Duration); 2] = [(0.2, Duration::from_millis(300)), (-0.25, Duration::from_millis(400))];

/// The service must look at the drive more often than it records.
const POLL: Duration = Duration::from_micros(500);

static LATEST: Signal<CriticalSectionRawMutex, Record> = Signal::new();

#[entry]
fn main() -> ! {
    let Machine { service, checkpoints, urgent, background } = Machine::start();
    let (Ok(serve), Ok(log)) = (serve(Run { service, checkpoints }), log()) else { failure() };
    urgent.spawn(serve);
    background.spawn(log);
    tasks::idle()
}

/// Logs what the drive is doing, ten times a second of the motor's time.
#[embassy_executor::task]
async fn log() {
    loop {
        let record = LATEST.wait().await;
        let hz = record.electrical_hz(time::CONTROL_HZ as f32);
        info!("{}: {=f32} Hz electrical, turn {=i32}", record.status.mode(), hz, record.rotor.position().turns());
        Timer::after_millis(100).await;
    }
}

#[embassy_executor::task]
async fn serve(mut run: Run) {
    match run.script().await {
        Ok(()) => success(),
        Err(why) => {
            error!("{}", why);
            failure()
        }
    }
}

/// What the service task works with.
struct Run {
    service: &'static mut Service,
    checkpoints: Consumer<'static, Checkpoint, 8>,
}

impl Run {
    async fn script(&mut self) -> Result<(), &'static str> {
        self.command(What::Calibrate, Command::Calibrate).await?;
        let calibration = loop {
            if let Some(calibration) = self.poll()? {
                break calibration;
            }
            Timer::after(POLL).await;
        };
        info!("calibrated: {}", calibration.report);
        // The next period takes it up.
        self.wait(POLL).await?;
        self.command(What::Arm, Command::Arm).await?;
        for (modulation, duration) in SCRIPT {
            let modulation = Modulation::saturating_from_num(modulation);
            self.command(What::Drive(modulation), Command::Drive(modulation)).await?;
            self.wait(duration).await?;
        }
        self.command(What::Disarm, Command::Disarm).await?;
        self.wait(POLL).await?;
        self.finish()
    }

    /// Sends a command right after a control period, so that there is no doubt in which it is obeyed, and notes it.
    async fn command(&mut self, what: What, command: Command) -> Result<(), &'static str> {
        let last = STATISTICS.periods.load(Relaxed);
        while STATISTICS.periods.load(Relaxed) == last {}
        let sent = self.service.send(command);
        let period = STATISTICS.periods.load(Relaxed);
        if sent.is_err() || period != last + 1 {
            return Err("a command was not sent within its period");
        }
        print(period, what);
        self.wait(POLL).await
    }

    /// Serves the drive for a time.
    async fn wait(&mut self, duration: Duration) -> Result<(), &'static str> {
        let end = Instant::now() + duration;
        while Instant::now() < end {
            Timer::after(POLL).await;
            self.poll()?;
        }
        Ok(())
    }

    /// Takes up everything that the drive has to tell.
    fn poll(&mut self) -> Result<Option<Calibration>, &'static str> {
        while let Some((periods, digest)) = self.checkpoints.dequeue() {
            print(periods, What::Digest(digest));
        }
        while let Some(event) = self.service.poll() {
            match event {
                Event::Calibrated(calibration) => return Ok(Some(calibration)),
                Event::Record(record) => LATEST.signal(record),
                Event::Reply(Ok(())) | Event::Installed(_) => {}
                Event::Reply(Err(_)) => return Err("the drive refused a command"),
                Event::Refused(error) => {
                    error!("{}", Display2Format(&error));
                    return Err("the calibration came to nothing");
                }
            }
        }
        Ok(None)
    }

    fn finish(&mut self) -> Result<(), &'static str> {
        let twin = control::stop().ok_or("the control interrupt was not running")?;
        print(twin.installed().ok_or("no calibration was installed")?, What::Install);
        print(twin.periods(), What::Digest(twin.digest()));
        println!("on the chip: {}", Display2Format(twin.figures()));
        let count = |ticks: &AtomicU32| instructions(ticks.load(Relaxed));
        println!(
            "Drive::step in the interrupt: {} instructions in the mean, {} at most, with a command to obey",
            count(&STATISTICS.step_ticks) / STATISTICS.steps.load(Relaxed).max(1),
            count(&STATISTICS.longest_step)
        );
        let lost = STATISTICS.lost.load(Relaxed);
        let [forward, backward] = twin.figures().fastest_hz();
        if lost != 0 || twin.figures().turns_lost() != 0 || forward < 50.0 || backward < 50.0 {
            return Err("the drive does not do what it should");
        }
        Ok(())
    }
}

fn print(period: u32, what: What) {
    println!("{}", Display2Format(&Entry { period, what }));
}
