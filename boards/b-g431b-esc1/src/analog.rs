//! Op-amps at the shunts, and the comparators that are the break input.

use b_g431b_esc1::constants::TRIP_UV;
use embassy_stm32::pac::comp::regs::Csr;
use embassy_stm32::pac::dac::regs::{Cr, Dhr12rd, Mcr};
use embassy_stm32::pac::opamp::regs::Csr as OpampCsr;
use embassy_stm32::pac::{COMP1, COMP2, COMP4, DAC3, OPAMP1, OPAMP2, OPAMP3, RCC};
use stm32g4::registers::analog::{COMP_ABOVE_DAC3, DAC_INTERNAL, DAC_ON, OPAMP_SHUNT, dac_both, dac_code};

/// Everything on, and locked: the chip keeps it so until the next reset. All pins are analog out of reset.
pub fn start() {
    for opamp in [OPAMP1, OPAMP2, OPAMP3] {
        opamp.csr().write_value(OpampCsr(OPAMP_SHUNT));
    }
    RCC.ahb2enr().modify(|enable| enable.set_dac3en(true));
    DAC3.mcr().write_value(Mcr(DAC_INTERNAL));
    DAC3.dhr12rd().write_value(Dhr12rd(dac_both(const { dac_code(TRIP_UV) })));
    DAC3.cr().write_value(Cr(DAC_ON));
    for comparator in [COMP1, COMP2, COMP4] {
        comparator.csr().write_value(Csr(COMP_ABOVE_DAC3));
    }
}
