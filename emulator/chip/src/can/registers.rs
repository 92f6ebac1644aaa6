//! FDCAN1's registers (RM0440, 44.4) and its message RAM as the core sees them.

use super::counters::State;
use super::ram::WORDS;
use super::{CCE, DAR, DEPTH, FDOE, Fdcan, Fifo, INIT, MON, NAME, Phase};
use crate::bits::{bit, field, unmodelled, wrong};
use bus::Complaint;

/// CCCR's bits that have a model; EFBI and PXHD change nothing here, TXP only delays.
const MODELLED: u32 = INIT | CCE | MON | DAR | FDOE | super::BRSE | 1 << 12 | 1 << 13 | 1 << 14;
/// All flags of IR.
const FLAGS: u32 = 0xff_ffff;
/// Flags of each group of ILS.
const GROUPS: [u32; 7] = [0x7, 0x38, 0x1c0, 0x1e00, 0xe000, 0x3_0000, 0xfc_0000];

impl Fdcan {
    pub(super) fn stored(&self, offset: u32) -> u32 {
        self.stored.get(&offset).copied().unwrap_or(0)
    }

    fn may_configure(&self) -> bool {
        self.cccr & (INIT | CCE) == INIT | CCE
    }

    /// Interrupt lines 0 and 1.
    pub fn interrupts(&self) -> [bool; 2] {
        let (flags, second) = (self.ir & self.stored(0x54), self.stored(0x58));
        let of_line = |line: bool| {
            let groups = GROUPS.iter().enumerate().filter(|(group, _)| bit(second, *group as u32) == line);
            groups.fold(0, |flags, (_, group)| flags | group)
        };
        [0, 1].map(|line| bit(self.stored(0x5c), line) && flags & of_line(line == 1) != 0)
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now_s: f64) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => 0x3214_1218,
            0x04 => 0x8765_4321,
            0x0c => self.dbtp,
            0x18 => self.cccr,
            0x1c => self.nbtp,
            0x10 | 0x14 | 0x20 | 0x28 | 0x54 | 0x58 | 0x5c | 0xc0 | 0xdc | 0xe0 => self.stored(offset),
            0x24 => self.stamp(now_s),
            0x2c => 0xffff,
            0x40 => {
                let value = self.counters.register();
                self.counters.logged = 0;
                value
            }
            0x44 => {
                let value = self.status();
                self.codes = [7, 7];
                self.seen = 0;
                value
            }
            0x48 => self.tdcr,
            0x50 => self.ir,
            0x80 => self.global.control,
            0x84 => self.global.mask,
            0x88 => self.high_priority,
            0x90 | 0x98 => self.fifos[usize::from(offset == 0x98)].status(),
            0x94 | 0x9c | 0xcc | 0xd0 | 0xe8 => 0,
            0xc4 => self.buffers(),
            0xc8 => self.pending,
            0xd4 => self.transmitted,
            0xd8 => self.cancelled,
            0xe4 => self.events.status(),
            0x100 => self.divider,
            _ => return Err(unmodelled(NAME, offset)),
        })
    }

    /// PSR.
    fn status(&self) -> u32 {
        let activity = match (self.phase, self.sending) {
            (Phase::Stopped | Phase::Waiting(_), _) => 0,
            (Phase::Running, None) => 1,
            (Phase::Running, Some(_)) => 3,
        };
        let state = self.counters.state();
        self.codes[0]
            | activity << 3
            | u32::from(state != State::Active) << 5
            | u32::from(self.counters.warns()) << 6
            | u32::from(state == State::Off) << 7
            | self.codes[1] << 8
            | self.seen
            | if bit(self.dbtp, 23) { self.delay() << 16 } else { 0 }
    }

    /// TXFQS. Where the buffers are a queue, levels and get index are zero.
    fn buffers(&self) -> u32 {
        let full = self.pending.count_ones() == DEPTH;
        let oldest = self.queue.front().map_or(self.put, |(buffer, _)| *buffer);
        let fifo = if bit(self.stored(0xc0), 24) { 0 } else { (DEPTH - self.pending.count_ones()) | oldest << 8 };
        fifo | self.put << 16 | u32::from(full) << 21
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now_s: f64) -> Result<(), Complaint> {
        let protected = matches!(offset, 0x0c | 0x14 | 0x1c | 0x20 | 0x28 | 0x48 | 0x80 | 0x84 | 0xc0 | 0x100);
        if protected && !self.may_configure() {
            return Err(wrong(NAME, format!("the register at {offset:#05x} takes no value without INIT and CCE")));
        }
        match offset {
            0x0c => self.dbtp = value & 0x009f_1fff,
            0x18 => return self.control(value),
            0x1c => self.nbtp = value & 0xffff_ff7f,
            0x48 => self.tdcr = value & 0x7f7f,
            0x50 => self.ir &= !(value & FLAGS),
            0x54 => _ = self.stored.insert(offset, value & FLAGS),
            0x58 => _ = self.stored.insert(offset, value & 0x7f),
            0x5c => _ = self.stored.insert(offset, value & 3),
            0x20 | 0x28 | 0xc0 | 0xdc | 0xe0 => {
                self.stored.insert(offset, value);
                if offset == 0x20 && field(value, 0, 2) == 2 || offset == 0x28 && bit(value, 0) {
                    return Err(wrong(NAME, "time stamps of TIM3 and timeouts are not modelled"));
                }
            }
            0x24 | 0x2c => {}
            0x80 => self.global.control = value & 0x0f1f_033f,
            0x84 => self.global.mask = value & 0x1fff_ffff,
            0x94 | 0x9c => self.fifos[usize::from(offset == 0x9c)].acknowledge(value & 7),
            0xcc => return self.request(value, now_s),
            0xd0 => self.cancel(value),
            0xe8 => self.events.acknowledge(value & 3),
            0x100 => self.divider = value & 0xf,
            0x10 | 0x14 if value == 0 => {}
            _ => return Err(unmodelled(NAME, offset)),
        }
        Ok(())
    }

    fn control(&mut self, value: u32) -> Result<(), Complaint> {
        if value & !MODELLED & 0xffff != 0 {
            return Err(wrong(NAME, format!("CCCR: {:#x} is not modelled", value & !MODELLED & 0xffff)));
        }
        let before = self.cccr;
        // CCE follows INIT, and what is set up with it may change only then (44.4.6).
        let free = if self.may_configure() { MODELLED } else { INIT | CCE };
        let mut now = before & !free | value & free;
        if now & INIT == 0 || before & INIT == 0 {
            now &= !CCE;
        }
        self.cccr = now;
        if now & CCE != 0 && before & CCE == 0 {
            self.clear();
        }
        if now & INIT != 0 && before & INIT == 0 {
            self.stop();
        }
        if now & INIT == 0 && before & INIT != 0 {
            self.start();
            return self.check_timing();
        }
        if (value ^ now) & !(INIT | CCE) & MODELLED != 0 {
            return Err(wrong(NAME, "CCCR is changed without INIT and CCE"));
        }
        Ok(())
    }

    /// What CCE clears (44.4.6).
    fn clear(&mut self) {
        self.high_priority = 0;
        self.fifos = [Fifo::default(); 2];
        self.events = Fifo::default();
        (self.pending, self.transmitted, self.cancelled, self.put) = (0, 0, 0, 0);
        self.queue.clear();
        self.sending = None;
    }

    fn check_timing(&self) -> Result<(), Complaint> {
        let refuse = |what: &str| Err(wrong(NAME, what));
        if self.clock_hz == 0.0 {
            return refuse("its kernel clock does not run (FDCANSEL of CCIPR)");
        }
        let timing = self.timing();
        for (name, rate) in [("NBTP", timing.nominal), ("DBTP", timing.data)] {
            if rate.jump > rate.after {
                return refuse(&format!("{name}: the jump width is beyond the second segment"));
            }
        }
        if bit(self.dbtp, 23) && field(self.dbtp, 16, 5) > 1 {
            return refuse("DBTP: the compensation of the delay takes a prescaler of 1 or 2 (44.3.2)");
        }
        if 1.0 / timing.nominal.bit_s() > 1.001e6 {
            return refuse("NBTP: more than 1 Mbit/s");
        }
        Ok(())
    }

    fn request(&mut self, value: u32, now_s: f64) -> Result<(), Complaint> {
        if self.cccr & INIT != 0 {
            return Err(wrong(NAME, "TXBAR is written while INIT is set"));
        }
        for buffer in (0..DEPTH).filter(|buffer| bit(value, *buffer)) {
            if bit(self.pending, buffer) {
                return Err(wrong(NAME, "TXBAR asks for a buffer that is pending"));
            }
            self.pending |= 1 << buffer;
            self.transmitted &= !(1 << buffer);
            self.cancelled &= !(1 << buffer);
            self.queue.push_back((buffer, now_s));
        }
        let next = |place: u32| (place + 1) % DEPTH;
        for _ in 0..DEPTH {
            if bit(self.pending, self.put) {
                self.put = next(self.put);
            }
        }
        Ok(())
    }

    /// What is on the wire already goes its way.
    fn cancel(&mut self, value: u32) {
        let asked = value & self.pending;
        for buffer in (0..DEPTH).filter(|buffer| bit(asked, *buffer)) {
            if self.sending != Some(buffer) {
                self.give_up(buffer);
            }
        }
    }

    /// Reads a word of the message RAM.
    pub fn read_ram(&self, offset: u32) -> Result<u32, Complaint> {
        self.ram.0.get(offset as usize / 4).copied().ok_or_else(|| unmodelled("FDCAN RAM", offset))
    }

    /// Writes a word of the message RAM.
    pub fn write_ram(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        let word = self.ram.0.get_mut(offset as usize / 4).ok_or_else(|| unmodelled("FDCAN RAM", offset))?;
        *word = value;
        debug_assert!((offset as usize) < 4 * WORDS);
        Ok(())
    }
}
