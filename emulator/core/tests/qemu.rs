//! The same images on this core and in QEMU print the same.

mod common;

/// Every class of instruction, 500 random ones each, on random operands.
#[test]
fn instructions_leave_what_they_leave_in_qemu() {
    let (mut machine, _) = common::machine("isa");
    let (ours, theirs) = (common::run(&mut machine), common::qemu("isa"));
    let differ: Vec<_> = ours.lines().zip(theirs.lines()).filter(|(ours, theirs)| ours != theirs).collect();
    assert!(ours.lines().count() > 150, "{ours}");
    assert_eq!(ours.lines().count(), theirs.lines().count(), "{theirs}");
    assert!(differ.is_empty(), "{} classes of instructions differ:\n{differ:#?}", differ.len());
}

#[test]
fn exceptions_come_in_the_same_order() {
    let (mut machine, _) = common::machine("exceptions");
    let (ours, theirs) = (common::run(&mut machine), common::qemu("exceptions"));
    assert_eq!(ours, theirs);
    assert!(ours.ends_with("has wrapped: true\n"), "{ours}");
}
