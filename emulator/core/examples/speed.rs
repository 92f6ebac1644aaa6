//! Instructions a second of host time: `cargo run --release -p cortex --example speed`.

#[path = "../tests/common/mod.rs"]
mod common;

fn main() {
    let (mut machine, _) = common::machine("speed");
    let start = std::time::Instant::now();
    machine.run(170_000_000);
    let seconds = start.elapsed().as_secs_f64();
    let million = machine.instructions() as f64 / 1e6;
    println!(
        "1 s of the chip at 170 MHz: {million:.0} million instructions in {seconds:.2} s, {:.0} MIPS",
        million / seconds
    );
}
