//! The line to a drive: a serial port, a pseudo-terminal, or TCP.

use hallservo_protocol::BAUD;
use serial2::SerialPort;
use std::io::{self, BufReader, Read, Write};
use std::net::TcpStream;
use std::time::Duration;

/// Longest wait for bytes before a look at the clock, and at whether a signal has come.
const LOOK: Duration = Duration::from_millis(5);

/// Both directions of a line. A read that finds nothing for a while fails with `WouldBlock` or `TimedOut`.
pub struct Line {
    /// From the drive.
    pub reader: Box<dyn Read + Send>,
    /// To the drive.
    pub writer: Box<dyn Write + Send>,
}

impl Line {
    fn new(reader: impl Read + Send + 'static, writer: impl Write + Send + 'static) -> Self {
        Self { reader: Box::new(BufReader::new(reader)), writer: Box::new(writer) }
    }

    fn tcp(stream: TcpStream) -> io::Result<Self> {
        stream.set_nodelay(true)?;
        stream.set_read_timeout(Some(LOOK))?;
        Ok(Self::new(stream.try_clone()?, stream))
    }

    fn serial(path: &str) -> io::Result<Self> {
        let mut serial = SerialPort::open(path, BAUD)?;
        own(&serial)?;
        serial.set_read_timeout(LOOK)?;
        Ok(Self::new(serial.try_clone()?, serial))
    }

    /// To a process of this machine.
    ///
    /// # Errors
    /// Those of the system.
    #[cfg(unix)]
    pub fn local(stream: std::os::unix::net::UnixStream) -> io::Result<Self> {
        stream.set_read_timeout(Some(LOOK))?;
        Ok(Self::new(stream.try_clone()?, stream))
    }
}

/// Keeps other programs that respect a lock (this one, picocom, tio) from the port until this process ends.
#[cfg(unix)]
fn own(serial: &SerialPort) -> io::Result<()> {
    use rustix::fs::{FlockOperation, flock};
    use std::os::fd::AsFd;
    flock(serial.as_fd(), FlockOperation::NonBlockingLockExclusive).map_err(|error| match error {
        rustix::io::Errno::WOULDBLOCK => io::Error::new(io::ErrorKind::ResourceBusy, "another program has it open"),
        error => error.into(),
    })
}

/// A serial port is one program's at a time there.
#[cfg(not(unix))]
fn own(_: &SerialPort) -> io::Result<()> {
    Ok(())
}

/// Opens `tcp:HOST:PORT`, or the path of a serial port or a pseudo-terminal.
///
/// # Errors
/// Those of the system, and that another program has the port.
pub fn open(port: &str) -> io::Result<Line> {
    match port.strip_prefix("tcp:") {
        Some(address) => Line::tcp(TcpStream::connect(address)?),
        None => Line::serial(port),
    }
}
