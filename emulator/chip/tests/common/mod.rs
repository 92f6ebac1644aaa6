//! What a firmware would write, by hand.
#![allow(dead_code)]

use bus::{Bus, Complaint, Cycle, Width};
use chip::gpio::Pin;
use chip::{Board, Chip};
use plant::PlantParameters;
use std::path::{Path, PathBuf};
use std::sync::Arc;

pub const TIM1: u32 = 0x4001_2c00;
pub const RCC: u32 = 0x4002_1000;
pub const PWR: u32 = 0x4000_7000;
pub const FLASH: u32 = 0x4002_2000;
pub const GPIO: u32 = 0x4800_0000;
pub const USART2: u32 = 0x4000_4400;
pub const IWDG: u32 = 0x4000_3000;
pub const WWDG: u32 = 0x4000_2c00;
pub const ADC: [u32; 5] = [0x5000_0000, 0x5000_0100, 0x5000_0400, 0x5000_0500, 0x5000_0600];
pub const ADC_COMMON: [u32; 2] = [0x5000_0300, 0x5000_0700];

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../../boards")
}

/// Every board that there is.
pub fn boards() -> Vec<Arc<Board>> {
    Board::all(&folder()).expect("boards")
}

/// The larger chip, with drivers whose lower inputs are inverted and a break pin.
pub fn nucleo() -> Arc<Board> {
    Board::load(&folder().join("nucleo-g474re-ihm08m1")).expect("a board")
}

/// The smaller chip, whose op-amps and comparators are at the shunts.
pub fn esc() -> Arc<Board> {
    Board::load(&folder().join("b-g431b-esc1")).expect("a board")
}

pub struct Bench {
    pub chip: Chip,
    pub now: Cycle,
}

impl Bench {
    pub fn new(board: &Arc<Board>) -> Self {
        Self { chip: Chip::new(Arc::clone(board), true, &PlantParameters::imperfect(1), 1).unwrap(), now: 0 }
    }

    pub fn try_write(&mut self, address: u32, value: u32) -> Option<Complaint> {
        self.now += 4;
        self.chip.write(address, Width::Word, value, self.now)
    }

    pub fn write(&mut self, address: u32, value: u32) {
        let complaint = self.try_write(address, value);
        assert_eq!(complaint, None, "{address:#x} = {value:#x}");
    }

    pub fn read(&mut self, address: u32) -> u32 {
        self.now += 4;
        let (value, complaint) = self.chip.read(address, Width::Word, self.now);
        assert_eq!(complaint, None, "{address:#x}");
        value
    }

    pub fn set(&mut self, address: u32, bits: u32) {
        let value = self.read(address);
        self.write(address, value | bits);
    }

    /// Runs on for so many cycles, stopping wherever the chip wants to be asked; `at` sees the lines that are up.
    pub fn run_seeing(&mut self, cycles: Cycle, mut at: impl FnMut(&mut Chip, Cycle)) {
        let end = self.now + cycles;
        while self.now < end {
            self.now = self.chip.advance(self.now).min(end);
            self.chip.advance(self.now);
            at(&mut self.chip, self.now);
        }
    }

    pub fn run(&mut self, cycles: Cycle) {
        self.run_seeing(cycles, |_, _| {});
    }

    /// 170 MHz from HSI, in the order that the manual asks for, and clocks for everything that a drive needs.
    pub fn clocks(&mut self) {
        self.set(RCC + 0x58, 1 << 28 | 1 << 17 | 1 << 1);
        self.set(RCC + 0x60, 1 | 1 << 11);
        self.set(RCC + 0x4c, 0x3f | 1 << 13);
        if self.chip.board().device.is_large() {
            self.set(RCC + 0x4c, 1 << 14);
        } else {
            self.set(RCC + 0x4c, 1 << 18);
        }
        self.write(RCC + 0x0c, 2 | 3 << 4 | 85 << 8 | 1 << 24);
        self.set(RCC, 1 << 24);
        self.run(16 * 50);
        self.set(RCC + 0x08, 8 << 4);
        self.write(PWR + 0x80, 0);
        self.write(FLASH, 0x0004_0604);
        self.run(16 * 2);
        self.write(RCC + 0x08, 3 | 8 << 4);
        self.run(200);
        self.write(RCC + 0x08, 3);
    }

    /// Gives a pin to an alternate function.
    pub fn alternate(&mut self, port: u8, pin: u32, af: u32) {
        let base = GPIO + 0x400 * u32::from(port - b'A');
        let afr = base + 0x20 + 4 * (pin / 8);
        let value = self.read(afr) & !(0xf << (4 * (pin % 8)));
        self.write(afr, value | af << (4 * (pin % 8)));
        let moder = self.read(base) & !(3 << (2 * pin));
        self.write(base, moder | 2 << (2 * pin));
    }

    /// The gate signals, and the driver awake.
    pub fn gate_pins(&mut self) {
        let board = Arc::clone(self.chip.board());
        if let Some(Pin { port, number }) = board.driver.standby {
            let base = GPIO + 0x400 * u32::from(port);
            self.write(base + 0x18, 1 << number);
            let moder = self.read(base) & !(3 << (2 * number));
            self.write(base, moder | 1 << (2 * number));
        }
        for (leg, pins) in board.gates.iter().enumerate() {
            for (side, pin) in pins.iter().enumerate() {
                let af = board.device.alternate(*pin, chip::device::Signal::Gate(leg, side)).unwrap();
                self.alternate(b'A' + pin.port, pin.number.into(), af.into());
            }
        }
    }

    /// 40 kHz centre-aligned, RCR = 1, PWM mode 2 (all low in the valley), an update in the valley as TRGO2; MOE off.
    pub fn timer(&mut self, dead_time: u32) {
        let low = self.chip.board().driver.low_inverted;
        // OISN high where the low side is inverted.
        self.write(TIM1 + 0x04, 2 << 20 | if low { 0x2a00 } else { 0 });
        self.write(TIM1, 0x20 | 1 << 7);
        self.write(TIM1 + 0x2c, 2125);
        self.write(TIM1 + 0x30, 1);
        self.write(TIM1 + 0x18, 0x7878);
        self.write(TIM1 + 0x1c, 0x0078);
        self.write(TIM1 + 0x20, if low { 0xddd } else { 0x555 });
        self.write(TIM1 + 0x44, 1 << 10 | 1 << 11 | dead_time);
        self.duties([1062; 3]);
        self.write(TIM1 + 0x14, 1);
    }

    /// Counts of half a period that each leg is high.
    pub fn duties(&mut self, counts: [u32; 3]) {
        for (channel, count) in counts.into_iter().enumerate() {
            self.write(TIM1 + 0x34 + 4 * channel as u32, 2125 - count);
        }
    }

    pub fn count(&mut self) {
        self.set(TIM1, 1);
    }

    pub fn moe(&mut self) {
        self.set(TIM1 + 0x44, 1 << 15);
    }

    /// All three legs switch, with [`Self::timer`]'s dead time and break settings.
    pub fn switching(&mut self, dead_time: u32) {
        self.timer(dead_time);
        self.gate_pins();
        self.count();
        self.moe();
    }

    /// A converter at HCLK/4, calibrated, with this injected sequence of (channel, SMP) from TIM1_TRGO2.
    pub fn converter(&mut self, index: usize, sequence: &[(u32, u32)], interrupt: bool) {
        let base = ADC[index];
        self.write(ADC_COMMON[usize::from(index >= 2)] + 0x08, 3 << 16);
        self.write(base + 0x08, 1 << 28);
        self.run(3500);
        self.write(base + 0x08, 1 << 28 | 1 << 31);
        self.run(1000);
        assert_eq!(self.read(base + 0x08) >> 31, 0);
        self.write(base + 0x08, 1 << 28 | 1);
        self.run(1000);
        assert_eq!(self.read(base) & 1, 1);
        let mut smpr = [0; 2];
        let mut jsqr = (sequence.len() as u32 - 1) | 8 << 2 | 1 << 7;
        for (rank, (channel, smp)) in sequence.iter().enumerate() {
            smpr[*channel as usize / 10] |= smp << (3 * (channel % 10));
            jsqr |= channel << (9 + 6 * rank);
        }
        self.write(base + 0x14, smpr[0]);
        self.write(base + 0x18, smpr[1]);
        self.write(base + 0x4c, jsqr);
        self.write(base + 0x04, u32::from(interrupt) << 6);
        self.write(base + 0x08, 1 << 28 | 1 << 3);
    }

    pub fn jdr(&mut self, index: usize, rank: u32) -> u32 {
        self.read(ADC[index] + 0x80 + 4 * rank)
    }
}
