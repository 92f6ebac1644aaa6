//! Phase currents, their sum and the bus voltage, sample by sample; and lost periods.

use crate::board::Sample;
use crate::control::config::Config;
use crate::fault::Fault;

/// Successive checks, eight steps apart, that a sum of the currents has to fail to be a fault.
const IMBALANCES: u32 = 2;

/// Thresholds in codes of the ADC, and the count of wrong sums.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Currents {
    /// Least code of each amplifier that is no over-current, and the codes from there to the largest.
    current_floors: [u32; 3],
    current_span: u32,
    /// Least code of the bus voltage, and the codes from there to the largest.
    bus_floor: u32,
    bus_span: u32,
    /// Least sum of the three currents' codes that is no imbalance.
    sum_floor: u32,
    /// Successive checks that found a wrong sum of the currents.
    imbalances: u32,
}

impl Currents {
    /// No thresholds.
    pub const NONE: Self = Self {
        current_floors: [0; 3],
        current_span: u32::MAX,
        bus_floor: 0,
        bus_span: u32::MAX,
        sum_floor: 0,
        imbalances: 0,
    };

    /// Nothing is counted.
    pub fn rest(&mut self) {
        self.imbalances = 0;
    }

    /// Thresholds about the amplifiers' zeros, codes for a full scale of 2¹⁶ in 2⁻⁸.
    pub fn set_zeros(&mut self, config: &Config, zeros: [i32; 3]) {
        let guard = &config.guard;
        let code = |zero: i32| (zero >> (8 + config.shift)) as u32;
        let [a, b, c] = zeros;
        let floor = |zero: i32| code(zero).wrapping_sub(guard.over_current);
        self.current_floors = [floor(a), floor(b), floor(c)];
        self.current_span = 2 * guard.over_current;
        (self.bus_floor, self.bus_span) = (guard.under, guard.range);
        self.sum_floor = code(a + b + c).wrapping_sub(guard.imbalance);
    }

    /// Whether currents and bus voltage are within their thresholds and no period was lost; in every step.
    #[inline(always)]
    pub fn allow(&self, sample: &Sample) -> bool {
        let flows = |k: usize| u32::from(sample.currents[k]).wrapping_sub(self.current_floors[k]) <= self.current_span;
        // A bus voltage has 16 bits: with a lost period it is out of every range.
        let bus = (u32::from(sample.bus) | u32::from(sample.lost.count()) << 16).wrapping_sub(self.bus_floor);
        flows(0) && flows(1) && flows(2) && bus <= self.bus_span
    }

    /// The fault where [`Self::allow`] says no.
    #[cold]
    #[inline(never)]
    pub fn fault(&self, sample: &Sample) -> Fault {
        let bus = u32::from(sample.bus);
        if bus < self.bus_floor {
            Fault::UnderVoltage
        } else if bus - self.bus_floor > self.bus_span {
            Fault::OverVoltage
        } else if sample.lost.any() {
            Fault::Deadline
        } else {
            Fault::OverCurrent
        }
    }

    /// Sum of the codes of three currents that add up to none.
    pub fn sum(&self, config: &Config) -> u16 {
        self.sum_floor.wrapping_add(config.guard.imbalance) as u16
    }

    /// Checks the sum of the currents: a fault when it is wrong [`IMBALANCES`] times in a row.
    #[inline(always)]
    pub fn imbalance(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let [a, b, c] = sample.currents.map(u32::from);
        let balanced = (a + b + c).wrapping_sub(self.sum_floor) <= 2 * config.guard.imbalance;
        self.imbalances = if balanced { 0 } else { self.imbalances + 1 };
        (self.imbalances >= IMBALANCES).then_some(Fault::CurrentImbalance)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::settings::{Control, Settings};

    #[test]
    fn a_sum_that_is_wrong_twice_in_a_row_is_a_fault_and_one_disturbed_sample_is_none() {
        let settings = Settings { control: Some(Control::default()), ..Settings::default() };
        let config = settings.validate().unwrap().control.unwrap();
        let middle = 1 << (settings.adc_bits - 1);
        let mut currents = Currents::NONE;
        currents.set_zeros(&config, [i32::from(middle) << (8 + config.shift); 3]);
        let balanced = Sample { currents: [middle; 3], ..Sample::default() };
        let off = config.guard.imbalance as u16 + 2;
        for wrong in [middle + off, middle - off] {
            let wrong = Sample { currents: [wrong, middle, middle], ..Sample::default() };
            let told = [&wrong, &balanced, &wrong, &wrong].map(|sample| currents.imbalance(&config, sample));
            assert_eq!(told, [None, None, None, Some(Fault::CurrentImbalance)]);
            currents.rest();
        }
    }
}
