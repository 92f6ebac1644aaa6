//! A stranger reads the examples whole. `cargo test` runs them, too, each as a program of its own.

#[test]
fn none_is_longer_than_eighty_lines() {
    for entry in std::fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/../examples")).unwrap() {
        let path = entry.unwrap().path();
        if path.is_file() {
            let lines = std::fs::read_to_string(&path).unwrap().lines().count();
            assert!(lines < 80, "{} has {lines} lines", path.display());
        }
    }
}
