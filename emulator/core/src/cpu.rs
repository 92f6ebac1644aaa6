//! Registers.

/// The registers of one core. `r[13]` is the stack pointer in use, the other one is banked.
#[derive(Clone, Debug)]
pub struct Cpu {
    /// R0 to R14; while an instruction executes, R15 as it reads there: its address plus 4.
    pub r: [u32; 16],
    /// Floating-point registers, as bits.
    pub s: [u32; 32],
    /// Address of the next instruction.
    pub pc: u32,
    pub n: bool,
    pub z: bool,
    pub c: bool,
    pub v: bool,
    pub q: bool,
    /// GE flags of parallel arithmetic.
    pub ge: u8,
    /// ITSTATE.
    pub it: u8,
    /// Number of the exception that executes, 0 in thread mode.
    pub ipsr: u16,
    /// The stack pointer that is not in use.
    pub other_sp: u32,
    /// CONTROL: bit 0 nPRIV, bit 1 SPSEL, bit 2 FPCA.
    pub control: u32,
    pub primask: bool,
    pub faultmask: bool,
    pub basepri: u8,
    pub fpscr: u32,
    /// Address of an exclusive load that still holds.
    pub exclusive: Option<u32>,
    /// The event register of WFE.
    pub event: bool,
    pub sleep: Option<Sleep>,
}

/// What a sleeping core waits for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Sleep {
    Interrupt,
    Event,
}

pub const SPSEL: u32 = 2;
pub const FPCA: u32 = 4;

impl Cpu {
    pub fn new() -> Self {
        Cpu {
            r: [0; 16],
            s: [0; 32],
            pc: 0,
            n: false,
            z: false,
            c: false,
            v: false,
            q: false,
            ge: 0,
            it: 0,
            ipsr: 0,
            other_sp: 0,
            control: 0,
            primask: false,
            faultmask: false,
            basepri: 0,
            fpscr: 0,
            exclusive: None,
            event: false,
            sleep: None,
        }
    }

    /// Whether a condition code holds (A7.3).
    #[inline(always)]
    pub fn holds(&self, cond: u8) -> bool {
        let holds = match cond >> 1 {
            0 => self.z,
            1 => self.c,
            2 => self.n,
            3 => self.v,
            4 => self.c && !self.z,
            5 => self.n == self.v,
            6 => self.n == self.v && !self.z,
            _ => return true,
        };
        holds != (cond & 1 != 0)
    }

    #[inline(always)]
    pub fn set_nz(&mut self, value: u32) {
        self.n = value >> 31 != 0;
        self.z = value == 0;
    }

    pub fn apsr(&self) -> u32 {
        u32::from(self.n) << 31
            | u32::from(self.z) << 30
            | u32::from(self.c) << 29
            | u32::from(self.v) << 28
            | u32::from(self.q) << 27
            | u32::from(self.ge) << 16
    }

    pub fn set_nzcvq(&mut self, value: u32) {
        self.n = value >> 31 & 1 != 0;
        self.z = value >> 30 & 1 != 0;
        self.c = value >> 29 & 1 != 0;
        self.v = value >> 28 & 1 != 0;
        self.q = value >> 27 & 1 != 0;
    }

    /// The whole program status as an exception stacks it.
    pub fn xpsr(&self) -> u32 {
        let it = u32::from(self.it);
        self.apsr() | (it & 3) << 25 | (it >> 2) << 10 | 1 << 24 | u32::from(self.ipsr)
    }

    pub fn set_xpsr(&mut self, value: u32) {
        self.set_nzcvq(value);
        self.ge = (value >> 16 & 15) as u8;
        self.it = ((value >> 25 & 3) | (value >> 10 & 0x3F) << 2) as u8;
        self.ipsr = (value & 0x1FF) as u16;
    }

    pub fn uses_process_stack(&self) -> bool {
        self.ipsr == 0 && self.control & SPSEL != 0
    }

    /// Sets SPSEL, exchanging the stack pointers where the one in use changes.
    pub fn select_stack(&mut self, process: bool) {
        if (self.control & SPSEL != 0) != process {
            std::mem::swap(&mut self.r[13], &mut self.other_sp);
            self.control ^= SPSEL;
        }
    }

    pub fn msp(&self) -> u32 {
        if self.control & SPSEL != 0 { self.other_sp } else { self.r[13] }
    }

    pub fn psp(&self) -> u32 {
        if self.control & SPSEL != 0 { self.r[13] } else { self.other_sp }
    }

    pub fn set_msp(&mut self, value: u32) {
        *if self.control & SPSEL != 0 { &mut self.other_sp } else { &mut self.r[13] } = value & !3;
    }

    pub fn set_psp(&mut self, value: u32) {
        *if self.control & SPSEL != 0 { &mut self.r[13] } else { &mut self.other_sp } = value & !3;
    }
}
