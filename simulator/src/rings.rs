//! The rings on the shaft of a simulated drive.

use anyhow::{Result, anyhow, bail, ensure};
use hallservo::vernier::encoder::Reading;
use plant::heads::{BITS, Encoder, HEADS};
use std::str::FromStr;

/// Pole pairs of two rings: `37/45`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Pairs(pub [usize; 2]);

impl FromStr for Pairs {
    type Err = anyhow::Error;

    fn from_str(text: &str) -> Result<Self> {
        let Some((reference, vernier)) = text.split_once('/') else { bail!("two rings are like 37/45, not {text:?}") };
        let pairs =
            |text: &str| text.trim().parse().map_err(|_| anyhow!("a ring has 1 to 64 pole pairs, not {text:?}"));
        let pairs: [usize; 2] = [pairs(reference)?, pairs(vernier)?];
        ensure!(pairs.iter().all(|pairs| (1..=64).contains(pairs)), "a ring has 1 to 64 pole pairs");
        let both = (2..=64).find(|number| pairs.iter().all(|pairs| pairs.is_multiple_of(*number)));
        if let Some(both) = both {
            bail!("both rings' pole pairs are multiples of {both}: they look alike {both} times in a turn");
        }
        Ok(Self(pairs))
    }
}

/// What the heads show, as the drive takes it.
pub(super) fn read(rings: &mut Encoder, shaft_rad: f64) -> Reading<HEADS> {
    let [reference, vernier] = rings.read(shaft_rad).map(|codes| codes.map(|code| code << (16 - BITS)));
    Reading { reference, vernier }
}
