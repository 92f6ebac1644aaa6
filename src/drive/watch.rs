//! What currents, voltage, temperatures and time tell about the health of a drive with current sensing.

use crate::control::config::Config;
use crate::drive::Sample;
use crate::fault::Fault;

/// Looks at a sum of the currents that amplifiers cannot show before it is a fault.
const IMBALANCED: u32 = 2;
/// Middle of the range of a code of 16 bits, in 2⁻⁸.
const MIDDLE: i32 = 32_768 << 8;

/// The state of the watch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Watch {
    /// Codes below are a current that is too large, and those that are more than the range above.
    low: [u32; 3],
    range: u32,
    /// The same of the bus.
    bus: [u32; 2],
    /// Sum of the codes that is too low.
    low_sum: u32,
    /// Largest current at the moment.
    pub most: i32,
    /// Largest share of the largest current that each temperature allows, in 2⁻¹⁶.
    shares: [i32; 2],
    imbalanced: u32,
    stalled: u32,
    silent: u32,
    /// Zero of each amplifier in 2⁻⁸ codes of 16 bits.
    pub offsets: [i32; 3],
}

impl Watch {
    pub const fn new() -> Self {
        Self {
            low: [0; 3],
            range: u32::MAX,
            bus: [0, u32::MAX],
            low_sum: 0,
            most: 0,
            shares: [0; 2],
            imbalanced: 0,
            stalled: 0,
            silent: 0,
            offsets: [MIDDLE; 3],
        }
    }

    /// While the bridge is off: the amplifiers show their offsets.
    pub fn idle(&mut self, config: &Config, sample: &Sample) {
        for (offset, code) in self.offsets.iter_mut().zip(sample.currents) {
            *offset += ((i32::from(code) << (config.shift + 8)) - *offset) >> 8;
        }
        (self.imbalanced, self.stalled, self.silent) = (0, 0, 0);
    }

    /// Takes the offsets that were found for zero.
    pub fn zero(&mut self, config: &Config) {
        let [a, b, c] = self.offsets;
        let code = |offset: i32| (offset >> (8 + config.shift)) as u32;
        self.low = [a, b, c].map(|offset| code(offset).wrapping_sub(config.guard.over_current));
        self.range = 2 * config.guard.over_current;
        self.bus = [config.guard.under, config.guard.range];
        self.low_sum = code(a + b + c).wrapping_sub(config.guard.imbalance);
    }

    /// What speaks against switching the bridge on.
    pub fn refusal(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let off = self.offsets.iter().any(|offset| (offset - MIDDLE).abs() >> 8 > config.guard.offset);
        if off {
            return Some(Fault::CurrentOffset);
        }
        self.zero(config);
        let fault = if self.healthy(sample) { self.heat(config, sample) } else { Some(self.explain(sample)) };
        for thermistor in 0..2 {
            self.derate(config, sample, thermistor);
        }
        fault
    }

    /// Whether currents, voltage and time are as they should, in every step.
    #[inline(always)]
    pub fn healthy(&self, sample: &Sample) -> bool {
        let flows = |k: usize| u32::from(sample.currents[k]).wrapping_sub(self.low[k]) <= self.range;
        // A bus voltage has 16 bits: with a lost period it is out of every range.
        let bus = (u32::from(sample.bus) | u32::from(sample.lost) << 16).wrapping_sub(self.bus[0]);
        flows(0) && flows(1) && flows(2) && bus <= self.bus[1]
    }

    /// Why not.
    #[cold]
    #[inline(never)]
    pub fn explain(&self, sample: &Sample) -> Fault {
        let bus = u32::from(sample.bus);
        if bus < self.bus[0] {
            Fault::UnderVoltage
        } else if bus - self.bus[0] > self.bus[1] {
            Fault::OverVoltage
        } else if sample.lost != 0 {
            Fault::Deadline
        } else {
            Fault::OverCurrent
        }
    }

    /// The sum of the currents: a fault when it is wrong at two looks, eight steps apart.
    #[inline(always)]
    pub fn balance(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let [a, b, c] = sample.currents.map(u32::from);
        let balanced = (a + b + c).wrapping_sub(self.low_sum) <= 2 * config.guard.imbalance;
        self.imbalanced = if balanced { 0 } else { self.imbalanced + 1 };
        (self.imbalanced >= IMBALANCED).then_some(Fault::CurrentImbalance)
    }

    /// Temperatures that are too high.
    #[inline(always)]
    pub fn heat(&self, config: &Config, sample: &Sample) -> Option<Fault> {
        let hot = |k: usize| i32::from(sample.temperatures[k]) << config.shift < config.guard.heat[k].fault;
        if hot(0) {
            Some(Fault::BridgeHot)
        } else if hot(1) {
            Some(Fault::MotorHot)
        } else {
            None
        }
    }

    /// What a temperature, of bridge or motor, leaves of the largest current.
    #[inline(always)]
    pub fn derate(&mut self, config: &Config, sample: &Sample, thermistor: usize) {
        let heat = config.guard.heat[thermistor];
        let above = ((i32::from(sample.temperatures[thermistor]) << config.shift) - heat.fault).max(0);
        self.shares[thermistor] = if above < heat.room { (above * heat.slope) >> 8 } else { 1 << 16 };
        let share = self.shares[0].min(self.shares[1]);
        // 0.9 · 2¹⁵ and 2¹⁶.
        self.most = (config.max_current * share) >> 16;
    }

    /// Whether a rotor does not turn though the current is at its limit, for too long.
    #[inline(always)]
    pub fn stalls(&mut self, config: &Config, limited: bool, speed: i32) -> bool {
        let creep = config.guard.creep;
        let stalls = limited && speed.wrapping_add(creep) as u32 <= 2 * creep as u32;
        if !stalls {
            // The speed is noisy: a look at which it seems to turn does not make up for all before.
            self.stalled = self.stalled.saturating_sub(4);
            return false;
        }
        self.stalled += 1;
        self.stalled > config.guard.stall
    }

    /// Whether the commands have stayed away for too long.
    #[inline(always)]
    pub fn is_silent(&mut self, config: &Config) -> bool {
        self.silent = self.silent.saturating_add(1);
        config.guard.timeout != 0 && self.silent >= config.guard.timeout
    }

    /// Any command is a sign of life.
    pub fn heard(&mut self) {
        self.silent = 0;
    }
}
