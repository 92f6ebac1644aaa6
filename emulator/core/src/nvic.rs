//! Exceptions and their priorities: which are enabled, pending, active (DDI 0403, B1.5 and B3.4).

/// Exception numbers.
pub const NMI: u16 = 2;
pub const HARD_FAULT: u16 = 3;
pub const MEMORY: u16 = 4;
pub const BUS: u16 = 5;
pub const USAGE: u16 = 6;
pub const SVCALL: u16 = 11;
pub const PENDSV: u16 = 14;
pub const SYSTICK: u16 = 15;
/// Number of IRQ 0.
pub const FIRST_IRQ: u16 = 16;

/// Lower than every exception's.
pub const THREAD: i32 = 256;

/// Sets of exceptions are indexed by their number: 16 of the system, then 102 interrupt lines.
#[derive(Clone, Debug)]
pub struct Nvic {
    pub enabled: u128,
    pub pending: u128,
    pub active: u128,
    /// Levels of the lines, already shifted by 16.
    lines: u128,
    /// Of IRQs; as many upper bits as are implemented.
    pub priority: [u8; 112],
    /// SHPR1 to SHPR3: of exceptions 4 to 15.
    pub system_priority: [u8; 12],
    /// AIRCR.PRIGROUP.
    pub group: u8,
}

const fn one(number: u16) -> u128 {
    1 << number
}

impl Nvic {
    pub fn new() -> Self {
        // Reset, NMI, HardFault, SVCall, PendSV and SysTick cannot be disabled; the other faults are by SHCSR.
        let enabled = one(NMI) | one(HARD_FAULT) | one(SVCALL) | one(PENDSV) | one(SYSTICK);
        Nvic { enabled, pending: 0, active: 0, lines: 0, priority: [0; 112], system_priority: [0; 12], group: 0 }
    }

    pub fn pend(&mut self, number: u16) {
        self.pending |= one(number);
    }

    pub fn is_pending(&self, number: u16) -> bool {
        self.pending & one(number) != 0
    }

    pub fn is_active(&self, number: u16) -> bool {
        self.active & one(number) != 0
    }

    /// Takes the levels of the interrupt lines; returns those that became pending.
    pub fn sample(&mut self, irq: u128) -> u128 {
        let lines = irq << FIRST_IRQ;
        // A line that stays up pends again once its handler has left; while it runs only a new edge does.
        let new = (lines & !self.active | lines & !self.lines) & !self.pending;
        self.lines = lines;
        self.pending |= new;
        new
    }

    /// Negative: cannot be masked.
    pub fn priority_of(&self, number: u16) -> i32 {
        match number {
            NMI => -2,
            HARD_FAULT => -1,
            4..=15 => self.system_priority[usize::from(number) - 4].into(),
            FIRST_IRQ.. => self.priority.get(usize::from(number - FIRST_IRQ)).copied().unwrap_or(0).into(),
            _ => -3,
        }
    }

    /// The part of a priority that pre-empts.
    pub fn group_of(&self, priority: i32) -> i32 {
        if (0..THREAD).contains(&priority) { priority & !((2 << self.group) - 1) } else { priority }
    }

    /// The pre-empting priority that executes, without masks.
    pub fn executing(&self) -> i32 {
        let mut lowest = THREAD;
        let mut rest = self.active;
        while rest != 0 {
            let number = rest.trailing_zeros() as u16;
            lowest = lowest.min(self.group_of(self.priority_of(number)));
            rest &= rest - 1;
        }
        lowest
    }

    /// Of those pending and enabled, the one that comes first: lowest priority value, then lowest number.
    pub fn first(&self) -> Option<(u16, i32)> {
        let mut rest = self.pending & self.enabled;
        let mut best: Option<(u16, i32)> = None;
        while rest != 0 {
            let number = rest.trailing_zeros() as u16;
            let priority = self.priority_of(number);
            if best.is_none_or(|(_, least)| priority < least) {
                best = Some((number, priority));
            }
            rest &= rest - 1;
        }
        best
    }

    pub fn activate(&mut self, number: u16) {
        self.pending &= !one(number);
        self.active |= one(number);
    }

    pub fn deactivate(&mut self, number: u16) {
        self.active &= !one(number);
        self.pending |= self.lines & one(number);
    }

    pub fn set_enabled(&mut self, number: u16, on: bool) {
        if on {
            self.enabled |= one(number);
        } else {
            self.enabled &= !one(number);
        }
    }

    pub fn set_pending(&mut self, number: u16, on: bool) {
        if on {
            self.pending |= one(number);
        } else {
            self.pending &= !one(number) | self.lines & !self.active;
        }
    }

    pub fn set_active(&mut self, number: u16, on: bool) {
        if on {
            self.active |= one(number);
        } else {
            self.active &= !one(number);
        }
    }
}

/// Name of an exception that is not an IRQ.
pub fn system_name(number: u16) -> Option<&'static str> {
    Some(match number {
        1 => "Reset",
        NMI => "NMI",
        HARD_FAULT => "HardFault",
        MEMORY => "MemManage",
        BUS => "BusFault",
        USAGE => "UsageFault",
        SVCALL => "SVCall",
        12 => "DebugMonitor",
        PENDSV => "PendSV",
        SYSTICK => "SysTick",
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_group_pre_empts_and_a_subpriority_only_orders() {
        let mut nvic = Nvic { group: 5, ..Nvic::new() };
        (nvic.priority[3], nvic.priority[4]) = (0x70, 0x40);
        nvic.set_enabled(19, true);
        nvic.set_enabled(20, true);
        nvic.sample(0b11 << 3);
        assert_eq!(nvic.first(), Some((20, 0x40)));
        nvic.activate(20);
        assert_eq!(nvic.group_of(0x70), nvic.executing());
    }

    #[test]
    fn a_line_that_stays_up_pends_again_after_its_handler() {
        let mut nvic = Nvic::new();
        nvic.sample(1);
        nvic.activate(16);
        assert_eq!(nvic.sample(1), 0);
        assert!(!nvic.is_pending(16));
        nvic.deactivate(16);
        assert!(nvic.is_pending(16));
    }
}
