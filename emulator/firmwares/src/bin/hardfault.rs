//! Ends in a hard fault: a store to where nothing is, with the bus fault off.
#![no_std]
#![no_main]

use cortex_m_rt::{ExceptionFrame, entry, exception};
use firmwares::{exit, say};

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [usize; 1] = [0];

#[inline(never)]
fn write_to(address: u32) {
    // SAFETY: none, that is the point.
    unsafe { core::ptr::write_volatile(address as *mut u32, 0x55) }
}

#[entry]
fn main() -> ! {
    write_to(0x9000_0010);
    exit()
}

#[exception]
unsafe fn HardFault(frame: &ExceptionFrame) -> ! {
    // SAFETY: reading has no effect.
    let (hfsr, cfsr, bfar) = unsafe {
        let scb = &*cortex_m::peripheral::SCB::PTR;
        (scb.hfsr.read(), scb.cfsr.read(), scb.bfar.read())
    };
    say!("HFSR {hfsr:08x} CFSR {cfsr:08x} BFAR {bfar:08x} R0 {:08x}", frame.r0());
    exit()
}
