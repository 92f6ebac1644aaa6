//! The bridge: TIM1 and its pins.

use crate::chip::watchdog;
use crate::registers::timer::{self, Gates};
use crate::wiring::Wiring;
use embassy_stm32::pac::gpio::Gpio;
use embassy_stm32::pac::gpio::vals::{Moder, Ospeedr};
use embassy_stm32::pac::timer::regs;
use embassy_stm32::pac::{RCC, SYSCFG, TIM1};
use hallservo::board::timing::{Enable, OutputEnable};
use hallservo::board::{Legs, Output};

/// A pin with a function, as those that TIM1 drives or watches: port, number, alternate function.
pub type Pin = (Gpio, u8, u8);

/// Hands pins over to their functions. Not inlined, it is a loop instead of all pins one after the other.
#[inline(never)]
pub(super) fn connect(pins: &[Pin]) {
    for &(port, pin, function) in pins {
        // Never more, which the compiler does not know.
        let pin = usize::from(pin % 16);
        port.afr(pin / 8).modify(|afr| afr.set_afr(pin % 8, function));
        port.ospeedr().modify(|speed| speed.set_ospeedr(pin, Ospeedr::HIGH_SPEED));
        port.moder().modify(|mode| mode.set_moder(pin, Moder::ALTERNATE));
    }
}

/// TIM1 as it drives the bridge.
pub struct Bridge {
    gates: Gates,
    period: u16,
    /// As preloaded.
    legs: Legs,
    enable: OutputEnable,
}

impl Bridge {
    /// The bridge that [`Self::hold`] has set up.
    pub const fn new(wiring: &Wiring) -> Self {
        Self { gates: wiring.gates, period: wiring.period(), legs: Legs::ALL, enable: OutputEnable::new() }
    }

    /// Sets everything up, off: all pins at the levels at which the transistors do not conduct, and the break armed. To
    /// be called before anything else: it needs no clock but the one out of reset, and no memory.
    pub fn hold(wiring: &Wiring, pins: &[Pin]) {
        RCC.apb2enr().modify(|enable| {
            enable.set_tim1en(true);
            enable.set_syscfgen(true);
        });
        RCC.ahb2enr().modify(|enable| {
            enable.set_gpioaen(true);
            enable.set_gpioben(true);
            enable.set_gpiocen(true);
        });
        let legs = timer::legs(wiring.gates, Legs::ALL.bits());
        TIM1.cr1().write_value(regs::Cr1Gp16(timer::CR1));
        TIM1.cr2().write_value(regs::Cr2Adv(timer::cr2(wiring.gates)));
        TIM1.arr().write_value(regs::ArrCore(wiring.period().into()));
        TIM1.rcr().write_value(regs::RcrAdv(timer::RCR));
        for channel in 0..3 {
            TIM1.ccr(channel).write_value(regs::Ccr1ch(wiring.period().into()));
        }
        TIM1.ccr(3).write_value(regs::Ccr1ch(wiring.lead));
        TIM1.ccmr_output(0).write_value(regs::CcmrOutputGp16(legs.ccmr1));
        TIM1.ccmr_output(1).write_value(regs::CcmrOutputGp16(legs.ccmr2));
        TIM1.ccer().write_value(regs::CcerAdv(legs.ccer));
        TIM1.af1().write_value(regs::Af1Adv(timer::af1(wiring.source)));
        TIM1.egr().write_value(regs::EgrAdv(timer::EGR_UPDATE | timer::EGR_COMMUTATE));
        TIM1.bdtr().write_value(regs::BdtrAdv(wiring.bdtr()));
        connect(pins);
    }

    /// Starts to count, and so to trigger the ADCs. The bridge stays off.
    pub(crate) fn start(&self) {
        TIM1.cr1().write_value(regs::Cr1Gp16(timer::CR1_COUNTING));
    }

    /// First thing in a period: the states of the legs that belong to the compare values which the valley has just
    /// taken up.
    #[inline(always)]
    pub(crate) fn commutate(&self) {
        TIM1.egr().write_value(regs::EgrAdv(timer::EGR_COMMUTATE));
    }

    /// Whether the hardware has switched off what should be on.
    #[inline(always)]
    pub(crate) fn has_tripped(&self) -> bool {
        self.enable.is_on() && !is_on()
    }

    /// What a step returned. Off is at once; anything else is from the next valley on, when all of it is taken up
    /// together. While the bridge is off another `period` of the drive is, too; true where it is another one.
    #[inline(always)]
    pub(crate) fn apply(&mut self, output: Output, period: impl FnOnce() -> u16) -> bool {
        // As a rule: on, and nothing changes but the compare values. These legs are never none.
        if self.enable.is_on() && output.legs == self.legs {
            self.compare(output);
            return false;
        }
        self.change(period(), output.pack())
    }

    #[inline(always)]
    fn compare(&self, output: Output) {
        for channel in 0..3 {
            // A compare value beyond the period, which there is none of, would keep the lower transistor on.
            let count = u32::from(self.period).wrapping_sub(output.compare[channel].into());
            TIM1.ccr(channel).write_value(regs::Ccr1ch(count));
        }
    }

    /// Anything else than to go on. Not inlined, as it is cold; but compiled with the interrupt, where all that the
    /// registers' functions assert is known to hold.
    #[cold]
    #[inline]
    fn change(&mut self, period: u16, output: u64) -> bool {
        let output = Output::unpack(output);
        let enable = self.enable.step(&output);
        if enable == Enable::Off {
            off();
            return self.take_up(period);
        }
        self.compare(output);
        if output.legs != self.legs {
            self.legs = output.legs;
            let legs = timer::legs(self.gates, output.legs.bits());
            TIM1.ccmr_output(0).write_value(regs::CcmrOutputGp16(legs.ccmr1));
            TIM1.ccmr_output(1).write_value(regs::CcmrOutputGp16(legs.ccmr2));
            TIM1.ccer().write_value(regs::CcerAdv(legs.ccer));
        }
        if enable == Enable::On && !watchdog::has_time() {
            // A break that is still there stays noted in BIF: the bridge stays off, and counts as tripped.
            TIM1.sr().write_value(regs::SrAdv(!timer::BIF));
            if TIM1.sr().read().0 & timer::BIF == 0 {
                TIM1.bdtr().modify(|bdtr| bdtr.0 |= timer::MOE);
            }
        }
        false
    }

    /// A period, from the next valley on; whether it is another one.
    #[inline(always)]
    fn take_up(&mut self, period: u16) -> bool {
        let other = period != self.period;
        if other {
            self.period = period;
            TIM1.arr().write_value(regs::ArrCore(period.into()));
        }
        other
    }
}

/// A locked-up core, a parity error of the SRAM and a double error of the flash are breaks as well, without code.
pub(crate) fn guard_against_the_core() {
    SYSCFG.cfgr2().write_value(embassy_stm32::pac::syscfg::regs::Cfgr2(timer::SYSTEM_BREAKS));
}

/// Whether the timer drives the bridge.
#[inline(always)]
pub(crate) fn is_on() -> bool {
    TIM1.bdtr().read().0 & timer::MOE != 0
}

/// Switches all transistors off.
#[inline(always)]
pub fn off() {
    TIM1.bdtr().modify(|bdtr| bdtr.0 &= !timer::MOE);
}
