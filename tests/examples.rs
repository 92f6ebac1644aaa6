//! The examples are run as they stand; each ends with an error where it does not do what it says.
#![allow(clippy::duplicate_mod, reason = "each example has the world around it as a module of its own")]

#[path = "../examples/estimator.rs"]
mod estimator;
#[path = "../examples/hello.rs"]
mod hello;
#[path = "../examples/own_hal.rs"]
mod own_hal;
#[path = "../examples/rtic_like.rs"]
mod rtic_like;
#[path = "../examples/vernier.rs"]
mod vernier;

#[test]
fn hello() {
    hello::main().unwrap();
}

#[test]
fn own_hal() {
    own_hal::main().unwrap();
}

#[test]
fn rtic_like() {
    rtic_like::main().unwrap();
}

#[test]
fn estimator() {
    estimator::main().unwrap();
}

#[test]
fn vernier() {
    vernier::main().unwrap();
}

/// A stranger reads them whole.
#[test]
fn none_is_longer_than_eighty_lines() {
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/examples")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            let lines = std::fs::read_to_string(&path).unwrap().lines().count();
            assert!(lines < 80, "{} has {lines} lines", path.display());
        }
    }
}
