//! The chip on its board, from one event to the next.

use crate::adc::{Adc, Common, Due};
use crate::analog::{Comp, Dac, Opamp};
use crate::board::Board;
use crate::bridge::Bridge;
use crate::can::Fdcan;
use crate::flash::Flash;
use crate::gpio::Gpio;
use crate::iwdg::Iwdg;
use crate::motor::Motor;
use crate::pwr::Pwr;
use crate::rcc::{Clocks, Rcc};
use crate::record::Record;
use crate::system::{Dbgmcu, Exti, Syscfg};
use crate::time::{Time, ceiling};
use crate::timer::{Edge, Happened, Shape, Timer};
use crate::usart::Usart;
use crate::wwdg::Wwdg;
use bus::{Cycle, ResetCause};
use plant::heads::Encoder;
use plant::{Error, PlantParameters, Truth};
use std::sync::Arc;

/// The timers in the order of [`Block::Timer`](crate::map::Block), and TRGO's number as a trigger of injected
/// sequences.
const TIMERS: [(Shape, Option<u32>); 12] = {
    const fn shape(name: &'static str, bits: u32, channels: usize, advanced: bool) -> Shape {
        Shape { name, bits, channels, advanced }
    }
    [
        (shape("TIM1", 16, 6, true), Some(0)),
        (shape("TIM2", 32, 4, false), Some(2)),
        (shape("TIM3", 16, 4, false), Some(12)),
        (shape("TIM4", 16, 4, false), Some(5)),
        (shape("TIM5", 32, 4, false), None),
        (shape("TIM6", 16, 0, false), Some(14)),
        (shape("TIM7", 16, 0, false), Some(30)),
        (shape("TIM8", 16, 6, true), Some(9)),
        (shape("TIM15", 16, 2, false), Some(15)),
        (shape("TIM16", 16, 1, false), None),
        (shape("TIM17", 16, 1, false), None),
        (shape("TIM20", 16, 6, true), Some(16)),
    ]
};
/// TRGO2 of TIM1, TIM8 and TIM20 as a trigger of injected sequences.
const TRGO2: [(usize, u32); 3] = [(0, 8), (7, 10), (11, 17)];
/// The same triggers of regular sequences (21.4.18, tables 163 and 164).
const REGULAR: [(u32, u32); 9] = [(0, 9), (8, 10), (2, 11), (12, 4), (5, 12), (14, 13), (15, 14), (9, 7), (10, 8)];
/// Names of the triggers.
pub(crate) const TRIGGERS: [(u32, &str); 12] = [
    (0, "TIM1_TRGO"),
    (8, "TIM1_TRGO2"),
    (2, "TIM2_TRGO"),
    (12, "TIM3_TRGO"),
    (5, "TIM4_TRGO"),
    (14, "TIM6_TRGO"),
    (30, "TIM7_TRGO"),
    (9, "TIM8_TRGO"),
    (10, "TIM8_TRGO2"),
    (15, "TIM15_TRGO"),
    (16, "TIM20_TRGO"),
    (17, "TIM20_TRGO2"),
];

/// Cycles after which the interrupt of a break is seen at the latest. What the break does is not late.
const BREAK_LATENCY: Cycle = 1000;

/// Distance of the rings of an encoder from the axis, mm.
const ECCENTRICITY_MM: f64 = 0.05;

/// A chip on a board, with a motor.
#[derive(Clone, Debug)]
pub struct Chip {
    pub(crate) board: Arc<Board>,
    /// Tells the chip from others, by its serial number.
    pub(crate) number: u16,
    pub(crate) now: Cycle,
    /// Nothing happens before this; 0 where a write may have changed that.
    pub(crate) due: Cycle,
    pub(crate) time: Time,
    pub(crate) clocks: Clocks,
    pub(crate) rcc: Rcc,
    pub(crate) pwr: Pwr,
    pub(crate) flash: Flash,
    pub(crate) gpio: [Gpio; 7],
    pub(crate) syscfg: Syscfg,
    pub(crate) exti: Exti,
    pub(crate) dbgmcu: Dbgmcu,
    pub(crate) timers: [Timer; 12],
    pub(crate) usarts: [Usart; 4],
    pub(crate) can: Fdcan,
    pub(crate) adcs: Vec<Adc>,
    pub(crate) commons: [Common; 2],
    pub(crate) dacs: [Dac; 4],
    pub(crate) comps: [Comp; 7],
    pub(crate) opamps: [Opamp; 6],
    pub(crate) iwdg: Iwdg,
    pub(crate) wwdg: Wwdg,
    pub(crate) bridge: Bridge,
    pub(crate) motor: Motor,
    pub(crate) record: Record,
    pub(crate) sent: Vec<u8>,
    pub(crate) break_pin: Option<bool>,
    /// The contact of the enable input.
    pub(crate) enable_open: bool,
    /// Voltage that each converter held last, V: what is left of it leaks into the next sample.
    pub(crate) held_v: [f64; 5],
    pub(crate) wanted_reset: Option<ResetCause>,
    pub(crate) stall_s: f64,
    /// Until then, flash operations hold the core, and its handlers catch up.
    pub(crate) held_until: f64,
    pub(crate) last_sampling: Option<(u16, Cycle)>,
}

impl Chip {
    /// At power-on, with an erased flash. `dual_bank` is the option bit DBANK of the larger chip.
    ///
    /// # Errors
    /// What is wrong with the motor's parameters.
    pub fn new(board: Arc<Board>, dual_bank: bool, parameters: &PlantParameters, seed: u64) -> Result<Self, Error> {
        let device = board.device;
        let rcc = Rcc::new(ResetCause::PowerOn);
        let clocks = rcc.clocks();
        let bytes = usize::from(device.flash_kib()) << 10;
        let mut motor = Motor::new(parameters, seed)?;
        motor.encoder = board.rings.map(|pairs| Encoder::new(pairs, ECCENTRICITY_MM, seed));
        let mut chip = Self {
            bridge: Bridge::new(board.driver.clone()),
            can: Fdcan::new(board.can.map_or(0.0, |can| can.loop_s)),
            board,
            number: seed as u16,
            now: 0,
            due: 0,
            time: Time::new(clocks.hclk),
            wwdg: Wwdg::new(clocks.pclk1, 0.0),
            clocks,
            rcc,
            pwr: Pwr::default(),
            flash: Flash::new(bytes, device.is_large(), dual_bank),
            gpio: core::array::from_fn(Gpio::new),
            syscfg: Syscfg::default(),
            exti: Exti::default(),
            dbgmcu: Dbgmcu::default(),
            timers: TIMERS.map(|(shape, _)| Timer::new(shape)),
            usarts: ["USART1", "USART2", "USART3", "LPUART1"].map(Usart::new),
            adcs: ["ADC1", "ADC2", "ADC3", "ADC4", "ADC5"][..device.converters()]
                .iter()
                .map(|name| Adc::new(name))
                .collect(),
            commons: [Common::new("ADC12", 28), Common::new("ADC345", 30)],
            dacs: ["DAC1", "DAC2", "DAC3", "DAC4"].map(Dac::new),
            comps: [Comp::default(); 7],
            opamps: [Opamp::default(); 6],
            iwdg: Iwdg::default(),
            motor,
            record: Record::default(),
            sent: Vec::new(),
            break_pin: None,
            enable_open: false,
            held_v: [0.0; 5],
            wanted_reset: None,
            stall_s: 0.0,
            held_until: 0.0,
            last_sampling: None,
        };
        chip.distribute_clocks(0);
        Ok(chip)
    }

    /// Puts an image into the flash, as a programmer would.
    pub fn load(&mut self, offset: usize, bytes: &[u8]) {
        self.flash.load(offset, bytes);
    }

    /// The state of motor and supply, which no drive gets to see, at the last event or access.
    pub fn truth(&self) -> Truth {
        self.motor.truth()
    }

    /// Whether the timer drives the bridge (MOE).
    pub fn bridge_is_on(&self) -> bool {
        self.timers[0].moe()
    }

    /// The board.
    pub fn board(&self) -> &Arc<Board> {
        &self.board
    }

    pub(crate) fn now_s(&self, now: Cycle) -> f64 {
        self.time.seconds(now as f64)
    }

    /// Tells everybody the clocks as they are from now on.
    pub(crate) fn distribute_clocks(&mut self, now: Cycle) {
        self.clocks = self.rcc.clocks();
        if self.clocks.hclk != self.time.hz() {
            self.time.change(now, self.clocks.hclk);
        }
        self.wwdg.set_clock(self.clocks.pclk1, self.time.seconds(now as f64));
        for (index, timer) in self.timers.iter_mut().enumerate() {
            timer.set_ratio(self.clocks.timer_ratio[usize::from(matches!(index, 0 | 7..=11))], now);
        }
        for (index, adc) in self.adcs.iter_mut().enumerate() {
            adc.set_clock(self.commons[usize::from(index >= 2)].clock(&self.rcc, &self.clocks), self.clocks.hclk);
        }
        let Clocks { hclk, sysclk, pclk1, pclk2, .. } = self.clocks;
        for (index, usart) in self.usarts.iter_mut().enumerate() {
            let kernel = match self.rcc.source([0, 2, 4, 10][index]) {
                0 => [pclk2, pclk1, pclk1, pclk1][index],
                1 => sysclk,
                _ => crate::rcc::HSI_HZ,
            };
            usart.set_clock(hclk / kernel, hclk / crate::board::BAUD);
        }
        // FDCANSEL: HSE, which the boards have not, PLLQ, PCLK1.
        self.can.set_clock(match self.rcc.source(24) {
            1 => self.clocks.pll_q.unwrap_or(0.0),
            2 => pclk1,
            _ => 0.0,
        });
    }

    fn cycle_of(&self, at_s: f64) -> Cycle {
        self.time.first_cycle(at_s)
    }

    /// Does everything that is due until now, in order.
    pub(crate) fn sync(&mut self, now: Cycle) {
        self.now = now;
        if now < self.due {
            return;
        }
        loop {
            let (at, what) = self.next();
            if at > now {
                self.due = at;
                break;
            }
            match what {
                Next::Timer(index) => self.fire_timer(index),
                Next::Driver => {
                    let at_s = self.bridge.next_s();
                    self.bridge.settle(at_s);
                    self.motor.set_switches(self.bridge.switches(), at_s);
                    self.compare(at);
                }
                Next::Adc(index) => self.fire_adc(index),
                Next::Usart(index) => self.fire_usart(index, at),
                Next::Can => {
                    self.can.fire();
                    let at_s = self.now_s(at);
                    self.record.events.extend(self.can.news.drain(..).map(|what| (at_s, what)));
                }
                Next::Flash => self.flash.advance(self.now_s(at)),
                Next::Watchdog => {
                    self.record.bites += 1;
                    self.bite(at, "the watchdog resets the chip", ResetCause::Watchdog);
                }
                Next::WindowWatchdog => {
                    self.record.window_bites += 1;
                    self.bite(at, "the window watchdog resets the chip", ResetCause::WindowWatchdog);
                }
                Next::Trace => {
                    let at_s = self.record.next_trace_s();
                    self.motor.advance(at_s);
                    let (truth, moe) = (self.motor.truth(), self.timers[0].moe());
                    self.record.trace(at_s, &truth, moe);
                    self.compare(at);
                }
            }
        }
    }

    fn bite(&mut self, at: Cycle, what: &str, cause: ResetCause) {
        let at_s = self.now_s(at);
        self.record.events.push((at_s, what.into()));
        self.iwdg.reset();
        self.wwdg.reset(at_s);
        self.wanted_reset = Some(cause);
    }

    fn next(&self) -> (Cycle, Next) {
        let mut first = (Cycle::MAX, Next::Trace);
        let mut offer = |at: Cycle, what: Next| {
            if at < first.0 {
                first = (at, what);
            }
        };
        for (index, timer) in self.timers.iter().enumerate() {
            offer(timer.next(), Next::Timer(index));
        }
        offer(self.cycle_of(self.bridge.next_s()), Next::Driver);
        for (index, adc) in self.adcs.iter().enumerate() {
            offer(ceiling(adc.next()), Next::Adc(index));
        }
        for (index, usart) in self.usarts.iter().enumerate() {
            offer(ceiling(usart.next()), Next::Usart(index));
        }
        let can_s = self.can.next_s();
        if can_s.is_finite() {
            offer(self.cycle_of(can_s), Next::Can);
        }
        if let Some(end_s) = self.flash.ends_s() {
            offer(self.cycle_of(end_s), Next::Flash);
        }
        if let Some(bite_s) = self.iwdg.bites_at_s() {
            offer(self.cycle_of(bite_s), Next::Watchdog);
        }
        if let Some(bite_s) = self.wwdg.bites_at_s() {
            offer(self.cycle_of(bite_s), Next::WindowWatchdog);
        }
        offer(self.cycle_of(self.record.next_trace_s()), Next::Trace);
        first
    }

    /// When an interrupt, a reset or a trigger may come next.
    pub(crate) fn next_of_interest(&self) -> Cycle {
        let mut next = Cycle::MAX;
        for timer in &self.timers {
            next = next.min(timer.next_of_interest());
        }
        for adc in &self.adcs {
            next = next.min(ceiling(adc.next_of_interest()));
        }
        for usart in &self.usarts {
            next = next.min(ceiling(usart.next()));
        }
        if self.can.next_s().is_finite() {
            next = next.min(self.cycle_of(self.can.next_s()));
        }
        for at_s in self.flash.ends_s().into_iter().chain(self.iwdg.bites_at_s()).chain(self.wwdg.bites_at_s()) {
            next = next.min(self.cycle_of(at_s));
        }
        // Nobody knows when a current will be too large.
        if self.timers[0].interrupts_at_break() { next.min(self.now + BREAK_LATENCY) } else { next }
    }

    fn fire_timer(&mut self, index: usize) {
        let at = self.timers[index].next();
        let happened = self.timers[index].fire();
        self.follow(index, happened, at);
    }

    /// What a timer's event entails: triggers, pins.
    pub(crate) fn follow(&mut self, index: usize, happened: Happened, at: Cycle) {
        if index == 0 && happened.outputs {
            self.refresh_gates(at);
        }
        if happened.trgo != Edge::None
            && let Some(number) = TIMERS[index].1
        {
            self.trigger(number, happened.trgo, at);
        }
        if happened.trgo2 != Edge::None
            && let Some((_, number)) = TRGO2.iter().find(|(timer, _)| *timer == index)
        {
            self.trigger(*number, happened.trgo2, at);
        }
    }

    fn trigger(&mut self, number: u32, edge: Edge, at: Cycle) {
        let sees = |edges: u32| match edge {
            Edge::Rising => edges & 1 != 0,
            Edge::Falling => edges & 2 != 0,
            Edge::Pulse => true,
            Edge::None => false,
        };
        let mut any = false;
        let regular = REGULAR.iter().find(|(injected, _)| *injected == number).map(|(_, regular)| *regular);
        for adc in &mut self.adcs {
            if adc.injected_trigger().is_some_and(|(selected, edges)| selected == number && sees(edges)) {
                adc.trigger_injected(at);
                any = true;
            }
            if adc.regular_trigger().is_some_and(|(selected, edges)| Some(selected) == regular && sees(edges)) {
                adc.trigger_regular(at);
            }
        }
        self.record.triggers += u64::from(any);
    }

    fn fire_adc(&mut self, index: usize) {
        let at = self.adcs[index].next();
        self.adcs[index].excused = self.excuses(at);
        match self.adcs[index].fire() {
            Due::Internal => {}
            Due::Hold { channel, sampled } => {
                let at_s = self.time.seconds(at);
                self.motor.advance(at_s);
                let sampled_s = sampled / self.time.hz();
                let volts = self.sample(index, channel, sampled_s, at_s);
                self.adcs[index].hold(volts / crate::analog::VDDA);
                self.compare(ceiling(at));
            }
            Due::Converted(one) => {
                if one.last && self.adcs[index].interrupts_at_end() {
                    let line = [18, 18, 47, 61, 62][index];
                    self.last_sampling = Some((line, one.instants[0] as Cycle));
                }
                let instants = one.instants.map(|at| self.after_valley_ns(at));
                let name = self.adcs[index].name();
                let (board, number) = (&self.board, index);
                self.record.convert(name, || crate::signals::describe(board, number, one.channel), &one, instants);
                self.record_trigger(index);
            }
        }
        if let Some(complaint) = self.adcs[index].take_complaint() {
            self.record.find(self.time.seconds(at), complaint);
        }
    }

    /// While a flash operation holds the core and the bridge is off, nobody misses what is converted.
    pub(crate) fn excuses(&self, at: f64) -> bool {
        !self.timers[0].moe() && at <= self.held_until
    }

    fn record_trigger(&mut self, index: usize) {
        let Some((number, _)) = self.adcs[index].injected_trigger() else { return };
        let name = self.adcs[index].name();
        for entry in self.record.sampling.iter_mut().filter(|entry| entry.trigger.is_empty() && entry.adc == name) {
            let known = TRIGGERS.iter().find(|(at, _)| *at == number);
            entry.trigger = known.map_or_else(|| format!("trigger {number}"), |(_, name)| (*name).into());
        }
    }

    /// An instant against the nearest valley of TIM1, ns.
    fn after_valley_ns(&self, at: f64) -> f64 {
        let valley = self.timers[0].valley().unwrap_or(0) as f64;
        let period = self.timers[0].period() as f64;
        let turns = (at - valley) / period;
        (turns - turns.round()) * period / self.time.hz() * 1e9
    }

    fn fire_usart(&mut self, index: usize, at: Cycle) {
        if let Some(byte) = self.usarts[index].fire() {
            if self.serial_port(0) == Some(index) {
                self.sent.push(byte);
            } else {
                let name = self.usarts[index].name();
                self.record
                    .find(self.now_s(at), format!("alternate function: {name} sends, and no pin carries its TX"));
            }
        }
    }
}

/// What comes next.
#[derive(Clone, Copy, Debug)]
enum Next {
    Timer(usize),
    Driver,
    Adc(usize),
    Usart(usize),
    Can,
    Flash,
    Watchdog,
    WindowWatchdog,
    Trace,
}
