//! The register file of a timer.

use super::compare::modelled;
use super::{Edge, Happened, Timer, UIF};
use crate::bits::{bit, merged, unmodelled, wrong};
use bus::{Complaint, Cycle};

const BDTR: u32 = 0x44;

/// Bits of CR1 and others that change how the timer counts and have no model.
const DITHER: u32 = 1 << 12;

impl Timer {
    /// Registers that this timer has (28.6, 29.5, 30.7, 31.4).
    fn has(&self, offset: u32) -> bool {
        let channels = self.shape.channels;
        match offset {
            0x00 | 0x04 | 0x0c | 0x10 | 0x14 | 0x24 | 0x28 | 0x2c => true,
            0x08 => channels >= 2,
            0x18 | 0x20 => channels >= 1,
            0x1c => channels >= 4,
            0x30 | BDTR => self.shape.advanced || matches!(channels, 1 | 2),
            0x34..=0x40 => ((offset - 0x34) / 4) < channels as u32,
            0x48..=0x50 => channels == 6,
            0x54 => self.shape.advanced,
            0x60 | 0x64 => channels >= 1,
            _ => false,
        }
    }

    /// Reads a register.
    pub fn read(&mut self, offset: u32, now: Cycle) -> Result<u32, Complaint> {
        if !self.has(offset) {
            return Err(unmodelled(self.shape.name, offset));
        }
        self.settle(now);
        Ok(match offset {
            0x00 => self.cr1 & !0x10 | u32::from(self.down) << 4,
            0x04 => self.cr2,
            0x08 => self.smcr,
            0x0c => self.dier,
            0x10 => self.sr,
            0x18 | 0x1c => self.ccmr[((offset - 0x18) / 4) as usize],
            0x20 => self.ccer,
            0x24 => self.count | if bit(self.cr1, 11) { (self.sr & UIF) << 31 } else { 0 },
            0x28 => self.psc,
            0x2c => self.arr,
            0x30 => self.rcr,
            0x34..=0x40 => self.ccr[((offset - 0x34) / 4) as usize],
            BDTR => self.bdtr,
            0x48 | 0x4c => self.ccr[((offset - 0x38) / 4) as usize],
            0x50 => self.ccmr[2],
            0x54 => self.dtr2,
            0x60 | 0x64 => self.af[((offset - 0x60) / 4) as usize],
            _ => 0,
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: Cycle) -> (Happened, Option<Complaint>) {
        let mut happened = Happened::default();
        if !self.has(offset) {
            return (happened, Some(unmodelled(self.shape.name, offset)));
        }
        self.settle(now);
        let complaint = self.store(offset, value, now, &mut happened);
        self.take_preloaded(offset == 0x14 && bit(value, 5));
        if self.shape.advanced {
            self.configure_outputs();
            self.outputs.settle(now);
            happened.outputs = true;
        }
        self.refresh_references(now, &mut happened);
        self.schedule();
        (happened, complaint)
    }

    /// With CCPC, enables and modes wait for a commutation (28.6.2).
    fn take_preloaded(&mut self, commutation: bool) {
        let waits = bit(self.cr2, 0) && !commutation;
        let (modes, enables) = if waits { (!0x0101_7070, 0xaaaa_aaaa) } else { (u32::MAX, u32::MAX) };
        for (acts, preload) in self.ccmr_acts.iter_mut().zip(&self.ccmr) {
            *acts = merged(*acts, *preload, modes);
        }
        self.ccer_acts = merged(self.ccer_acts, self.ccer, enables);
    }

    fn store(&mut self, offset: u32, value: u32, now: Cycle, happened: &mut Happened) -> Option<Complaint> {
        let name = self.shape.name;
        let all = if self.shape.bits == 32 { u32::MAX } else { 0xffff };
        match offset {
            0x00 => return self.write_cr1(value, now),
            0x04 => {
                let new = if self.locked(1) { merged(value, self.cr2, 0x3f00) } else { value };
                let complaint = (new != value).then(|| wrong(name, "CR2: the idle states are locked (28.6.20, LOCK)"));
                self.cr2 = new;
                return complaint;
            }
            0x08 => {
                self.smcr = value;
                if value & 7 != 0 || bit(value, 16) || bit(value, 14) {
                    return Some(wrong(name, "SMCR: slave modes and the external clock are not modelled"));
                }
            }
            0x0c => {
                self.dier = value;
                if value & 0x7f00 != 0 {
                    return Some(wrong(name, "DIER: DMA requests are not modelled"));
                }
            }
            0x10 => self.sr &= value,
            0x14 => return self.generate(value, now, happened),
            0x18 | 0x1c | 0x50 => {
                let which = if offset == 0x50 { 2 } else { ((offset - 0x18) / 4) as usize };
                return self.write_ccmr(which, value);
            }
            0x20 => {
                let new = if self.locked(2) { merged(value, self.ccer, 0xaaaa) } else { value };
                self.ccer = new;
                return (new != value).then(|| wrong(name, "CCER: the polarities are locked (28.6.20, LOCK)"));
            }
            0x24 => {
                self.count = value & all;
                self.at = now;
            }
            0x28 => self.psc = value & 0xffff,
            0x2c => {
                self.arr = value & all;
                if !bit(self.cr1, 7) {
                    self.arr_acts = self.arr;
                }
            }
            0x30 => self.rcr = value & 0xffff,
            0x34..=0x40 => self.write_ccr(((offset - 0x34) / 4) as usize, value & all),
            0x48 => {
                self.write_ccr(4, value & 0xffff);
                if value >> 29 != 0 {
                    return Some(wrong(name, "CCR5: grouping of channels is not modelled"));
                }
            }
            0x4c => self.write_ccr(5, value & 0xffff),
            BDTR => return self.write_bdtr(value, now),
            0x54 => self.dtr2 = value & 0x3_00ff,
            _ => {
                let which = ((offset - 0x60) / 4) as usize;
                if self.locked(1) && value != self.af[which] {
                    return Some(wrong(name, "AF1 and AF2 are locked (28.6.20, LOCK)"));
                }
                self.af[which] = value;
            }
        }
        None
    }

    fn locked(&self, level: u32) -> bool {
        self.shape.advanced && self.bdtr >> 8 & 3 >= level
    }

    fn write_cr1(&mut self, value: u32, now: Cycle) -> Option<Complaint> {
        let was_on = self.enabled();
        let mode_changes = (self.cr1 ^ value) & 0x60 != 0;
        self.cr1 = value & 0x1fff;
        if !self.centred() {
            self.down = bit(value, 4);
        }
        self.at = if was_on { self.at } else { now };
        if !was_on && value & 1 != 0 && self.count == 0 {
            self.valley = Some(now);
        }
        let name = self.shape.name;
        if value & DITHER != 0 {
            return Some(wrong(name, "CR1: dithering is not modelled"));
        }
        (was_on && value & 1 != 0 && mode_changes)
            .then(|| wrong(name, "CR1: the alignment changes while the counter runs (28.6.1, CMS)"))
    }

    fn generate(&mut self, value: u32, now: Cycle, happened: &mut Happened) -> Option<Complaint> {
        if bit(value, 0) {
            self.at = now;
            self.count = if !self.centred() && self.down { self.arr } else { 0 };
            self.down &= !self.centred();
            if self.count == 0 {
                self.valley = Some(now);
            }
            let flag = !bit(self.cr1, 2);
            self.update(happened, flag);
            if self.cr2 >> 20 & 0xf == 0 && self.shape.advanced {
                happened.trgo2 = Edge::Pulse;
            }
            if self.cr2 >> 4 & 7 == 0 {
                happened.trgo = Edge::Pulse;
            }
        }
        self.sr |= value & 0x1e;
        self.sr |= value & 1 << 5;
        for position in [7, 8] {
            if bit(value, position) && self.shape.advanced {
                self.sr |= 1 << position;
                self.set_moe(false, now, None);
            }
        }
        (bit(value, 6)).then(|| wrong(self.shape.name, "EGR: triggers are not modelled"))
    }

    fn write_ccmr(&mut self, which: usize, value: u32) -> Option<Complaint> {
        let name = self.shape.name;
        if self.locked(3) && value != self.ccmr[which] {
            return Some(wrong(name, "CCMR is locked (28.6.20, LOCK)"));
        }
        self.ccmr[which] = value;
        for half in [0, 8] {
            if which < 2 && value >> half & 3 != 0 {
                return Some(wrong(name, "CCMR: input capture is not modelled"));
            }
            let mode = value >> (half + 4) & 7 | value >> (half + 13) & 8;
            if !modelled(mode) || bit(value, half + 7) {
                return Some(wrong(name, format!("CCMR: output mode {mode} or clearing by OCREF_CLR is not modelled")));
            }
        }
        None
    }

    fn write_ccr(&mut self, channel: usize, value: u32) {
        self.ccr[channel] = value;
        let preloaded = bit(self.ccmr[channel / 2], 8 * (channel as u32 % 2) + 3);
        if !preloaded {
            self.ccr_acts[channel] = value;
        }
    }

    fn write_bdtr(&mut self, value: u32, now: Cycle) -> Option<Complaint> {
        let name = self.shape.name;
        let mut mask: u32 = !(1 << 15);
        mask &= if self.locked(1) { !0x03ff_70ff } else { u32::MAX };
        mask &= if self.locked(2) { !0x0c00 } else { u32::MAX };
        mask &= if self.bdtr & 0x300 != 0 { !0x300 } else { u32::MAX };
        let new = merged(self.bdtr, value, mask);
        let refused = (new ^ value) & !(1 << 15) != 0;
        self.bdtr = new;
        let wanted = bit(value, 15);
        let held = wanted && self.breaks != [false; 2];
        self.configure_outputs();
        self.set_moe(wanted && !held, now, None);
        if held {
            return Some(wrong(name, "BDTR: MOE is set while a break input is active, and stays off (28.3.16)"));
        }
        refused.then(|| wrong(name, "BDTR: locked bits are written (28.6.20, LOCK)"))
    }

    /// Dead time that BDTR asks for, cycles of HCLK; how it counts; ARR; and what MMS2 selects.
    pub fn settings(&self) -> Settings {
        Settings {
            dead_time: self.outputs.dead_time(),
            mode: match (self.cr1 >> 5 & 3, self.cr1 >> 4 & 1) {
                (0, 0) => "edge-aligned, up".into(),
                (0, _) => "edge-aligned, down".into(),
                (mode, _) => format!("centre-aligned {mode}"),
            },
            reload: self.arr_acts,
            runs: self.enabled(),
        }
    }
}

/// How a timer is set up.
#[derive(Clone, Debug, PartialEq)]
pub struct Settings {
    /// Cycles of HCLK.
    pub dead_time: Cycle,
    /// Such as `centre-aligned 1`.
    pub mode: String,
    /// ARR.
    pub reload: u32,
    /// CEN.
    pub runs: bool,
}
