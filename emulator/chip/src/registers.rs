//! The side of the core: reads, writes, interrupts, reset, and the report.

use crate::adc::Adc;
use crate::analog::{Comp, Dac, Opamp};
use crate::bits::{unmodelled, wrong};
use crate::chip::{Chip, TRIGGERS};
use crate::flash::Begun;
use crate::gpio::{Gpio, Pin};
use crate::map::{self, Block, Place};
use crate::pwr::Pwr;
use crate::rcc::Rcc;
use crate::signals::PHASES;
use crate::system::{Dbgmcu, Exti, Syscfg, factory};
use crate::usart::Usart;
use bus::{Clock, Complaint, Cycle, Disturbance, Edge, Facts, Pwm, Range, ResetCause, System, Trace, Watchdog, Width};
use std::collections::BTreeMap;

const FLASH_BASE: u32 = 0x0800_0000;

impl Chip {
    /// Offset within the flash array.
    fn in_flash(&self, address: u32) -> Option<u32> {
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

    fn read_word(&mut self, address: u32, now: Cycle) -> Result<u32, Complaint> {
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
            Block::Adc(group) => match self.converter(group, offset) {
                Some(index) => self.adcs[index].read(offset & 0xff),
                None if offset >= 0x300 => {
                    let flags = [0, 1].map(|k| self.adcs.get(2 * group + k).map_or(0, Adc::flags));
                    self.commons[group].read(offset - 0x300, flags)
                }
                None => Err(unmodelled(place.name, offset)),
            },
            Block::Dac(index) => self.dacs[index].read(offset),
            Block::Iwdg => self.iwdg.read(offset, now_s),
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

    fn write_word(&mut self, address: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
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
                self.machine.advance(now_s);
                self.compare(now);
                result
            }
            Block::Exti => self.exti.write(offset, value),
            Block::Timer(index) => self.write_timer(index, offset, value, now),
            Block::Usart(index) => self.usarts[index].write(offset, value, now),
            Block::Adc(group) => self.write_adc(place, group, offset, value, now),
            Block::Dac(index) => {
                let result = self.dacs[index].write(offset, value);
                self.machine.advance(now_s);
                self.compare(now);
                result
            }
            Block::Iwdg => {
                let result = self.iwdg.write(offset, value, now_s);
                self.rcc.watchdog_runs = self.iwdg.runs();
                result
            }
            Block::Dbgmcu => self.dbgmcu.write(offset, value),
            Block::Nothing => Err(unmodelled(place.name, offset)),
        }
    }

    fn write_timer(&mut self, index: usize, offset: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let (moe, idle) = (self.timers[0].moe(), self.idle_settings());
        let (happened, complaint) = self.timers[index].write(offset, value, now);
        self.machine.advance(self.now_s(now));
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

    fn reset_block(&mut self, block: Block) {
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
            Block::Dac(index) => self.dacs[index] = Dac::new(["DAC1", "DAC2", "DAC3", "DAC4"][index]),
            Block::Rcc | Block::Exti | Block::Iwdg | Block::Dbgmcu | Block::Nothing => {}
        }
    }

    fn begin(&mut self, begun: Begun, now_s: f64) {
        self.stall_s += begun.stall_s;
        if begun.power_cut {
            self.record.events.push((now_s, "the power goes in the middle of a flash operation".into()));
            self.wanted_reset = Some(ResetCause::PowerOn);
        }
    }
}

impl System for Chip {
    fn read(&mut self, address: u32, width: Width, now: Cycle) -> (u32, Option<Complaint>) {
        self.sync(now);
        let mask = u32::MAX >> (32 - 8 * width.bytes());
        if let Some(offset) = self.in_flash(address) {
            let bytes = &self.flash.memory()[offset as usize & !3..];
            let word = u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]]);
            return (word >> (8 * (address & 3)) & mask, None);
        }
        if let 0x1fff_7000..=0x1fff_7fff = address {
            let half = |at| factory(at, self.board.device);
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
        lines
    }

    fn take_reset(&mut self) -> Option<ResetCause> {
        self.wanted_reset.take()
    }

    fn flash(&self) -> &[u8] {
        self.flash.memory()
    }

    fn take_flash_changes(&mut self) -> Vec<core::ops::Range<u32>> {
        self.flash.take_changes()
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
        self.iwdg.reset();
        self.stall_s = 0.0;
        self.wanted_reset = None;
        self.distribute_clocks(now);
        self.refresh_gates(now);
    }

    fn hclk_hz(&self) -> f64 {
        self.clocks.hclk
    }

    fn seconds(&self, at: Cycle) -> f64 {
        self.now_s(at)
    }

    fn flash_wait_states(&self) -> u32 {
        self.flash.wait_states()
    }

    fn last_sampling(&self) -> Option<(u16, Cycle)> {
        self.last_sampling
    }

    fn disturb(&mut self, disturbance: &Disturbance, now: Cycle) -> Result<(), String> {
        self.sync(now);
        self.due = 0;
        let now_s = self.now_s(now);
        self.machine.advance(now_s);
        let in_range = |index: usize| if index < 3 { Ok(index) } else { Err(format!("there is no number {index}")) };
        match disturbance {
            Disturbance::Hall(wire, fault) => self.machine.set_hall_fault(in_range(*wire)?, *fault),
            Disturbance::SwapHalls(a, b) => self.machine.swap_halls(in_range(*a)?, in_range(*b)?),
            Disturbance::Bus(volts) => self.machine.plant.set_supply(*volts).map_err(|error| error.to_string())?,
            Disturbance::Overcurrent(phase, amperes) => self.machine.shorts_a[in_range(*phase)?] = *amperes,
            Disturbance::BreakPin(level) => {
                let Some((pin, _)) = self.board.trip else {
                    return Err(format!("{} has no break pin; its comparators watch the shunts", self.board.name));
                };
                let before = self.level(pin, now);
                self.break_pin = *level;
                let (after, line) = (self.level(pin, now), u32::from(pin.number));
                if after != before && self.syscfg.port(line) == pin.port {
                    self.exti.edge(line, after == Some(true));
                }
            }
            Disturbance::Load(torque) => self.machine.plant.set_load(*torque).map_err(|error| error.to_string())?,
            Disturbance::Serial(bytes) => {
                let port = self.serial_port(1).ok_or("no serial port is connected to the RX pin")?;
                self.usarts[port].receive(bytes, now);
                return Ok(());
            }
            Disturbance::PowerCut(operations) => self.flash.cut_power_after(*operations),
            Disturbance::PowerCycle => self.wanted_reset = Some(ResetCause::PowerOn),
        }
        self.record.events.push((now_s, format!("{disturbance:?}")));
        self.compare(now);
        Ok(())
    }

    fn take_serial(&mut self) -> Vec<u8> {
        core::mem::take(&mut self.sent)
    }

    fn facts(&self) -> Facts {
        Facts {
            clocks: self.clock_facts(),
            pwm: self.pwm_facts(),
            legs: core::array::from_fn(|leg| self.leg_facts(leg)),
            sampling: self.record.sampling.clone(),
            triggers: self.record.triggers,
            missed_triggers: self.adcs.iter().map(|adc| adc.missed).sum(),
            unread_sequences: self.record.unread,
            moe: self.record.moe.clone(),
            watchdog: (self.iwdg.runs() || self.record.bites > 0).then(|| Watchdog {
                timeout_s: self.iwdg.timeout_s(),
                interval_s: self.iwdg.interval_s,
                bites: self.record.bites,
            }),
            flash_operations: self.flash.operations,
            findings: self.record.findings.clone(),
            events: self.record.events.clone(),
            motor: self.motor_facts(),
        }
    }

    fn take_trace(&mut self) -> Trace {
        self.record.take_trace()
    }
}

impl Chip {
    fn clock_facts(&self) -> Vec<Clock> {
        let clocks = &self.clocks;
        let mut list = vec![("SYSCLK", clocks.sysclk), ("HCLK", clocks.hclk)];
        list.extend([("PCLK1", clocks.pclk1), ("PCLK2", clocks.pclk2)]);
        list.extend(
            [0, 1].map(|bus| (["APB1 timers", "APB2 timers"][bus], clocks.hclk / clocks.timer_ratio[bus] as f64)),
        );
        for (group, name) in [(0, "ADC12"), (1, "ADC345")] {
            let ratio = self.commons[group].clock(&self.rcc, clocks).ratio;
            if 2 * group < self.adcs.len() && ratio.is_finite() {
                list.push((name, clocks.hclk / ratio));
            }
        }
        for direction in [0, 1] {
            if let Some(port) = self.serial_port(direction) {
                list.push((
                    ["serial TX, baud", "serial RX, baud"][direction],
                    clocks.hclk / self.usarts[port].bit_cycles(),
                ));
            }
        }
        list.into_iter().map(|(name, hz)| Clock { name: name.into(), hz }).collect()
    }

    fn pwm_facts(&self) -> Option<Pwm> {
        let timer = &self.timers[0];
        let settings = timer.settings();
        settings.runs.then(|| Pwm {
            hz: self.clocks.hclk / timer.period() as f64,
            mode: settings.mode,
            reload: settings.reload,
            dead_time_ns: settings.dead_time as f64 / self.clocks.hclk * 1e9,
            off_state: if timer.outputs.driven_when_off() {
                "forced to the idle level".into()
            } else {
                "left to the pull resistors".into()
            },
            breaks: [0, 1].into_iter().flat_map(|input| timer.break_names(input)).collect(),
        })
    }

    fn leg_facts(&self, leg: usize) -> bus::Leg {
        let seen = &self.bridge.legs[leg];
        let level = |high: bool| if high { "high".to_string() } else { "low".to_string() };
        let ns = |range: &Range| Range { min: range.min * 1e9, max: range.max * 1e9, count: range.count };
        bus::Leg {
            pins: self.board.gates[leg].map(|pin| pin.to_string()),
            driver_on_level: [level(true), level(!self.board.driver.low_inverted)],
            timer_on_level: self.timers[0].outputs.active_low(leg).map(|low| level(!low)),
            dead_time_rising_ns: ns(&seen.rising_s),
            dead_time_falling_ns: ns(&seen.falling_s),
            shoot_through: seen.shoot_through.0,
            first_shoot_through_s: seen.shoot_through.1,
        }
    }

    fn motor_facts(&self) -> BTreeMap<String, f64> {
        let truth = self.machine.truth();
        let mut facts = BTreeMap::from([
            ("angle_turns".to_string(), truth.mechanical_angle_rad / core::f64::consts::TAU),
            ("electrical_angle_rad".to_string(), truth.electrical_angle_rad),
            ("speed_rad_s".to_string(), truth.speed_rad_s),
            ("torque_nm".to_string(), truth.torque_nm),
            ("bus_v".to_string(), truth.bus_v),
        ]);
        for (phase, current) in PHASES.iter().zip(truth.currents_a) {
            facts.insert(format!("current_{}_a", phase.to_lowercase()), current);
        }
        facts
    }
}
