//! What a drive with current sensing keeps and does beside finding the angle: control of torque, speed and position.
//!
//! The current control runs in every step, the rest in the slots of a [schedule](super::slots).

use crate::angle::{ElectricalAngle, Position};
use crate::commutation::Modulation;
use crate::commutation::frames::{Clarke, Dq, Rotation};
use crate::commutation::svpwm::{Circle, Modulator};
use crate::control::cogging;
use crate::control::current::{Integrators, Inverse, Local, Present};
use crate::control::settings::Config;
use crate::control::trajectory::Trajectory;
use crate::control::velocity::Integrator;
use crate::control::{Current, Speed};
use crate::drive::watch::Watch;
use crate::drive::{OUTER, Sample};
use crate::fault::Limits;
use crate::hall::track::{self, Tracker};
use crate::math::{clamp, high};
use crate::telemetry::Measurement;

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

impl State {
    /// Nothing.
    pub(crate) const NONE: Self =
        Self { phases: [0; 3], current: Dq { d: 0, q: 0 }, wanted: 0, voltage: Dq { d: 0, q: 0 }, bus: 0 };
}

/// Bits of the fraction of a current within the current control.
const CURRENT: u32 = 13;

/// The state of the loops.
#[derive(Clone, Copy, Debug)]
pub(super) struct Servo {
    pub watch: Watch,
    clarke: Clarke,
    /// What the alignment is off by, as the voltage along d tells while turning.
    trim: ElectricalAngle,
    modulator: Modulator,
    gains: Present,
    /// The current along q that is asked for, as the current control and as the dead time's correction know it.
    wanted: i32,
    flowing: i32,
    currents: Integrators,
    /// Currents and voltage of the last step.
    current: Dq,
    voltage: Dq,
    pub demand: Demand,
    /// Bus voltage of the present gains.
    bus: i32,
    trajectory: Trajectory,
    /// The speed that the outer loops ask for, and the current that they or the demand do.
    speed: i32,
    asked: i32,
    velocity: Integrator,
    local: Local,
    pub limits: Limits,
    /// What the tasks get.
    pub noted: Measurement,
}

impl Servo {
    pub const fn new() -> Self {
        Self {
            watch: Watch::new(),
            clarke: Clarke::new(0, [0; 3], false),
            trim: ElectricalAngle::ZERO,
            modulator: Modulator::NONE,
            gains: Present::ZERO,
            wanted: 0,
            flowing: 0,
            currents: Integrators::ZERO,
            current: Dq { d: 0, q: 0 },
            voltage: Dq { d: 0, q: 0 },
            demand: Demand::Voltage,
            bus: 1,
            trajectory: Trajectory::at(Position::from_bits(0), 0),
            speed: 0,
            asked: 0,
            velocity: Integrator::ZERO,
            local: Local::ZERO,
            limits: Limits::NONE,
            noted: Measurement::NONE,
        }
    }

    /// What the alignment is off by.
    pub const fn trim(&self) -> ElectricalAngle {
        self.trim
    }

    /// Everything at rest, following nothing; the amplifiers' zeros and the gains are those of now.
    pub fn reset(&mut self, config: &Config, rotor: &Tracker, sample: &Sample) {
        self.watch.zero(config);
        self.clarke = Clarke::new(config.shift, self.watch.offsets, config.reversed);
        self.modulator = config.modulator;
        // One by one: a whole new servo on its way over the stack would take as long as all the rest of the step.
        self.currents = Integrators::ZERO;
        (self.current, self.voltage) = (Dq { d: 0, q: 0 }, Dq { d: 0, q: 0 });
        self.demand = Demand::Voltage;
        self.trajectory = Trajectory::at(Position::from_bits(0), 0);
        (self.speed, self.asked) = (0, 0);
        self.velocity = Integrator::ZERO;
        self.local = Local::ZERO;
        self.limits = Limits::NONE;
        self.aim(config, 0);
        self.bus = config.bus(sample.bus);
        self.scale(config, sample);
        self.induce(config, rotor.speed());
    }

    /// Any command is a sign of life.
    pub fn heard(&mut self) {
        self.watch.heard();
        self.limits = self.limits.without(Limits::TIMEOUT);
    }

    /// Takes up a demand; from another kind, the loops begin with what there is.
    pub fn follow(&mut self, config: &Config, demand: Demand, rotor: &Tracker) {
        let moving = matches!(self.demand, Demand::Speed(_) | Demand::Position(_));
        if !moving {
            self.trajectory = Trajectory::at(coarse(rotor.smoothed()), rotor.speed());
            self.speed = rotor.speed();
            self.asked = self.noted.state.wanted;
            self.velocity = Integrator::holding(self.asked);
        }
        self.demand = demand;
        if let Demand::Current(Current(current)) = demand {
            self.asked = current;
            self.aim(config, current);
        }
    }

    /// What is left of the way to a position.
    #[inline(always)]
    pub fn look_ahead(&mut self, config: &Config) {
        if let Demand::Position(position) = self.demand {
            self.trajectory.look_ahead(coarse(position), &config.trajectory);
        }
    }

    /// The way to the demand, a step of the outer loops on.
    #[inline(always)]
    pub fn go(&mut self, config: &Config) {
        match self.demand {
            Demand::Voltage | Demand::Current(_) => {}
            Demand::Speed(Speed(speed)) => self.trajectory.towards_speed(speed, &config.trajectory),
            Demand::Position(_) => self.trajectory.go_on(&config.trajectory),
        }
    }

    /// The speed that the demand asks for.
    #[inline(always)]
    pub fn chase(&mut self, config: &Config, rotor: &Tracker) {
        self.speed = self.trajectory.speed();
        if let Demand::Position(_) = self.demand {
            let (wanted, measured) = (self.trajectory.position(), coarse(rotor.smoothed()));
            self.speed = config.position.speed(wanted, measured, self.speed, config.catching_up);
        }
    }

    /// The current that the speed asks for.
    #[inline(always)]
    pub fn turn(&mut self, config: &Config, rotor: &Tracker) {
        let (Demand::Speed(_) | Demand::Position(_)) = self.demand else { return };
        let forward = config.velocity.feed_forward(self.trajectory.acceleration());
        let most = self.watch.most;
        self.asked = self.velocity.step(&config.velocity, self.speed, rotor.speed(), forward, most);
    }

    /// Whether a rotor that should turn does not.
    #[inline(always)]
    pub fn stalls(&mut self, config: &Config, speed: i32) -> bool {
        let follows = matches!(self.demand, Demand::Speed(_) | Demand::Position(_));
        self.watch.stalls(config, follows && self.asked.abs() == self.watch.most, speed)
    }

    /// What the demand and the cogging ask for.
    #[inline(always)]
    pub fn choose(&mut self, config: &Config, rotor: &Tracker, cogging: Option<&cogging::Table>) {
        let balance = cogging.map_or(0, |table| table.current(rotor.angle()));
        let asked = self.asked + balance;
        self.aim(config, asked);
    }

    /// The current from now on, within its limit.
    #[inline(always)]
    fn aim(&mut self, config: &Config, asked: i32) {
        let most = self.watch.most;
        let wanted = clamp(asked, most);
        self.noted.state.wanted = wanted;
        self.wanted = wanted << CURRENT;
        self.flowing = clamp(wanted, config.steep) * config.ramp;
        let cut = wanted != asked;
        self.limits = self.limits.set(Limits::CURRENT, cut).set(Limits::HEAT, cut && most < config.max_current);
    }

    /// Takes up the bus voltage.
    #[inline(always)]
    pub fn scale(&mut self, config: &Config, sample: &Sample) {
        let bus = config.bus(sample.bus);
        let inverse = Inverse::new(bus);
        self.gains.scale(&config.gains, inverse);
        self.currents.follow(self.bus, bus, inverse);
        self.bus = bus;
    }

    /// Takes up the speed.
    #[inline(always)]
    pub fn induce(&mut self, config: &Config, speed: i32) {
        self.gains.induce(&config.gains, Inverse::new(self.bus), speed);
    }

    /// Turns the frame until no back-EMF is left along d: what the integrator holds there, beyond what is fed forward, is that of an
    /// angle that is off. Only while the rotor turns fast enough to tell, and not farther than 60°.
    #[inline(always)]
    pub fn refine(&mut self, config: &Config, speed: i32) {
        let fast = speed.wrapping_add(config.telling) as u32 > 2 * config.telling as u32;
        let limited = Circle::NEW.touches(self.voltage);
        self.limits = self.limits.set(Limits::DUTY, limited);
        if fast && !limited {
            let along = if speed < 0 { -self.currents.d() } else { self.currents.d() };
            let trim = self.trim.to_bits() - high(along << 8, config.refinement);
            self.trim = ElectricalAngle::from_bits(clamp(trim, 715_827_882));
        }
    }

    /// Currents in the frame of the rotor at the sampling instant.
    #[inline(always)]
    fn park(&mut self, angle: ElectricalAngle, sample: &Sample) {
        self.current = Rotation::at(angle).park(self.clarke.of(sample.currents));
    }

    /// Field-oriented: compare values of the three legs.
    #[inline(always)]
    pub fn field(&mut self, rotor: &Tracker, tracking: &track::Config, sample: &Sample) -> [u16; 3] {
        self.park(rotor.angle() + self.trim, sample);
        self.voltage = self.currents.step(&self.gains, self.wanted, self.current);
        // What is computed now acts in the next period.
        let ahead = Rotation::at(rotor.predicted(tracking) + self.trim);
        self.modulator.compare(ahead, self.voltage, self.flowing)
    }

    /// The local feedback of Simpkins and Todorov, Fig. 7, on the current between two legs or along q: the modulation.
    pub fn local(
        &mut self,
        config: &Config,
        rotor: &Tracker,
        sample: &Sample,
        legs: Option<(usize, usize)>,
    ) -> Modulation {
        self.park(rotor.angle(), sample);
        let measured = match legs {
            Some(legs) => across(self.phases(config, sample), legs),
            None => self.current.q >> CURRENT,
        };
        let half_bus = config.bus(sample.bus) / 2;
        let voltage = self.local.step(&config.local, self.noted.state.wanted, measured, rotor.speed(), half_bus);
        let modulation = (voltage << 15) / half_bus.max(1);
        Modulation::from_bits(clamp(modulation, 32_767) as i16)
    }

    /// More was asked for than the duty limits allow.
    pub fn cut_off(&mut self, cut: bool) {
        self.limits = self.limits.set(Limits::DUTY, cut);
    }

    /// Phase currents.
    #[inline(always)]
    fn phases(&self, config: &Config, sample: &Sample) -> [i32; 3] {
        let phase = |k: usize| (i32::from(sample.currents[k]) << config.shift) - (self.watch.offsets[k] >> 8);
        [phase(0), phase(1), phase(2)]
    }

    /// Takes everything down for the tasks.
    #[inline(always)]
    pub fn note(&mut self, config: &Config, rotor: &Tracker, sequence: u32, sample: &Sample) {
        let volts = self.bus.wrapping_mul(config.volts) >> 6;
        let state = State {
            phases: self.phases(config, sample),
            current: Dq { d: self.current.d >> CURRENT, q: self.current.q >> CURRENT },
            wanted: self.noted.state.wanted,
            voltage: Dq { d: high(self.voltage.d, volts), q: high(self.voltage.q, volts) },
            bus: self.bus,
        };
        self.noted = Measurement { rotor: *rotor, sequence, state, trim: self.trim };
    }
}

/// A position in the unit of the outer loops: what a speed moves on by in a step of theirs is its number.
const fn coarse(position: Position) -> Position {
    Position::from_bits(position.to_bits() >> OUTER.ilog2())
}

/// Current that flows in at one leg and out at another, as the length of a vector along q that makes the same mean
/// torque under block commutation: 2/√3 · 3/π = 1.103 times it.
fn across(phases: [i32; 3], (up, down): (usize, usize)) -> i32 {
    // Never out of range, which the compiler does not see.
    let phase = |leg: usize| phases.get(leg).copied().unwrap_or(0);
    (phase(up) - phase(down)) * 1129 / 2048
}
