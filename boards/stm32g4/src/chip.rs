//! A drive on the chip.

mod bridge;
#[cfg(feature = "can")]
pub mod can;
mod chopper;
mod clock;
mod control;
mod converters;
mod enable;
mod encoder;
mod firmware;
mod last;
mod latest;
mod line;
mod memory;
mod storage;
mod time;
mod watchdog;

pub use bridge::{Bridge, Pin};
pub use control::Control;
pub use converters::{Converter, low_side_current, ntc_to_reference, result};
pub use memory::before_memory;

use crate::registers::clock::HCLK_HZ;
use crate::registers::timer;
use crate::wiring::Wiring;
use core::num::NonZeroU32;
use core::ptr::addr_of;
use defmt_rtt as _;
use embassy_executor::Executor;
use embassy_stm32::pac::adccommon::AdcCommon;
use embassy_stm32::pac::{DBGMCU, Interrupt, RCC};
use encoder::{OnShaft, OwnDrive, own};
use hallservo::board::Sample;
use hallservo::settings::Settings;
use hallservo_app::{Identity, Memory, Stop, Supervisor, embassy};
use line::{Received, Sending};
use static_cell::{ConstStaticCell, StaticCell};
use storage::Storage;

/// What a board is, beyond its chip.
pub trait Board: Send + 'static {
    /// Its name.
    const NAME: &'static str;
    /// The way to the gate drivers.
    const BRIDGE: Wiring;
    /// Outputs of TIM1, and its break input if that is a pin.
    const PINS: &'static [Pin];
    /// TX and RX of the serial line, USART2.
    const SERIAL: [Pin; 2];
    /// The ADCs. The end of the first one's sequence is the control interrupt.
    const CONVERTERS: &'static [Converter];
    /// What the ADCs share.
    const GROUPS: &'static [AdcCommon];

    /// The CAN.
    #[cfg(feature = "can")]
    const CAN: can::Wires;

    /// What a drive on this board starts with, as long as nothing else is stored.
    fn settings() -> Settings;

    /// The results of the sequences that have just ended, into their place: all but the periods that were lost. What it
    /// never sets stays as in [`Sample::default`]. In the control interrupt.
    fn sample(&mut self, sample: &mut Sample);

    /// The PWM has another period from the next valley on, in ticks of its timer. In the control interrupt, with the bridge
    /// off.
    fn retime(&mut self, period: NonZeroU32) {
        let _ = period;
    }

    /// What the heads of the encoder show, at the same instant.
    #[cfg(feature = "encoder")]
    fn heads(&mut self) -> hallservo::vernier::encoder::Reading<{ encoder::HEADS }>;
}

/// The tasks.
type Tasks = Supervisor<Storage, OnShaft>;

static STOP: Stop = Stop::new();

/// Clocks, priorities and time.
pub fn start<B: Board>() -> Bridge {
    if let Some(input) = B::BRIDGE.enable {
        enable::start(input);
    }
    if let Some(output) = B::BRIDGE.chopper {
        chopper::start(output);
    }
    start_core();
    Bridge::new(&B::BRIDGE)
}

/// What no board has another way. Not generic, so that it is compiled for size.
#[inline(never)]
fn start_core() {
    // SAFETY: out of reset, and once.
    let mut core = unsafe { cortex_m::Peripherals::steal() };
    shared::priority::init(&mut core.NVIC, &mut core.SCB, Interrupt::ADC1_2);
    core.DCB.enable_trace();
    core.DWT.enable_cycle_counter();
    clock::start();
    time::start();
    bridge::guard_against_the_core();
    // A breakpoint stops the timer, which takes its outputs to their idle levels, and the watchdogs. A probe reads the log
    // while the core sleeps.
    DBGMCU.cr().modify(|cr| cr.set_dbg_sleep(true));
    DBGMCU.apb2fzr().modify(|freeze| freeze.set_tim1(true));
    DBGMCU.apb1lfzr().modify(|freeze| {
        freeze.set_iwdg(true);
        freeze.set_wwdg(true);
    });
}

/// Everything else. Never returns.
pub fn run<B: Board>(board: B, bridge: Bridge, control: &'static Control<B>) -> ! {
    execute(
        prepare(board, bridge, control),
        &B::SERIAL,
        #[cfg(feature = "can")]
        can::Bus::start(&B::CAN),
    )
}

/// Runs the tasks. Not generic, so that it is compiled for size.
#[inline(never)]
fn execute(supervisor: &'static mut Tasks, serial: &[Pin; 2], #[cfg(feature = "can")] bus: can::Bus) -> ! {
    static EXECUTOR: StaticCell<Executor> = StaticCell::new();
    let (rx, tx) = line::open(serial);
    let tasks = tasks(
        supervisor,
        rx,
        tx,
        #[cfg(feature = "can")]
        bus,
    );
    EXECUTOR.init(Executor::new()).run(|spawner| match tasks {
        Ok(tasks) => spawner.spawn(tasks),
        Err(_) => unreachable!("spawned once"),
    })
}

/// Serial number of the chip (RM0440, 48.1), the lowest word first.
fn serial() -> [u32; 3] {
    const UID: *const [u32; 3] = 0x1fff_7590 as _;
    // SAFETY: three aligned words of the factory's, which never change.
    unsafe { UID.read_volatile() }
}

/// What the start takes of the stack is given back before the tasks run.
#[inline(never)]
fn prepare<B: Board>(board: B, bridge: Bridge, control: &'static Control<B>) -> &'static mut Tasks {
    greet(B::NAME);
    converters::start(B::GROUPS, B::CONVERTERS);
    watchdog::start();
    let identity = Identity { board: B::NAME, firmware: env!("CARGO_PKG_VERSION"), serial: serial() };
    let (drive, supervisor) = begin(identity, B::settings(), Storage::new());
    tell(&B::BRIDGE, own(drive).period());
    control.start(
        board,
        drive,
        bridge,
        #[cfg(feature = "scope")]
        match supervisor.recorder() {
            Some(recorder) => recorder,
            None => unreachable!("it was never taken"),
        },
    );
    supervisor
}

/// What is large goes to its place and leaves the stack.
#[inline(never)]
fn begin(identity: Identity, defaults: Settings, flash: Storage) -> (&'static mut OwnDrive, &'static mut Tasks) {
    static MEMORY: ConstStaticCell<Memory<Storage, OnShaft>> = ConstStaticCell::new(Memory::with_encoder());
    match Supervisor::start_with_encoder(identity, defaults, flash, place(), MEMORY.take()) {
        Ok(started) => started,
        Err(_) => panic!("the board's default settings are invalid"),
    }
}

/// All that is not the control interrupt. Here, and not generic, so that it is compiled for size.
#[embassy_executor::task]
async fn tasks(supervisor: &'static mut Tasks, rx: Received, tx: Sending, #[cfg(feature = "can")] bus: can::Bus) -> ! {
    #[cfg(feature = "can")]
    embassy::run_with_bus(supervisor, (rx, tx), latest::readings, &STOP, watchdog::feed, bus).await;
    #[cfg(not(feature = "can"))]
    embassy::run(supervisor, rx, tx, latest::readings, &STOP, watchdog::feed).await
}

/// Where the place for settings begins, from the begin of the flash: memory.x reserves it.
fn place() -> u32 {
    unsafe extern "C" {
        static _storage: u8;
    }
    addr_of!(_storage) as u32
}

/// What a person with a probe wants to know at first.
#[inline(never)]
fn greet(name: &str) {
    defmt::info!("{=str}, hallservo {=str}: the bridge is off", name, env!("CARGO_PKG_VERSION"));
    let causes = RCC.csr().read();
    if causes.iwdgrstf() {
        defmt::error!("the watchdog has reset the chip: the control interrupt or a task had stopped");
    }
    if causes.wwdgrstf() {
        defmt::error!("the window watchdog has reset the chip: the control interrupt had stopped");
    }
    RCC.csr().modify(|csr| csr.set_rmvf(true));
}

/// How the bridge switches, with the settings that were stored.
#[inline(never)]
fn tell(wiring: &Wiring, period: u16) {
    defmt::info!(
        "{=u32} MHz from the internal oscillator; PWM {=u32} Hz, {=u16} counts; dead time {=u32} ns",
        HCLK_HZ / 1_000_000,
        HCLK_HZ / timer::whole(period),
        period,
        u32::from(wiring.dead_time_ticks()) * 1000 / (HCLK_HZ / 1_000_000)
    );
}
