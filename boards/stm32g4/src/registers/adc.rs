//! The ADCs: injected sequences, started by one event of TIM1 (RM0440, chapter 21).
//!
//! All ADCs run at a quarter of HCLK, in step with the timer that triggers them: an ADC cycle is 4 ticks of TIM1.
//! 42.5 MHz, where the data sheets allow 60 for one ADC at a time and 52 for all.

use super::field;

/// Ticks of HCLK in a cycle of an ADC.
pub const DIVIDER: u32 = 4;

/// ADCx_CCR: CKMODE = 11, a quarter of HCLK. The same for both groups of ADCs.
pub const CCR: u32 = field(0b11, 16, 2);
/// ADC_CR: out of deep power-down, voltage regulator on (ADVREGEN).
pub const CR_REGULATOR: u32 = 1 << 28;
/// ADC_CR, ADCAL: begins the calibration, for single-ended inputs; set until it is done.
pub const CR_CALIBRATE: u32 = 1 << 31;
/// ADC_CR, ADEN.
pub const CR_ENABLE: u32 = 1;
/// ADC_CR, JADSTART: converts at every trigger from now on.
pub const CR_START_INJECTED: u32 = 1 << 3;
/// ADC_ISR, ADRDY.
pub const READY: u32 = 1;
/// ADC_ISR and ADC_IER: the end of an injected sequence (JEOS).
pub const END_OF_SEQUENCE: u32 = 1 << 6;
/// ADC_CFGR: right-aligned 12 bits, no queue of sequences (JQDIS).
pub const CFGR: u32 = 1 << 31;

/// Microseconds from the voltage regulator's start until it is stable (data sheets, t_ADCVREG_STUP).
pub const REGULATOR_US: u32 = 20;

/// How long an input is sampled, in ADC cycles (ADC_SMPR1). 2.5 is left out: it lets neighbouring channels leak into
/// each other.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
#[repr(u8)]
pub enum Sampling {
    /// 6.5
    Cycles6_5 = 1,
    /// 12.5
    Cycles12_5 = 2,
    /// 24.5
    Cycles24_5 = 3,
    /// 47.5
    Cycles47_5 = 4,
    /// 92.5
    Cycles92_5 = 5,
}

impl Sampling {
    const ALL: [Self; 5] = [Self::Cycles6_5, Self::Cycles12_5, Self::Cycles24_5, Self::Cycles47_5, Self::Cycles92_5];

    /// In ticks of TIM1.
    pub const fn ticks(self) -> u32 {
        const HALVES: [u32; 6] = [5, 13, 25, 49, 95, 185];
        HALVES[self as usize] * DIVIDER / 2
    }

    /// The shortest that charges the sampling capacitor to half an LSB of 14 bits through a source of so many ohms:
    /// (R + 1 kΩ of the switch) · 5 pF · ln 2¹⁴, 48.5 ps an ohm.
    ///
    /// # Panics
    /// At compile time, above 43 kΩ.
    pub const fn from_source(ohm: u32) -> Self {
        let picoseconds = (ohm as u64 + 1000) * 485 / 10;
        let mut k = 0;
        while k < Self::ALL.len() {
            // A tick lasts 1/170 µs.
            if Self::ALL[k].ticks() as u64 * 1_000_000 / 170 >= picoseconds {
                return Self::ALL[k];
            }
            k += 1;
        }
        panic!("the source is too weak to be sampled without a capacitor")
    }
}

/// One conversion of a sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Rank {
    /// Input of the ADC, 1 to 18.
    pub channel: u8,
    /// How long it is sampled.
    pub sampling: Sampling,
}

impl Rank {
    /// One conversion.
    pub const fn new(channel: u8, sampling: Sampling) -> Self {
        assert!(channel >= 1 && channel <= 18);
        Self { channel, sampling }
    }
}

/// An injected sequence of one ADC, 1 to 4 conversions.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sequence(pub &'static [Rank]);

/// Ticks from the trigger to the start of sampling: 2.125 ADC cycles at a quarter of HCLK (data sheets, t_LATRINJ),
/// rounded up.
const LATENCY: u32 = 9;
/// Ticks of a conversion of 12 bits after sampling: 12.5 cycles.
const CONVERSION: u32 = 50;

impl Sequence {
    /// ADC_JSQR: sequence, started by the rising edge of TIM1_TRGO2, which is JEXTSEL = 01000 for ADC1 and ADC2 as
    /// for ADC3, ADC4 and ADC5 (RM0440, tables "External triggers for injected channels").
    pub const fn jsqr(&self) -> u32 {
        let mut value = field(self.0.len() as u32 - 1, 0, 2) | field(0b01000, 2, 5) | field(0b01, 7, 2);
        let mut k = 0;
        while k < self.0.len() {
            value |= field(self.0[k].channel as u32, 9 + 6 * k as u32, 5);
            k += 1;
        }
        value
    }

    /// ADC_SMPR1 and ADC_SMPR2: three bits a channel, ten channels in the first.
    pub const fn smpr(&self) -> [u32; 2] {
        let mut value = [0; 2];
        let mut k = 0;
        while k < self.0.len() {
            let Rank { channel, sampling } = self.0[k];
            value[channel as usize / 10] |= field(sampling as u32, 3 * (channel as u32 % 10), 3);
            k += 1;
        }
        value
    }

    /// Ticks from the trigger until the input of a rank, from 0, is held.
    pub const fn held(&self, rank: usize) -> u32 {
        self.begun(rank) + self.0[rank].sampling.ticks()
    }

    /// Ticks from the trigger until the input of a rank begins to be sampled.
    pub const fn begun(&self, rank: usize) -> u32 {
        let mut ticks = LATENCY;
        let mut k = 0;
        while k < rank {
            ticks += self.0[k].sampling.ticks() + CONVERSION;
            k += 1;
        }
        ticks
    }

    /// Ticks from the trigger to the last result.
    pub const fn done(&self) -> u32 {
        self.held(self.0.len() - 1) + CONVERSION
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Sampling::*;

    const SEQUENCE: Sequence = Sequence(&[
        Rank::new(3, Cycles12_5),
        Rank::new(12, Cycles12_5),
        Rank::new(14, Cycles24_5),
        Rank::new(5, Cycles47_5),
    ]);

    #[test]
    fn sequence_and_trigger() {
        // ADC_JSQR: JL 1:0 = 11, JEXTSEL 6:2 = 01000, JEXTEN 8:7 = 01, JSQ1 13:9, JSQ2 19:15, JSQ3 25:21, JSQ4 31:27.
        assert_eq!(SEQUENCE.jsqr(), 3 | 8 << 2 | 1 << 7 | 3 << 9 | 12 << 15 | 14 << 21 | 5 << 27);
        const ONE: Sequence = Sequence(&[Rank::new(5, Cycles24_5)]);
        assert_eq!(ONE.jsqr(), 8 << 2 | 1 << 7 | 5 << 9);
    }

    #[test]
    fn sampling_times() {
        // ADC_SMPR1: SMP3 11:9 = 010, SMP5 17:15 = 100. ADC_SMPR2: SMP12 8:6 = 010, SMP14 14:12 = 011.
        assert_eq!(SEQUENCE.smpr(), [2 << 9 | 4 << 15, 2 << 6 | 3 << 12]);
        assert_eq!(Sampling::ALL.map(Sampling::ticks), [26, 50, 98, 190, 370]);
    }

    #[test]
    fn instants() {
        // Each conversion lasts its sampling time and 12.5 cycles of four ticks.
        assert_eq!([0, 1, 2, 3].map(|rank| SEQUENCE.held(rank)), [59, 159, 307, 547]);
        assert_eq!((SEQUENCE.begun(0), SEQUENCE.begun(1), SEQUENCE.done()), (9, 109, 597));
    }

    #[test]
    fn source_impedances() {
        // 6.5 cycles of 42.5 MHz are 153 ns: 2150 Ω and the switch.
        let longest = |picoseconds: f64| picoseconds / (5.0 * 14.0 * core::f64::consts::LN_2) - 1000.0;
        for (sampling, cycles) in Sampling::ALL.into_iter().zip([6.5, 12.5, 24.5, 47.5, 92.5]) {
            let ohm = longest(cycles / 42.5e-6);
            assert_eq!(Sampling::from_source(ohm as u32 - 10), sampling);
            if sampling != Cycles92_5 {
                assert!(Sampling::from_source(ohm as u32 + 20) > sampling);
            }
        }
    }

    #[test]
    fn clock() {
        // CKMODE 17:16 = 11.
        assert_eq!(CCR, 0x0003_0000);
        assert_eq!(crate::registers::clock::HCLK_HZ / DIVIDER, 42_500_000);
    }
}
