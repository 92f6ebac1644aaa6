//! What the chip tells the host of a run, a line each: commands and the period in which they were obeyed, and the
//! digest now and then.

use core::fmt;
use core::str::FromStr;
use hallservo::commutation::Modulation;

/// A line, without what is around it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Entry {
    /// Periods done before.
    pub period: u32,
    /// What happened then.
    pub what: What,
}

/// What can happen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum What {
    /// The command to calibrate.
    Calibrate,
    /// The service installed what it found.
    Install,
    /// The command to arm.
    Arm,
    /// The command of a modulation.
    Drive(Modulation),
    /// The command to disarm.
    Disarm,
    /// The digest of all samples and outputs.
    Digest(u64),
}

/// What tells an entry from other lines.
const MARK: &str = "twin:";

impl fmt::Display for Entry {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{MARK} {} ", self.period)?;
        match self.what {
            What::Calibrate => write!(f, "calibrate"),
            What::Install => write!(f, "install"),
            What::Arm => write!(f, "arm"),
            What::Drive(modulation) => write!(f, "drive {}", modulation.to_bits()),
            What::Disarm => write!(f, "disarm"),
            What::Digest(digest) => write!(f, "digest {digest}"),
        }
    }
}

/// The line is no entry.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoEntry;

impl FromStr for Entry {
    type Err = NoEntry;

    fn from_str(line: &str) -> Result<Self, NoEntry> {
        let mut words = line.strip_prefix(MARK).ok_or(NoEntry)?.split_ascii_whitespace();
        let period = words.next().and_then(|word| word.parse().ok()).ok_or(NoEntry)?;
        let what = match (words.next().ok_or(NoEntry)?, words.next()) {
            ("calibrate", None) => What::Calibrate,
            ("install", None) => What::Install,
            ("arm", None) => What::Arm,
            ("drive", Some(bits)) => What::Drive(Modulation::from_bits(bits.parse().map_err(|_| NoEntry)?)),
            ("disarm", None) => What::Disarm,
            ("digest", Some(digest)) => What::Digest(digest.parse().map_err(|_| NoEntry)?),
            _ => return Err(NoEntry),
        };
        Ok(Self { period, what })
    }
}
