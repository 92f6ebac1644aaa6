//! The scope after a step: with nothing to record, and with four channels of every kind and a trigger that waits.

use crate::call::{Arguments, Results};
use crate::drive::{field_oriented, sample};
use crate::row::{Row, function};
use core::sync::atomic::{AtomicPtr, Ordering::Relaxed};
use hallservo::board::{Output, Sample};
use hallservo::config::Config;
use hallservo::drive::{self, Drive};
use hallservo::scope::{Channel, Channels, Recorder, Recording, Scope, Setup, Trigger};
use mps2_an386::failure;
use static_cell::StaticCell;

pub const ROWS: &[Row] = &[
    Row::new("scope, nothing to record", "hallservo", function!(take), idle, none).budget(8),
    Row::new("scope, four channels", "hallservo", function!(take), recording, none).budget(300),
];

/// What a board's control interrupt does after the step.
#[unsafe(no_mangle)]
#[inline(never)]
pub extern "C" fn take(recorder: &mut Recorder, drive: &Drive, sample: &Sample, output: &Output) {
    recorder.take(drive, sample, output);
}

struct Bench {
    drive: Drive,
    recorder: Recorder,
    scope: Scope,
    sample: Sample,
    output: Output,
    config: Config,
}

static BENCH: AtomicPtr<Bench> = AtomicPtr::new(core::ptr::null_mut());

pub fn init() {
    static PLACE: StaticCell<Bench> = StaticCell::new();
    static CHANNELS: StaticCell<drive::Channels> = StaticCell::new();
    static SCOPE: StaticCell<Channels> = StaticCell::new();
    static RECORDING: StaticCell<Recording> = StaticCell::new();
    let Ok(config) = field_oriented().validate() else { failure() };
    let (interrupt, _) = CHANNELS.init(drive::Channels::new()).split();
    let (recorder, scope) = SCOPE.init(Channels::new()).split(Some(RECORDING.init(Recording::new())));
    let drive = Drive::new(config, interrupt);
    BENCH.store(PLACE.init(Bench { drive, recorder, scope, sample: sample(), output: Output::OFF, config }), Relaxed);
}

fn bench() -> &'static mut Bench {
    // SAFETY: `init` has stored a static, and there is one caller at a time.
    unsafe { &mut *BENCH.load(Relaxed) }
}

impl Bench {
    fn arguments(&mut self) -> Arguments {
        let addresses = [
            &raw mut self.recorder as usize,
            &raw const self.drive as usize,
            &raw const self.sample as usize,
            &raw const self.output as usize,
        ];
        Arguments { r: addresses.map(|address| address as u32), ..Arguments::default() }
    }

    fn take(&mut self) {
        take(&mut self.recorder, &self.drive, &self.sample, &self.output);
    }

    /// Other channels; nothing crosses the level.
    fn begin(&mut self, first: usize) {
        self.scope.cancel();
        self.take();
        let channel = |number: usize| Channel::ALL[(first + number) % Channel::ALL.len()].0;
        let setup = Setup {
            channels: [0, 1, 2, 3].map(|number| Some(channel(number))),
            every: 1,
            rows: 512,
            before: 100,
            trigger: Trigger::Level { channel: channel(4), level: -0.001, rising: false },
        };
        let Ok(plan) = setup.plan(&self.config, 40e3, 0) else { failure() };
        if self.scope.begin(&plan).is_err() {
            failure();
        }
        self.take();
    }
}

fn idle(_: u32) -> Arguments {
    bench().arguments()
}

fn recording(index: u32) -> Arguments {
    let bench = bench();
    if index.is_multiple_of(64) {
        bench.begin(index as usize / 64);
    }
    bench.arguments()
}

fn none(_: &Arguments, _: &Results) -> f64 {
    0.0
}
