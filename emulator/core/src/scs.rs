//! The private peripheral bus: system control block, SysTick, NVIC registers, DWT (DDI 0403, B3 and C1.8).

use crate::cpu::SPSEL;
use crate::fault::Fault;
use crate::machine::Machine;
use crate::nvic::{self, FIRST_IRQ, PENDSV, SVCALL, SYSTICK};
use crate::systick::{CycleCounter, SysTick};
use bus::{Bus, Complaint, Integration, Width};

const ASPEN: u32 = 1 << 31;
const LSPEN: u32 = 1 << 30;
const LSPACT: u32 = 1;

/// Registers that the core itself acts on.
#[derive(Clone, Debug)]
pub struct Scs {
    pub vtor: u32,
    scr: u32,
    ccr: u32,
    pub cfsr: u32,
    pub hfsr: u32,
    pub bfar: u32,
    cpacr: u32,
    fpccr: u32,
    fpcar: u32,
    pub fpdscr: u32,
    demcr: u32,
    actlr: u32,
    reset_requested: bool,
    /// Implemented bits of a priority.
    priority_mask: u8,
    pub systick: SysTick,
    pub cycles: CycleCounter,
}

impl Scs {
    pub fn new(integration: &Integration) -> Self {
        Scs {
            vtor: 0,
            scr: 0,
            ccr: 0x200,
            cfsr: 0,
            hfsr: 0,
            bfar: 0,
            cpacr: 0,
            fpccr: ASPEN | LSPEN,
            fpcar: 0,
            fpdscr: 0,
            demcr: 0,
            actlr: 0,
            reset_requested: false,
            priority_mask: !(0xFF >> integration.priority_bits),
            systick: SysTick::new(integration.systick_reference),
            cycles: CycleCounter::default(),
        }
    }

    pub fn traps_division(&self) -> bool {
        self.ccr & 1 << 4 != 0
    }

    pub fn aligns_stack(&self) -> bool {
        self.ccr & 1 << 9 != 0
    }

    pub fn sends_event_on_pending(&self) -> bool {
        self.scr & 1 << 4 != 0
    }

    pub fn sleeps_on_exit(&self) -> bool {
        self.scr & 1 << 1 != 0
    }

    pub fn has_float(&self) -> bool {
        self.cpacr >> 20 & 0xF != 0
    }

    pub fn saves_float(&self) -> bool {
        self.fpccr & ASPEN != 0
    }

    pub fn stacks_lazily(&self) -> bool {
        self.fpccr & LSPEN != 0
    }

    pub fn reserve_float(&mut self, frame: u32) {
        self.fpcar = frame;
        self.fpccr |= LSPACT;
    }

    /// The reserved place, once.
    pub fn take_reserved_float(&mut self) -> Option<u32> {
        let reserved = self.fpccr & LSPACT != 0;
        self.fpccr &= !LSPACT;
        reserved.then_some(self.fpcar)
    }

    pub fn take_reset_request(&mut self) -> bool {
        std::mem::take(&mut self.reset_requested)
    }
}

/// Registers of 32 exceptions each, one bit an exception.
fn set_bits(mut bits: u32, first: u32, mut f: impl FnMut(u16)) {
    while bits != 0 {
        let number = u32::from(FIRST_IRQ) + first + bits.trailing_zeros();
        if number < 128 {
            f(number as u16);
        }
        bits &= bits - 1;
    }
}

fn irq_bits(set: u128, register: u32) -> u32 {
    let at = 32 * register + u32::from(FIRST_IRQ);
    if at < 128 { (set >> at) as u32 } else { 0 }
}

impl<S: Bus> Machine<S> {
    pub(crate) fn read_private(&mut self, address: u32, width: Width) -> Result<u32, Fault> {
        let word = self.private_word(address & !3)?;
        let shifted = word >> (8 * (address & 3));
        Ok(match width {
            Width::Byte => shifted & 0xFF,
            Width::Half => shifted & 0xFFFF,
            Width::Word => shifted,
        })
    }

    fn private_word(&mut self, address: u32) -> Result<u32, Fault> {
        Ok(match address {
            0xE000_1000 => 0x4000_0000 | u32::from(self.scs.cycles.is_on()),
            0xE000_1004 => self.scs.cycles.read(self.now),
            0xE000_E004 => 3,
            0xE000_E008 => self.scs.actlr,
            0xE000_E010 => self.scs.systick.read_control(self.now),
            0xE000_E014 => self.scs.systick.reload(),
            0xE000_E018 => self.scs.systick.current(self.now),
            0xE000_E01C => 0x4000_0000,
            0xE000_E100..=0xE000_E11C => irq_bits(self.nvic.enabled, (address & 0x7F) / 4),
            0xE000_E180..=0xE000_E19C => irq_bits(self.nvic.enabled, (address & 0x7F) / 4),
            0xE000_E200..=0xE000_E21C => irq_bits(self.nvic.pending, (address & 0x7F) / 4),
            0xE000_E280..=0xE000_E29C => irq_bits(self.nvic.pending, (address & 0x7F) / 4),
            0xE000_E300..=0xE000_E31C => irq_bits(self.nvic.active, (address & 0x7F) / 4),
            // Registers of interrupts that the chip has not read as zero and ignore writes.
            0xE000_E470..=0xE000_E7EC => 0,
            0xE000_E400..=0xE000_E46C => {
                let at = (address - 0xE000_E400) as usize;
                u32::from_le_bytes(self.nvic.priority[at..at + 4].try_into().unwrap_or_default())
            }
            0xE000_ED00 => 0x410F_C241,
            0xE000_ED04 => self.icsr(),
            0xE000_ED08 => self.scs.vtor,
            0xE000_ED0C => 0xFA05_0000 | u32::from(self.nvic.group) << 8,
            0xE000_ED10 => self.scs.scr,
            0xE000_ED14 => self.scs.ccr,
            0xE000_ED18..=0xE000_ED20 => {
                let at = (address - 0xE000_ED18) as usize;
                u32::from_le_bytes(self.nvic.system_priority[at..at + 4].try_into().unwrap_or_default())
            }
            0xE000_ED24 => self.shcsr(),
            0xE000_ED28 => self.scs.cfsr,
            0xE000_ED2C => self.scs.hfsr,
            // DFSR, MMFAR, AFSR: no debug events, no memory protection.
            0xE000_ED30 | 0xE000_ED34 | 0xE000_ED3C => 0,
            0xE000_ED38 => self.scs.bfar,
            0xE000_ED88 => self.scs.cpacr,
            // MPU_TYPE: eight regions, MPU_CTRL: off.
            0xE000_ED90 => 0x800,
            0xE000_ED94 => 0,
            // DHCSR: a debugger is attached or not.
            0xE000_EDF0 => u32::from(self.debugger),
            0xE000_EDFC => self.scs.demcr,
            0xE000_EF34 => self.scs.fpccr,
            0xE000_EF38 => self.scs.fpcar,
            0xE000_EF3C => self.scs.fpdscr,
            // MVFR0 and MVFR1 of the Cortex-M4F.
            0xE000_EF40 => 0x1011_0021,
            0xE000_EF44 => 0x1100_0011,
            _ => {
                self.unmodelled(address, false);
                0
            }
        })
    }

    pub(crate) fn write_private(&mut self, address: u32, width: Width, value: u32) -> Result<(), Fault> {
        self.due = 0;
        match (address, width) {
            (0xE000_E400..=0xE000_E7EF, _) | (0xE000_ED18..=0xE000_ED23, _) => {
                for index in 0..width.bytes() {
                    self.write_priority(address + index, (value >> (8 * index)) as u8 & self.scs.priority_mask);
                }
                return Ok(());
            }
            // The parts of CFSR, write one to clear.
            (0xE000_ED28..=0xE000_ED2B, _) => {
                self.scs.cfsr &= !(value << (8 * (address & 3)));
                return Ok(());
            }
            (_, Width::Word) => {}
            _ => {
                self.unmodelled(address, true);
                return Ok(());
            }
        }
        let first = 32 * ((address & 0x7F) / 4);
        match address {
            0xE000_1000 => self.scs.cycles.switch(value & 1 != 0 && self.scs.demcr >> 24 & 1 != 0, self.now),
            0xE000_1004 => self.scs.cycles.write(value, self.now),
            0xE000_E008 => self.scs.actlr = value,
            0xE000_E010 => self.scs.systick.write_control(value, self.now),
            0xE000_E014 => self.scs.systick.write_reload(value, self.now),
            0xE000_E018 => self.scs.systick.clear(self.now),
            0xE000_E100..=0xE000_E11C => set_bits(value, first, |n| self.nvic.set_enabled(n, true)),
            0xE000_E180..=0xE000_E19C => set_bits(value, first, |n| self.nvic.set_enabled(n, false)),
            0xE000_E200..=0xE000_E21C => set_bits(value, first, |n| self.pend(n)),
            0xE000_E280..=0xE000_E29C => set_bits(value, first, |n| self.nvic.set_pending(n, false)),
            0xE000_ED04 => self.write_icsr(value),
            0xE000_ED08 => self.scs.vtor = value & !0x1FF,
            0xE000_ED0C if value >> 16 == 0x05FA => {
                self.nvic.group = (value >> 8 & 7) as u8;
                self.scs.reset_requested |= value & 4 != 0;
            }
            0xE000_ED0C => {}
            0xE000_ED10 => self.scs.scr = value & 0x16,
            0xE000_ED14 => self.scs.ccr = value & 0x31B,
            0xE000_ED24 => self.write_shcsr(value),
            0xE000_ED2C => self.scs.hfsr &= !value,
            0xE000_ED30 => {}
            0xE000_ED38 => self.scs.bfar = value,
            0xE000_ED88 => self.scs.cpacr = value & 0x00F0_0000,
            0xE000_EDFC => self.scs.demcr = value & 0x0100_0000,
            0xE000_EF00 => self.pend(FIRST_IRQ + (value & 0x1FF).min(111) as u16),
            0xE000_EF34 => self.scs.fpccr = value & (ASPEN | LSPEN | LSPACT),
            0xE000_EF38 => self.scs.fpcar = value & !7,
            0xE000_EF3C => self.scs.fpdscr = value & 0x07C0_0000,
            _ => self.unmodelled(address, true),
        }
        Ok(())
    }

    fn unmodelled(&mut self, address: u32, write: bool) {
        let peripheral = match address >> 12 {
            0xE0000 => "ITM",
            0xE0001 => "DWT",
            0xE0002 => "FPB",
            _ => "SCS",
        };
        self.complain(Complaint::Unmodelled { peripheral, register: address & 0xFFF }, address, write);
    }

    fn pend(&mut self, number: u16) {
        if !self.nvic.is_pending(number) {
            self.nvic.set_pending(number, true);
            self.profile.pended(1 << number, self.now);
        }
    }

    fn write_priority(&mut self, address: u32, value: u8) {
        if address < 0xE000_ED00 {
            if let Some(place) = self.nvic.priority.get_mut((address - 0xE000_E400) as usize) {
                *place = value;
            }
        } else {
            self.nvic.system_priority[(address - 0xE000_ED18) as usize] = value;
        }
    }

    fn icsr(&self) -> u32 {
        let first = self.nvic.first().map_or(0, |(number, _)| u32::from(number));
        let only = self.nvic.active.count_ones() <= 1;
        u32::from(self.nvic.is_pending(nvic::NMI)) << 31
            | u32::from(self.nvic.is_pending(PENDSV)) << 28
            | u32::from(self.nvic.is_pending(SYSTICK)) << 26
            | u32::from(self.nvic.pending >> FIRST_IRQ != 0) << 22
            | first << 12
            | u32::from(only) << 11
            | u32::from(self.cpu.ipsr)
    }

    fn write_icsr(&mut self, value: u32) {
        let bit = |at: u32| value >> at & 1 != 0;
        for (at, number) in [(31, nvic::NMI), (28, PENDSV), (26, SYSTICK)] {
            if bit(at) {
                self.pend(number);
            }
        }
        for (at, number) in [(27, PENDSV), (25, SYSTICK)] {
            if bit(at) {
                self.nvic.set_pending(number, false);
            }
        }
    }

    /// Bits of SHCSR: enabled, pending, active.
    const ENABLES: [(u32, u16); 3] = [(16, nvic::MEMORY), (17, nvic::BUS), (18, nvic::USAGE)];
    const PENDS: [(u32, u16); 4] = [(12, nvic::USAGE), (13, nvic::MEMORY), (14, nvic::BUS), (15, SVCALL)];
    const ACTIVES: [(u32, u16); 6] =
        [(0, nvic::MEMORY), (1, nvic::BUS), (3, nvic::USAGE), (7, SVCALL), (10, PENDSV), (11, SYSTICK)];

    fn shcsr(&self) -> u32 {
        let gather = |set: u128, table: &[(u32, u16)]| {
            table.iter().fold(0, |word, &(at, number)| word | ((set >> number & 1) as u32) << at)
        };
        gather(self.nvic.enabled, &Self::ENABLES)
            | gather(self.nvic.pending, &Self::PENDS)
            | gather(self.nvic.active, &Self::ACTIVES)
    }

    fn write_shcsr(&mut self, value: u32) {
        let bit = |at: u32| value >> at & 1 != 0;
        Self::ENABLES.iter().for_each(|&(at, number)| self.nvic.set_enabled(number, bit(at)));
        Self::PENDS.iter().for_each(|&(at, number)| self.nvic.set_pending(number, bit(at)));
        Self::ACTIVES.iter().for_each(|&(at, number)| self.nvic.set_active(number, bit(at)));
    }

    /// CPSIE and CPSID.
    pub(crate) fn change_masks(&mut self, disable: bool, primask: bool, faultmask: bool) {
        if primask {
            self.cpu.primask = disable;
        }
        if faultmask {
            self.cpu.faultmask = disable;
        }
        self.due = 0;
    }

    /// MRS, B5.2.2.
    pub(crate) fn read_special(&self, special: u8) -> u32 {
        let cpu = &self.cpu;
        match special {
            0 | 2 => cpu.apsr(),
            1 | 3 => cpu.apsr() | u32::from(cpu.ipsr),
            5 | 7 => u32::from(cpu.ipsr),
            8 => cpu.msp(),
            9 => cpu.psp(),
            16 => u32::from(cpu.primask),
            17 | 18 => u32::from(cpu.basepri),
            19 => u32::from(cpu.faultmask),
            20 => cpu.control,
            _ => 0,
        }
    }

    /// MSR, B5.2.3.
    pub(crate) fn write_special(&mut self, special: u8, mask: u8, value: u32) {
        match special {
            0..=3 => {
                if mask & 2 != 0 {
                    self.cpu.set_nzcvq(value);
                }
                if mask & 1 != 0 {
                    self.cpu.ge = (value >> 16 & 15) as u8;
                }
            }
            8 => self.cpu.set_msp(value),
            9 => self.cpu.set_psp(value),
            16 => self.cpu.primask = value & 1 != 0,
            17 => self.cpu.basepri = value as u8 & self.scs.priority_mask,
            18 => {
                let value = value as u8 & self.scs.priority_mask;
                if value != 0 && (self.cpu.basepri == 0 || value < self.cpu.basepri) {
                    self.cpu.basepri = value;
                }
            }
            19 => self.cpu.faultmask = value & 1 != 0 && self.masked_priority(false) > -1,
            20 => {
                if self.cpu.ipsr == 0 {
                    self.cpu.select_stack(value & SPSEL != 0);
                }
                self.cpu.control = self.cpu.control & SPSEL | value & 5;
            }
            _ => {}
        }
        self.due = 0;
    }
}
