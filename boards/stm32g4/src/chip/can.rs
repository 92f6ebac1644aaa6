//! CAN-FD by FDCAN1. The interrupt takes frames to a queue; all else is a task's.
//!
//! The HAL has a driver, which leaves the delay of the transceiver uncompensated and so does not see its own bits at 5
//! Mbit/s.

use crate::chip::bridge::connect;
use crate::chip::{Pin, STOP};
use crate::registers::can::*;
use core::cell::RefCell;
use core::future::poll_fn;
use core::sync::atomic::{AtomicU32, Ordering::Relaxed};
use core::task::Poll;
use cortex_m::peripheral::NVIC;
use critical_section::Mutex;
use embassy_stm32::interrupt;
use embassy_stm32::pac::can::regs::{Cccr, Dbtp, Ie, Ile, Ir, Nbtp, Rxgfc, Tdcr, Txbar, Txbcr};
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::Moder;
use embassy_stm32::pac::rcc::vals::Fdcansel;
use embassy_stm32::pac::{FDCAN1, FDCANRAM1, Interrupt, RCC};
use embassy_sync::waitqueue::AtomicWaker;
use embassy_time::{Duration, Timer};
use hallservo_app::bus::BusHealth;
use hallservo_app::{FrameListener, bus};
use hallservo_registers::frame::Bytes;
use hallservo_registers::{Address, Reply, Request};
use heapless::spsc::{Consumer, Producer, Queue};
use static_cell::ConstStaticCell;

/// Frames that wait for the tasks, and one more. The chip has three places beside them.
const ROOM: usize = 4;
/// Looks at a full chip before what waits there is given up: nobody waits for it any more.
const PATIENCE: u32 = 20;
/// From look to look.
const LOOK: Duration = Duration::from_millis(1);

/// What a board has of a CAN.
#[derive(Clone, Copy)]
pub struct Wires {
    /// FDCAN1_RX and FDCAN1_TX.
    pub pins: [Pin; 2],
    /// Outputs that switch the transceiver on: port, pin, level.
    pub transceiver: &'static [(Gpio, usize, bool)],
}

static ARRIVED: AtomicWaker = AtomicWaker::new();
static LOST: AtomicU32 = AtomicU32::new(0);
static TAKES: Mutex<RefCell<Option<Takes>>> = Mutex::new(RefCell::new(None));

/// What takes frames, and hears at once which of them stop the drive.
struct Takes {
    queue: Producer<'static, Request, ROOM>,
    listener: FrameListener,
}

/// The bus, for one task.
pub struct Bus {
    frames: Consumer<'static, Request, ROOM>,
    off: u32,
    /// As it was told last.
    known: BusHealth,
}

impl Bus {
    /// Takes part, and lets nothing in before it [listens](bus::Bus::listen).
    pub fn start(wires: &Wires) -> Self {
        static QUEUE: ConstStaticCell<Queue<Request, ROOM>> = ConstStaticCell::new(Queue::new());
        let (queue, frames) = QUEUE.take().split();
        let takes = Takes { queue, listener: FrameListener::new() };
        critical_section::with(|section| TAKES.borrow(section).replace(Some(takes)));
        for &(port, pin, level) in wires.transceiver {
            port.bsrr().write(|set| if level { set.set_bs(pin, true) } else { set.set_br(pin, true) });
            port.moder().modify(|mode| mode.set_moder(pin, Moder::OUTPUT));
        }
        connect(&wires.pins);
        RCC.ccipr().modify(|ccipr| ccipr.set_fdcansel(Fdcansel::PCLK1));
        RCC.apb1enr1().modify(|enable| enable.set_fdcanen(true));
        configure();
        let bus = Self { frames, off: 0, known: BusHealth::NONE };
        write_words(0, &[0; 2]);
        write_words(EXTENDED, &[0; 4]);
        FDCAN1.cccr().write_value(Cccr(RUN));
        // SAFETY: what it shares with the tasks is behind critical sections, whose ceiling is its priority.
        unsafe { NVIC::unmask(Interrupt::FDCAN1_IT0) };
        bus
    }
}

impl bus::Bus for Bus {
    async fn receive(&mut self) -> Request {
        poll_fn(|context| {
            ARRIVED.register(context.waker());
            self.frames.dequeue().map_or(Poll::Pending, Poll::Ready)
        })
        .await
    }

    async fn send(&mut self, reply: &Reply) {
        for _ in 0..PATIENCE {
            if FDCAN1.cccr().read().init() {
                // Off the bus.
                return;
            }
            if !FDCAN1.txfqs().read().tfqf() {
                return transmit(reply.identifier, &reply.bytes);
            }
            Timer::after(LOOK).await;
        }
        // It was not heard for so long that nobody waits for it.
        FDCAN1.txbcr().write_value(Txbcr(0b111));
    }

    /// A frame that comes just then may be lost.
    fn listen(&mut self, address: Address) {
        let (standard, extended) = filters(address.id, address.prefix);
        write_words(0, &standard);
        write_words(EXTENDED, &extended);
    }

    /// Who is off the bus comes back: so much later than it might, for the others to get on meanwhile.
    fn look_after(&mut self) {
        if FDCAN1.psr().read().bo() && FDCAN1.cccr().read().init() {
            self.off = self.off.saturating_add(1);
            // Nobody waits for what was to be sent.
            configure();
            FDCAN1.cccr().write_value(Cccr(RUN));
        }
        let health = self.health();
        if (health.passive, health.off, health.lost) != (self.known.passive, self.known.off, self.known.lost) {
            let BusHealth { transmit, receive, passive, off, lost } = health;
            defmt::warn!(
                "CAN: transmit {}, receive {}, passive {}, off {}, lost {}",
                transmit,
                receive,
                passive,
                off,
                lost
            );
            self.known = health;
        }
    }

    fn health(&self) -> BusHealth {
        let counters = FDCAN1.ecr().read();
        BusHealth {
            transmit: counters.tec(),
            receive: counters.rec(),
            passive: FDCAN1.psr().read().ep(),
            off: self.off,
            lost: LOST.load(Relaxed),
        }
    }
}

/// Sets everything up, with INIT set.
fn configure() {
    FDCAN1.cccr().modify(|cccr| cccr.set_init(true));
    while !FDCAN1.cccr().read().init() {}
    FDCAN1.cccr().modify(|cccr| cccr.set_cce(true));
    FDCAN1.cccr().write_value(Cccr(CONFIGURE | RUN));
    FDCAN1.nbtp().write_value(Nbtp(NBTP));
    FDCAN1.dbtp().write_value(Dbtp(DBTP));
    FDCAN1.tdcr().write_value(Tdcr(TDCR));
    FDCAN1.rxgfc().write_value(Rxgfc(RXGFC));
    FDCAN1.ie().write_value(Ie(IE));
    FDCAN1.ile().write_value(Ile(1));
}

fn transmit(identifier: u32, bytes: &[u8]) {
    let buffer = usize::from(FDCAN1.txfqs().read().tfqpi()).min(2);
    let (head, length) = to_send(identifier, bytes.len());
    let place = BUFFERS + ELEMENT * buffer;
    write_words(place, &head);
    for (index, at) in (0..length).step_by(4).enumerate() {
        // What pads it does nothing in the protocol of the registers.
        let mut word = [PADDING; 4];
        let rest = bytes.get(at..).unwrap_or_default();
        word.iter_mut().zip(rest).for_each(|(place, byte)| *place = *byte);
        write_words(place + 2 + index, &[u32::from_le_bytes(word)]);
    }
    FDCAN1.txbar().write_value(Txbar(1 << buffer));
}

/// NOP of the registers' protocol.
const PADDING: u8 = 0x50;

fn ram() -> *mut u32 {
    FDCANRAM1.as_ptr().cast()
}

fn write_words(from: usize, words: &[u32]) {
    for (index, word) in words.iter().enumerate().take(WORDS - from.min(WORDS)) {
        // SAFETY: within the part of the message RAM that is FDCAN1's.
        unsafe { ram().add(from + index).write_volatile(*word) };
    }
}

fn read_words<const N: usize>(from: usize) -> [u32; N] {
    // SAFETY: within the part of the message RAM that is FDCAN1's, as the callers' constants are.
    core::array::from_fn(|index| unsafe { ram().add((from + index).min(WORDS - 1)).read_volatile() })
}

#[interrupt]
fn FDCAN1_IT0() {
    critical_section::with(|section| {
        let Ok(mut takes) = TAKES.borrow(section).try_borrow_mut() else { return };
        let Some(Takes { queue, listener }) = &mut *takes else { return };
        if FDCAN1.ir().read().0 & crate::registers::can::LOST != 0 {
            LOST.store(LOST.load(Relaxed).wrapping_add(1), Relaxed);
        }
        FDCAN1.ir().write_value(Ir(IE | crate::registers::can::LOST));
        loop {
            let status = FDCAN1.rxfs(0).read();
            if status.ffl() == 0 {
                break;
            }
            let element = FIFO + ELEMENT * usize::from(status.fgi());
            let (identifier, length) = received(read_words(element));
            let words: [u32; 16] = read_words(element + 2);
            let bytes: Bytes = words.iter().flat_map(|word| word.to_le_bytes()).take(length).collect();
            let handed_on = queue.ready();
            listener.hear(&bytes, handed_on, &STOP);
            // It has room, if it is ready.
            let _ = queue.enqueue(Request { identifier, bytes });
            if !handed_on {
                LOST.store(LOST.load(Relaxed).wrapping_add(1), Relaxed);
            }
            FDCAN1.rxfa(0).write(|acknowledge| acknowledge.set_fai(status.fgi()));
        }
        ARRIVED.wake();
    });
}
