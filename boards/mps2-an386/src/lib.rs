//! QEMU's `mps2-an386`: a Cortex-M4F with CMSDK timers. What its firmwares share.
#![no_std]

// Linked for what they provide: the log transport and the critical section.
use defmt_semihosting as _;
use shared as _;

pub mod control;
mod device;
mod exit;
pub mod tasks;
pub mod time;
mod timers;

use control::Checkpoint;
pub use device::Interrupt;
use embassy_executor::SendSpawner;
pub use exit::{failure, success};
use hallservo::drive::Channels;
use hallservo::hall::estimate::Estimator;
use hallservo::service::Service;
use heapless::spsc::Consumer;
use static_cell::{ConstStaticCell, StaticCell};
use twin::Twin;

defmt::timestamp!("{=u64:us}", embassy_time::Instant::now().as_micros());

/// Sets the priorities and starts the clock. To be called once, at first.
pub fn init() -> cortex_m::Peripherals {
    let Some(mut core) = cortex_m::Peripherals::take() else { failure() };
    shared::priority::init(&mut core.NVIC, &mut core.SCB, Interrupt::Timer0);
    time::init();
    core
}

/// A drive at its motor, under way in the control interrupt, and what its tasks need.
pub struct Machine {
    /// The other side of the drive.
    pub service: &'static mut Service,
    /// Digests of the run so far.
    pub checkpoints: Consumer<'static, Checkpoint, 8>,
    /// For the tasks that must not be late.
    pub urgent: SendSpawner,
    /// For the others.
    pub background: SendSpawner,
}

impl Machine {
    /// Starts it, [`init`] included.
    pub fn start() -> Self {
        static CHANNELS: ConstStaticCell<Channels> = ConstStaticCell::new(Channels::new());
        static ESTIMATORS: ConstStaticCell<[Estimator; 2]> =
            ConstStaticCell::new([const { Estimator::blank() }, const { Estimator::blank() }]);
        static SERVICE: StaticCell<Service> = StaticCell::new();

        let mut core = init();
        let Ok(config) = twin::settings().validate() else { failure() };
        let (interrupt, tasks) = CHANNELS.take().split();
        let service = SERVICE.init(Service::new(config, tasks, ESTIMATORS.take().each_mut()));
        let Some(twin) = Twin::new(config, interrupt) else { failure() };
        let checkpoints = control::start(twin, &mut core.SYST);
        let [urgent, background] = tasks::start(&mut core.NVIC);
        Self { service, checkpoints, urgent, background }
    }
}
