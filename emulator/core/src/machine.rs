//! The core with its memory and the system around it, and how time passes.

use crate::cache::{Caches, Speed};
use crate::cpu::{Cpu, Sleep};
use crate::fault::{Fault, FaultReport};
use crate::memory::Memory;
use crate::nvic::Nvic;
use crate::profile::{Profile, Spent};
use crate::scs::Scs;
use crate::watch::{Longest, Watch};
use bus::{Bus, Complaint, Cycle, ResetCause};
use serde::Serialize;
use std::collections::BTreeMap;

/// Why [`Machine::run`] came back.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Stop {
    /// The cycle asked for is reached.
    Time,
    /// BKPT with its number, where a debugger is attached. The next run goes on after it.
    Breakpoint(u8),
    /// A fault within the hard fault handler, or no vector table: only a reset helps.
    Lockup,
    /// The chip was reset and starts again.
    Reset(ResetCause),
}

/// A wrong access, where and how often.
#[derive(Clone, Debug, Serialize)]
pub struct Listed {
    /// What is wrong.
    pub complaint: Complaint,
    /// Address of the instruction.
    pub pc: u32,
    /// Address of the access.
    pub address: u32,
    /// Whether it was a store.
    pub write: bool,
    /// How often.
    pub count: u64,
    /// Seconds since power-on, the first time.
    pub first_s: f64,
}

/// A chip: the core, its RAM, and everything else as a [`Bus`].
#[derive(Clone)]
pub struct Machine<S> {
    /// Peripherals, board, motor.
    pub system: S,
    pub(crate) cpu: Cpu,
    pub(crate) nvic: Nvic,
    pub(crate) scs: Scs,
    pub(crate) memory: Memory,
    pub(crate) caches: Caches,
    pub(crate) now: Cycle,
    /// When the core has to look up from its instructions: the system's next event, SysTick's, the end of the run; 0 at
    /// once.
    pub(crate) due: Cycle,
    /// The instruction executes within an IT block.
    pub(crate) within_it: bool,
    pub(crate) instructions: u64,
    pub(crate) profile: Profile,
    /// Faults that were taken, in order.
    pub faults: Vec<FaultReport>,
    complaints: BTreeMap<(u32, u32, bool, Complaint), Listed>,
    /// A debugger is attached: BKPT stops the run, and is not a fault.
    pub debugger: bool,
    /// The handler of this exception hangs as soon as it is entered.
    hang: Option<u16>,
    /// Its handler does; 0 is thread mode.
    pub(crate) hung: Option<u16>,
    locked_up: bool,
    /// Address of the instruction that executes.
    pub(crate) here: u32,
    /// Over an exception's handler.
    pub(crate) watch: Watch,
    awake_since: Cycle,
    /// Cycles spent in sleep.
    asleep: Cycle,
}

impl<S: Bus> Machine<S> {
    /// At power-on.
    pub fn new(system: S) -> Self {
        let integration = system.integration();
        let memory = Memory::new(integration, system.code().len());
        let mut machine = Machine {
            system,
            cpu: Cpu::new(),
            nvic: Nvic::new(),
            scs: Scs::new(&integration),
            memory,
            caches: Caches::new(&integration),
            now: 0,
            due: 0,
            within_it: false,
            instructions: 0,
            profile: Profile::default(),
            faults: Vec::new(),
            complaints: BTreeMap::new(),
            debugger: false,
            hang: None,
            hung: None,
            locked_up: false,
            here: 0,
            watch: Watch::default(),
            awake_since: 0,
            asleep: 0,
        };
        machine.start();
        machine
    }

    /// Out of reset: stack pointer and first instruction from the vector table (B1.5.5).
    fn start(&mut self) {
        self.cpu = Cpu::new();
        self.nvic = Nvic::new();
        self.scs = Scs::new(&self.memory.integration);
        self.profile.abandon();
        self.watch.abandon();
        (self.hang, self.hung, self.locked_up, self.due) = (None, None, false, 0);
        match (self.load::<4>(0), self.load::<4>(4)) {
            (Ok(stack), Ok(entry)) if entry & 1 != 0 => {
                self.cpu.r[13] = stack & !3;
                self.cpu.r[14] = u32::MAX;
                self.cpu.pc = entry & !1;
            }
            _ => self.lock_up("no vector table at address 0"),
        }
    }

    /// Resets core and system. RAM keeps its contents, unless power was gone.
    pub fn reset(&mut self, cause: ResetCause) {
        if cause == ResetCause::PowerOn {
            self.memory = Memory::new(self.memory.integration, self.system.code().len());
        }
        self.system.reset(cause);
        self.start();
    }

    /// Runs until a cycle, or until something has to be told.
    pub fn run(&mut self, until: Cycle) -> Stop {
        self.due = 0;
        loop {
            if self.now >= self.due {
                if self.locked_up && !self.debugger {
                    // Time goes on for what else is on the chip: the watchdog may end this.
                    self.now = self.now.max(self.system.advance(self.now).min(until));
                }
                if let Some(cause) = self.look_up(until) {
                    self.reset(cause);
                    return Stop::Reset(cause);
                }
                if self.locked_up && self.debugger {
                    return Stop::Lockup;
                }
                if self.now >= until {
                    return Stop::Time;
                }
                if self.cpu.sleep.is_some() || self.is_stuck() || self.locked_up {
                    // Nothing happens until then.
                    self.now = self.due.max(self.now);
                    continue;
                }
            }
            let done = if self.watch.exception == Some(self.cpu.ipsr) { self.watched_step() } else { self.step() };
            if let Err(fault) = done {
                if let Fault::Breakpoint(number) = fault
                    && self.debugger
                {
                    self.cpu.pc = self.here + 2;
                    return Stop::Breakpoint(number);
                }
                self.fault(fault);
            }
        }
    }

    #[inline(never)]
    fn watched_step(&mut self) -> Result<(), Fault> {
        let before = self.spent();
        let done = self.step();
        let took = self.spent().since(before);
        self.watch.note(self.here, took);
        done
    }

    /// One instruction.
    #[inline(always)]
    fn step(&mut self) -> Result<(), Fault> {
        let pc = self.cpu.pc;
        self.here = pc;
        let Some(decoded) = self.memory.fetch(pc, &self.system) else { return Err(Fault::Fetch) };
        self.fetched(pc);
        self.cpu.r[15] = pc.wrapping_add(4);
        self.cpu.pc = pc.wrapping_add(decoded.length.into());
        self.instructions += 1;
        self.now += 1;
        let it = self.cpu.it;
        if it == 0 {
            return self.execute(decoded.op);
        }
        // Four conditions at most; the last one leaves the block (A7.3.2).
        self.cpu.it = if it & 7 == 0 { 0 } else { it & 0xE0 | it << 1 & 0x1F };
        if !self.cpu.holds(it >> 4) {
            return Ok(());
        }
        self.within_it = true;
        let done = self.execute(decoded.op);
        self.within_it = false;
        if done.is_err() && !matches!(done, Err(Fault::ExceptionReturn(_) | Fault::Supervisor)) {
            self.cpu.it = it;
        }
        done
    }

    /// Wait states of a fetch from code memory.
    #[inline(always)]
    fn fetched(&mut self, pc: u32) {
        if self.caches.word_changes(pc) && self.memory.is_code(pc) {
            self.now += self.caches.fetch(pc, self.now, self.code_speed());
        }
    }

    /// Wait states of a load from code memory.
    pub(crate) fn code_data(&mut self, offset: u32) -> Cycle {
        self.caches.load(offset, self.now, self.code_speed())
    }

    fn code_speed(&self) -> Speed {
        Speed { wait_states: self.system.code_wait_states(), prefetch: self.system.code_prefetch() }
    }

    /// How lines of the cache are filled.
    pub fn set_fill(&mut self, fill: bus::Fill) {
        self.caches.fill = fill;
    }

    /// Since power-on.
    pub fn spent(&self) -> Spent {
        Spent { instructions: self.instructions, cycles: self.now, waited: self.caches.waited }
    }

    /// Notes from now on what each instruction of an exception's handler takes.
    pub fn watch(&mut self, exception: u16) {
        self.watch.exception = Some(exception);
    }

    /// What the watched handler's instructions took, by address.
    pub fn watched(&self) -> &BTreeMap<u32, Spent> {
        &self.watch.all
    }

    /// The longest run of the watched handler.
    pub fn longest_watched(&self) -> Option<&Longest> {
        self.watch.longest.as_ref()
    }

    /// Lets the system catch up, takes an exception where one is due, and says when to look up again. `Some` asks for a
    /// reset.
    #[inline(never)]
    fn look_up(&mut self, until: Cycle) -> Option<ResetCause> {
        loop {
            let next = self.catch_up();
            if let Some(cause) = self.system.take_reset() {
                return Some(cause);
            }
            if self.scs.take_reset_request() {
                return Some(ResetCause::Software);
            }
            let (tick, next_tick) = self.scs.systick.advance(self.now);
            if tick {
                self.nvic.pend(crate::nvic::SYSTICK);
                self.profile.pended(1 << crate::nvic::SYSTICK, self.now);
            }
            self.wake_up();
            self.due = next.min(next_tick).min(until);
            if self.cpu.sleep.is_some() || self.locked_up || !self.take_exception() {
                return None;
            }
            // Taking it took time: look again for what came meanwhile.
        }
    }

    #[cold]
    pub(crate) fn pend_nmi(&mut self) {
        self.nvic.pend(crate::nvic::NMI);
        self.profile.pended(1 << crate::nvic::NMI, self.now);
        self.due = 0;
    }

    /// Brings the system to now; returns its next event.
    pub(crate) fn catch_up(&mut self) -> Cycle {
        let next = self.system.advance(self.now);
        for range in self.system.take_code_changes() {
            self.memory.forget_code(range);
            self.caches.flush();
        }
        self.sample();
        let held = self.now + self.system.take_stall();
        // What comes meanwhile is late from its own moment on.
        let mut next = next;
        while self.now < held {
            self.now = next.min(held);
            next = self.system.advance(self.now);
            self.sample();
        }
        next
    }

    /// Interrupts that have come.
    fn sample(&mut self) {
        let new = self.nvic.sample(self.system.interrupts());
        if new != 0 {
            self.profile.pended(new, self.now);
            if self.scs.sends_event_on_pending() {
                self.cpu.event = true;
            }
        }
    }

    fn wake_up(&mut self) {
        let Some(sleep) = self.cpu.sleep else { return };
        // PRIMASK does not keep an interrupt from waking the core (B1.5.17).
        let wakes =
            self.nvic.first().is_some_and(|(_, priority)| self.nvic.group_of(priority) < self.masked_priority(false));
        if wakes || sleep == Sleep::Event && std::mem::take(&mut self.cpu.event) {
            self.cpu.sleep = None;
            self.asleep += self.now - self.awake_since;
            self.scs.cycles.pause(self.awake_since, self.now);
        }
    }

    pub(crate) fn fall_asleep(&mut self, sleep: Sleep) {
        self.cpu.sleep = Some(sleep);
        self.awake_since = self.now;
        self.due = 0;
    }

    pub(crate) fn lock_up(&mut self, what: &str) {
        self.locked_up = true;
        self.due = 0;
        self.report("lockup", what.to_owned(), None);
    }

    /// What executes is an endless loop. What is more urgent comes all the same, so thread mode first ends its critical
    /// section.
    fn is_stuck(&self) -> bool {
        self.hung == Some(self.cpu.ipsr) && (self.cpu.ipsr != 0 || self.cpu.basepri == 0 && !self.cpu.primask)
    }

    /// A handler has been entered.
    pub(crate) fn entered(&mut self, exception: u16) {
        if self.hang == Some(exception) {
            self.hung = self.hang.take();
        }
    }

    /// From its next entry on, the handler of this exception never ends: an endless loop as its first instruction. 0 is
    /// thread mode, which hangs as soon as it masks no interrupt. Ends with a reset.
    pub fn hang(&mut self, exception: u16) {
        match exception {
            0 => self.hung = Some(0),
            _ => self.hang = Some(exception),
        }
    }

    pub(crate) fn report(&mut self, exception: &'static str, what: String, address: Option<u32>) {
        let mut registers = [0; 15];
        registers.copy_from_slice(&self.cpu.r[..15]);
        self.faults.push(FaultReport {
            at_s: self.system.seconds(self.now),
            exception,
            what,
            pc: self.here,
            registers,
            xpsr: self.cpu.xpsr(),
            cfsr: self.scs.cfsr,
            hfsr: self.scs.hfsr,
            address,
        });
    }

    pub(crate) fn complain(&mut self, complaint: Complaint, address: u32, write: bool) {
        let first_s = self.system.seconds(self.now);
        let (pc, key) = (self.here, (self.here, address, write, complaint.clone()));
        self.complaints.entry(key).or_insert(Listed { complaint, pc, address, write, count: 0, first_s }).count += 1;
    }

    /// All wrong accesses so far.
    pub fn complaints(&self) -> impl Iterator<Item = &Listed> {
        self.complaints.values()
    }

    /// Cycles since power-on.
    pub fn now(&self) -> Cycle {
        self.now
    }

    /// Of these, the core slept.
    pub fn asleep(&self) -> Cycle {
        self.asleep
    }

    /// Instructions since power-on.
    pub fn instructions(&self) -> u64 {
        self.instructions
    }

    /// How often, how late and how long each exception's handler ran.
    pub fn profile(&self) -> &Profile {
        &self.profile
    }

    /// What handlers did so far is not to count.
    pub fn forget_profile(&mut self) {
        self.profile.clear();
        self.watch.clear();
    }

    /// R0 to R12, SP, LR, and the program counter.
    pub fn registers(&self) -> [u32; 16] {
        let mut registers = self.cpu.r;
        registers[15] = self.cpu.pc;
        registers
    }

    /// Sets a register, as a debugger does: 0 to 14, and 15 for the program counter.
    pub fn set_register(&mut self, number: usize, value: u32) {
        if number == 15 {
            self.cpu.pc = value & !1;
        } else {
            self.cpu.r[number] = value;
        }
    }

    /// RAM from `address` on, which may be its alias.
    pub fn ram(&self, address: u32, length: u32) -> Option<&[u8]> {
        match self.memory.place(address, length) {
            crate::memory::Place::Ram(offset) => self.memory.ram.get(offset as usize..(offset + length) as usize),
            _ => None,
        }
    }

    /// Writes RAM, as a debugger does.
    pub fn write_ram(&mut self, address: u32, bytes: &[u8]) -> Option<()> {
        let crate::memory::Place::Ram(offset) = self.memory.place(address, bytes.len() as u32) else { return None };
        self.memory.ram.get_mut(offset as usize..)?.get_mut(..bytes.len())?.copy_from_slice(bytes);
        for at in (offset..offset + bytes.len() as u32).step_by(64) {
            self.memory.stored(at, 64);
        }
        Some(())
    }
}
