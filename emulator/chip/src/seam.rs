//! The side of the core: accesses of any width, interrupt lines, resets, time.

use crate::bits::{unmodelled, wrong};
use crate::chip::Chip;
use crate::facts::Edge;
use crate::gpio::Gpio;
use crate::map::{self, Block};
use crate::pwr::Pwr;
use crate::rcc::Rcc;
use crate::system::{Dbgmcu, Exti, Syscfg, factory};
use bus::{Bus, Complaint, Cycle, Integration, ResetCause, Width};

impl Bus for Chip {
    fn integration(&self) -> Integration {
        self.board.device.integration()
    }

    fn read(&mut self, address: u32, width: Width, now: Cycle) -> (u32, Option<Complaint>) {
        self.sync(now);
        let mask = u32::MAX >> (32 - 8 * width.bytes());
        if let Some(offset) = self.in_flash(address) {
            let bytes = &self.flash.memory()[offset as usize & !3..];
            let word = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            return (word >> (8 * (address & 3)) & mask, None);
        }
        if let 0x1fff_7000..=0x1fff_7fff = address {
            let half = |at| factory(at, self.board.device, self.number);
            return match (half(address & !3), half(address & !3 | 2)) {
                (None, None) => (0, Some(unmodelled("factory area", address & 0xfff))),
                (low, high) => {
                    let word = u32::from(low.unwrap_or(0)) | u32::from(high.unwrap_or(0)) << 16;
                    (word >> (8 * (address & 3)) & mask, None)
                }
            };
        }
        match self.read_word(address & !3, now) {
            Ok(word) => (word >> (8 * (address & 3)) & mask, None),
            Err(complaint) => (0, Some(complaint)),
        }
    }

    fn write(&mut self, address: u32, width: Width, value: u32, now: Cycle) -> Option<Complaint> {
        self.sync(now);
        self.due = 0;
        if let Some(offset) = self.in_flash(address) {
            let now_s = self.now_s(now);
            return match self.flash.store(offset, width.bytes(), value, now_s) {
                Ok(begun) => {
                    self.begin(begun, now_s);
                    None
                }
                Err(complaint) => Some(complaint),
            };
        }
        if address & 3 != 0 {
            let name = map::at(address, self.board.device).map_or("bus", |place| place.name);
            return Some(wrong(name, format!("a narrow write into the middle of the register at {:#x}", address & !3)));
        }
        self.write_word(address, value, now).err()
    }

    fn advance(&mut self, now: Cycle) -> Cycle {
        self.sync(now);
        self.next_of_interest().max(now + 1)
    }

    fn interrupts(&self) -> u128 {
        let mut lines = self.exti.interrupts();
        let mut raise = |line: u32, up: bool| lines |= u128::from(up) << line;
        raise(4, self.flash.interrupt());
        for (index, adc) in self.adcs.iter().enumerate() {
            raise([18, 18, 47, 61, 62][index], adc.interrupt());
        }
        let [tim1, tim2, tim3, tim4, tim5, tim6, tim7, tim8, tim15, tim16, tim17, tim20] = &self.timers;
        for (timer, first) in [(tim1, 24), (tim8, 43), (tim20, 77)] {
            raise(first, timer.break_interrupt());
            raise(first + 1, timer.interrupt(1));
            raise(first + 2, timer.interrupt(0x60));
            raise(first + 3, timer.interrupt(0x1e));
        }
        let all = u32::MAX;
        for (timer, line) in [(tim15, 24), (tim16, 25), (tim17, 26), (tim2, 28), (tim3, 29), (tim4, 30), (tim5, 50)] {
            raise(line, timer.interrupt(all));
        }
        raise(54, tim6.interrupt(all));
        raise(55, tim7.interrupt(all));
        for (usart, line) in self.usarts.iter().zip([37, 38, 39, 91]) {
            raise(line, usart.interrupt());
        }
        let [first, second] = self.can.interrupts();
        raise(21, first);
        raise(22, second);
        lines
    }

    fn origin(&self, line: u16) -> Option<Cycle> {
        self.last_sampling.filter(|(sampled, _)| *sampled == line).map(|(_, at)| at)
    }

    fn take_reset(&mut self) -> Option<ResetCause> {
        self.wanted_reset.take()
    }

    fn code(&self) -> &[u8] {
        self.flash.memory()
    }

    fn take_code_changes(&mut self) -> Vec<core::ops::Range<u32>> {
        self.flash.take_changes()
    }

    fn code_is_torn(&mut self, offset: u32) -> bool {
        self.flash.reads_torn(offset)
    }

    fn take_stall(&mut self) -> Cycle {
        (core::mem::take(&mut self.stall_s) * self.time.hz()).ceil() as Cycle
    }

    fn reset(&mut self, cause: ResetCause) {
        self.due = 0;
        let now = self.now;
        let now_s = self.now_s(now);
        if self.timers[0].moe() {
            self.record.moe.push(Edge { at_s: now_s, on: false, by: "reset".into() });
        }
        self.record.events.push((now_s, format!("reset: {cause:?}")));
        self.rcc = Rcc::new(cause);
        self.pwr = Pwr::default();
        self.flash.reset();
        self.gpio = core::array::from_fn(Gpio::new);
        self.syscfg = Syscfg::default();
        self.exti = Exti::default();
        if cause == ResetCause::PowerOn {
            self.dbgmcu = Dbgmcu::default();
        }
        for timer in &mut self.timers {
            timer.reset();
        }
        for group in 0..2 {
            self.reset_block(Block::Adc(group));
        }
        for index in 0..4 {
            self.reset_block(Block::Usart(index));
            self.reset_block(Block::Dac(index));
        }
        self.reset_block(Block::Syscfg);
        self.reset_block(Block::Can);
        self.refresh_can();
        self.iwdg.reset();
        self.wwdg.reset(now_s);
        self.stall_s = 0.0;
        self.wanted_reset = None;
        self.distribute_clocks(now);
        self.refresh_gates(now);
    }

    fn clock_hz(&self) -> f64 {
        self.clocks.hclk
    }

    fn seconds(&self, at: Cycle) -> f64 {
        self.now_s(at)
    }

    fn code_wait_states(&self) -> u32 {
        self.flash.wait_states()
    }

    fn code_prefetch(&self) -> bool {
        self.flash.prefetch()
    }
}
