//! The page for users has the table of the registers that the code has.

use hallservo_registers::register::{Access, Quantity, TABLE, name};

const PAGE: &str = include_str!("../../docs/moteus-clients.md");

const fn unit(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Current => "A",
        Quantity::Torque => "N·m",
        Quantity::Voltage => "V",
        Quantity::Temperature => "°C",
        Quantity::Time => "s",
        Quantity::Position => "rev",
        Quantity::Velocity => "rev/s",
        Quantity::Acceleration => "rev/s²",
        Quantity::Power => "W",
        Quantity::Word => "int32 only",
        Quantity::Share | Quantity::Integer | Quantity::Counter => "",
    }
}

#[test]
fn the_table_of_the_page_is_that_of_the_code() {
    for row in TABLE {
        let access = match row.access {
            Access::Read => "read",
            Access::Write => "write",
            Access::Both => "read, write",
        };
        let name = name(row.number.into()).unwrap();
        let line = format!("| {:#05x} | {name} | {access} | {} |", row.number, unit(row.quantity));
        assert!(PAGE.lines().any(|found| found == line), "{line}");
    }
    assert_eq!(PAGE.lines().filter(|line| line.starts_with("| 0x")).count(), TABLE.len());
}
