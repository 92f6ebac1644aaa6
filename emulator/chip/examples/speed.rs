//! What a PWM period of chip and motor costs the host: `cargo run --release --example speed`.

#[path = "../tests/common/mod.rs"]
mod common;

use bus::{Bus, Width};
use std::time::Instant;

fn main() {
    let mut bench = common::Bench::new(&common::nucleo());
    bench.clocks();
    bench.timer(85);
    bench.gate_pins();
    bench.converter(0, &[(5, 2), (1, 1), (6, 1)], true);
    bench.converter(1, &[(2, 2), (7, 1), (8, 1)], false);
    bench.converter(2, &[(5, 2)], false);
    bench.converter(3, &[(3, 2)], false);
    bench.count();
    bench.moe();
    bench.duties([1400, 900, 1000]);
    let (periods, mut reads, begin) = (80_000, 0_u64, Instant::now());
    bench.run_seeing(periods * 4250, |chip, now| {
        if chip.interrupts() >> 18 & 1 != 0 {
            for rank in 0..3 {
                for adc in [common::ADC[0], common::ADC[1]] {
                    reads += u64::from(chip.read(adc + 0x80 + 4 * rank, Width::Word, now).0);
                }
            }
            chip.write(common::ADC[0], Width::Word, 0x60, now);
            for channel in 0..3 {
                chip.write(common::TIM1 + 0x34 + 4 * channel, Width::Word, 1000 + 10 * channel, now);
            }
        }
    });
    let each = begin.elapsed().as_secs_f64() / periods as f64;
    println!("{:.2} us a PWM period ({} periods, mean code {})", each * 1e6, periods, reads / 6 / periods);
}
