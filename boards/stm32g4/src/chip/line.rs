//! The serial line's receiving half. The interrupt that takes a byte hears at once whether that completes a request to
//! disarm, whatever the tasks are doing; for them the bytes wait in a queue.

use crate::chip::STOP;
use core::cell::RefCell;
use core::convert::Infallible;
use core::future::poll_fn;
use core::task::Poll;
use critical_section::Mutex;
use embassy_stm32::interrupt::typelevel;
use embassy_stm32::usart::BufferedUartRx;
use embassy_sync::waitqueue::AtomicWaker;
use embedded_io::{ErrorType, ReadReady};
use embedded_io_async::Read;
use hallservo_app::Listener;
use heapless::spsc::{Consumer, Producer, Queue};
use static_cell::ConstStaticCell;

/// Bytes that wait for the tasks, and one more.
const ROOM: usize = 256;

/// What takes bytes, once the line is [open](Received::open).
static LISTENING: Mutex<RefCell<Option<Listening>>> = Mutex::new(RefCell::new(None));
static ARRIVED: AtomicWaker = AtomicWaker::new();

struct Listening {
    uart: &'static mut BufferedUartRx<'static>,
    listener: Listener,
    queue: Producer<'static, u8, ROOM>,
}

/// The handler of the serial line's interrupt, to be bound after the HAL's own.
pub struct Listen;

impl<I: typelevel::Interrupt> typelevel::Handler<I> for Listen {
    unsafe fn on_interrupt() {
        listen();
    }
}

fn listen() {
    critical_section::with(|section| {
        let Ok(mut listening) = LISTENING.borrow(section).try_borrow_mut() else { return };
        let Some(Listening { uart, listener, queue }) = &mut *listening else { return };
        let mut byte = [0];
        while uart.read_ready() == Ok(true) && embedded_io::Read::read(uart, &mut byte) == Ok(1) {
            let [byte] = byte;
            // One that finds no room is lost, as if the line had disturbed it: its frame's CRC tells.
            listener.hear(byte, queue.enqueue(byte).is_ok(), &STOP);
            ARRIVED.wake();
        }
    });
}

/// The bytes for the tasks.
pub(crate) struct Received(Consumer<'static, u8, ROOM>);

impl Received {
    pub fn open(uart: &'static mut BufferedUartRx<'static>) -> Self {
        static QUEUE: ConstStaticCell<Queue<u8, ROOM>> = ConstStaticCell::new(Queue::new());
        let (queue, received) = QUEUE.take().split();
        let listening = Listening { uart, listener: Listener::new(), queue };
        critical_section::with(|section| LISTENING.borrow(section).replace(Some(listening)));
        // What has come before.
        listen();
        Self(received)
    }
}

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
