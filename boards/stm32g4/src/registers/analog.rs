//! Op-amps, comparators and the converter of their thresholds (RM0440, chapters 25, 24 and 22).

use super::{bit, field};

/// OPAMPx_CSR: amplifies the difference between VINP0 and VINM0 by sixteen, at high speed, onto its pin; on, and locked
/// on until the next reset, so that nothing can switch it off and leave the ADC converting a floating output.
///
/// VP_SEL = 00: pin VINP0. VM_SEL = 10: the resistor ladder. PGA_GAIN = 01011: gain 16, the ladder's foot at pin VINM0,
/// which is the ground side of the shunt. OPAINTOEN = 0: the output is on the pin, which the ADC reads.
pub const OPAMP_SHUNT: u32 =
    1 | field(0b00, 2, 2) | field(0b10, 5, 2) | bit(true, 7) | field(0b01011, 14, 5) | bit(true, 31);

/// OPAMPx_CSR: follows the pin VINP2, at high speed, onto a converter inside the chip; on, and locked until the next
/// reset.
///
/// VP_SEL = 10: pin VINP2. VM_SEL = 11: its own output. OPAINTOEN = 1: the output goes to an ADC and to no pin.
pub const OPAMP_FOLLOWER: u32 = 1 | field(0b10, 2, 2) | field(0b11, 5, 2) | bit(true, 7) | bit(true, 8) | bit(true, 31);

/// COMPx_CSR: compares INP0 with DAC3, high when it is above; on, and locked until the next reset.
///
/// INMSEL = 100: channel 1 of DAC3 for COMP1 and COMP3, channel 2 for COMP2 and COMP4. No hysteresis: the break
/// latches, and its filter takes care of noise.
pub const COMP_ABOVE_DAC3: u32 = 1 | field(0b100, 4, 3) | bit(false, 8) | bit(true, 31);

/// DAC_MCR: both channels to the chip's own peripherals, without buffers (MODE = 011), at HCLK above 160 MHz
/// (HFSEL = 10).
pub const DAC_INTERNAL: u32 = field(0b011, 0, 3) | field(0b10, 14, 2) | field(0b011, 16, 3);
/// DAC_CR: both channels on.
pub const DAC_ON: u32 = bit(true, 0) | bit(true, 16);

/// Code of 12 bits for a voltage in microvolts, rounded up, at a reference of 3.3 V.
pub const fn dac_code(microvolts: u32) -> u16 {
    let code = (microvolts as u64 * 4096).div_ceil(3_300_000);
    assert!(code < 4096, "above the reference");
    code as u16
}

/// DAC_DHR12RD: the same code for both channels.
pub const fn dac_both(code: u16) -> u32 {
    field(code as u32, 0, 12) | field(code as u32, 16, 12)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn opamp() {
        // OPAMPEN 0, VM_SEL 6:5, OPAHSM 7, PGA_GAIN 18:14, LOCK 31.
        assert_eq!(OPAMP_SHUNT, 0x8002_C0C1);
        // VP_SEL 3:2, OPAINTOEN 8.
        assert_eq!(OPAMP_FOLLOWER, 0x8000_01E9);
    }

    #[test]
    fn comparator_and_threshold() {
        // EN 0, INMSEL 6:4, LOCK 31.
        assert_eq!(COMP_ABOVE_DAC3, 0x8000_0041);
        // MODE1 2:0, HFSEL 15:14, MODE2 18:16; EN1 0, EN2 16.
        assert_eq!((DAC_INTERNAL, DAC_ON), (0x0003_8003, 0x0001_0001));
        // 231.4 mV of 3.3 V: 287.2.
        assert_eq!(dac_code(231_400), 288);
        assert_eq!(dac_both(288), 0x0120_0120);
    }
}
