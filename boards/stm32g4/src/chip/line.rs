//! The serial line, which is USART2. Its interrupt takes bytes from the port to one queue and from another to the port. It
//! hears at once whether a byte completes a request to disarm, whatever the tasks are doing.

use crate::chip::STOP;
use crate::chip::bridge::{Pin, connect};
use crate::registers::clock::{PCLK1_HZ, baud};
use crate::registers::usart::{ERRORS, cr1};
use core::cell::RefCell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::Poll;
use cortex_m::peripheral::NVIC;
use critical_section::Mutex;
use embassy_stm32::interrupt;
use embassy_stm32::pac::usart::regs::{Brr, Cr1, Dr, Icr};
use embassy_stm32::pac::{Interrupt, RCC, USART2};
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io_async::{ErrorType, Read, Write};
use hallservo_app::Listener;
use heapless::spsc::{Consumer, Producer, Queue};
use static_cell::ConstStaticCell;

/// Bits a second, as `hallctl` expects them.
const BAUD: u32 = 460_800;
/// USART_BRR.
const DIVIDER: u16 = {
    let (divider, error) = baud(PCLK1_HZ, BAUD);
    assert!(error.abs() < 100, "the baud rate is off by more than 1 %");
    divider
};
/// Bytes that wait on their way in or out, and one more.
const ROOM: usize = 256;

static LINE: Mutex<RefCell<Option<Line>>> = Mutex::new(RefCell::new(None));
static ARRIVED: AtomicWaker = AtomicWaker::new();
static SENT: AtomicWaker = AtomicWaker::new();

/// What the interrupt has, once the line is [open].
struct Line {
    listener: Listener,
    received: Producer<'static, u8, ROOM>,
    to_send: Consumer<'static, u8, ROOM>,
}

#[interrupt]
fn USART2() {
    critical_section::with(|section| {
        let Ok(mut line) = LINE.borrow(section).try_borrow_mut() else { return };
        let Some(line) = &mut *line else { return };
        line.receive();
        line.send();
    });
}

impl Line {
    fn receive(&mut self) {
        while USART2.isr().read().rxne() {
            let byte = USART2.rdr().read().0 as u8;
            // One that finds no room is lost, as if the line had disturbed it: its frame's CRC tells.
            self.listener.hear(byte, self.received.enqueue(byte).is_ok(), &STOP);
            ARRIVED.wake();
        }
        USART2.icr().write_value(Icr(ERRORS));
    }

    fn send(&mut self) {
        while USART2.isr().read().txe()
            && let Some(byte) = self.to_send.dequeue()
        {
            USART2.tdr().write_value(Dr(byte.into()));
        }
        let sends = self.to_send.ready();
        USART2.cr1().write_value(Cr1(cr1(sends)));
        if !sends {
            SENT.wake();
        }
    }
}

/// Opens the line at its two pins, for the tasks.
pub(crate) fn open(pins: &[Pin; 2]) -> (Received, Sending) {
    static FROM_PORT: ConstStaticCell<Queue<u8, ROOM>> = ConstStaticCell::new(Queue::new());
    static TO_PORT: ConstStaticCell<Queue<u8, ROOM>> = ConstStaticCell::new(Queue::new());
    RCC.apb1enr1().modify(|enable| enable.set_usart2en(true));
    let (received, from_port) = FROM_PORT.take().split();
    let (to_port, to_send) = TO_PORT.take().split();
    let line = Line { listener: Listener::new(), received, to_send };
    critical_section::with(|section| LINE.borrow(section).replace(Some(line)));
    connect(pins);
    USART2.brr().write_value(Brr(DIVIDER.into()));
    USART2.cr1().write_value(Cr1(cr1(false)));
    // SAFETY: what it shares with the tasks is behind critical sections, whose ceiling is its priority.
    unsafe { NVIC::unmask(Interrupt::USART2) };
    (Received(from_port), Sending(to_port))
}

/// The bytes for the tasks.
pub(crate) struct Received(Consumer<'static, u8, ROOM>);

impl ErrorType for Received {
    type Error = Infallible;
}

impl Read for Received {
    async fn read(&mut self, bytes: &mut [u8]) -> Result<usize, Infallible> {
        poll_fn(|context| {
            ARRIVED.register(context.waker());
            let mut length = 0;
            for (place, byte) in bytes.iter_mut().zip(core::iter::from_fn(|| self.0.dequeue())) {
                *place = byte;
                length += 1;
            }
            if length > 0 { Poll::Ready(Ok(length)) } else { Poll::Pending }
        })
        .await
    }
}

/// The bytes of the tasks.
pub(crate) struct Sending(Producer<'static, u8, ROOM>);

impl ErrorType for Sending {
    type Error = Infallible;
}

impl Write for Sending {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, Infallible> {
        poll_fn(|context| {
            SENT.register(context.waker());
            let length = bytes.iter().take_while(|byte| self.0.enqueue(**byte).is_ok()).count();
            NVIC::pend(Interrupt::USART2);
            if length > 0 || bytes.is_empty() { Poll::Ready(Ok(length)) } else { Poll::Pending }
        })
        .await
    }

    /// What waits is sent without being waited for.
    async fn flush(&mut self) -> Result<(), Infallible> {
        Ok(())
    }
}
