//! Links for the board, and guards the flags that `.cargo/config.toml` sets.

fn main() {
    // RUSTFLAGS in the environment replaces the ones of `.cargo/config.toml` without a word; the image would run, but
    // its instruction counts would be those of another target.
    println!("cargo::rerun-if-env-changed=CARGO_ENCODED_RUSTFLAGS");
    let flags = std::env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    assert!(
        flags.contains("target-cpu=cortex-m4"),
        "build in this folder, and without RUSTFLAGS: -Ctarget-cpu=cortex-m4 of .cargo/config.toml is missing"
    );

    let here = std::env::var("CARGO_MANIFEST_DIR").expect("set by cargo");
    println!("cargo::rustc-link-search={here}");
    println!("cargo::rerun-if-changed=memory.x");
    for argument in ["--nmagic", "-Tlink.x", "-Tdefmt.x", "--emit-relocs"] {
        println!("cargo::rustc-link-arg-bins={argument}");
    }
}
