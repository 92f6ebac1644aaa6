//! Words of registers: which peripheral they are, whether it is clocked, and what a write entails.

use crate::adc::Adc;
use crate::analog::{Comp, Dac, Opamp};
use crate::bits::{unmodelled, wrong};
use crate::chip::{Chip, TRIGGERS};
use crate::flash::Begun;
use crate::gpio::{Gpio, Pin};
use crate::map::{self, Block, Place};
use crate::pwr::Pwr;
use crate::system::Syscfg;
use crate::usart::Usart;
use bus::{Complaint, Cycle, ResetCause};

const FLASH_BASE: u32 = 0x0800_0000;

impl Chip {
    /// Offset within the flash array.
    pub(crate) fn in_flash(&self, address: u32) -> Option<u32> {
        let offset = address.checked_sub(FLASH_BASE)?;
        ((offset as usize) < self.flash.memory().len()).then_some(offset)
    }

    fn place(&self, address: u32) -> Result<&'static Place, Complaint> {
        let place = map::at(address, self.board.device).ok_or(Complaint::Unmapped)?;
        match place.enable {
            Some((register, position)) if !self.rcc.has(register, position) => {
                Err(Complaint::Unclocked { peripheral: place.name })
            }
            _ => Ok(place),
        }
    }

    pub(crate) fn read_word(&mut self, address: u32, now: Cycle) -> Result<u32, Complaint> {
        let place = self.place(address)?;
        let (offset, now_s) = (address - place.base, self.now_s(now));
        match place.block {
            Block::Rcc => self.rcc.read(offset, now_s),
            Block::Pwr => self.pwr.read(offset),
            Block::Flash => self.flash.read(offset),
            Block::Gpio(port) => {
                let level = |number| self.level(Pin { port: port as u8, number }, now).unwrap_or(false);
                self.gpio[port].read(offset, level)
            }
            Block::Syscfg => match offset {
                0x200..=0x218 if offset as usize <= 0x1fc + 4 * self.board.device.comparators() => {
                    Ok(self.comps[(offset as usize - 0x200) / 4].read())
                }
                0x300..=0x314 if offset as usize <= 0x2fc + 4 * self.board.device.opamps() => {
                    Ok(self.opamps[(offset as usize - 0x300) / 4].read())
                }
                _ => self.syscfg.read(offset),
            },
            Block::Exti => self.exti.read(offset),
            Block::Timer(index) => self.timers[index].read(offset, now),
            Block::Usart(index) => self.usarts[index].read(offset),
            Block::Can => self.can.read(offset, now_s),
            Block::CanRam => self.can.read_ram(offset),
            Block::Adc(group) => match self.converter(group, offset) {
                Some(index) => {
                    self.adcs[index].excused = self.excuses(now as f64);
                    self.adcs[index].read(offset & 0xff)
                }
                None if offset >= 0x300 => {
                    let flags = [0, 1].map(|k| self.adcs.get(2 * group + k).map_or(0, Adc::flags));
                    self.commons[group].read(offset - 0x300, flags)
                }
                None => Err(unmodelled(place.name, offset)),
            },
            Block::Dac(index) => self.dacs[index].read(offset),
            Block::Iwdg => self.iwdg.read(offset, now_s),
            Block::Wwdg => self.wwdg.read(offset, now_s),
            Block::Dbgmcu => self.dbgmcu.read(offset, self.board.device),
            Block::Nothing => Err(unmodelled(place.name, offset)),
        }
    }

    /// The converter at an offset of its group's page.
    fn converter(&self, group: usize, offset: u32) -> Option<usize> {
        let index = 2 * group + (offset / 0x100) as usize;
        let inside = offset < if group == 0 { 0x200 } else { 0x300 };
        (inside && index < self.adcs.len()).then_some(index)
    }

    pub(crate) fn write_word(&mut self, address: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let place = self.place(address)?;
        let (offset, now_s) = (address - place.base, self.now_s(now));
        match place.block {
            Block::Rcc => {
                let result = self.rcc.write(offset, value, now_s);
                self.after_clocks(offset, value, now);
                result.and_then(|()| self.check_clocks(matches!(offset, 0x00 | 0x08 | 0x0c)))
            }
            Block::Pwr => self.pwr.write(offset, value).and_then(|()| self.check_clocks(true)),
            Block::Flash => {
                let begun = self.flash.write(offset, value, now_s)?;
                self.begin(begun, now_s);
                self.check_clocks(offset == 0)
            }
            Block::Gpio(port) => {
                let result = self.gpio[port].write(offset, value);
                self.refresh_gates(now);
                self.refresh_can();
                result
            }
            Block::Syscfg => {
                let result = match offset {
                    0x200..=0x218 if offset as usize <= 0x1fc + 4 * self.board.device.comparators() => {
                        self.comps[(offset as usize - 0x200) / 4].write(value)
                    }
                    0x300..=0x314 if offset as usize <= 0x2fc + 4 * self.board.device.opamps() => {
                        self.opamps[(offset as usize - 0x300) / 4].write(value)
                    }
                    _ => self.syscfg.write(offset, value),
                };
                self.motor.advance(now_s);
                self.compare(now);
                result
            }
            Block::Exti => self.exti.write(offset, value),
            Block::Timer(index) => self.write_timer(index, offset, value, now),
            Block::Usart(index) => self.usarts[index].write(offset, value, now),
            Block::Can => {
                self.refresh_can();
                self.can.write(offset, value, now_s)
            }
            Block::CanRam => self.can.write_ram(offset, value),
            Block::Adc(group) => self.write_adc(place, group, offset, value, now),
            Block::Dac(index) => {
                let result = self.dacs[index].write(offset, value);
                self.motor.advance(now_s);
                self.compare(now);
                result
            }
            Block::Iwdg => {
                let result = self.iwdg.write(offset, value, now_s);
                self.rcc.watchdog_runs = self.iwdg.runs();
                result
            }
            Block::Wwdg => self.wwdg.write(offset, value, now_s),
            Block::Dbgmcu => self.dbgmcu.write(offset, value),
            Block::Nothing => Err(unmodelled(place.name, offset)),
        }
    }

    fn write_timer(&mut self, index: usize, offset: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let (moe, idle) = (self.timers[0].moe(), self.idle_settings());
        let (happened, complaint) = self.timers[index].write(offset, value, now);
        self.motor.advance(self.now_s(now));
        self.follow(index, happened, now);
        if moe && self.timers[0].moe() && idle != self.idle_settings() {
            let what = "idle states: they are written while MOE is set (OIS of CR2, OSSI of BDTR)";
            self.record.find(self.now_s(now), what.into());
        }
        complaint.map_or(Ok(()), Err)
    }

    fn idle_settings(&self) -> ([[Option<bool>; 2]; 3], bool) {
        let outputs = &self.timers[0].outputs;
        (core::array::from_fn(|leg| core::array::from_fn(|side| outputs.idle(leg, side))), outputs.driven_when_off())
    }

    fn write_adc(&mut self, place: &Place, group: usize, offset: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let Some(index) = self.converter(group, offset) else {
            if offset < 0x300 {
                return Err(unmodelled(place.name, offset));
            }
            let result = self.commons[group].write(offset - 0x300, value);
            self.distribute_clocks(now);
            return result;
        };
        let offset = offset & 0xff;
        self.adcs[index].write(offset, value, now)?;
        if offset == 0x08 && value & 0x8000_0001 != 0 {
            let clock = self.commons[group].clock(&self.rcc, &self.clocks);
            if let Some(complaint) = self.commons[group].complaint(clock, self.clocks.hclk) {
                return Err(complaint);
            }
        }
        match self.adcs[index].injected_trigger() {
            Some((number, _)) if !TRIGGERS.iter().any(|(known, _)| *known == number) => {
                Err(wrong(self.adcs[index].name(), format!("JSQR: trigger {number} is not modelled")))
            }
            _ => Ok(()),
        }
    }

    /// RCC was written: clocks may have changed, and peripherals may have been reset.
    fn after_clocks(&mut self, offset: u32, value: u32, now: Cycle) {
        if matches!(offset, 0x28..=0x30 | 0x38..=0x40) {
            for place in map::gated_by(offset + 0x20, value) {
                self.reset_block(place.block);
            }
            self.distribute_clocks(now);
            self.refresh_gates(now);
        } else if matches!(offset, 0x00 | 0x08 | 0x0c | 0x88) {
            self.distribute_clocks(now);
        }
    }

    fn check_clocks(&self, changed: bool) -> Result<(), Complaint> {
        if !changed {
            return Ok(());
        }
        let complaint = self.pwr.complaint(self.clocks.hclk, self.flash.wait_states());
        complaint.or_else(|| self.rcc.pll_complaint()).map_or(Ok(()), Err)
    }

    pub(crate) fn reset_block(&mut self, block: Block) {
        match block {
            Block::Pwr => self.pwr = Pwr::default(),
            Block::Flash => self.flash.reset(),
            Block::Gpio(port) => self.gpio[port] = Gpio::new(port),
            Block::Syscfg => {
                self.syscfg = Syscfg::default();
                self.comps = [Comp::default(); 7];
                self.opamps = [Opamp::default(); 6];
            }
            Block::Timer(index) => self.timers[index].reset(),
            Block::Usart(index) => self.usarts[index] = Usart::new(self.usarts[index].name()),
            Block::Adc(group) => {
                for (index, adc) in self.adcs.iter_mut().enumerate() {
                    if usize::from(index >= 2) == group {
                        *adc = Adc::new(adc.name());
                    }
                }
                self.commons[group].reset();
            }
            Block::Can => self.can.reset(),
            Block::Dac(index) => self.dacs[index] = Dac::new(["DAC1", "DAC2", "DAC3", "DAC4"][index]),
            Block::Rcc | Block::CanRam | Block::Exti | Block::Iwdg | Block::Wwdg | Block::Dbgmcu | Block::Nothing => {}
        }
    }

    pub(crate) fn begin(&mut self, begun: Begun, now_s: f64) {
        self.stall_s += begun.stall_s;
        if begun.stall_s > 0.0 {
            let catching_up = 2 * self.timers[0].period();
            self.held_until = self.time.cycle(now_s + begun.stall_s) + catching_up as f64;
        }
        if begun.power_cut {
            self.record.events.push((now_s, "the power goes in the middle of a flash operation".into()));
            self.wanted_reset = Some(ResetCause::PowerOn);
        }
    }
}
