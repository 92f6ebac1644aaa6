//! All integration tests as one program: linking one for each file takes longer than running most of them.

mod common;
mod electrical;
mod faults;
mod field;
mod inverter;
mod iron;
mod load;
mod mechanical;
mod sensors;
mod whole;
