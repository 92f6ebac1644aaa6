//! Linear Hall sensors, with what is wrong with cheap ones, and with broken ones.

use crate::error::{Error, finite, not_negative, positive, require};
use crate::magnets::{Magnets, Neighbours};
use crate::noise::Noise;
use crate::phasor::Phasor;

use core::f64::consts::TAU;

/// 120°.
const THIRD_TURN: f64 = TAU / 3.0;

/// Output range of a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Saturation {
    /// Lowest output, V.
    pub low_v: f64,
    /// Highest output, V.
    pub high_v: f64,
    /// Where the output begins to bend, as a share of the half range; 1 clips hard, below 1 a
    /// hyperbolic tangent leads into the rail.
    pub knee: f64,
}

impl Saturation {
    /// Hard at 0 and this voltage.
    #[must_use]
    pub const fn hard(high_v: f64) -> Self {
        Self { low_v: 0.0, high_v, knee: 1.0 }
    }

    fn apply(&self, volts: f64) -> f64 {
        let half = 0.5 * (self.high_v - self.low_v);
        let middle = 0.5 * (self.high_v + self.low_v);
        let out = volts - middle;
        let linear = self.knee * half;
        let beyond = out.abs() - linear;
        if beyond <= 0.0 {
            return volts;
        }
        let room = half - linear;
        let bent = if room > 0.0 { linear + room * libm::tanh(beyond / room) } else { half };
        middle + bent.copysign(out)
    }
}

/// A harmonic of the wave that need not be locked to the fundamental: size · sin(k·x + phase).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Harmonic {
    /// Relative to the fundamental.
    pub size: f64,
    /// Radians of the harmonic.
    pub phase_rad: f64,
}

impl Harmonic {
    /// None.
    pub const NONE: Self = Self { size: 0.0, phase_rad: 0.0 };
}

/// Second to seventh.
pub const HARMONICS: usize = 6;

/// One sensor: r = sin x + h3·sin 3x + h5·sin 5x + further harmonics, where x = θe − φ − ψ less the displacement of the
/// magnet that it sees, becomes offset + amplitude · strength of that magnet · r + coupling·currents.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct HallParameters {
    /// Output without field at 25 °C, V.
    pub offset_v: f64,
    /// Amplitude of the fundamental at 25 °C, V.
    pub amplitude_v: f64,
    /// Placement ψ, electrical radians, its error included.
    pub placement_rad: f64,
    /// Third harmonic h3, relative.
    pub third: f64,
    /// Fifth harmonic h5, relative.
    pub fifth: f64,
    /// Second to seventh harmonic of this sensor alone, in any phase; beside `third` and `fifth`.
    pub harmonics: [Harmonic; HARMONICS],
    /// Whole electrical turns by which the sensor sits further round the stator than its placement says.
    pub turns_away: u8,
    /// Drift of the output without field, V/K.
    pub offset_drift_v_k: f64,
    /// Relative change of the amplitude per kelvin.
    pub amplitude_drift_k: f64,
    /// Stray field of the three phase currents, V/A.
    pub coupling_v_a: [f64; 3],
    /// Standard deviation of the Gaussian noise, relative to the amplitude at 25 °C.
    pub noise: f64,
    /// Output range.
    pub saturation: Saturation,
    /// Bandwidth of the first-order lag, Hz; `None`: no lag.
    pub bandwidth_hz: Option<f64>,
    /// Delay of the output without any change of its shape, s; up to 32 steps of the simulation.
    pub delay_s: f64,
}

impl HallParameters {
    /// Without flaws, saturating at 0 and twice the offset.
    #[must_use]
    pub const fn ideal(offset_v: f64, amplitude_v: f64, placement_rad: f64) -> Self {
        Self {
            offset_v,
            amplitude_v,
            placement_rad,
            third: 0.0,
            fifth: 0.0,
            harmonics: [Harmonic::NONE; HARMONICS],
            turns_away: 0,
            offset_drift_v_k: 0.0,
            amplitude_drift_k: 0.0,
            coupling_v_a: [0.0; 3],
            noise: 0.0,
            saturation: Saturation::hard(2.0 * offset_v),
            bandwidth_hz: None,
            delay_s: 0.0,
        }
    }

    /// With the field of the windings: a current vector of `rated_a` acts like a magnet in its direction, with a share
    /// of the rotor's field. The windings lie 120° apart, that of phase A at zero; `phase_rad` is φ, as the plant has
    /// it.
    #[must_use]
    pub fn with_windings(mut self, share: f64, rated_a: f64, phase_rad: f64) -> Self {
        let volts_per_ampere = share * self.amplitude_v / rated_a;
        let away = -phase_rad - self.placement_rad;
        // A vector of the amplitude i has i · cos in each phase; their sum is 3/2 as long.
        self.coupling_v_a = [0.0, 1.0, 2.0].map(|phase| volts_per_ampere / 1.5 * libm::sin(phase * THIRD_TURN + away));
        self
    }

    fn check(&self) -> Result<(), Error> {
        finite(self.offset_v, "halls.offset_v")?;
        not_negative(self.amplitude_v, "halls.amplitude_v")?;
        finite(self.placement_rad, "halls.placement_rad")?;
        finite(self.third, "halls.third")?;
        finite(self.fifth, "halls.fifth")?;
        for Harmonic { size, phase_rad } in self.harmonics {
            finite(size, "halls.harmonics.size")?;
            finite(phase_rad, "halls.harmonics.phase_rad")?;
        }
        finite(self.offset_drift_v_k, "halls.offset_drift_v_k")?;
        finite(self.amplitude_drift_k, "halls.amplitude_drift_k")?;
        for coupling in self.coupling_v_a {
            finite(coupling, "halls.coupling_v_a")?;
        }
        not_negative(self.noise, "halls.noise")?;
        finite(self.saturation.low_v, "halls.saturation.low_v")?;
        finite(self.saturation.high_v, "halls.saturation.high_v")?;
        require(self.saturation.high_v > self.saturation.low_v, "halls.saturation.high_v", "above low_v")?;
        require((0.0..=1.0).contains(&self.saturation.knee), "halls.saturation.knee", "0 to 1")?;
        not_negative(self.delay_s, "halls.delay_s")?;
        self.bandwidth_hz.map_or(Ok(()), |hz| positive(hz, "halls.bandwidth_hz"))
    }
}

/// A rail of the sensors' supply.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Rail {
    /// 0 V.
    Low,
    /// The converter's reference or above.
    High,
}

/// What has happened to a sensor.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum HallFault {
    /// The output stays at a voltage.
    StuckAt(f64),
    /// A broken wire, pulled to a rail.
    Open(Rail),
    /// Connected with the output of the sensor of this number: both show the mean. A number that
    /// is not 0 to 2, or the sensor itself, does nothing.
    ShortedTo(usize),
    /// Gaussian noise of this standard deviation on top, V.
    Noisy(f64),
}

/// The rotor as the sensors see it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct View {
    /// Of the electrical angle.
    pub electrical: Phasor,
    pub mechanical_rad: f64,
}

/// What the sensors look at.
#[derive(Clone, Copy, Debug)]
struct Ring {
    magnets: Magnets,
    pole_pairs: u8,
    even: bool,
}

#[derive(Clone, Debug)]
struct Hall {
    parameters: HallParameters,
    /// Where it sits, mechanical radians.
    place_rad: f64,
    /// The magnets that it is between.
    neighbours: Neighbours,
    /// Second to seventh harmonic: size · cos and size · sin of the phase; `None`: not one.
    harmonics: Option<[Phasor; HARMONICS]>,
    /// Of -φ-ψ.
    placement: Phasor,
    offset_v: f64,
    amplitude_v: f64,
    lag: Option<Lag>,
    delay: Option<Delay>,
    volts: f64,
}

/// Steps of the simulation that a sensor's delay may be as long as.
const LONGEST_DELAY: usize = 32;

/// What went in, step by step, the newest last; between the steps it is taken to run straight.
#[derive(Clone, Copy, Debug)]
struct Delay {
    delay_s: f64,
    /// Length of the step to an input, and the input.
    steps: [(f64, f64); LONGEST_DELAY],
}

impl Delay {
    fn new(delay_s: f64) -> Self {
        Self { delay_s, steps: [(0.0, 0.0); LONGEST_DELAY] }
    }

    fn settle(&mut self, input: f64) {
        self.steps = [(f64::INFINITY, input); LONGEST_DELAY];
    }

    fn advance(&mut self, input: f64, span_s: f64) -> f64 {
        self.steps.rotate_left(1);
        self.steps[LONGEST_DELAY - 1] = (span_s, input);
        let mut left_s = self.delay_s;
        for pair in self.steps.windows(2).rev() {
            let ((_, before), (span_s, after)) = (pair[0], pair[1]);
            if left_s <= span_s {
                return if span_s.is_finite() { after + (before - after) * left_s / span_s } else { after };
            }
            left_s -= span_s;
        }
        self.steps[0].1
    }
}

/// First-order lag whose input is taken to run straight from sample to sample.
#[derive(Clone, Copy, Debug)]
struct Lag {
    time_constant_s: f64,
    /// The span that comes up most, what is kept of a deviation over it, and the time constant over it.
    usual_s: f64,
    relative: f64,
    kept: f64,
    input: f64,
}

impl Lag {
    fn new(bandwidth_hz: f64, usual_s: f64) -> Self {
        let time_constant_s = 1.0 / (TAU * bandwidth_hz);
        let relative = time_constant_s / usual_s;
        Self { time_constant_s, usual_s, relative, kept: libm::exp(-1.0 / relative), input: 0.0 }
    }

    /// Time constant over this span, and what is kept over it.
    fn over(&self, span_s: f64) -> (f64, f64) {
        if span_s == self.usual_s {
            return (self.relative, self.kept);
        }
        let relative = self.time_constant_s / span_s;
        (relative, libm::exp(-1.0 / relative))
    }
}

impl Hall {
    fn new(parameters: &HallParameters, phase_rad: f64, pole_pairs: u8, period_s: f64) -> Result<Self, Error> {
        parameters.check()?;
        let electrical_rad = phase_rad + parameters.placement_rad + TAU * f64::from(parameters.turns_away);
        let wave = |harmonic: Harmonic| {
            let (sin, cos) = libm::sincos(harmonic.phase_rad);
            Phasor { sin: harmonic.size * sin, cos: harmonic.size * cos }
        };
        Ok(Self {
            parameters: *parameters,
            place_rad: electrical_rad / f64::from(pole_pairs),
            neighbours: Neighbours::default(),
            harmonics: (parameters.harmonics != [Harmonic::NONE; HARMONICS]).then(|| parameters.harmonics.map(wave)),
            placement: Phasor::new(-phase_rad - parameters.placement_rad),
            offset_v: parameters.offset_v,
            amplitude_v: parameters.amplitude_v,
            lag: parameters.bandwidth_hz.map(|hz| Lag::new(hz, period_s)),
            delay: (parameters.delay_s > 0.0).then(|| Delay::new(parameters.delay_s)),
            volts: parameters.offset_v,
        })
    }

    /// Field as a voltage.
    fn field_v(&mut self, view: &View, ring: &Ring, currents_a: &[f64; 3]) -> f64 {
        let HallParameters { third, fifth, coupling_v_a, .. } = self.parameters;
        let mut x = view.electrical.plus(self.placement);
        let mut strength = 1.0;
        if !ring.even {
            let place_rad = view.mechanical_rad - self.place_rad;
            let (here, displaced_rad) = ring.magnets.at_near(place_rad, ring.pole_pairs, &mut self.neighbours);
            strength = here;
            x = x.plus(Phasor::new(-displaced_rad));
        }
        let sin = x.sin;
        let square = sin * sin;
        let mut relative = sin;
        if third != 0.0 {
            relative += third * sin * (3.0 - 4.0 * square);
        }
        if fifth != 0.0 {
            relative += fifth * sin * (5.0 - square * (20.0 - 16.0 * square));
        }
        if let Some(harmonics) = &self.harmonics {
            let mut multiple = x;
            for wave in harmonics {
                multiple = multiple.plus(x);
                relative += multiple.plus(*wave).sin;
            }
        }
        self.offset_v
            + self.amplitude_v * strength * relative
            + coupling_v_a[0] * currents_a[0]
            + coupling_v_a[1] * currents_a[1]
            + coupling_v_a[2] * currents_a[2]
    }

    fn settle(&mut self, field_v: f64) {
        self.volts = field_v;
        if let Some(lag) = &mut self.lag {
            lag.input = field_v;
        }
        if let Some(delay) = &mut self.delay {
            delay.settle(field_v);
        }
    }

    fn advance(&mut self, field_v: f64, span_s: f64) {
        let field_v = match &mut self.delay {
            Some(delay) => delay.advance(field_v, span_s),
            None => field_v,
        };
        let Some(lag) = &mut self.lag else {
            self.volts = field_v;
            return;
        };
        let (relative, kept) = lag.over(span_s);
        let behind = (field_v - lag.input) * relative;
        self.volts = field_v - behind + (self.volts - lag.input + behind) * kept;
        lag.input = field_v;
    }
}

/// The three sensors of a motor.
#[derive(Clone, Debug)]
pub(crate) struct Halls {
    halls: [Hall; 3],
    ring: Ring,
    faults: [Option<HallFault>; 3],
}

impl Halls {
    pub fn new(
        parameters: &[HallParameters; 3],
        phase_rad: f64,
        magnets: &Magnets,
        pole_pairs: u8,
        period_s: f64,
    ) -> Result<Self, Error> {
        finite(phase_rad, "hall_phase_rad")?;
        magnets.check()?;
        let ring = Ring { magnets: *magnets, pole_pairs, even: magnets.is_even() };
        let hall = |index: usize| {
            Hall::new(&parameters[index], phase_rad, pole_pairs, period_s).map_err(|error| error.at(index))
        };
        Ok(Self { halls: [hall(0)?, hall(1)?, hall(2)?], ring, faults: [None; 3] })
    }

    /// Sets a fault, or clears it.
    pub fn set_fault(&mut self, sensor: usize, fault: Option<HallFault>) {
        if let Some(entry) = self.faults.get_mut(sensor) {
            *entry = fault;
        }
    }

    pub fn set_temperature(&mut self, celsius: f64) {
        for hall in &mut self.halls {
            let (parameters, over) = (&hall.parameters, celsius - 25.0);
            hall.offset_v = parameters.offset_v + parameters.offset_drift_v_k * over;
            hall.amplitude_v = parameters.amplitude_v * (1.0 + parameters.amplitude_drift_k * over);
        }
    }

    /// The sensors have long seen this.
    pub fn settle(&mut self, view: View, currents_a: &[f64; 3]) {
        for hall in &mut self.halls {
            let field_v = hall.field_v(&view, &self.ring, currents_a);
            hall.settle(field_v);
        }
    }

    /// A span later they see this.
    pub fn advance(&mut self, view: View, currents_a: &[f64; 3], span_s: f64) {
        for hall in &mut self.halls {
            let field_v = hall.field_v(&view, &self.ring, currents_a);
            hall.advance(field_v, span_s);
        }
    }

    /// Voltages at the converter, with fresh noise.
    pub fn volts(&self, noise: &mut Noise) -> [f64; 3] {
        let mut volts = [0.0; 3];
        for (index, (volts, hall)) in volts.iter_mut().zip(&self.halls).enumerate() {
            let parameters = &hall.parameters;
            let own = noise.scaled(parameters.noise * parameters.amplitude_v);
            let burst = match self.faults[index] {
                Some(HallFault::Noisy(deviation_v)) => noise.scaled(deviation_v),
                _ => 0.0,
            };
            *volts = parameters.saturation.apply(hall.volts + own + burst);
        }
        for (sensor, fault) in self.faults.iter().enumerate() {
            match *fault {
                Some(HallFault::StuckAt(at)) => volts[sensor] = at,
                Some(HallFault::Open(Rail::Low)) => volts[sensor] = 0.0,
                Some(HallFault::Open(Rail::High)) => volts[sensor] = f64::MAX,
                Some(HallFault::ShortedTo(other)) if other < 3 => {
                    let mean = 0.5 * (volts[sensor] + volts[other]);
                    (volts[sensor], volts[other]) = (mean, mean);
                }
                _ => {}
            }
        }
        volts
    }
}
