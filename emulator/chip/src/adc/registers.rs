//! The register file of a converter (RM0440, 21.7).

use super::*;
use crate::bits::{unmodelled, wrong};
use bus::Complaint;

impl Adc {
    /// Reads a register.
    pub fn read(&mut self, offset: u32) -> Result<u32, Complaint> {
        Ok(match offset {
            0x00 => self.isr,
            0x04 => self.ier,
            0x08 => self.cr,
            0x0c => self.cfgr,
            0x10 => self.cfgr2,
            0x14 | 0x18 => self.smpr[((offset - 0x14) / 4) as usize],
            0x20..=0x28 => self.thresholds[((offset - 0x20) / 4) as usize],
            0x30..=0x3c => self.sqr[((offset - 0x30) / 4) as usize],
            0x40 => {
                self.isr &= !EOC;
                self.dr
            }
            0x4c => self.jsqr,
            0x60..=0x6c => self.ofr[((offset - 0x60) / 4) as usize],
            0x80..=0x8c => return self.read_injected(((offset - 0x80) / 4) as usize),
            0xa0 | 0xa4 => 0,
            0xb0 => self.difsel,
            0xb4 => self.calfact,
            0xc0 => self.gcomp,
            _ => return Err(unmodelled(self.name, offset)),
        })
    }

    fn read_injected(&mut self, rank: usize) -> Result<u32, Complaint> {
        self.read[rank] = true;
        self.unread[rank] = false;
        // Not a complaint that could carry the value, so the record takes it.
        if !self.excused && self.run.is_some_and(|run| run.injected && run.now.rank <= rank) {
            let name = self.name;
            self.complaint.get_or_insert_with(|| format!("{name}: JDR{} is read while its rank converts", rank + 1));
        }
        Ok(self.jdr[rank])
    }

    /// Writes a register.
    pub fn write(&mut self, offset: u32, value: u32, now: Cycle) -> Result<(), Complaint> {
        let runs = self.cr & (ADSTART | JADSTART) != 0;
        let name = self.name;
        match offset {
            0x00 => self.isr &= !value,
            0x04 => {
                self.ier = value & 0x7ff;
                if value & 0x780 != 0 {
                    return Err(wrong(name, "IER: analogue watchdogs and the queue are not modelled"));
                }
            }
            0x08 => return self.write_cr(value, now as f64),
            0x0c => {
                if runs && (value ^ self.cfgr) & !0x4001 != 0 {
                    return Err(wrong(name, "CFGR is written while conversions are started (21.7.4)"));
                }
                self.cfgr = value;
                return self.check_cfgr();
            }
            0x10 => {
                self.cfgr2 = value;
                if value & 0x0e00_0003 != 0 {
                    return Err(wrong(name, "CFGR2: oversampling, bulb and sampling-time triggers are not modelled"));
                }
            }
            0x14 | 0x18 => {
                let which = ((offset - 0x14) / 4) as usize;
                if runs && value != self.smpr[which] {
                    return Err(wrong(name, "sampling times are written while conversions are started (21.7.6)"));
                }
                self.smpr[which] = value;
            }
            0x20..=0x28 => self.thresholds[((offset - 0x20) / 4) as usize] = value,
            0x30..=0x3c => self.sqr[((offset - 0x30) / 4) as usize] = value,
            0x4c => {
                if self.cr & JADSTART != 0 && value != self.jsqr {
                    return Err(wrong(name, "JSQR is written while JADSTART is set and the queue is off (21.7.16)"));
                }
                self.jsqr = value;
            }
            0x60..=0x6c => self.ofr[((offset - 0x60) / 4) as usize] = value,
            0xb0 => {
                self.difsel = value;
                if value != 0 {
                    return Err(wrong(name, "DIFSEL: differential inputs are not modelled"));
                }
            }
            0xb4 => self.calfact = value,
            0xc0 => self.gcomp = value & 0x3fff,
            0xa0 | 0xa4 if value == 0 => {}
            _ => return Err(unmodelled(name, offset)),
        }
        Ok(())
    }

    fn check_cfgr(&self) -> Result<(), Complaint> {
        let name = self.name;
        if self.cfgr & 1 != 0 {
            return Err(wrong(name, "CFGR: DMA is not modelled"));
        }
        if self.cfgr >> 31 == 0 {
            return Err(wrong(name, "CFGR: the queue of injected contexts (JQDIS = 0) is not modelled"));
        }
        if self.cfgr & 0x03d1_4000 != 0 {
            return Err(wrong(
                name,
                "CFGR: discontinuous modes, automatic injection, delays and watchdogs are not modelled",
            ));
        }
        Ok(())
    }

    /// CR's bits are set by software and cleared by hardware (21.7.3).
    fn write_cr(&mut self, value: u32, now: f64) -> Result<(), Complaint> {
        let name = self.name;
        let rising = value & !self.cr;
        let powered = self.cr & ADVREGEN != 0;
        if rising & ADVREGEN != 0 && value & DEEPPWD == 0 {
            self.regulator_at = now + (REGULATOR_S * self.hclk_hz).floor();
        }
        if value & ADVREGEN == 0 || value & DEEPPWD != 0 {
            if self.cr & ADEN != 0 {
                return Err(wrong(name, "CR: the regulator is switched off while the converter is enabled"));
            }
            self.regulator_at = f64::INFINITY;
            self.calibrated &= value & DEEPPWD == 0;
        }
        self.cr = self.cr & !(ADVREGEN | DEEPPWD | ADCALDIF) | value & (ADVREGEN | DEEPPWD | ADCALDIF);
        if rising & ADCAL != 0 {
            return self.calibrate(powered, now);
        }
        if rising & ADEN != 0 {
            return self.enable(now);
        }
        if rising & ADDIS != 0 && self.cr & ADEN != 0 {
            self.cr &= !(ADEN | ADSTART | JADSTART);
            self.isr &= !ADRDY;
            self.run = None;
        }
        self.stop(value);
        if rising & (ADSTART | JADSTART) != 0 {
            if self.cr & ADEN == 0 {
                return Err(wrong(name, "CR: a start while the converter is not enabled (21.7.3)"));
            }
            self.cr |= rising & (ADSTART | JADSTART);
            if rising & JADSTART != 0 && self.jsqr >> 7 & 3 == 0 {
                self.start(true, now, 0);
            }
            if rising & ADSTART != 0 && self.cfgr >> 10 & 3 == 0 {
                self.start(false, now, 0);
            }
        }
        Ok(())
    }

    fn stop(&mut self, value: u32) {
        for (stop, start, injected) in [(1 << 4, ADSTART, false), (1 << 5, JADSTART, true)] {
            if value & stop != 0 {
                self.cr &= !start;
                if self.run.is_some_and(|run| run.injected == injected) {
                    self.run = None;
                }
            }
        }
    }

    fn calibrate(&mut self, powered: bool, now: f64) -> Result<(), Complaint> {
        let name = self.name;
        if self.cr & ADEN != 0 {
            return Err(wrong(name, "CR: ADCAL is set while the converter is enabled (21.4.8)"));
        }
        if self.clock.ratio.is_infinite() {
            return Err(wrong(name, "CR: a calibration without a clock never ends: RCC_CCIPR selects none"));
        }
        self.cr |= ADCAL;
        self.calibrates_until = Some(now + CALIBRATION * self.clock.ratio);
        if !powered || now < self.regulator_at {
            return Err(wrong(name, "CR: ADCAL is set before the regulator has started, 20 us (21.4.6)"));
        }
        Ok(())
    }

    fn enable(&mut self, now: f64) -> Result<(), Complaint> {
        let name = self.name;
        if self.cr & ADCAL != 0 || now < self.regulator_at {
            return Err(wrong(name, "CR: ADEN is set while it calibrates or the regulator starts (21.4.9)"));
        }
        self.cr |= ADEN;
        // A conversion's time after the enable.
        self.ready_at = Some(now + 15.0 * self.clock.ratio).filter(|at| at.is_finite());
        if self.ready_at.is_none() {
            return Err(wrong(name, "CR: ADEN without a clock: ADRDY never comes"));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CR: u32 = 0x08;
    const JSQR: u32 = 0x4c;
    const CLOCK: AdcClock = AdcClock { ratio: 4.0, mode: 3 };

    fn run(adc: &mut Adc, until: f64) -> Vec<Converted> {
        let mut converted = Vec::new();
        while adc.next() <= until {
            match adc.fire() {
                Due::Hold { channel, .. } => adc.hold(f64::from(channel) / 100.0),
                Due::Converted(one) => converted.push(one),
                Due::Internal => {}
            }
        }
        converted
    }

    /// Calibrated and enabled at HCLK = 170 MHz, converter at 42.5 MHz.
    fn ready() -> Adc {
        let mut adc = Adc::new("ADC1");
        adc.set_clock(CLOCK, 170e6);
        adc.write(CR, ADVREGEN, 0).unwrap();
        adc.write(CR, ADVREGEN | ADCAL, 3400).unwrap();
        run(&mut adc, 3400.0 + 463.0);
        assert_ne!(adc.read(CR).unwrap() & ADCAL, 0, "116 periods of 4 cycles");
        run(&mut adc, 3400.0 + 464.0);
        assert_eq!(adc.read(CR).unwrap() & ADCAL, 0);
        adc.write(CR, ADVREGEN | ADEN, 4000).unwrap();
        run(&mut adc, 4060.0);
        assert_eq!(adc.read(0x00).unwrap(), ADRDY);
        adc
    }

    #[test]
    fn the_regulator_needs_its_time() {
        let mut adc = Adc::new("ADC1");
        adc.set_clock(CLOCK, 170e6);
        adc.write(CR, ADVREGEN, 0).unwrap();
        assert!(adc.write(CR, ADVREGEN | ADCAL, 3399).is_err());
    }

    #[test]
    fn without_a_clock_it_never_calibrates() {
        let mut adc = Adc::new("ADC1");
        adc.write(CR, ADVREGEN, 0).unwrap();
        let complaint = adc.write(CR, ADVREGEN | ADCAL, 10_000).unwrap_err();
        assert!(complaint.to_string().contains("without a clock"), "{complaint}");
    }

    #[test]
    fn an_injected_sequence_samples_when_the_manual_says() {
        let mut adc = ready();
        // Channel 5 with 6.5, channel 12 with 24.5 periods; two ranks, rising edge of trigger 8.
        adc.write(0x14, 1 << 15, 5000).unwrap();
        adc.write(0x18, 3 << 6, 5000).unwrap();
        adc.write(JSQR, 1 | 8 << 2 | 1 << 7 | 5 << 9 | 12 << 15, 5000).unwrap();
        adc.write(CR, ADVREGEN | JADSTART, 5000).unwrap();
        assert_eq!(adc.injected_trigger(), Some((8, 1)));
        adc.trigger_injected(10_000);
        let converted = run(&mut adc, 20_000.0);
        // 2.125 periods of latency, then 6.5 + 12.5 and 24.5 + 12.5 periods of 4 cycles.
        assert_eq!(converted[0].instants, [10_000.0, 10_008.5, 10_034.5, 10_084.5]);
        assert_eq!(converted[1].instants, [10_000.0, 10_084.5, 10_182.5, 10_232.5]);
        assert!(!converted[0].last && converted[1].last);
        assert_eq!(adc.read(0x80).unwrap(), 205, "0.05 of 4096, rounded");
        assert_eq!(adc.read(0x84).unwrap(), 492);
        assert_eq!(adc.read(0x00).unwrap() & (JEOC | JEOS), JEOC | JEOS);
        adc.write(0x00, JEOC | JEOS, 20_000).unwrap();
        assert_eq!(adc.read(0x00).unwrap() & (JEOC | JEOS), 0);
    }

    #[test]
    fn missed_triggers_and_unread_data_are_counted() {
        let mut adc = ready();
        adc.write(JSQR, 8 << 2 | 1 << 7 | 5 << 9, 5000).unwrap();
        adc.write(CR, ADVREGEN | JADSTART, 5000).unwrap();
        adc.trigger_injected(10_000);
        adc.trigger_injected(10_010);
        assert_eq!((adc.triggers, adc.missed), (2, 1));
        assert!(!run(&mut adc, 11_000.0)[0].unread);
        adc.read(0x80).unwrap();
        adc.trigger_injected(11_000);
        assert!(!run(&mut adc, 12_000.0)[0].unread);
        adc.trigger_injected(12_000);
        assert!(run(&mut adc, 13_000.0)[0].unread);
    }

    #[test]
    fn offsets_are_subtracted_with_a_sign() {
        let mut adc = ready();
        adc.write(0x60, 1 << 31 | 5 << 26 | 2048, 5000).unwrap();
        adc.write(JSQR, 5 << 9, 5000).unwrap();
        adc.write(CR, ADVREGEN | JADSTART, 5000).unwrap();
        run(&mut adc, 6000.0);
        assert_eq!(adc.read(0x80).unwrap(), u32::from((205_i16 - 2048) as u16));
        assert_eq!(adc.read(CR).unwrap() & JADSTART, 0, "by software: cleared at the end");
    }

    #[test]
    fn an_injected_trigger_puts_a_regular_conversion_off() {
        let mut adc = ready();
        adc.write(0x30, 7 << 6, 5000).unwrap();
        adc.write(JSQR, 8 << 2 | 1 << 7 | 5 << 9, 5000).unwrap();
        adc.write(CR, ADVREGEN | JADSTART | ADSTART, 5000).unwrap();
        adc.trigger_injected(5010);
        run(&mut adc, 5100.0);
        assert_eq!(adc.read(0x00).unwrap() & (JEOS | EOC), JEOS);
        run(&mut adc, 5200.0);
        assert_eq!(adc.read(0x00).unwrap() & EOC, EOC);
        assert_eq!(adc.read(0x40).unwrap(), 287);
        assert_eq!(adc.read(0x00).unwrap() & EOC, 0);
    }

    #[test]
    fn an_uncalibrated_converter_is_off_and_told_of() {
        let mut adc = Adc::new("ADC2");
        adc.set_clock(CLOCK, 170e6);
        adc.write(CR, ADVREGEN, 0).unwrap();
        adc.write(CR, ADVREGEN | ADEN, 4000).unwrap();
        run(&mut adc, 5000.0);
        adc.write(JSQR, 5 << 9, 5000).unwrap();
        adc.write(CR, ADVREGEN | JADSTART, 5000).unwrap();
        run(&mut adc, 6000.0);
        assert!(adc.take_complaint().unwrap().contains("uncalibrated"));
        assert_eq!(adc.read(0x80).unwrap(), 217);
    }
}
