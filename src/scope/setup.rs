//! What is to be recorded, as a person says it, and as the interrupt works with it.

use super::{CHANNELS, Channel, ROWS};
use crate::config::Config;
use core::fmt;

/// What is to be recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub struct Setup {
    /// Up to four, each once.
    pub channels: [Option<Channel>; CHANNELS],
    /// Control periods from row to row; 1 for all.
    pub every: u16,
    /// Rows, 1 to [`ROWS`].
    pub rows: u16,
    /// How many of them are before the trigger: fewer than all.
    pub before: u16,
    /// What it waits for.
    pub trigger: Trigger,
}

/// What a recording waits for. It is looked for at the rows only.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Trigger {
    /// Nothing; no row is before it.
    Now,
    /// The next command to the drive, of whatever kind.
    Command,
    /// The next fault.
    Fault,
    /// A channel, recorded or not, crosses a level.
    Level {
        /// Which one.
        channel: Channel,
        /// In the channel's unit.
        level: f32,
        /// Upwards; otherwise downwards.
        rising: bool,
    },
}

/// Why nothing is recorded.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(feature = "serde", derive(serde::Serialize, serde::Deserialize))]
pub enum Error {
    /// There is no channel.
    Empty,
    /// A channel is there twice.
    Twice(Channel),
    /// There is no current sensing, which the channel needs.
    NoControl(Channel),
    /// Every 0th period.
    Every,
    /// No rows, or more than this.
    Rows(u16),
    /// All rows, or more, are before the trigger.
    Before,
    /// The level is not a number, or beyond ± this.
    Level(f32),
}

impl fmt::Display for Error {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty => write!(f, "no channel is to be recorded"),
            Self::Twice(channel) => write!(f, "{channel:?} is to be recorded twice"),
            Self::NoControl(channel) => write!(f, "{channel:?} needs current sensing, which this drive does not have"),
            Self::Every => write!(f, "every 0th period cannot be recorded"),
            Self::Rows(most) => write!(f, "the rows have to be 1 to {most}"),
            Self::Before => write!(f, "fewer rows than all can be before the trigger"),
            Self::Level(most) => write!(f, "the level has to be a number within ±{most}"),
        }
    }
}

impl core::error::Error for Error {}

/// What the trigger looks at.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Source {
    Nothing,
    Command,
    Fault,
    Channel(Channel),
}

/// A [`Setup`] that can be recorded, in the units of the interrupt.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Plan {
    pub(super) channels: [Option<Channel>; CHANNELS],
    pub(super) every: u16,
    pub(super) rows: u16,
    pub(super) before: u16,
    pub(super) source: Source,
    pub(super) level: i32,
    pub(super) rising: bool,
}

impl Plan {
    /// In memory that is not used yet: all zeros, whatever they mean, so that the flash does not have to hold it.
    pub(super) const UNUSED: Self = Self {
        channels: [Some(Channel::PhaseA); CHANNELS],
        every: 0,
        rows: 0,
        before: 0,
        source: Source::Channel(Channel::PhaseA),
        level: 0,
        rising: false,
    };
}

impl Setup {
    /// Checks it, for a drive with these settings and control periods a second. `origin` is the raw position where the
    /// user's is zero.
    ///
    /// # Errors
    /// What is wrong with it.
    #[cfg_attr(feature = "small", inline(never))]
    pub fn plan(&self, config: &Config, step_hz: f32, origin: i32) -> Result<Plan, Error> {
        self.check(config, step_hz)?;
        let Self { channels, every, rows, before, trigger } = *self;
        let mut plan = Plan { channels, every, rows, before, source: Source::Nothing, level: 1, rising: true };
        match trigger {
            Trigger::Now => plan.before = 0,
            Trigger::Command => plan.source = Source::Command,
            Trigger::Fault => plan.source = Source::Fault,
            Trigger::Level { channel, level, rising } => {
                let scale = channel.scale(config, step_hz).ok_or(Error::NoControl(channel))?;
                let raw = level / scale;
                // Not a number is not within, either.
                if !(raw.abs() <= LARGEST) {
                    return Err(Error::Level(LARGEST * scale));
                }
                let origin = if channel.is_position() { origin } else { 0 };
                plan.source = Source::Channel(channel);
                (plan.level, plan.rising) = (crate::float::nearest(raw).wrapping_add(origin), rising);
            }
        }
        Ok(plan)
    }

    /// Checks all but the trigger.
    #[cfg_attr(feature = "small", inline(never))]
    fn check(&self, config: &Config, step_hz: f32) -> Result<(), Error> {
        let mut empty = true;
        for (number, channel) in self.channels.iter().enumerate() {
            let Some(channel) = *channel else { continue };
            if self.channels.iter().take(number).any(|earlier| *earlier == Some(channel)) {
                return Err(Error::Twice(channel));
            }
            if channel.scale(config, step_hz).is_none() {
                return Err(Error::NoControl(channel));
            }
            empty = false;
        }
        if empty {
            return Err(Error::Empty);
        }
        if self.every == 0 {
            return Err(Error::Every);
        }
        if self.rows == 0 || usize::from(self.rows) > ROWS {
            return Err(Error::Rows(ROWS as u16));
        }
        if self.before >= self.rows {
            return Err(Error::Before);
        }
        Ok(())
    }
}

/// Largest raw level: half of the range, so that a difference to a level is one of the same sign.
const LARGEST: f32 = 1_073_741_824.0;
