//! The converters (RM0440, chapter 21): power-up, calibration, regular and injected sequences, sampling instants.
//!
//! Times are cycles of HCLK, with fractions: the converter's clock need not divide it.

mod common;
mod registers;

pub use common::Common;

use bus::Cycle;

/// From a trigger to the start of sampling, periods of the converter's clock: kernel clock, HCLK/1, /2, /4 (data sheet
/// DS12288, table 66, tLATR; 2 is the middle of 1.5 to 2.5).
const LATENCY: [f64; 4] = [2.0, 2.0, 2.25, 2.125];
/// Sampling times of SMPx, periods of the converter's clock (21.4.12).
const SAMPLING: [f64; 8] = [2.5, 6.5, 12.5, 24.5, 47.5, 92.5, 247.5, 640.5];
/// Start-up of the regulator (DS12288, tADCVREG_STUP), s.
const REGULATOR_S: f64 = 20e-6;
/// Periods of the converter's clock that a calibration takes (DS12288, tCAL).
const CALIBRATION: f64 = 116.0;
/// What an uncalibrated converter is off by, LSB: the data sheet's total unadjusted error and a bit more.
const UNCALIBRATED_LSB: f64 = 12.0;

const ADRDY: u32 = 1;
const EOSMP: u32 = 1 << 1;
const EOC: u32 = 1 << 2;
const EOS: u32 = 1 << 3;
const OVR: u32 = 1 << 4;
const JEOC: u32 = 1 << 5;
const JEOS: u32 = 1 << 6;

const ADEN: u32 = 1;
const ADDIS: u32 = 1 << 1;
const ADSTART: u32 = 1 << 2;
const JADSTART: u32 = 1 << 3;
const ADVREGEN: u32 = 1 << 28;
const DEEPPWD: u32 = 1 << 29;
const ADCALDIF: u32 = 1 << 30;
const ADCAL: u32 = 1 << 31;

/// The converter's clock.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct AdcClock {
    /// Cycles of HCLK in one of its periods; infinite where it has no clock.
    pub ratio: f64,
    /// CKMODE, which decides the trigger latency.
    pub mode: usize,
}

/// A conversion under way.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Conversion {
    /// In the sequence, from 0.
    rank: usize,
    channel: u32,
    starts: f64,
    holds: f64,
    ends: f64,
    held: Option<u32>,
}

/// A sequence under way.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Run {
    injected: bool,
    triggered: f64,
    now: Conversion,
}

/// What the master of ceremonies has to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Due {
    /// Nothing outside.
    Internal,
    /// Give the voltage of this channel as a share of full scale with [`Adc::hold`].
    Hold {
        /// Input.
        channel: u32,
        /// How long it was sampled, cycles of HCLK.
        sampled: f64,
    },
    /// A conversion of an injected sequence ended.
    Converted(Converted),
}

/// A conversion of an injected sequence, for the record.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Converted {
    /// From 0.
    pub rank: usize,
    /// Input.
    pub channel: u32,
    /// Trigger, start of sampling, end of sampling, end of conversion; cycles of HCLK.
    pub instants: [f64; 4],
    /// The sequence is complete.
    pub last: bool,
    /// Data of this rank was there and had not been read.
    pub unread: bool,
}

/// A converter.
#[derive(Clone, Debug)]
pub struct Adc {
    name: &'static str,
    isr: u32,
    ier: u32,
    cr: u32,
    cfgr: u32,
    cfgr2: u32,
    smpr: [u32; 2],
    thresholds: [u32; 3],
    sqr: [u32; 4],
    dr: u32,
    jsqr: u32,
    ofr: [u32; 4],
    jdr: [u32; 4],
    unread: [bool; 4],
    difsel: u32,
    calfact: u32,
    gcomp: u32,
    clock: AdcClock,
    hclk_hz: f64,
    regulator_at: f64,
    calibrates_until: Option<f64>,
    calibrated: bool,
    ready_at: Option<f64>,
    run: Option<Run>,
    /// A regular conversion that an injected sequence has put off (21.4.16).
    put_off: Option<usize>,
    /// Ranks whose injected data someone reads; others may be there for their time alone.
    read: [bool; 4],
    /// Who reads late has an excuse, and nobody minds.
    pub excused: bool,
    /// Triggers of the injected sequence, and those that came while it ran.
    pub triggers: u64,
    /// Triggers that came too early.
    pub missed: u64,
    complaint: Option<String>,
}

impl Adc {
    /// As reset leaves it: in deep power-down.
    pub fn new(name: &'static str) -> Self {
        Self {
            name,
            isr: 0,
            ier: 0,
            cr: DEEPPWD,
            cfgr: 0x8000_0000,
            cfgr2: 0,
            smpr: [0; 2],
            thresholds: [0x0fff_0000, 0x00ff_0000, 0x00ff_0000],
            sqr: [0; 4],
            dr: 0,
            jsqr: 0,
            ofr: [0; 4],
            jdr: [0; 4],
            unread: [false; 4],
            difsel: 0,
            calfact: 0,
            gcomp: 0,
            clock: AdcClock { ratio: f64::INFINITY, mode: 0 },
            hclk_hz: 16e6,
            regulator_at: f64::INFINITY,
            calibrates_until: None,
            calibrated: false,
            ready_at: None,
            run: None,
            put_off: None,
            read: [false; 4],
            excused: false,
            triggers: 0,
            missed: 0,
            complaint: None,
        }
    }

    /// As the manual calls it.
    pub fn name(&self) -> &'static str {
        self.name
    }

    /// Its clock, and HCLK.
    pub fn set_clock(&mut self, clock: AdcClock, hclk_hz: f64) {
        self.clock = clock;
        self.hclk_hz = hclk_hz;
    }

    /// Interrupt line.
    pub fn interrupt(&self) -> bool {
        self.isr & self.ier != 0
    }

    /// ISR.
    pub fn flags(&self) -> u32 {
        self.isr
    }

    /// Whether the end of the injected sequence raises the line.
    pub fn interrupts_at_end(&self) -> bool {
        self.ier & (JEOS | JEOC) != 0
    }

    /// What it found wrong outside an access, once.
    pub fn take_complaint(&mut self) -> Option<String> {
        self.complaint.take()
    }

    /// Selected trigger of the injected sequence: JEXTSEL, while it waits for one.
    pub fn injected_trigger(&self) -> Option<(u32, u32)> {
        let edges = self.jsqr >> 7 & 3;
        (self.cr & JADSTART != 0 && edges != 0).then_some((self.jsqr >> 2 & 0x1f, edges))
    }

    /// The same for the regular sequence: EXTSEL.
    pub fn regular_trigger(&self) -> Option<(u32, u32)> {
        let edges = self.cfgr >> 10 & 3;
        (self.cr & ADSTART != 0 && edges != 0).then_some((self.cfgr >> 5 & 0x1f, edges))
    }

    /// When something happens next.
    pub fn next(&self) -> f64 {
        let mut next = f64::INFINITY;
        if let Some(run) = &self.run {
            next = if run.now.held.is_none() { run.now.holds } else { run.now.ends };
        }
        next.min(self.calibrates_until.unwrap_or(f64::INFINITY)).min(self.ready_at.unwrap_or(f64::INFINITY))
    }

    /// When it may raise its interrupt next.
    pub fn next_of_interest(&self) -> f64 {
        match &self.run {
            Some(run) if self.ier & !(JEOS | EOS) == 0 && self.ier != 0 => {
                let mut last = run.now;
                while last.rank + 1 < self.ranks(run.injected) {
                    last = self.conversion(run.injected, last.rank + 1, last.ends);
                }
                last.ends
            }
            _ if self.ier != 0 => self.next(),
            _ => f64::INFINITY,
        }
    }

    /// Does what is due at [`Adc::next`].
    pub fn fire(&mut self) -> Due {
        let now = self.next();
        if self.calibrates_until == Some(now) {
            self.calibrates_until = None;
            self.cr &= !ADCAL;
            if self.cr & ADCALDIF == 0 {
                self.calibrated = true;
                self.calfact = self.calfact & !0x7f | 0x3a;
            } else {
                self.calfact = self.calfact & !0x7f_0000 | 0x3b_0000;
            }
            return Due::Internal;
        }
        if self.ready_at == Some(now) {
            self.ready_at = None;
            self.isr |= ADRDY;
            return Due::Internal;
        }
        match self.run {
            Some(Run { now: Conversion { held: None, channel, holds, starts, .. }, .. }) => {
                Due::Hold { channel, sampled: holds - starts }
            }
            Some(run) => self.finish(run),
            None => Due::Internal,
        }
    }

    /// The sample-and-hold opens with this share of full scale on it.
    pub fn hold(&mut self, share: f64) {
        let bits = 12 - 2 * (self.cfgr >> 3 & 3);
        let steps = f64::from(1_u32 << bits);
        let off = if self.calibrated { 0.0 } else { UNCALIBRATED_LSB };
        let code = (share * steps + off + 0.5).clamp(0.0, steps - 1.0) as u32;
        if let Some(run) = &mut self.run {
            run.now.held = Some(code);
            self.isr |= EOSMP;
        }
    }

    /// A trigger: starts the injected sequence.
    pub fn trigger_injected(&mut self, at: Cycle) {
        self.triggers += 1;
        match self.run {
            Some(run) if run.injected => {
                self.missed += 1;
                return;
            }
            Some(run) => self.put_off = Some(run.now.rank),
            None => {}
        }
        self.start(true, at as f64, 0);
    }

    /// A trigger: starts the regular sequence.
    pub fn trigger_regular(&mut self, at: Cycle) {
        if self.run.is_none() {
            self.start(false, at as f64, 0);
        }
    }

    fn start(&mut self, injected: bool, triggered: f64, rank: usize) {
        if self.cr & ADEN == 0 || self.ready_at.is_some() || self.clock.ratio.is_infinite() {
            self.complaint.get_or_insert_with(|| format!("{}: a conversion starts without clock or enable", self.name));
            return;
        }
        if !self.calibrated {
            self.complaint.get_or_insert_with(|| format!("{}: converts uncalibrated (21.4.8)", self.name));
        }
        let starts = triggered + LATENCY[self.clock.mode] * self.clock.ratio;
        self.run = Some(Run { injected, triggered, now: self.conversion(injected, rank, starts) });
    }

    fn conversion(&self, injected: bool, rank: usize, starts: f64) -> Conversion {
        let channel = if injected {
            self.jsqr >> (9 + 6 * rank) & 0x1f
        } else {
            let slot = rank + 1;
            self.sqr[slot / 5] >> (6 * (slot % 5)) & 0x1f
        };
        let code = self.smpr[(channel / 10) as usize] >> (3 * (channel % 10)) & 7;
        let mut sampling = SAMPLING[code as usize];
        if code == 0 && self.smpr[0] >> 31 != 0 {
            sampling += 1.0;
        }
        let holds = starts + sampling * self.clock.ratio;
        let converting = 12.5 - 2.0 * f64::from(self.cfgr >> 3 & 3);
        Conversion { rank, channel, starts, holds, ends: holds + converting * self.clock.ratio, held: None }
    }

    fn ranks(&self, injected: bool) -> usize {
        (if injected { self.jsqr & 3 } else { self.sqr[0] & 0xf }) as usize + 1
    }

    fn finish(&mut self, run: Run) -> Due {
        let done = run.now;
        let last = done.rank + 1 == self.ranks(run.injected);
        let data = self.corrected(done.channel, done.held.unwrap_or(0));
        self.run =
            if last { None } else { Some(Run { now: self.conversion(run.injected, done.rank + 1, done.ends), ..run }) };
        if !run.injected {
            self.finish_regular(data, last, done.ends);
            return Due::Internal;
        }
        let unread = core::mem::replace(&mut self.unread[done.rank], true);
        self.jdr[done.rank] = data;
        self.isr |= JEOC | if last { JEOS } else { 0 };
        if last {
            if self.jsqr >> 7 & 3 == 0 {
                self.cr &= !JADSTART;
            }
            if let Some(rank) = self.put_off.take() {
                let now = self.conversion(false, rank, done.ends);
                self.run = Some(Run { injected: false, triggered: done.ends, now });
            }
        }
        Due::Converted(Converted {
            rank: done.rank,
            channel: done.channel,
            instants: [run.triggered, done.starts, done.holds, done.ends],
            last,
            unread: unread && self.read[done.rank] && !self.excused,
        })
    }

    fn finish_regular(&mut self, data: u32, last: bool, ends: f64) {
        if self.isr & EOC != 0 {
            self.isr |= OVR;
        }
        if self.isr & OVR == 0 || self.cfgr >> 12 & 1 != 0 {
            self.dr = data;
        }
        self.isr |= EOC | if last { EOS } else { 0 };
        if last && self.cfgr >> 13 & 1 != 0 {
            self.run = Some(Run { injected: false, triggered: ends, now: self.conversion(false, 0, ends) });
        } else if last && self.cfgr >> 10 & 3 == 0 {
            self.cr &= !ADSTART;
        }
    }

    /// Offsets (21.4.26), gain compensation (21.4.27) and alignment (21.4.25).
    fn corrected(&self, channel: u32, code: u32) -> u32 {
        let mut value = i64::from(code);
        if self.cfgr2 >> 16 & 1 != 0 {
            value = value * i64::from(self.gcomp & 0x3fff) / 4096;
        }
        let offset = self.ofr.iter().find(|ofr| *ofr >> 31 != 0 && *ofr >> 26 & 0x1f == channel);
        if let Some(ofr) = offset {
            let amount = i64::from(ofr & 0xfff);
            value += if ofr >> 24 & 1 != 0 { amount } else { -amount };
            if ofr >> 25 & 1 != 0 {
                value = value.clamp(0, 0xfff);
            }
        }
        let left = if self.cfgr >> 15 & 1 != 0 { 4 - u32::from(offset.is_some()) } else { 0 };
        (value as u32) << left & 0xffff
    }
}
