//! SYSCFG, EXTI, DBGMCU and the factory's words (RM0440, chapters 10, 15, 47 and 48).

use crate::bits::unmodelled;
use crate::device::Device;
use bus::Complaint;

/// System configuration (10.2).
#[derive(Clone, Debug, Default)]
pub struct Syscfg {
    cfgr1: u32,
    exticr: [u32; 4],
    cfgr2: u32,
}

impl Syscfg {
    /// Reads a register.
    pub fn read(&self, offset: u32) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => 0,
            0x04 => self.cfgr1,
            0x08..=0x14 => self.exticr[((offset - 8) / 4) as usize],
            0x1c => self.cfgr2,
            _ => return Err(unmodelled("SYSCFG", offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        match offset {
            0x04 => self.cfgr1 = value,
            0x08..=0x14 => self.exticr[((offset - 8) / 4) as usize] = value,
            // Locks only grow.
            0x1c => self.cfgr2 |= value & 0xf,
            _ => return Err(unmodelled("SYSCFG", offset)),
        }
        Ok(())
    }

    /// Port of an external line.
    pub fn port(&self, line: u32) -> u8 {
        (self.exticr[(line / 4) as usize] >> (4 * (line % 4)) & 0xf) as u8
    }
}

/// Extended interrupts, lines 0 to 31 (15.5); the others have no source here.
#[derive(Clone, Debug, Default)]
pub struct Exti {
    imr: [u32; 2],
    emr: [u32; 2],
    edges: [[u32; 2]; 2],
    pending: u32,
}

impl Exti {
    /// Reads a register.
    pub fn read(&self, offset: u32) -> Result<u32, Complaint> {
        let bank = (offset / 0x20) as usize;
        Ok(match offset {
            0x00 | 0x20 => self.imr[bank],
            0x04 | 0x24 => self.emr[bank],
            0x08 | 0x28 => self.edges[bank][0],
            0x0c | 0x2c => self.edges[bank][1],
            0x10 | 0x30 => 0,
            0x14 => self.pending,
            0x34 => 0,
            _ => return Err(unmodelled("EXTI", offset)),
        })
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        let bank = (offset / 0x20) as usize;
        match offset {
            0x00 | 0x20 => self.imr[bank] = value,
            0x04 | 0x24 => self.emr[bank] = value,
            0x08 | 0x28 => self.edges[bank][0] = value,
            0x0c | 0x2c => self.edges[bank][1] = value,
            0x10 => self.pending |= value & self.imr[0],
            0x14 => self.pending &= !value,
            _ => return Err(unmodelled("EXTI", offset)),
        }
        Ok(())
    }

    /// An edge at the pin of a line.
    pub fn edge(&mut self, line: u32, rising: bool) {
        self.pending |= self.edges[0][usize::from(!rising)] & 1 << line;
    }

    /// Interrupt lines of the core.
    pub fn interrupts(&self) -> u128 {
        let up = self.pending & self.imr[0];
        let single = u128::from(up & 0x1f) << 6;
        let middle = u128::from(up & 0x3e0 != 0) << 23;
        single | middle | u128::from(up & 0xfc00 != 0) << 40
    }
}

/// Debug support (47.9), outside the core's private bus.
#[derive(Clone, Debug, Default)]
pub struct Dbgmcu {
    registers: [u32; 5],
}

impl Dbgmcu {
    /// Reads a register.
    pub fn read(&self, offset: u32, device: Device) -> Result<u32, Complaint> {
        match offset {
            0x00 => Ok(device.idcode()),
            0x04..=0x10 => Ok(self.registers[(offset / 4) as usize]),
            _ => Err(unmodelled("DBGMCU", offset)),
        }
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32) -> Result<(), Complaint> {
        match offset {
            0x04..=0x10 => self.registers[(offset / 4) as usize] = value,
            _ => return Err(unmodelled("DBGMCU", offset)),
        }
        Ok(())
    }
}

/// A half-word of the factory's area of the chip of this number; calibration words are taken at 3.0 V (48.1, 48.2; DS12288, 3.18).
pub fn factory(address: u32, device: Device, number: u16) -> Option<u16> {
    let word = match address & !1 {
        0x1fff_7590 => number,
        at @ 0x1fff_7592..=0x1fff_759a => 0x4853 + (at as u16 & 0xf) * 0x0101,
        0x1fff_75e0 => device.flash_kib(),
        // TS_CAL1 at 30 °C, TS_CAL2 at 130 °C: 0.76 V at 30 °C and 2.5 mV/K, in steps of 3.0 V / 4096.
        0x1fff_75a8 => 1038,
        0x1fff_75ca => 1379,
        // VREFINT of 1.212 V.
        0x1fff_75aa => 1655,
        0x1fff_7500 => 0,
        _ => return None,
    };
    Some(word)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn calibration_words_follow_from_the_data_sheet() {
        let code = |volts: f64| (volts / 3.0 * 4096.0).round() as u16;
        assert_eq!(factory(0x1fff_75aa, Device::G431CB, 0), Some(code(crate::analog::VREFINT)));
        assert_eq!(factory(0x1fff_75a8, Device::G431CB, 0), Some(code(0.76)));
        assert_eq!(factory(0x1fff_75ca, Device::G431CB, 0), Some(code(0.76 + 0.0025 * 100.0)));
        assert_eq!(factory(0x1fff_75e0, Device::G474RE, 0), Some(512));
    }

    #[test]
    fn external_lines_share_interrupts() {
        let mut exti = Exti::default();
        exti.write(0x00, 1 << 13 | 1 << 2).unwrap();
        exti.write(0x0c, 1 << 13).unwrap();
        exti.edge(13, true);
        assert_eq!(exti.interrupts(), 0);
        exti.edge(13, false);
        assert_eq!(exti.interrupts(), 1 << 40);
        exti.write(0x14, 1 << 13).unwrap();
        exti.write(0x10, 1 << 2).unwrap();
        assert_eq!(exti.interrupts(), 1 << 8);
    }
}
