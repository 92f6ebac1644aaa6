//! The line to a drive: a serial port, a pseudo-terminal, or TCP.

use hallservo_protocol::BAUD;
use serial2::SerialPort;
use std::io::{self, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest wait for bytes before a look at the clock.
const LOOK: Duration = Duration::from_millis(100);

/// Bytes both ways.
pub trait Stream: Read + Write {}

impl<T: Read + Write> Stream for T {}

/// Opens `tcp:HOST:PORT`, or the path of a serial port or a pseudo-terminal.
///
/// # Errors
/// Those of the system.
pub fn open(port: &str) -> io::Result<Box<dyn Stream>> {
    if let Some(address) = port.strip_prefix("tcp:") {
        let stream = TcpStream::connect(address)?;
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK))?;
        return Ok(Box::new(stream));
    }
    let mut serial = SerialPort::open(port, BAUD)?;
    serial.set_read_timeout(LOOK)?;
    Ok(Box::new(serial))
}
