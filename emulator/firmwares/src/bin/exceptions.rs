//! Exceptions as the architecture has them: who runs, in which order, and what is left of the registers.
#![no_std]
#![no_main]

use core::arch::{asm, global_asm};
use core::ptr::{read_volatile, write_volatile};
use core::sync::atomic::{AtomicU32, AtomicUsize, Ordering};
use cortex_m::peripheral::{NVIC, SCB, SYST};
use cortex_m::register::{basepri, basepri_max, control, faultmask, primask};
use cortex_m_rt::{entry, exception};
use firmwares::{LINES, exit, say};

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [unsafe extern "C" fn(); LINES] = [irq; LINES];

unsafe extern "C" {
    fn irq();
}

// Every interrupt comes here with EXC_RETURN as its argument.
global_asm!(".global irq", ".thumb_func", "irq:", "mov r0, lr", "b {handler}", handler = sym interrupt);

#[derive(Clone, Copy)]
struct Line(u16);

// SAFETY: numbers of the vector table above.
unsafe impl cortex_m::interrupt::InterruptNumber for Line {
    fn number(self) -> u16 {
        self.0
    }
}

/// What handlers noted, in order.
static TRACE: [AtomicU32; 64] = [const { AtomicU32::new(0) }; 64];
static NOTED: AtomicUsize = AtomicUsize::new(0);
/// What a line's handler pends: a set of lines.
static PENDS: [AtomicU32; LINES] = [const { AtomicU32::new(0) }; LINES];
static TICKS: AtomicU32 = AtomicU32::new(0);

fn note(what: u32) {
    TRACE[NOTED.fetch_add(1, Ordering::Relaxed)].store(what, Ordering::Relaxed);
}

fn told(title: &str) {
    let count = NOTED.swap(0, Ordering::Relaxed);
    firmwares::say!("{title}");
    for word in &TRACE[..count] {
        say!("    {:08x}", word.load(Ordering::Relaxed));
    }
}

fn pend(set: u32) {
    // SAFETY: ISPR0 takes a set of interrupts; together, so that they become pending at once.
    unsafe { (*NVIC::PTR).ispr[0].write(set) };
    cortex_m::asm::dsb();
    cortex_m::asm::isb();
}

fn active() -> u32 {
    // SAFETY: reading has no effect.
    unsafe { (*SCB::PTR).icsr.read() }
}

extern "C" fn interrupt(link: u32) {
    let state = active();
    let number = (state & 0x1FF) - 16;
    note(0xA000_0000 | number << 16 | link & 0xFFFF);
    note(state & 0x0043_F800);
    let pends = PENDS[number as usize].load(Ordering::Relaxed);
    if pends != 0 {
        pend(pends);
    }
    if number == 7 {
        // Clobbers all that the caller may keep in the FPU.
        // SAFETY: they are given as clobbered.
        unsafe {
            asm!("vmov.f32 s0, #1.5", "vmov.f32 s7, #2.5", "vmov.f32 s15, #3.5", "vmov {t}, s7", t = out(reg) _,
                out("s0") _, out("s7") _, out("s15") _)
        };
    }
    note(0xE000_0000 | number << 16);
}

#[exception]
fn SysTick() {
    TICKS.fetch_add(1, Ordering::Relaxed);
}

#[exception]
fn SVCall() {
    note(0x5000_0000);
    SCB::set_pendsv();
    note(0x5000_0001);
}

#[exception]
fn PendSV() {
    note(0x9000_0000);
}

/// The instruction after the one that faulted: all of those below are 4 bytes long.
#[exception]
fn UsageFault() {
    // SAFETY: the fault status is cleared by writing ones.
    let status = unsafe {
        let status = (*SCB::PTR).cfsr.read();
        (*SCB::PTR).cfsr.write(status);
        status
    };
    note(0xF600_0000 | status >> 16);
    skip();
}

#[exception]
fn BusFault() {
    // SAFETY: as above.
    let (status, address) = unsafe {
        let status = (*SCB::PTR).cfsr.read();
        (*SCB::PTR).cfsr.write(status);
        (status, (*SCB::PTR).bfar.read())
    };
    note(0xF500_0000 | status & 0xFF00);
    note(address);
    skip();
}

/// Where `skip` finds the frame of the fault.
static FRAME: AtomicU32 = AtomicU32::new(0);

/// Moves the stacked program counter on. The thread below runs on the process stack.
fn skip() {
    let frame = cortex_m::register::psp::read();
    FRAME.store(frame, Ordering::Relaxed);
    let place = (frame + 24) as *mut u32;
    // SAFETY: the frame that the fault has just stacked.
    unsafe { write_volatile(place, read_volatile(place) + 4) };
}

fn set_priority(peripherals: &mut cortex_m::Peripherals, priorities: [u8; LINES]) {
    for (line, priority) in priorities.into_iter().enumerate() {
        // SAFETY: nothing here relies on masking by priority.
        unsafe {
            peripherals.NVIC.set_priority(Line(line as u16), priority);
            NVIC::unmask(Line(line as u16));
        }
        PENDS[line].store(0, Ordering::Relaxed);
    }
}

#[repr(align(8))]
struct Stack(#[allow(dead_code)] [u32; 256]);
static mut PROCESS: Stack = Stack([0; 256]);

#[entry]
fn main() -> ! {
    let mut p = cortex_m::Peripherals::take().unwrap();
    set_priority(&mut p, [0x80, 0x40, 0x80, 0x40, 0xC0, 0x20, 0x00, 0x10]);
    told("nothing yet");
    // A fresh FPU context would make the first frame an extended one here and not there.
    // SAFETY: thread mode does not use the FPU at this point.
    unsafe {
        let mut word = control::read();
        word.set_fpca(control::Fpca::NotActive);
        control::write(word);
    }

    pend(1 << 0);
    told("one interrupt");

    PENDS[0].store(1 << 1 | 1 << 2, Ordering::Relaxed);
    pend(1 << 0);
    told("1 pre-empts 0, 2 follows 0 by tail-chaining");
    PENDS[0].store(0, Ordering::Relaxed);

    PENDS[4].store(1 << 0, Ordering::Relaxed);
    PENDS[0].store(1 << 1, Ordering::Relaxed);
    PENDS[1].store(1 << 5, Ordering::Relaxed);
    pend(1 << 4);
    told("four deep");
    PENDS.iter().for_each(|pends| pends.store(0, Ordering::Relaxed));

    pend(0x3F);
    told("all at once: by priority, then by number");

    // SAFETY: tests of masking.
    unsafe { basepri::write(0x40) };
    pend(0x3F);
    told("BASEPRI 0x40 lets 0x20 through");
    // SAFETY: as above.
    unsafe { basepri::write(0x80) };
    cortex_m::asm::isb();
    told("BASEPRI 0x80 lets 0x40 through");
    basepri_max::write(0xC0);
    say!("BASEPRI_MAX does not lower: {:02x}", basepri::read());
    basepri_max::write(0x20);
    say!("BASEPRI_MAX raises: {:02x}", basepri::read());
    // SAFETY: as above.
    unsafe { basepri::write(0) };
    cortex_m::asm::isb();
    told("no BASEPRI: the rest");

    cortex_m::interrupt::disable();
    pend(1 << 6 | 1 << 1);
    told("PRIMASK holds all back");
    // SAFETY: as above.
    unsafe { asm!("cpsid f") };
    say!("PRIMASK {}, FAULTMASK {}", primask::read().is_inactive(), faultmask::read().is_inactive());
    // SAFETY: as above.
    unsafe { cortex_m::interrupt::enable() };
    told("FAULTMASK still does");
    // SAFETY: as above.
    unsafe { asm!("cpsie f", "isb") };
    told("now they come");

    // SAFETY: as above. Group priorities of two bits: 0x80 and 0xB0 do not pre-empt each other.
    unsafe { p.SCB.aircr.write(0x05FA_0000 | 5 << 8) };
    set_priority(&mut p, [0xB0, 0x80, 0x40, 0x90, 0, 0, 0, 0]);
    PENDS[0].store(1 << 1 | 1 << 2 | 1 << 3, Ordering::Relaxed);
    pend(1 << 0);
    told("within a group no pre-emption, but order");
    // SAFETY: as above.
    unsafe { p.SCB.aircr.write(0x05FA_0000) };

    set_priority(&mut p, [0x80, 0x40, 0x80, 0x40, 0xC0, 0x20, 0x00, 0x10]);
    // SAFETY: PendSV lowest, SVCall above.
    unsafe {
        p.SCB.set_priority(cortex_m::peripheral::scb::SystemHandler::PendSV, 0xF0);
        p.SCB.set_priority(cortex_m::peripheral::scb::SystemHandler::SVCall, 0x30);
        asm!("svc 5");
    }
    told("PendSV waits for SVCall");

    floating();
    process_stack(&mut p);
    sleeping(&mut p);
    exit()
}

/// FP registers survive handlers that use them, one nested in the other; the frame is an extended one.
fn floating() {
    let mut after = [0u32; 4];
    PENDS[0].store(1 << 7, Ordering::Relaxed);
    // SAFETY: pends line 0 in the midst of FP code, whose registers are declared.
    unsafe {
        asm!(
            "vmov.f32 s0, #4.0", "vmov.f32 s7, #5.0", "vmov.f32 s15, #6.0", "vmov.f32 s20, #7.0",
            "movs {one}, #0x81",
            "str {one}, [{ispr}]",
            "dsb", "isb",
            "vstr s0, [{after}]", "vstr s7, [{after}, #4]", "vstr s15, [{after}, #8]", "vstr s20, [{after}, #12]",
            one = out(reg) _, ispr = in(reg) 0xE000_E200u32, after = in(reg) after.as_mut_ptr(),
            out("s0") _, out("s7") _, out("s15") _, out("s20") _,
        )
    };
    PENDS[0].store(0, Ordering::Relaxed);
    told("handlers with floating point");
    say!("{after:08x?}");
}

fn process_stack(p: &mut cortex_m::Peripherals) {
    p.SCB.enable(cortex_m::peripheral::scb::Exception::UsageFault);
    p.SCB.enable(cortex_m::peripheral::scb::Exception::BusFault);
    // SAFETY: traps division by zero.
    unsafe { p.SCB.ccr.modify(|value| value | 1 << 4) };
    let top = &raw mut PROCESS as u32 + 1024;
    // SAFETY: a stack of its own for what follows; nothing of the compiler's is between the switches.
    unsafe {
        asm!(
            "msr psp, {top}",
            "mrs {old}, control",
            "orr {new}, {old}, #2",
            "msr control, {new}",
            "isb",
            "movs {new}, #1",
            "str {new}, [{ispr}]", "dsb", "isb",
            "movs {new}, #0",
            "sdiv {new}, {old}, {new}",
            ".inst.w 0xf7f0a000",
            "ldr.w {new}, [{nowhere}]",
            "ldrd {new}, {two}, [{odd}]",
            "sub sp, #4",
            "movs {new}, #1",
            "str {new}, [{ispr}]", "dsb", "isb",
            "add sp, #4",
            "msr control, {old}",
            "isb",
            top = in(reg) top, old = out(reg) _, new = out(reg) _, two = out(reg) _, ispr = in(reg) 0xE000_E200u32,
            nowhere = in(reg) 0x9000_0000u32, odd = in(reg) (&raw const TICKS as u32 + 2),
        )
    };
    told("on the process stack: interrupt, division by zero, undefined, bus fault, unaligned, unaligned stack");
    say!("frame {} below the top", top - FRAME.load(Ordering::Relaxed));
}

fn sleeping(p: &mut cortex_m::Peripherals) {
    p.SYST.set_clock_source(cortex_m::peripheral::syst::SystClkSource::Core);
    p.SYST.set_reload(50_000);
    p.SYST.clear_current();
    p.SYST.enable_counter();
    p.SYST.enable_interrupt();
    for _ in 0..5 {
        cortex_m::asm::wfi();
    }
    say!("ticks {}", TICKS.load(Ordering::Relaxed));
    cortex_m::interrupt::disable();
    cortex_m::asm::wfi();
    say!("PRIMASK: awake at {} ticks", TICKS.load(Ordering::Relaxed));
    p.SYST.disable_counter();
    // SAFETY: the tick that is pending comes.
    unsafe { cortex_m::interrupt::enable() };
    say!("ticks {}", TICKS.load(Ordering::Relaxed));
    cortex_m::asm::sev();
    cortex_m::asm::wfe();
    say!("SEV keeps WFE from sleeping");
    say!("has wrapped: {}", SYST::get_reload() == 50_000);
}
