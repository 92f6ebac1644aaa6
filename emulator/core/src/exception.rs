//! Entry to exceptions and return from them (DDI 0403, B1.5).
//!
//! Entry takes 12 cycles, tail-chaining 6, return 10 (DDI 0439, 3.9.1). Floating-point registers are stacked lazily, as
//! the hardware does after reset: their place is reserved, and the first FP instruction of a handler fills it.

use crate::cpu::{FPCA, Sleep};
use crate::fault::{self, Fault};
use crate::machine::Machine;
use crate::nvic::{self, BUS, HARD_FAULT, SVCALL, USAGE};
use bus::Bus;

const ENTRY: u64 = 12;
const TAIL: u64 = 6;
const RETURN: u64 = 10;

impl<S: Bus> Machine<S> {
    /// The priority that an exception has to be above to be taken now.
    pub(crate) fn masked_priority(&self, primask: bool) -> i32 {
        let mut priority = self.nvic.executing();
        if self.cpu.basepri != 0 {
            priority = priority.min(self.nvic.group_of(self.cpu.basepri.into()));
        }
        if primask && self.cpu.primask {
            priority = priority.min(0);
        }
        if self.cpu.faultmask {
            priority = priority.min(-1);
        }
        priority
    }

    fn ready(&self) -> Option<u16> {
        let (number, priority) = self.nvic.first()?;
        (self.nvic.group_of(priority) < self.masked_priority(true)).then_some(number)
    }

    /// Takes the first exception that is ready; `false` where none is.
    pub(crate) fn take_exception(&mut self) -> bool {
        let Some(number) = self.ready() else { return false };
        let return_to = self.cpu.pc;
        self.enter(number, return_to);
        true
    }

    /// Stacks, and goes to the handler of `number` or of what has come meanwhile and is more urgent.
    fn enter(&mut self, number: u16, return_to: u32) {
        let link = match self.stack_frame(return_to) {
            Ok(link) => link,
            Err(_) => {
                self.scs.cfsr |= fault::STKERR;
                if number == HARD_FAULT || self.nvic.is_active(HARD_FAULT) {
                    return self.lock_up("no stack for the hard fault handler");
                }
                self.scs.hfsr |= fault::FORCED;
                self.report("HardFault", "the stack for an exception is not in RAM".into(), Some(self.cpu.r[13]));
                self.nvic.pend(HARD_FAULT);
                0xFFFF_FFF9
            }
        };
        self.now += ENTRY;
        self.vector(number, link);
    }

    /// The part of entry that tail-chaining shares: chooses the most urgent, and fetches its vector.
    fn vector(&mut self, number: u16, link: u32) {
        // Late arrival: what came while registers were stacked goes first.
        self.catch_up();
        let number = match self.nvic.first() {
            Some((late, priority))
                if self.nvic.group_of(priority) < self.nvic.group_of(self.nvic.priority_of(number))
                    && self.nvic.group_of(priority) < self.masked_priority(true) =>
            {
                late
            }
            _ => number,
        };
        self.nvic.activate(number);
        self.cpu.ipsr = number;
        self.cpu.it = 0;
        self.cpu.select_stack(false);
        self.cpu.control &= !FPCA;
        self.cpu.exclusive = None;
        self.cpu.event = true;
        self.cpu.r[14] = link;
        self.due = 0;
        match self.load::<4>(self.scs.vtor.wrapping_add(4 * u32::from(number))) {
            Ok(target) if target & 1 != 0 => self.cpu.pc = target & !1,
            _ => {
                self.scs.hfsr |= fault::VECTTBL;
                return self.lock_up("no handler in the vector table");
            }
        }
        let origin = number.checked_sub(nvic::FIRST_IRQ).and_then(|line| self.system.origin(line));
        self.profile.entered(number, origin, self.spent());
        self.entered(number);
    }

    /// Pushes the frame (B1.5.6); returns EXC_RETURN.
    fn stack_frame(&mut self, return_to: u32) -> Result<u32, Fault> {
        let extended = self.cpu.control & FPCA != 0;
        let size = if extended { 104 } else { 32 };
        let stack = self.cpu.r[13];
        let padded = stack & 4 != 0 && self.scs.aligns_stack();
        let frame = stack.wrapping_sub(size) & if self.scs.aligns_stack() { !7 } else { !3 };
        let xpsr = self.cpu.xpsr() | u32::from(padded) << 9;
        let r = self.cpu.r;
        for (index, value) in [r[0], r[1], r[2], r[3], r[12], r[14], return_to, xpsr].into_iter().enumerate() {
            self.store::<4>(frame + 4 * index as u32, value).map_err(|_| Fault::Stacking)?;
        }
        if extended {
            if self.scs.stacks_lazily() {
                self.scs.reserve_float(frame + 32);
            } else {
                self.push_float(frame + 32)?;
                self.now += 17;
            }
        }
        let (handler, process) = (self.cpu.ipsr != 0, self.cpu.uses_process_stack());
        self.cpu.r[13] = frame;
        let mode = if handler {
            0x1
        } else if process {
            0xD
        } else {
            0x9
        };
        Ok(0xFFFF_FFE0 | u32::from(!extended) << 4 | mode)
    }

    fn push_float(&mut self, frame: u32) -> Result<(), Fault> {
        for index in 0..16 {
            self.store::<4>(frame + 4 * index, self.cpu.s[index as usize])?;
        }
        self.store::<4>(frame + 64, self.cpu.fpscr)
    }

    /// Before every FP instruction: is there an FPU, is a frame still to be filled, is this context to be saved?
    pub(crate) fn prepare_float(&mut self) -> Result<(), Fault> {
        if !self.scs.has_float() {
            return Err(Fault::NoCoprocessor);
        }
        if let Some(frame) = self.scs.take_reserved_float() {
            self.push_float(frame)?;
            self.now += 17;
        }
        if self.cpu.control & FPCA == 0 && self.scs.saves_float() {
            self.cpu.control |= FPCA;
            self.cpu.fpscr = self.cpu.fpscr & 0xF83F_FFFF | self.scs.fpdscr;
        }
        Ok(())
    }

    /// B1.5.8.
    fn return_from_exception(&mut self, value: u32) -> Result<(), Fault> {
        let number = self.cpu.ipsr;
        if let Some(own) = self.profile.left(number, self.spent()) {
            self.watch.left(number, own, self.now);
        }
        if !self.nvic.is_active(number) {
            return Err(Fault::InvalidReturn);
        }
        self.nvic.deactivate(number);
        if number != nvic::NMI {
            self.cpu.faultmask = false;
        }
        self.cpu.exclusive = None;
        let process = match value & 0xF {
            0x1 | 0x9 => false,
            0xD => true,
            _ => return Err(Fault::InvalidReturn),
        };
        if value | 0x1F != u32::MAX || (value & 0xF == 1) == (self.nvic.active == 0) {
            return Err(Fault::InvalidReturn);
        }
        self.catch_up();
        if let Some(next) = self.ready() {
            self.now += TAIL;
            self.vector(next, value);
            return Ok(());
        }
        self.now += RETURN;
        self.unstack(value, process)?;
        self.due = 0;
        if self.cpu.ipsr == 0 && self.scs.sleeps_on_exit() {
            self.fall_asleep(Sleep::Interrupt);
        }
        Ok(())
    }

    fn unstack(&mut self, value: u32, process: bool) -> Result<(), Fault> {
        let extended = value & 0x10 == 0;
        let frame = if process { self.cpu.psp() } else { self.cpu.msp() };
        let mut words = [0; 8];
        for (index, word) in words.iter_mut().enumerate() {
            *word = self.load::<4>(frame.wrapping_add(4 * index as u32))?;
        }
        let [r0, r1, r2, r3, r12, lr, pc, xpsr] = words;
        // The place was reserved and never needed: the registers still hold what would have been saved.
        if extended && self.scs.take_reserved_float().is_none() {
            for index in 0..16 {
                self.cpu.s[index as usize] = self.load::<4>(frame + 32 + 4 * index)?;
            }
            self.cpu.fpscr = self.load::<4>(frame + 96)?;
            self.now += 17;
        }
        self.cpu.control = self.cpu.control & !FPCA | if extended { FPCA } else { 0 };
        let padding = if xpsr >> 9 & 1 != 0 && self.scs.aligns_stack() { 4 } else { 0 };
        let stack = frame.wrapping_add(if extended { 104 } else { 32 }) + padding;
        if process {
            self.cpu.set_psp(stack);
        } else {
            self.cpu.set_msp(stack);
        }
        self.cpu.set_xpsr(xpsr);
        if value & 0xF != 1 {
            self.cpu.ipsr = 0;
        }
        self.cpu.select_stack(process);
        self.cpu.r[..4].copy_from_slice(&[r0, r1, r2, r3]);
        (self.cpu.r[12], self.cpu.r[14], self.cpu.pc) = (r12, lr, pc & !1);
        Ok(())
    }

    /// What becomes of an instruction that did not complete.
    #[inline(never)]
    pub(crate) fn fault(&mut self, fault: Fault) {
        let (number, bits, what, address) = match fault {
            Fault::ExceptionReturn(value) => {
                if let Err(fault) = self.return_from_exception(value) {
                    self.fault(fault);
                }
                return;
            }
            Fault::Supervisor => {
                return self.synchronous(SVCALL, self.cpu.pc, "SVC at a priority that cannot take it", None);
            }
            Fault::Undefined => (USAGE, fault::UNDEFINSTR, "undefined instruction", None),
            Fault::InvalidState => (USAGE, fault::INVSTATE, "branch to an address without the Thumb bit", None),
            Fault::InvalidReturn => (USAGE, fault::INVPC, "wrong return from an exception", None),
            Fault::NoCoprocessor => {
                (USAGE, fault::NOCP, "floating-point instruction, but the FPU is off (CPACR)", None)
            }
            Fault::Unaligned => (USAGE, fault::UNALIGNED, "unaligned access", None),
            Fault::DivideByZero => (USAGE, fault::DIVBYZERO, "division by zero", None),
            Fault::Data(address) => {
                self.scs.bfar = address;
                let bits = fault::PRECISERR | fault::BFARVALID;
                (BUS, bits, "access to an address where nothing is", Some(address))
            }
            Fault::Fetch => (BUS, fault::IBUSERR, "fetch from an address where nothing is", None),
            Fault::Stacking => (BUS, fault::STKERR, "the stack is not in RAM", None),
            Fault::Breakpoint(_) => {
                self.scs.hfsr |= fault::DEBUGEVT;
                return self.synchronous(HARD_FAULT, self.here, "breakpoint instruction, but no debugger", None);
            }
        };
        self.scs.cfsr |= bits;
        let return_to = match fault {
            Fault::InvalidState | Fault::InvalidReturn => self.cpu.pc,
            _ => self.here,
        };
        self.synchronous(number, return_to, what, address);
    }

    /// Takes an exception now, or its escalation to a hard fault (B1.5.14).
    fn synchronous(&mut self, number: u16, return_to: u32, what: &str, address: Option<u32>) {
        let enabled = self.nvic.enabled >> number & 1 != 0;
        let above = self.nvic.group_of(self.nvic.priority_of(number)) < self.masked_priority(true);
        if enabled && above && number != HARD_FAULT {
            if number != SVCALL {
                let name = nvic::system_name(number).unwrap_or("fault");
                self.report(name, what.into(), address);
            }
            return self.enter(number, return_to);
        }
        if self.masked_priority(false) <= -1 {
            return self.lock_up(what);
        }
        if number != HARD_FAULT {
            self.scs.hfsr |= fault::FORCED;
        }
        self.report("HardFault", what.into(), address);
        self.enter(HARD_FAULT, return_to);
    }
}
