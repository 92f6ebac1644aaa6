//! What a drive with current sensing does beside finding the angle: watch, and control torque, speed and position.

use crate::angle::{ElectricalAngle, Position};
use crate::commutation::frames::{Dq, Rotation, clarke, inverse_clarke};
use crate::commutation::{Modulation, svpwm};
use crate::control::cogging;
use crate::control::current::{Integrators, Local};
use crate::control::settings::Config;
use crate::control::trajectory::Trajectory;
use crate::control::velocity::Integrator;
use crate::control::{Current, Speed, clamp};
use crate::drive::Sample;
use crate::fault::{Fault, Limits};
use crate::hall::track::{self, Tracker};
use crate::pwm;

/// What is to be followed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Demand {
    /// A voltage, open loop.
    #[default]
    Voltage,
    /// A current along q.
    Current(Current),
    /// A speed.
    Speed(Speed),
    /// A position.
    Position(Position),
}

/// What the control has in its hands, beside angle and speed: voltages and currents in 2⁻¹⁵ of their full scales.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct State {
    /// Phase currents, offsets taken off.
    pub phases: [i32; 3],
    /// Currents in the frame of the rotor.
    pub current: Dq,
    /// Current along q that is asked for.
    pub wanted: i32,
    /// Voltage of the last step under field-oriented commutation.
    pub voltage: Dq,
    /// Bus voltage.
    pub bus: i32,
}

/// Steps with a sum of currents that amplifiers cannot show before it is a fault.
const IMBALANCED: u8 = 20;
/// Middle of the range of a code of 16 bits, in 2⁻⁸.
const MIDDLE: i32 = 32_768 << 8;

/// The state of the loops and of the watch.
#[derive(Clone, Copy, Debug)]
pub(super) struct Servo {
    pub demand: Demand,
    pub state: State,
    trajectory: Trajectory,
    velocity: Integrator,
    currents: Integrators,
    local: Local,
    /// Zero of each amplifier in 2⁻⁸ codes of 16 bits.
    offsets: [i32; 3],
    /// What the alignment is off by, as the voltage along d tells while turning; 2⁻³² turns.
    trim: i32,
    /// Largest current at the moment.
    most: i32,
    /// Which limits were in the way of the last step.
    pub limits: Limits,
    imbalanced: u8,
    turn: u8,
    stalled: u32,
    silent: u32,
}

impl Servo {
    pub const fn new() -> Self {
        Self {
            demand: Demand::Voltage,
            state: State { phases: [0; 3], current: Dq { d: 0, q: 0 }, wanted: 0, voltage: Dq { d: 0, q: 0 }, bus: 0 },
            trajectory: Trajectory::at(Position::from_bits(0), 0),
            velocity: Integrator::ZERO,
            currents: Integrators::ZERO,
            local: Local::ZERO,
            offsets: [MIDDLE; 3],
            trim: 0,
            most: 0,
            limits: Limits::NONE,
            imbalanced: 0,
            turn: 0,
            stalled: 0,
            silent: 0,
        }
    }

    /// Takes up currents and voltage, and tells what is wrong with them.
    #[inline(always)]
    pub fn watch(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let guard = &config.guard;
        let mut sum = 0;
        let mut beyond = false;
        for k in 0..3 {
            let current = (i32::from(sample.currents[k]) << config.shift) - (self.offsets[k] >> 8);
            self.state.phases[k] = current;
            sum += current;
            beyond |= current.wrapping_add(guard.over_current) as u32 > 2 * guard.over_current as u32;
        }
        self.state.bus = (i32::from(sample.bus) << config.shift) >> 1;
        let within = self.state.bus.wrapping_sub(guard.under) as u32 <= guard.range;
        let balanced = sum.wrapping_add(guard.imbalance) as u32 <= 2 * guard.imbalance as u32;
        self.imbalanced = if balanced { 0 } else { self.imbalanced + 1 };
        if beyond || !within || self.imbalanced >= IMBALANCED || sample.lost != 0 {
            return Some(self.instant(config, sample, beyond));
        }
        self.turn = self.turn.wrapping_add(1);
        match self.turn & 7 {
            0 => self.heat(config, sample),
            4 => self.late(config),
            _ => None,
        }
    }

    /// Which of the faults that one sample shows.
    #[cold]
    #[inline(never)]
    fn instant(&mut self, config: &Config, sample: &Sample, beyond: bool) -> Fault {
        self.imbalanced = 0;
        if beyond {
            Fault::OverCurrent
        } else if self.state.bus < config.guard.under {
            Fault::UnderVoltage
        } else if self.state.bus.wrapping_sub(config.guard.under) as u32 > config.guard.range {
            Fault::OverVoltage
        } else if sample.lost != 0 {
            Fault::Deadline
        } else {
            Fault::CurrentImbalance
        }
    }

    /// Temperatures: a fault, or what they leave of the largest current.
    #[inline(never)]
    fn heat(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let mut share = 1 << 16;
        for (k, fault) in [Fault::BridgeHot, Fault::MotorHot].into_iter().enumerate() {
            let heat = config.guard.heat[k];
            let above = (i32::from(sample.temperatures[k]) << config.shift) - heat.fault;
            if above < 0 {
                return Some(fault);
            }
            share = share.min(above.saturating_mul(heat.slope) >> 8);
        }
        self.most = ((i64::from(config.max_current) * i64::from(share)) >> 16) as i32;
        None
    }

    /// Stall and silence; eight steps are counted at once.
    #[inline(never)]
    fn late(&mut self, config: &Config) -> Option<Fault> {
        if self.stalled > config.guard.stall {
            return Some(Fault::Stall);
        }
        self.silent = self.silent.saturating_add(8);
        if config.guard.timeout != 0 && self.silent > config.guard.timeout {
            if !config.guard.stops {
                return Some(Fault::CommandTimeout);
            }
            self.limits = self.limits.with(Limits::TIMEOUT);
        }
        None
    }

    /// Whether the commands have stayed away for so long that the drive is to stop.
    pub fn is_silent(&self) -> bool {
        self.limits.contains(Limits::TIMEOUT)
    }

    /// While the bridge is off: the amplifiers show their offsets.
    pub fn idle(&mut self, config: &Config, sample: &Sample) {
        for (offset, code) in self.offsets.iter_mut().zip(sample.currents) {
            *offset += ((i32::from(code) << (config.shift + 8)) - *offset) >> 8;
        }
        self.imbalanced = 0;
        self.silent = 0;
        // What has stalled is no reason not to arm again.
        self.stalled = 0;
    }

    /// What speaks against switching the bridge on.
    pub fn refusal(&mut self, config: &Config, sample: &Sample) -> Option<Fault> {
        let off = self.offsets.iter().any(|offset| (offset - MIDDLE).abs() >> 8 > config.guard.offset);
        if off {
            return Some(Fault::CurrentOffset);
        }
        self.watch(config, sample).or_else(|| self.heat(config, sample))
    }

    /// What the alignment is off by.
    pub const fn trim(&self) -> ElectricalAngle {
        ElectricalAngle::from_bits(self.trim)
    }

    /// Everything at rest, following nothing.
    pub fn reset(&mut self) {
        let Self { offsets, trim, most, state, .. } = *self;
        *self = Self { offsets, trim, most, state, ..Self::new() };
        self.state.wanted = 0;
    }

    /// Any command is a sign of life.
    pub fn heard(&mut self) {
        self.silent = 0;
        self.limits = self.limits.without(Limits::TIMEOUT);
    }

    /// Takes up a demand; from another kind, the loops begin with what there is.
    pub fn follow(&mut self, demand: Demand, rotor: &Tracker) {
        let moving = matches!(self.demand, Demand::Speed(_) | Demand::Position(_));
        if !moving {
            self.trajectory = Trajectory::at(rotor.smoothed(), rotor.speed());
            self.velocity = Integrator::holding(self.state.wanted);
        }
        self.demand = demand;
    }

    /// The outer loops: the current along q that the demand asks for.
    #[inline(always)]
    pub fn outer(&mut self, config: &Config, rotor: &Tracker, cogging: Option<&cogging::Table>) {
        let asked = match self.demand {
            Demand::Voltage => 0,
            Demand::Current(Current(current)) => current,
            Demand::Speed(Speed(speed)) => {
                self.trajectory.towards_speed(speed, &config.trajectory);
                self.turn_with(config, rotor, self.trajectory.speed())
            }
            Demand::Position(position) => {
                self.trajectory.towards(position, &config.trajectory);
                let (wanted, forward) = (self.trajectory.position(), self.trajectory.speed());
                // A little more than the trajectory's, to catch up.
                let most = config.trajectory.speed() / 8 * 9;
                let speed = config.position.speed(wanted, rotor.smoothed(), forward, most);
                self.turn_with(config, rotor, speed)
            }
        };
        let asked = match cogging {
            Some(table) => asked + table.current(rotor.angle()),
            None => asked,
        };
        self.state.wanted = clamp(asked, self.most);
        let cut = self.state.wanted != asked;
        self.limits = self.limits.set(Limits::CURRENT, cut).set(Limits::HEAT, cut && self.most < config.max_current);
    }

    #[inline(always)]
    fn turn_with(&mut self, config: &Config, rotor: &Tracker, speed: i32) -> i32 {
        let forward = config.velocity.feed_forward(self.trajectory.acceleration());
        let current = self.velocity.step(&config.velocity, speed, rotor.speed(), forward, self.most);
        let stalls = (current == self.most || current == -self.most)
            && rotor.speed().wrapping_add(config.guard.creep) as u32 <= 2 * config.guard.creep as u32;
        // The speed is noisy: a step that seems to turn does not make up for all before.
        self.stalled = if stalls { self.stalled + 1 } else { self.stalled.saturating_sub(4) };
        current
    }

    /// Currents in the frame of the rotor at the sampling instant.
    #[inline(always)]
    pub fn park(&mut self, angle: ElectricalAngle, reversed: bool) {
        let [a, b, c] = self.state.phases;
        let vector = clarke(if reversed { [a, c, b] } else { [a, b, c] });
        self.state.current = Rotation::at(angle).park(vector);
    }

    /// Current that flows in at one leg and out at another, as the length of a vector along q that makes the same mean
    /// torque under block commutation: 2/√3 · 3/π = 1.103 times it.
    pub fn across(&self, (up, down): (usize, usize)) -> i32 {
        // Never out of range, which the compiler does not see.
        let phase = |leg: usize| self.state.phases.get(leg).copied().unwrap_or(0);
        (phase(up) - phase(down)) * 1129 / 2048
    }

    /// Field-oriented: compare values of the three legs.
    #[inline(always)]
    pub fn field(
        &mut self,
        config: &Config,
        rotor: &Tracker,
        tracking: &track::Config,
        limits: &pwm::Limits,
        reversed: bool,
    ) -> [u16; 3] {
        let trim = ElectricalAngle::from_bits(self.trim);
        self.park(rotor.angle() + trim, reversed);
        let wanted = Dq { d: 0, q: self.state.wanted };
        let radius = ((self.state.bus as u32 * config.radius as u32) >> 16) as i32;
        let voltage = self.currents.step(&config.gains, wanted, self.state.current, rotor.speed(), radius);
        self.state.voltage = voltage.dq;
        self.refine(config, rotor.speed(), voltage.limited);
        self.limits = self.limits.set(Limits::DUTY, voltage.limited);
        // The bus is above the least, which is not zero.
        let counts = (config.period / (self.state.bus as u32 | 1)) as i32;
        let scaled = Dq { d: (voltage.dq.d * counts) >> 7, q: (voltage.dq.q * counts) >> 7 };
        // What is computed now acts in the next period.
        let ahead = Rotation::at(rotor.predicted(tracking) + trim);
        let [most, slope] = [config.dead_time[0], config.dead_time[1]];
        let flowing = inverse_clarke(ahead.inverse_park(wanted));
        let correction = flowing.map(|current| svpwm::dead_time(current, slope, most));
        let [a, b, c] = svpwm::compare(ahead.inverse_park(scaled), correction, limits);
        if reversed { [a, c, b] } else { [a, b, c] }
    }

    /// Turns the frame until no back-EMF is left along d: what the integrator holds there, beyond what is fed forward, is that of an
    /// angle that is off. Only while the rotor turns fast enough to tell, and not farther than 60°.
    #[inline(always)]
    fn refine(&mut self, config: &Config, speed: i32, limited: bool) {
        let fast = speed.wrapping_add(config.telling) as u32 > 2 * config.telling as u32;
        if fast && !limited {
            let along = if speed < 0 { -self.currents.d() } else { self.currents.d() };
            self.trim = clamp(self.trim - along * config.refinement, 715_827_882);
        }
    }

    /// The local feedback of Simpkins and Todorov, Fig. 7, on one current: the modulation.
    pub fn local(&mut self, config: &Config, measured: i32, speed: i32) -> Modulation {
        let half_bus = self.state.bus / 2;
        let voltage = self.local.step(&config.local, self.state.wanted, measured, speed, half_bus);
        let modulation = (voltage << 15) / half_bus.max(1);
        Modulation::from_bits(clamp(modulation, 32_767) as i16)
    }
}
