//! Work like a control loop's, without end: what the emulator's speed is measured with.
#![no_std]
#![no_main]

use core::hint::black_box;
use cortex_m_rt::entry;
use firmwares as _;

#[unsafe(link_section = ".vector_table.interrupts")]
#[unsafe(no_mangle)]
static __INTERRUPTS: [usize; 1] = [0];

#[entry]
fn main() -> ! {
    let mut table = [0i32; 64];
    let (mut angle, mut gain) = (1i32, 0.5f32);
    loop {
        for place in &mut table {
            angle = angle.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            let product = i64::from(angle) * i64::from(*place | 1);
            *place = if product & 4 != 0 { (product >> 31) as i32 } else { angle >> 3 };
            gain = 0.99 * gain + 0.01 * (*place as f32);
        }
        black_box((&table, gain));
    }
}
