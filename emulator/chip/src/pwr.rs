//! Power control (RM0440, chapter 6), as far as it limits the clock.

use crate::bits::{bit, field, unmodelled, wrong};
use bus::Complaint;

const NAME: &str = "PWR";
const CR1: u32 = 0x00;
const CR5: u32 = 0x80;
/// PWR_CR5.R1MODE: 0 is the boost mode (6.4.19).
const R1MODE: u32 = 8;

/// The peripheral.
#[derive(Clone, Debug)]
pub struct Pwr {
    cr1: u32,
    others: [u32; 3],
    cr5: u32,
}

impl Default for Pwr {
    fn default() -> Self {
        Self { cr1: 0x200, others: [0, 0x8000, 0], cr5: 1 << R1MODE }
    }
}

impl Pwr {
    /// Reads a register.
    pub fn read(&self, offset: u32) -> Result<u32, Complaint> {
        match offset {
            CR1 => Ok(self.cr1),
            0x04..=0x0c => Ok(self.others[(offset / 4 - 1) as usize]),
            // Range settled, low-power regulator started.
            0x10 => Ok(0),
            0x14 => Ok(0x100),
            CR5 => Ok(self.cr5),
            _ => Err(unmodelled(NAME, offset)),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        match offset {
            CR1 => {
                self.cr1 = value & 0x4707;
                if !matches!(field(value, 9, 2), 1 | 2) {
                    return Err(wrong(NAME, "CR1.VOS holds a reserved value"));
                }
            }
            0x04..=0x0c => self.others[(offset / 4 - 1) as usize] = value,
            0x18 => {}
            CR5 => {
                self.cr5 = value & 1 << R1MODE;
                if value & !(1 << R1MODE) != 0 {
                    return Err(wrong(NAME, "CR5: reserved bits are set; R1MODE is bit 8"));
                }
            }
            _ => return Err(unmodelled(NAME, offset)),
        }
        Ok(())
    }

    /// Highest HCLK of the range that is programmed, Hz (6.1.5).
    pub fn highest_hz(&self) -> f64 {
        match (field(self.cr1, 9, 2), bit(self.cr5, R1MODE)) {
            (2, _) => 26e6,
            (_, true) => 150e6,
            (_, false) => 170e6,
        }
    }

    /// Least flash wait states at this HCLK (3.3.3, table 9).
    pub fn wait_states(&self, hclk: f64) -> u32 {
        let each_hz = match (field(self.cr1, 9, 2), bit(self.cr5, R1MODE)) {
            (2, _) => 12e6,
            (_, true) => 30e6,
            (_, false) => 34e6,
        };
        ((hclk - 1.0) / each_hz) as u32
    }

    /// What is wrong with this HCLK at this many wait states.
    pub fn complaint(&self, hclk: f64, wait_states: u32) -> Option<Complaint> {
        let (mhz, highest) = (hclk / 1e6, self.highest_hz());
        if hclk > highest + 1.0 {
            let range = format!("HCLK of {mhz:.0} MHz is above the {:.0} MHz of this voltage range", highest / 1e6);
            return Some(wrong(
                NAME,
                range + if highest == 150e6 { ": R1MODE (CR5, bit 8) is not cleared" } else { "" },
            ));
        }
        let least = self.wait_states(hclk);
        (wait_states < least)
            .then(|| wrong("FLASH", format!("{wait_states} wait states at {mhz:.0} MHz, {least} are needed")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn more_than_150_mhz_needs_the_boost_mode_at_bit_8() {
        let mut pwr = Pwr::default();
        assert_eq!(pwr.complaint(150e6, 4), None);
        assert!(pwr.complaint(170e6, 4).unwrap().to_string().contains("R1MODE"));
        // The bit that a wrong register description names.
        assert!(pwr.write(CR5, 0x101).is_err());
        assert!(pwr.complaint(170e6, 4).is_some());
        pwr.write(CR5, 0).unwrap();
        assert_eq!(pwr.complaint(170e6, 4), None);
    }

    #[test]
    fn wait_states_are_those_of_table_9() {
        let mut pwr = Pwr::default();
        for (mhz, states) in [(16.0, 0), (30.0, 0), (60.0, 1), (90.0, 2), (120.0, 3), (150.0, 4)] {
            assert_eq!(pwr.wait_states(mhz * 1e6), states, "{mhz} MHz");
        }
        pwr.write(CR5, 0).unwrap();
        for (mhz, states) in [(34.0, 0), (68.0, 1), (102.0, 2), (136.0, 3), (170.0, 4)] {
            assert_eq!(pwr.wait_states(mhz * 1e6), states, "{mhz} MHz in boost mode");
        }
        assert!(pwr.complaint(170e6, 3).is_some());
    }
}
