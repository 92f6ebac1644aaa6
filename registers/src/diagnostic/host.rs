//! What the channel needs of a drive.

use super::record::{Build, Halls};
use crate::axis::{Axis, Command};
use core::fmt;

/// What values a setting takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind<'a> {
    /// A number.
    Real,
    /// A whole number.
    Whole,
    /// 0 for no and 1 for yes.
    Switch,
    /// One of these names, separated by `|`, counted from zero.
    Choice(&'a str),
}

/// A setting.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Setting<'a> {
    /// Its name.
    pub name: &'a str,
    /// What values it takes.
    pub kind: Kind<'a>,
    /// What it is at the moment.
    pub value: f32,
}

/// What is asked of the settings.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Change {
    /// Another value of one, by its number.
    Set(u16, f32),
    /// Another address of the drive on its bus.
    Id(u8),
    /// Keep them in the flash.
    Save,
    /// Back to those in the flash.
    Load,
    /// Back to the board's defaults.
    Default,
}

/// A drive with settings and telemetry.
pub trait Host: Axis {
    /// Why a change is refused, in words.
    type Refusal: fmt::Display;

    /// Number of settings.
    fn settings(&self) -> u16;

    /// A setting; `None` for one that this drive does not have after all.
    fn setting(&self, number: u16) -> Option<Setting<'_>>;

    /// The address on the bus.
    fn id(&self) -> u8;

    /// Begins a change, of which there is one at a time; [`outcome`](Self::outcome) tells what became of it.
    fn begin(&mut self, change: Change);

    /// What became of the change, once. To come within a second at most, whatever happens.
    fn outcome(&mut self) -> Option<Result<(), Self::Refusal>>;

    /// A motion that this channel has commanded is to go on. It must not begin again: false where it is over, for
    /// whatever reason, or something else was commanded since.
    fn renew(&mut self, motion: &Command) -> bool;

    /// What it was built from.
    fn build(&self) -> Build;

    /// The Halls.
    fn halls(&self) -> Halls;
}
