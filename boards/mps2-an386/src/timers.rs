//! Registers of the CMSDK timers (Arm DDI0479): plain readings and writings, no state.

use core::ptr::{read_volatile, write_volatile};

/// A 32-bit timer that counts down from `reload` to zero, interrupts and starts over. 25 MHz.
pub struct Timer {
    base: usize,
}

/// CMSDK timer 0, in the place of the timer that makes the PWM and triggers the ADC.
pub const PWM: Timer = Timer { base: 0x4000_0000 };

impl Timer {
    const CONTROL: usize = 0x0;
    const VALUE: usize = 0x4;
    const RELOAD: usize = 0x8;
    const CLEAR: usize = 0xC;

    const ENABLE: u32 = 1;
    const INTERRUPT: u32 = 1 << 3;

    /// Starts to interrupt every `period` ticks.
    pub fn start(&self, period: u32) {
        self.write(Self::RELOAD, period - 1);
        self.write(Self::VALUE, period - 1);
        self.write(Self::CONTROL, Self::ENABLE | Self::INTERRUPT);
    }

    /// Stops it.
    pub fn stop(&self) {
        self.write(Self::CONTROL, 0);
    }

    /// Ticks since the last interrupt was due.
    pub fn elapsed(&self) -> u32 {
        // SAFETY: a register of this timer without side effects.
        let (reload, value) = unsafe {
            (
                read_volatile((self.base + Self::RELOAD) as *const u32),
                read_volatile((self.base + Self::VALUE) as *const u32),
            )
        };
        reload - value
    }

    /// Takes back the interrupt request.
    pub fn clear(&self) {
        self.write(Self::CLEAR, 1);
    }

    fn write(&self, register: usize, value: u32) {
        // SAFETY: a register of this timer; only its interrupt and its count depend on it.
        unsafe { write_volatile((self.base + register) as *mut u32, value) }
    }
}

/// One of the two 32-bit timers of the dual timer, here behind its divider by 256: 97 656.25 Hz.
pub struct Slow {
    base: usize,
}

/// Counts down for ever, interrupts where it wraps.
pub const CLOCK: Slow = Slow { base: 0x4000_2000 };
/// Counts down once, interrupts at zero.
pub const ALARM: Slow = Slow { base: 0x4000_2020 };

impl Slow {
    const LOAD: usize = 0x0;
    const VALUE: usize = 0x4;
    const CONTROL: usize = 0x8;
    const CLEAR: usize = 0xC;
    const REQUEST: usize = 0x10;

    const ENABLE: u32 = 1 << 7;
    const INTERRUPT: u32 = 1 << 5;
    const BY_256: u32 = 2 << 2;
    const BITS_32: u32 = 1 << 1;
    const ONE_SHOT: u32 = 1;

    /// Ticks of the machine's 25 MHz in one of this timer.
    pub const DIVIDER: u32 = 256;

    /// Counts down from 2³² − 1 and wraps.
    pub fn run(&self) {
        self.write(Self::LOAD, u32::MAX);
        self.write(Self::CONTROL, Self::ENABLE | Self::INTERRUPT | Self::BY_256 | Self::BITS_32);
    }

    /// Interrupts once after `ticks` of this timer, at least one.
    pub fn once(&self, ticks: u32) {
        self.write(Self::CONTROL, 0);
        self.write(Self::LOAD, ticks);
        self.write(Self::CONTROL, Self::ENABLE | Self::INTERRUPT | Self::BY_256 | Self::BITS_32 | Self::ONE_SHOT);
    }

    /// Ticks since the start or the last wrap.
    pub fn elapsed(&self) -> u32 {
        u32::MAX - self.read(Self::VALUE)
    }

    /// Whether it requests an interrupt.
    pub fn requests(&self) -> bool {
        self.read(Self::REQUEST) & 1 != 0
    }

    /// Takes back the interrupt request.
    pub fn clear(&self) {
        self.write(Self::CLEAR, 1);
    }

    fn read(&self, register: usize) -> u32 {
        // SAFETY: a register of this timer without side effects.
        unsafe { read_volatile((self.base + register) as *const u32) }
    }

    fn write(&self, register: usize, value: u32) {
        // SAFETY: a register of this timer; only its interrupt and its count depend on it.
        unsafe { write_volatile((self.base + register) as *mut u32, value) }
    }
}
