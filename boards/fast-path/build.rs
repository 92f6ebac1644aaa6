//! Makes the step the entry of the image: what it does not need is not in it.

fn main() {
    println!("cargo::rustc-link-arg-bins=--entry=step");
}
