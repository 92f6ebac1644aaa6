//! Tells the library whether the core divides in hardware: ARMv6-M does not.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    println!("cargo::rustc-check-cfg=cfg(hardware_divide)");
    if !std::env::var("TARGET").is_ok_and(|target| target.starts_with("thumbv6m")) {
        println!("cargo::rustc-cfg=hardware_divide");
    }
}
