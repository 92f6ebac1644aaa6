//! A drive without a board: the application of every board and its control interrupt, at the simulated motor, in time of its own.

pub mod fault;
pub mod flash;
pub mod serve;

use anyhow::{Context as _, Result, anyhow};
use embassy_time::{Duration, MockDriver};
use embedded_io_async::{ErrorType, Read, Write};
use fault::Planned;
use flash::Flash;
use hallservo::board::{Output, Sample, TemperatureCode};
use hallservo::commutation::Commutation;
use hallservo::control::settings::{GuardSettings, OnTimeout, Settings as Control};
use hallservo::drive::Drive;
use hallservo::mode::Mode;
use hallservo::settings::Settings;
use hallservo_app::{Heartbeat, Identity, Memory};
use plant::{Plant, PlantParameters, Truth};
use std::cell::{Cell, RefCell};
use std::collections::VecDeque;
use std::convert::Infallible;
use std::future::{Future, poll_fn};
use std::pin::Pin;
use std::rc::Rc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::task::{Context, Poll, Wake, Waker};

/// What it says it is.
const IDENTITY: Identity = Identity { board: "simulated", firmware: env!("CARGO_PKG_VERSION") };
/// Both thermistors at 25 °C, 12 bit.
const COOL: TemperatureCode = TemperatureCode::new(2048);

/// What the simulated board has by default: the motor of Simpkins and Todorov, field-oriented; a command holds for a second.
pub fn defaults() -> Settings {
    let guard = GuardSettings { command_timeout_s: 1.0, on_timeout: OnTimeout::Stop, ..GuardSettings::default() };
    let control = Control { guard, ..Control::default() };
    Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() }
}

type Bytes = Rc<RefCell<VecDeque<u8>>>;

/// There is one clock in a process, so there can be one drive at a time.
static CLOCK: Mutex<()> = Mutex::new(());

/// Sees each sample before the drive does, with how things really are, and may change it.
pub type Observe = Box<dyn FnMut(&mut Sample, &Truth)>;

/// A drive, its tasks and its motor.
pub struct Simulator {
    /// The motor.
    pub plant: Plant,
    /// Somebody who looks on.
    pub observe: Option<Observe>,
    drive: Drive,
    alive: &'static Heartbeat,
    flash: Flash,
    app: Pin<Box<dyn Future<Output = ()>>>,
    woken: Arc<Woken>,
    input: Bytes,
    output: Bytes,
    fed: Rc<Cell<u32>>,
    last: Output,
    digest: u64,
    /// Of the timer, in counts.
    period: u16,
    /// Control periods in a millisecond, and in the state running.
    periods: u32,
    running: u64,
    planned: Vec<Planned>,
    disturbed: Option<fault::Kind>,
    /// Control periods for which a hand turns the shaft.
    hand: u32,
    _clock: MutexGuard<'static, ()>,
}

impl Simulator {
    /// At power-up, an unkind motor at rest.
    ///
    /// # Errors
    /// What is wrong with the defaults.
    pub fn new(seed: u64, flash: Flash, planned: Vec<Planned>) -> Result<Self> {
        Self::at(&PlantParameters::unkind(seed), seed, flash, planned)
    }

    /// The same at any motor.
    ///
    /// # Errors
    /// What is wrong with the motor's parameters.
    pub fn at(plant: &PlantParameters, seed: u64, flash: Flash, planned: Vec<Planned>) -> Result<Self> {
        Self::with(defaults(), plant, seed, flash, planned)
    }

    /// The same with the settings of a board, whose PWM the motor has to have.
    ///
    /// # Errors
    /// What is wrong with the settings or the motor's parameters.
    pub fn with(
        settings: Settings,
        plant: &PlantParameters,
        seed: u64,
        flash: Flash,
        planned: Vec<Planned>,
    ) -> Result<Self> {
        let config = settings.validate().context("the settings")?;
        let clock = CLOCK.lock().unwrap_or_else(PoisonError::into_inner);
        MockDriver::get().reset();
        let mut plant = Plant::new(plant, seed).map_err(|error| anyhow!("the motor: {error}"))?;
        plant.place(0.3, 0.0)?;
        // On a chip these are statics; here, too, a drive lives as long as its process.
        let memory: &'static mut Memory = Box::leak(Box::new(Memory::new()));
        let alive: &'static Heartbeat = Box::leak(Box::new(Heartbeat::new()));
        let (drive, app) =
            hallservo_app::start(IDENTITY, settings, flash.clone(), 0, memory, Box::leak(Box::new_uninit()));
        let (input, output, fed) = (Bytes::default(), Bytes::default(), Rc::new(Cell::new(0)));
        let feed = {
            let fed = Rc::clone(&fed);
            move || fed.set(fed.get() + 1)
        };
        let (rx, tx) = (Line(Rc::clone(&input)), Line(Rc::clone(&output)));
        let periods = (1e-3 / plant.period_s()).round() as u32;
        Ok(Self {
            plant,
            observe: None,
            drive,
            alive,
            flash,
            app: Box::pin(async move { app.run(rx, tx, alive, feed).await }),
            woken: Arc::default(),
            input,
            output,
            fed,
            last: Output::OFF,
            digest: 0xcbf2_9ce4_8422_2325,
            period: config.period,
            periods,
            running: 0,
            planned,
            disturbed: None,
            hand: 0,
            _clock: clock,
        })
    }

    /// A millisecond of the drive's life.
    pub fn step(&mut self) {
        for _ in 0..self.periods {
            self.period();
        }
        self.tasks();
    }

    /// A hand takes the shaft, turns it by so many turns, negative ones backwards, and lets it go: a turn takes a second.
    ///
    /// # Errors
    /// A number of turns that is not finite.
    pub fn turn_by_hand(&mut self, turns: f64) -> Result<()> {
        self.plant.set_dyno(Some(std::f64::consts::TAU.copysign(turns)))?;
        self.hand = (turns.abs() / self.plant.period_s()).round() as u32;
        Ok(())
    }

    /// A period of the hand, which stops the shaft before it lets it go.
    fn hold(&mut self) {
        if self.hand > 0 {
            self.hand -= 1;
            if self.hand == 0 {
                let stopped = self.plant.set_dyno(Some(0.0)).and_then(|()| self.plant.set_dyno(None));
                debug_assert!(stopped.is_ok(), "both speeds are finite");
            }
        }
    }

    /// A millisecond in which the control interrupt does not come.
    pub fn stall(&mut self) {
        self.tasks();
    }

    /// The tasks' share of a millisecond.
    fn tasks(&mut self) {
        MockDriver::get().advance(Duration::from_millis(1));
        let waker = Waker::from(Arc::clone(&self.woken));
        self.woken.0.store(true, Ordering::Relaxed);
        while self.woken.0.swap(false, Ordering::Relaxed) {
            // It never returns.
            let _ = self.app.as_mut().poll(&mut Context::from_waker(&waker));
        }
    }

    /// The control interrupt.
    fn period(&mut self) {
        let plant::Codes { halls, currents, bus } = self.plant.sample();
        let mut sample = Sample { halls, currents, bus, temperatures: [COOL; 2], ..Sample::default() };
        if let Some(kind) = self.disturbed {
            kind.disturb(&mut sample);
        }
        if let Some(observe) = &mut self.observe {
            observe(&mut sample, &self.plant.truth());
        }
        self.alive.beat(&sample);
        self.last = self.drive.step(&sample);
        let [a, b, c] = self.last.compare;
        for word in [a, b, c, self.last.legs.bits().into()] {
            self.digest = (self.digest ^ u64::from(word)).wrapping_mul(0x0100_0000_01b3);
        }
        self.plant.advance(&sim::rig::legs(&self.last, self.period));
        self.hold();
        if self.drive.mode() == Mode::Running {
            self.running += 1;
            self.inject();
        }
    }

    /// Faults whose time has come.
    fn inject(&mut self) {
        let seconds = self.running as f64 * self.plant.period_s();
        while let Some(at) = self.planned.iter().position(|planned| planned.after_s <= seconds) {
            let kind = self.planned.swap_remove(at).kind;
            if !kind.break_hall(&mut self.plant) {
                self.disturbed = Some(kind);
            }
        }
    }

    /// Bytes to the drive.
    pub fn write(&mut self, bytes: &[u8]) {
        self.input.borrow_mut().extend(bytes);
    }

    /// Bytes from the drive since the last call.
    pub fn read(&mut self) -> Vec<u8> {
        self.output.borrow_mut().drain(..).collect()
    }

    /// What the control interrupt wrote to the timer last.
    pub const fn output(&self) -> &Output {
        &self.last
    }

    /// A digest (FNV-1a, a word at a time) of all that it ever wrote: two drives with the same have turned their motors alike.
    pub const fn digest(&self) -> u64 {
        self.digest
    }

    /// What its flash holds.
    pub fn flash(&self) -> Vec<u8> {
        self.flash.bytes()
    }

    /// The drive, to look at.
    pub const fn drive(&self) -> &Drive {
        &self.drive
    }

    /// How often the watchdog was fed.
    pub fn fed(&self) -> u32 {
        self.fed.get()
    }
}

/// Whether the tasks are to be polled once more.
#[derive(Default)]
struct Woken(AtomicBool);

impl Wake for Woken {
    fn wake(self: Arc<Self>) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// One direction of the serial line.
struct Line(Bytes);

impl ErrorType for Line {
    type Error = Infallible;
}

impl Read for Line {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|_| {
            let mut line = self.0.borrow_mut();
            // What comes next comes between two polls, which a millisecond has one of at least.
            if line.is_empty() {
                return Poll::Pending;
            }
            let length = line.len().min(bytes.len());
            for (place, byte) in bytes.iter_mut().zip(line.drain(..length)) {
                *place = byte;
            }
            Poll::Ready(Ok(length))
        })
        .await
    }
}

impl Write for Line {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        self.0.borrow_mut().extend(bytes);
        Ok(bytes.len())
    }

    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
