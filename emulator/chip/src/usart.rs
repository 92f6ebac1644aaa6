//! Serial ports (RM0440, chapters 37 and 38): USART and LPUART with and without FIFO, bytes in real time.

use crate::bits::{bit, unmodelled, wrong};
use bus::{Complaint, Cycle};
use std::collections::VecDeque;

const UE: u32 = 1;
const RE: u32 = 1 << 2;
const TE: u32 = 1 << 3;
const FIFOEN: u32 = 1 << 29;

const FE: u32 = 1 << 1;
const ORE: u32 = 1 << 3;
const IDLE: u32 = 1 << 4;
const RXNE: u32 = 1 << 5;
const TC: u32 = 1 << 6;
const TXE: u32 = 1 << 7;
const BUSY: u32 = 1 << 16;

/// Depth of the FIFOs.
const DEPTH: usize = 8;
const PRESCALERS: [f64; 12] = [1.0, 2.0, 4.0, 6.0, 8.0, 10.0, 12.0, 16.0, 32.0, 64.0, 128.0, 256.0];
/// Beyond this difference of the baud rates a byte is garbled (37.5.9: 3.75 % at 8 data bits).
const TOLERANCE: f64 = 0.0375;

/// A port.
#[derive(Clone, Debug)]
pub struct Usart {
    name: &'static str,
    low_power: bool,
    cr: [u32; 3],
    brr: u32,
    presc: u32,
    /// ORE, FE, IDLE and TC; the rest follows from the FIFOs.
    flags: u32,
    received: VecDeque<u8>,
    to_send: VecDeque<u8>,
    /// Byte on the line and when it is over.
    sending: Option<(u8, f64)>,
    /// Bytes that the other side sends, and when the first is over.
    line: VecDeque<u8>,
    arrives: Option<f64>,
    idle_at: Option<f64>,
    /// Cycles of HCLK per period of the port's clock.
    ratio: f64,
    /// HCLK over the baud rate of the other side.
    other_bit: f64,
}

impl Usart {
    /// As reset leaves it.
    pub fn new(name: &'static str) -> Self {
        Self {
            name,
            low_power: name.starts_with("LP"),
            cr: [0; 3],
            brr: 0,
            presc: 0,
            flags: TC,
            received: VecDeque::new(),
            to_send: VecDeque::new(),
            sending: None,
            line: VecDeque::new(),
            arrives: None,
            idle_at: None,
            ratio: 1.0,
            other_bit: 1.0,
        }
    }

    /// As the manual calls it.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Cycles of HCLK per period of its clock, and per bit of the other side.
    pub fn set_clock(&mut self, ratio: f64, other_bit: f64) {
        self.ratio = ratio;
        self.other_bit = other_bit;
    }

    /// Cycles of HCLK that a bit lasts (37.5.7, 38.4.7).
    pub fn bit_cycles(&self) -> f64 {
        let clock = self.ratio * PRESCALERS[(self.presc as usize & 0xf).min(11)];
        let periods = if self.low_power {
            f64::from(self.brr & 0xf_ffff) / 256.0
        } else if bit(self.cr[0], 15) {
            f64::from(self.brr & 0xfff0 | (self.brr & 7) << 1) / 2.0
        } else {
            f64::from(self.brr & 0xffff)
        };
        periods * clock
    }

    /// Start, data with parity, and stop bits.
    fn frame_bits(&self) -> f64 {
        let data = match (bit(self.cr[0], 28), bit(self.cr[0], 12)) {
            (false, false) => 8.0,
            (false, true) => 9.0,
            _ => 7.0,
        };
        let stop = [1.0, 0.5, 2.0, 1.5][(self.cr[1] >> 12 & 3) as usize];
        1.0 + data + stop
    }

    fn depth(&self) -> usize {
        if self.cr[0] & FIFOEN != 0 { DEPTH } else { 1 }
    }

    fn on(&self, what: u32) -> bool {
        self.cr[0] & (UE | what) == UE | what
    }

    /// The other side sends these.
    pub fn receive(&mut self, bytes: &[u8], now: Cycle) {
        self.line.extend(bytes);
        if self.arrives.is_none() && !self.line.is_empty() {
            self.arrives = Some(now as f64 + 10.0 * self.other_bit);
        }
    }

    /// When something happens next.
    pub fn next(&self) -> f64 {
        let sent = self.sending.map_or(f64::INFINITY, |(_, at)| at);
        sent.min(self.arrives.unwrap_or(f64::INFINITY)).min(self.idle_at.unwrap_or(f64::INFINITY))
    }

    /// Does what is due; a byte that has left the port.
    pub fn fire(&mut self) -> Option<u8> {
        let now = self.next();
        if self.idle_at == Some(now) {
            self.idle_at = None;
            self.flags |= IDLE;
        }
        if self.arrives == Some(now) {
            self.arrive(now);
        }
        let (byte, at) = self.sending?;
        if at > now {
            return None;
        }
        self.sending = None;
        self.shift(at);
        if self.sending.is_none() {
            self.flags |= TC;
        }
        Some(byte)
    }

    fn arrive(&mut self, now: f64) {
        let byte = self.line.pop_front().unwrap_or(0);
        self.arrives = (!self.line.is_empty()).then_some(now + 10.0 * self.other_bit);
        if !self.on(RE) {
            return;
        }
        self.idle_at = self.arrives.is_none().then_some(now + self.frame_bits() * self.bit_cycles());
        let off = (self.bit_cycles() / self.other_bit - 1.0).abs();
        let byte = if off > TOLERANCE {
            self.flags |= FE;
            byte.rotate_left(3) ^ 0xa5
        } else {
            byte
        };
        if self.received.len() < self.depth() {
            self.received.push_back(byte);
        } else if !bit(self.cr[2], 12) {
            self.flags |= ORE;
        }
    }

    fn shift(&mut self, now: f64) {
        if self.sending.is_none()
            && self.on(TE)
            && let Some(byte) = self.to_send.pop_front()
        {
            self.flags &= !TC;
            self.sending = Some((byte, now + self.frame_bits() * self.bit_cycles()));
        }
    }

    fn isr(&self) -> u32 {
        let fifo = self.cr[0] & FIFOEN != 0;
        let mut isr = self.flags;
        isr |= if self.received.is_empty() { 0 } else { RXNE };
        isr |= if self.to_send.len() < self.depth() { TXE } else { 0 };
        isr |= if self.arrives.is_some() && self.on(RE) { BUSY } else { 0 };
        if fifo {
            isr |= if self.to_send.is_empty() { 1 << 23 } else { 0 };
            isr |= if self.received.len() == DEPTH { 1 << 24 } else { 0 };
        }
        isr | if self.on(TE) { 1 << 21 } else { 0 } | if self.on(RE) { 1 << 22 } else { 0 }
    }

    /// Interrupt line (37.6, table 346).
    pub fn interrupt(&self) -> bool {
        let (isr, cr1) = (self.isr(), self.cr[0]);
        let enabled = |flag: u32, enable: u32| isr & flag != 0 && bit(cr1, enable);
        enabled(IDLE, 4)
            || enabled(RXNE | ORE, 5)
            || enabled(TC, 6)
            || enabled(TXE, 7)
            || enabled(1 << 23, 30)
            || enabled(1 << 24, 31)
            || bit(self.cr[2], 0) && isr & (FE | ORE | 1 << 2) != 0
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00..=0x08 => self.cr[(offset / 4) as usize],
            0x0c => self.brr,
            0x1c => self.isr(),
            0x18 | 0x20 => 0,
            0x24 => u32::from(self.received.pop_front().unwrap_or(0)),
            0x28 => 0,
            0x2c => self.presc,
            _ => return Err(unmodelled(self.name, offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let name = self.name;
        match offset {
            0x00 => {
                self.cr[0] = value;
                if value & UE == 0 {
                    self.sending = None;
                    self.to_send.clear();
                    self.received.clear();
                    self.flags = TC;
                    self.idle_at = None;
                }
                self.shift(now as f64);
                if value & (1 << 10 | 1 << 13 | 1 << 14 | 1 << 26) != 0 {
                    return Err(wrong(name, "CR1: parity, mute mode, character match and timeouts are not modelled"));
                }
            }
            0x04 => {
                self.cr[1] = value;
                if value & !0x3000 != 0 {
                    return Err(wrong(name, "CR2: nothing but STOP is modelled"));
                }
            }
            0x08 => {
                self.cr[2] = value;
                if value & !0x1801 != 0 {
                    return Err(wrong(name, "CR3: nothing but EIE, ONEBIT and OVRDIS is modelled"));
                }
            }
            0x0c | 0x2c => {
                if self.cr[0] & UE != 0 {
                    return Err(wrong(name, "BRR or PRESC is written while the port is enabled"));
                }
                *(if offset == 0x0c { &mut self.brr } else { &mut self.presc }) = value;
            }
            0x18 => {
                if bit(value, 3) {
                    self.received.clear();
                }
                if bit(value, 4) {
                    self.to_send.clear();
                }
            }
            0x20 => self.flags &= !(value & 0x5f),
            0x28 => {
                if self.to_send.len() == self.depth() {
                    return Err(wrong(name, "TDR is written while it is full: the byte is lost"));
                }
                self.to_send.push_back(value as u8);
                self.flags &= !TC;
                self.shift(now as f64);
                if !self.on(TE) {
                    return Err(wrong(name, "TDR is written while the transmitter is off"));
                }
            }
            _ => return Err(unmodelled(name, offset)),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TDR: u32 = 0x28;

    /// 170 MHz, 460 800 baud: BRR = 369.
    fn port(cr1: u32) -> Usart {
        let mut port = Usart::new("USART2");
        port.set_clock(1.0, 170e6 / 460_800.0);
        port.write(0x0c, 369, 0).unwrap();
        port.write(0x00, UE | RE | TE | cr1, 0).unwrap();
        port
    }

    #[test]
    fn baud_rates_of_brr() {
        assert_eq!(port(0).bit_cycles(), 369.0);
        let mut port = Usart::new("LPUART1");
        port.write(0x0c, 94_444, 0).unwrap();
        assert!((port.bit_cycles() - 368.92).abs() < 0.01);
        let mut port = Usart::new("USART1");
        // Oversampling by 8: USARTDIV = 2 · 17e6 / 115 200 = 295 = 0x127, BRR = 0x123 (0x7 shifted right).
        port.write(0x0c, 0x123, 0).unwrap();
        port.write(0x00, 1 << 15, 0).unwrap();
        assert_eq!(port.bit_cycles(), 147.0);
    }

    #[test]
    fn bytes_leave_one_after_the_other() {
        let mut port = port(0);
        port.write(TDR, 0x55, 1000).unwrap();
        assert_ne!(port.read(0x1c).unwrap() & TXE, 0, "moved to the shift register at once");
        port.write(TDR, 0xaa, 1000).unwrap();
        assert_eq!(port.read(0x1c).unwrap() & (TXE | TC), 0);
        assert_eq!(port.next(), 1000.0 + 3690.0);
        assert_eq!(port.fire(), Some(0x55));
        assert_eq!(port.read(0x1c).unwrap() & (TXE | TC), TXE);
        assert_eq!(port.next(), 1000.0 + 7380.0);
        assert_eq!(port.fire(), Some(0xaa));
        assert_eq!(port.read(0x1c).unwrap() & (TXE | TC), TXE | TC);
    }

    #[test]
    fn bytes_arrive_and_the_line_goes_idle() {
        let mut port = port(FIFOEN);
        port.receive(b"ab", 0);
        while port.next().is_finite() {
            port.fire();
        }
        assert_ne!(port.read(0x1c).unwrap() & IDLE, 0);
        assert_eq!([port.read(0x24).unwrap(), port.read(0x24).unwrap()], [u32::from(b'a'), u32::from(b'b')]);
        assert_eq!(port.read(0x1c).unwrap() & RXNE, 0);
        port.write(0x20, IDLE, 9000).unwrap();
        assert_eq!(port.read(0x1c).unwrap() & IDLE, 0);
    }

    #[test]
    fn more_than_there_is_room_for_is_an_overrun() {
        for (fifo, room) in [(0, 1), (FIFOEN, 8)] {
            let mut port = port(fifo | 1 << 5);
            port.receive(&[7; 9], 0);
            for received in 1..=9 {
                port.fire();
                assert_eq!(port.read(0x1c).unwrap() & ORE != 0, received > room, "{received} into {room}");
            }
            assert!(port.interrupt());
            port.write(0x20, ORE, 0).unwrap();
        }
    }

    #[test]
    fn a_wrong_baud_rate_garbles() {
        let mut port = port(0);
        port.set_clock(1.0, 170e6 / 500_000.0);
        port.receive(b"a", 0);
        port.fire();
        assert_ne!(port.read(0x1c).unwrap() & FE, 0);
        assert_ne!(port.read(0x24).unwrap(), u32::from(b'a'));
    }
}
