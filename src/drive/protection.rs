//! Protection by currents, bus voltage, temperatures and deadlines, for a drive with current sensing.

use super::{Idle, Sample};
use crate::control::Window;
use crate::control::config::Config;
use crate::fault::{Fault, Limits};

/// Successive checks, eight steps apart, that a sum of the currents has to fail to be a fault.
const IMBALANCES: u32 = 2;
/// What a check of the stall that finds the rotor turning takes off the count of those that found it at rest.
const STALL_RECOVERY: u32 = 4;

/// Thresholds in codes of the ADC, and the counters of what has to last to be a fault.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Protection {
    /// Least code of each amplifier that is no over-current, and the codes from there to the largest.
    current_floors: [u32; 3],
    current_span: u32,
    /// Least code of the bus voltage, and the codes from there to the largest.
    bus_floor: u32,
    bus_span: u32,
    /// Least sum of the three currents' codes that is no imbalance.
    sum_floor: u32,
    /// What is left to the current along q at the moment.
    pub window: Window,
    /// Share of the largest current that each temperature, of bridge and motor, allows: 0 to 2¹⁶.
    shares: [i32; 2],
    /// Successive checks that found a wrong sum of the currents.
    imbalances: u32,
    /// Checks, 32 steps apart, that found the rotor at rest with the current at its limit, less what recovery took off.
    stalls: u32,
    /// Steps of the outer loops since the last command.
    command_age: u32,
}

impl Protection {
    /// No thresholds, and no current: for a drive without current sensing, and before the bridge is first on.
    pub const NONE: Self = Self {
        current_floors: [0; 3],
        current_span: u32::MAX,
        bus_floor: 0,
        bus_span: u32::MAX,
        sum_floor: 0,
        window: Window::ZERO,
        shares: [0; 2],
        imbalances: 0,
        stalls: 0,
        command_age: 0,
    };

    /// Clears the counts while the bridge is off.
    pub fn rest(&mut self) {
        (self.imbalances, self.stalls, self.command_age) = (0, 0, 0);
    }

    /// Thresholds about the amplifiers' zeros, codes for a full scale of 2¹⁶ in 2⁻⁸.
    pub fn set_zeros(&mut self, config: &Config, zeros: [i32; 3]) {
        let guard = &config.guard;
        let code = |zero: i32| (zero >> (8 + config.shift)) as u32;
        self.current_floors = zeros.map(|zero| code(zero).wrapping_sub(guard.over_current));
        self.current_span = 2 * guard.over_current;
        (self.bus_floor, self.bus_span) = (guard.under, guard.range);
        self.sum_floor = code(zeros.iter().sum()).wrapping_sub(guard.imbalance);
    }

    /// What would be a fault at once if the bridge were switched on now. Changes nothing: the thresholds are made on the
    /// stack, where they stay.
    #[inline(never)]
    pub fn refusal(config: &Config, zeros: &Idle, sample: &Sample) -> Option<Fault> {
        if !zeros.zeros_are_plausible(config) {
            return Some(Fault::CurrentOffset);
        }
        let mut protection = Self::NONE;
        protection.set_zeros(config, zeros.zeros());
        if !protection.allows(sample) {
            return Some(protection.fault(sample));
        }
        protection.over_temperature(config, sample)
    }

    /// The bridge is to be switched on: nothing is counted yet, and the largest current is that of these temperatures.
    pub fn arm(&mut self, config: &Config, sample: &Sample) {
        self.rest();
        for thermistor in 0..2 {
            self.derate(config, sample, thermistor);
        }
    }

    /// Whether currents and bus voltage are within their thresholds and no period was lost; in every step.
    #[inline(always)]
    pub fn allows(&self, sample: &Sample) -> bool {
        let flows = |k: usize| u32::from(sample.currents[k]).wrapping_sub(self.current_floors[k]) <= self.current_span;
        // A bus voltage has 16 bits: with a lost period it is out of every range.
        let bus = (u32::from(sample.bus) | u32::from(sample.lost.count()) << 16).wrapping_sub(self.bus_floor);
        flows(0) && flows(1) && flows(2) && bus <= self.bus_span
    }

    /// The fault where [`Self::allows`] says no.
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

    /// Checks the sum of the currents: a fault when it is wrong [`IMBALANCES`] times in a row.
    #[inline(always)]
    pub fn imbalance(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let [a, b, c] = sample.currents.map(u32::from);
        let balanced = (a + b + c).wrapping_sub(self.sum_floor) <= 2 * config.guard.imbalance;
        self.imbalances = if balanced { 0 } else { self.imbalances + 1 };
        (self.imbalances >= IMBALANCES).then_some(Fault::CurrentImbalance)
    }

    /// Temperatures that are too high.
    #[inline(always)]
    pub fn over_temperature(&self, config: &Config, sample: &Sample) -> Option<Fault> {
        let hot = |k: usize| i32::from(sample.temperatures[k].to_bits()) << config.shift < config.guard.heat[k].fault;
        if hot(0) {
            Some(Fault::BridgeHot)
        } else if hot(1) {
            Some(Fault::MotorHot)
        } else {
            None
        }
    }

    /// Derates the largest current by a temperature, of bridge (0) or motor (1).
    #[inline(always)]
    pub fn derate(&mut self, config: &Config, sample: &Sample, thermistor: usize) {
        let heat = config.guard.heat[thermistor];
        let above = ((i32::from(sample.temperatures[thermistor].to_bits()) << config.shift) - heat.fault).max(0);
        self.shares[thermistor] = if above < heat.room { (above * heat.slope) >> 8 } else { 1 << 16 };
        let share = self.shares[0].min(self.shares[1]);
        // 0.9 · 2¹⁵ and 2¹⁶.
        let most = (config.max_current * share) >> 16;
        let narrowed = Limits::NONE.set(Limits::HEAT, share < 1 << 16);
        self.window = Window { narrowed, ..Window::symmetric(most) };
    }

    /// Whether the rotor has stood still with the current at its limit for too long.
    #[inline(always)]
    pub fn is_stalled(&mut self, config: &Config, limited: bool, speed: i32) -> bool {
        let rest_speed = config.guard.rest_speed;
        let stands = limited && speed.wrapping_add(rest_speed) as u32 <= 2 * rest_speed as u32;
        if !stands {
            // The speed is noisy: a single check above the threshold must not clear the count.
            self.stalls = self.stalls.saturating_sub(STALL_RECOVERY);
            return false;
        }
        self.stalls += 1;
        self.stalls > config.guard.stall
    }

    /// Whether no command has come for too long; to be asked once every step of the outer loops.
    #[inline(always)]
    pub fn is_command_overdue(&mut self, config: &Config) -> bool {
        self.command_age = self.command_age.saturating_add(1);
        config.guard.timeout != 0 && self.command_age >= config.guard.timeout
    }

    /// Restarts the command time-out.
    pub fn command_received(&mut self) {
        self.command_age = 0;
    }
}
