//! All integration tests as one program: linking one for each file takes longer than running most of them, and one core
//! would wait for the last of each.

mod attack;
mod cli;
mod numbers;
mod pages;
mod papers;
