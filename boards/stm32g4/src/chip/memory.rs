//! What happens out of reset before the memory is filled, which takes milliseconds at 16 MHz: the gate drivers' inputs
//! get their idle levels, and what the control interrupt executes is copied to where the core fetches it without wait
//! states. memory.x says what that is.

use crate::chip::{Board, Bridge};
use core::ptr::{addr_of, addr_of_mut};

/// SCB_VTOR.
const VTOR: *mut u32 = 0xE000_ED08 as *mut u32;

unsafe extern "C" {
    static __vector_table: u32;
    static mut __ccm_vectors: u32;
    static mut __sccm: u32;
    static __eccm: u32;
    static __siccm: u32;
}

/// Looks at no variable, as none is filled yet.
///
/// # Safety
/// To be called out of reset, before the memory is filled.
#[inline(always)]
pub unsafe fn before_memory<B: Board>() {
    Bridge::hold(&B::BRIDGE, B::PINS);
    // SAFETY: memory.x reserves both places for these, whole words from and to aligned addresses; nothing uses them yet.
    unsafe {
        copy(addr_of!(__siccm), addr_of_mut!(__sccm), addr_of!(__eccm));
        let vectors = addr_of_mut!(__ccm_vectors);
        copy(addr_of!(__vector_table), vectors, vectors.byte_add(size_of_vectors()));
        VTOR.write_volatile(vectors as u32);
    }
}

/// The initial stack pointer, the exceptions and the interrupts.
fn size_of_vectors() -> usize {
    unsafe extern "C" {
        static __evector_bytes: u8;
    }
    addr_of!(__evector_bytes) as usize
}

/// # Safety
/// `to` up to `end` is memory that nothing else refers to, and as much can be read from `from`.
// Not inlined, it is compiled for size.
#[inline(never)]
unsafe fn copy(mut from: *const u32, mut to: *mut u32, end: *const u32) {
    while to.cast_const() < end {
        // SAFETY: as the caller promises. Volatile, so that it is no call to what would have to be copied first.
        unsafe {
            to.write_volatile(from.read_volatile());
            (from, to) = (from.add(1), to.add(1));
        }
    }
}
