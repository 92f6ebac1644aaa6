//! Links for the chip: memory.x of this board, the reference, is at the root of the repository; link.x is that of
//! cortex-m-rt, defmt.x the log's.

fn main() {
    let here = std::env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    println!("cargo::rustc-link-search={here}/../..");
    println!("cargo::rerun-if-changed=../../memory.x");
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x", "--emit-relocs"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
