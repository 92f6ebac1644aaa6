//! What is around a drive in the examples: a motor, a flash, and a tool at the other end of the serial line. No part of
//! a port.
#![allow(dead_code, reason = "no example uses everything")]

use embedded_storage::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use embedded_storage_inmemory::{MemFlash, MemFlashError};
use hallservo::board::{Output, Sample};
use hallservo::commutation::Commutation;
use hallservo::settings::{Control, Settings};
use hallservo_protocol::{Activity, Answer, Ask, Decoder, FRAME, Reply, Request, Status, encode};
use plant::{Plant, PlantParameters};
use std::collections::VecDeque;
use std::error::Error;
use std::sync::Mutex;

/// A simulated motor with uneven sensors, its bridge and its converters: what the registers of a chip lead to.
pub struct Motor {
    pub plant: Plant,
    /// Counts of half a PWM period.
    period: u16,
}

impl Motor {
    pub fn new(seed: u64, period: u16) -> Result<Self, plant::Error> {
        Ok(Self { plant: Plant::new(&PlantParameters::imperfect(seed), seed)?, period })
    }

    /// What the ADCs deliver.
    pub fn sample(&mut self) -> Sample {
        let plant::Codes { halls, currents, bus } = self.plant.sample();
        Sample { halls, currents, bus, ..Sample::default() }
    }

    /// Mechanical turns since the start, as they really are.
    pub fn turns(&self) -> f64 {
        self.plant.truth().mechanical_angle_rad / std::f64::consts::TAU
    }

    /// A PWM period with these compare values.
    pub fn turn(&mut self, output: &Output) {
        self.plant.advance(&rig::legs(output, self.period));
    }
}

/// A flash that keeps what it holds when the power goes: a copy is the same flash.
#[derive(Clone, Copy)]
pub struct Flash(&'static Mutex<Cells>);

type Cells = MemFlash<{ 6 * 2048 }, 2048, 8>;

impl Flash {
    /// One of two, each blank at first.
    pub fn first() -> Self {
        static CELLS: Mutex<Cells> = Mutex::new(MemFlash::new(0xff));
        Self(&CELLS)
    }

    pub fn second() -> Self {
        static CELLS: Mutex<Cells> = Mutex::new(MemFlash::new(0xff));
        Self(&CELLS)
    }

    fn with<T>(self, access: impl FnOnce(&mut Cells) -> T) -> T {
        access(&mut self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner))
    }
}

impl ErrorType for Flash {
    type Error = MemFlashError;
}

impl ReadNorFlash for Flash {
    const READ_SIZE: usize = 1;

    fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Self::Error> {
        self.with(|cells| ReadNorFlash::read(cells, offset, bytes))
    }

    fn capacity(&self) -> usize {
        6 * 2048
    }
}

impl NorFlash for Flash {
    const WRITE_SIZE: usize = 8;
    const ERASE_SIZE: usize = 2048;

    fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Self::Error> {
        self.with(|cells| NorFlash::write(cells, offset, bytes))
    }

    fn erase(&mut self, from: u32, to: u32) -> Result<(), Self::Error> {
        self.with(|cells| NorFlash::erase(cells, from, to))
    }
}

/// Field-oriented control of the simulated motor, whose sensing and windings are the library's defaults.
pub fn settings() -> Settings {
    Settings { commutation: Commutation::FieldOriented, control: Some(Control::default()), ..Settings::default() }
}

/// The bytes on a serial line, both ways.
#[derive(Default)]
pub struct Line {
    pub to_drive: VecDeque<u8>,
    pub from_drive: VecDeque<u8>,
}

/// A tool such as `hallctl`. Each call runs the drive, a millisecond at a time, until it has answered.
#[derive(Default)]
pub struct Tool {
    line: Line,
    decoder: Decoder,
    id: u16,
}

impl Tool {
    /// Asks, and takes the answer; a refusal is an error.
    pub fn ask(
        &mut self,
        ask: Ask<'_>,
        mut millisecond: impl FnMut(&mut Line),
    ) -> Result<Option<Status>, Box<dyn Error>> {
        self.id += 1;
        let mut frame = [0; FRAME];
        let length = encode(&Request { id: self.id, client: 1, unattended: false, ask }, &mut frame)?;
        self.line.to_drive.extend(&frame[..length]);
        for _ in 0..1000 {
            millisecond(&mut self.line);
            while let Some(byte) = self.line.from_drive.pop_front() {
                match self.decoder.push::<Reply<'_>>(byte).transpose()?.map(|reply| reply.answer) {
                    None => {}
                    Some(Answer::Status(status)) => return Ok(Some(status)),
                    Some(Answer::Refused(refusal)) => return Err(format!("refused: {refusal:?}").into()),
                    Some(_) => return Ok(None),
                }
            }
        }
        Err("the drive does not answer".into())
    }

    /// How the drive is.
    pub fn status(&mut self, millisecond: impl FnMut(&mut Line)) -> Result<Status, Box<dyn Error>> {
        self.ask(Ask::Status, millisecond)?.ok_or_else(|| "no status".into())
    }

    /// Waits for a procedure to come to its end.
    pub fn wait(&mut self, mut millisecond: impl FnMut(&mut Line)) -> Result<Status, Box<dyn Error>> {
        loop {
            let status = self.status(&mut millisecond)?;
            if status.activity == Activity::None {
                return Ok(status);
            }
        }
    }
}
