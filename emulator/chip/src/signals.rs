//! What goes from pin to pin: gate signals, breaks, analogue voltages.

use crate::analog::{OPAMP_OUT, Threshold, VDDA, VREFINT};
use crate::board::{Board, Net};
use crate::chip::Chip;
use crate::device::{Input, Signal};
use crate::facts::Edge;
use crate::gpio::{Mode, Pin};
use bus::Cycle;
use core::array::from_fn;

/// Resistance and capacitance of a converter's input (DS12288, table 66).
const ADC_OHM: f64 = 1000.0;
const ADC_FARAD: f64 = 5e-12;
/// Less dead time than this at the pins is a mistake on any board, s.
const LEAST_DEAD_TIME_S: f64 = 100e-9;
/// Names of the phases.
pub(crate) const PHASES: [&str; 3] = ["U", "V", "W"];

/// What a board has at a channel of a converter.
pub(crate) fn describe(board: &Board, converter: usize, channel: u32) -> String {
    let net = |pin: Pin| match board.net(pin).map(|(net, _)| net) {
        Some(Net::Hall(number)) => format!("hall {} at {pin}", number + 1),
        Some(Net::Shunt { phase, .. }) => format!("phase current {} at {pin}", PHASES[phase]),
        Some(Net::Bus(_)) => format!("bus voltage at {pin}"),
        Some(Net::Ntc(_)) => format!("temperature at {pin}"),
        Some(Net::Potentiometer) => format!("potentiometer at {pin}"),
        Some(Net::Head(ring, head)) => format!("head {} of ring {} at {pin}", head + 1, ring + 1),
        None => OPAMP_OUT[..board.device.opamps()]
            .iter()
            .position(|out| *out == pin)
            .map_or_else(|| format!("nothing at {pin}"), |opamp| format!("OPAMP{} at {pin}", opamp + 1)),
    };
    match board.device.input(converter, channel) {
        Some(Input::Pin(pin)) => net(pin),
        Some(Input::Opamp(number)) => format!("OPAMP{} inside", number + 1),
        Some(inside) => format!("{inside:?}"),
        None => "nothing".into(),
    }
}

impl Chip {
    fn mode(&self, pin: Pin) -> Mode {
        self.gpio[usize::from(pin.port)].mode(pin.number)
    }

    /// Level at a pin as chip and board drive it; `None` where it floats.
    pub(crate) fn level(&self, pin: Pin, now: Cycle) -> Option<bool> {
        let outside = || self.outside(pin).or_else(|| self.gpio[usize::from(pin.port)].own_level(pin.number));
        match self.mode(pin) {
            Mode::Alternate(af) => match self.board.device.signal(pin, af) {
                Some(Signal::Gate(leg, side)) => self.timers[0].outputs.level(leg, side, now),
                // An idle line is high.
                Some(Signal::Tx(_) | Signal::Rx(_) | Signal::CanTx | Signal::CanRx) => Some(true),
                _ => outside(),
            },
            Mode::Output { .. } => self.gpio[usize::from(pin.port)].own_level(pin.number),
            Mode::Input => outside(),
            Mode::Analog => self.outside(pin),
        }
    }

    /// Level that the board gives a pin.
    fn outside(&self, pin: Pin) -> Option<bool> {
        match self.board.trip {
            Some((trip, limit_a)) if trip == pin => {
                let over = (0..3).any(|phase| self.motor.shunt_a(phase) < -limit_a);
                Some(self.break_pin.unwrap_or(!over))
            }
            _ if self.board.enable == Some(pin) => (!self.enable_open).then_some(true),
            _ => self.board.pulled_up.contains(&pin).then_some(true),
        }
    }

    /// Takes the gate signals from the pins.
    pub(crate) fn refresh_gates(&mut self, now: Cycle) {
        let awake = self.board.driver.standby.is_none_or(|pin| self.level(pin, now) == Some(true));
        let input = |leg: usize, side: usize| self.level(self.board.gates[leg][side], now).filter(|_| awake);
        let levels = from_fn(|leg| from_fn(|side| input(leg, side)));
        let now_s = self.now_s(now);
        self.bridge.set_inputs(levels, now_s);
        self.motor.set_switches(self.bridge.switches(), now_s);
        self.refresh_brake(now, now_s);
        for edge in self.timers[0].take_moe_edges() {
            let at_s = self.time.seconds(edge.at as f64);
            let by = match edge.cause {
                None => "software".into(),
                Some((input, 0)) => format!("break {}", ["TIM1_BKIN", "TIM1_BKIN2"][input]),
                Some((_, comparator)) => format!("break COMP{comparator}"),
            };
            self.record.moe.push(Edge { at_s, on: edge.on, by });
            if edge.on {
                self.check_before_on(at_s);
            }
        }
        self.check_dead_times(now_s);
        self.compare(now);
    }

    /// Takes the brake resistor's signal from its pin.
    fn refresh_brake(&mut self, now: Cycle, now_s: f64) {
        let Some((pin, ohm)) = self.board.brake else { return };
        let on = self.level(pin, now) == Some(true);
        if on != self.record.brake.last().is_some_and(|edge| edge.1) {
            self.record.brake.push((now_s, on));
            self.motor.set_brake(on.then_some(ohm), now_s);
        }
    }

    fn check_dead_times(&mut self, now_s: f64) {
        for (leg, phase) in self.bridge.legs.iter().zip(PHASES) {
            if leg.shortest_s() < LEAST_DEAD_TIME_S {
                let what = format!("dead time: leg {phase} has less than {:.0} ns", LEAST_DEAD_TIME_S * 1e9);
                self.record.find(now_s, what);
            }
        }
    }

    /// MOE has been set: what should have been in place before.
    fn check_before_on(&mut self, at_s: f64) {
        if let Some(pin) = self.board.driver.standby.filter(|pin| self.level(*pin, self.now) != Some(true)) {
            let what = format!("standby: MOE is set while {pin} keeps the {} asleep", self.board.driver.name);
            self.record.find(at_s, what);
        }
        let outputs = &self.timers[0].outputs;
        if !outputs.driven_when_off() {
            let what = "idle states: MOE is set while OSSI is clear, so the drivers' inputs float when it falls";
            self.record.find(at_s, what.into());
        }
        for leg in 0..3 {
            for side in 0..2 {
                let pin = self.board.gates[leg][side];
                let name = format!("TIM1_CH{}{}", leg + 1, ["", "N"][side]);
                if self.bridge.asks(side, outputs.level_if_off(leg, side)) {
                    let what = format!("idle states: MOE is set while {name} would switch {pin} on when it falls");
                    self.record.find(at_s, what);
                }
                let right = self.board.device.alternate(pin, Signal::Gate(leg, side)).unwrap_or(0);
                if self.mode(pin) != Mode::Alternate(right) {
                    let mode = match self.mode(pin) {
                        Mode::Alternate(af) => format!("AF{af}"),
                        other => format!("{other:?}"),
                    };
                    let what = format!("alternate function: {pin} is {mode} while MOE is set; {name} is AF{right}");
                    self.record.find(at_s, what);
                }
            }
        }
    }

    /// The serial port whose TX (`0`) or RX (`1`) is at the board's connector.
    pub(crate) fn serial_port(&self, direction: usize) -> Option<usize> {
        let pin = self.board.serial[direction];
        let Mode::Alternate(af) = self.mode(pin) else { return None };
        match (direction, self.board.device.signal(pin, af)?) {
            (0, Signal::Tx(port)) | (1, Signal::Rx(port)) => Some(port),
            _ => None,
        }
    }

    /// Whether FDCAN1 is at the board's transceiver, and that is awake.
    pub(crate) fn refresh_can(&mut self) {
        let Some(board) = self.board.can else { return };
        let carries = |pin, signal| match self.mode(pin) {
            Mode::Alternate(af) => self.board.device.signal(pin, af) == Some(signal),
            _ => false,
        };
        let shut = board.shutdown.is_some_and(|pin| self.level(pin, self.now) != Some(false));
        self.can.connected = carries(board.pins[0], Signal::CanTx) && carries(board.pins[1], Signal::CanRx) && !shut;
    }

    /// Comparators and break inputs; the motor has been advanced.
    pub(crate) fn compare(&mut self, now: Cycle) {
        for number in 0..self.board.device.comparators() {
            if self.comps[number].enabled() {
                let plus = self.pin_volts(self.comps[number].plus(number));
                let minus = match self.comps[number].minus(number) {
                    Threshold::Reference(quarters) => VREFINT * f64::from(quarters) / 4.0,
                    Threshold::Dac(dac, channel) => self.dacs[usize::from(dac) - 1].volts(usize::from(channel) - 1),
                    Threshold::Pin(pin) => self.pin_volts(pin),
                };
                self.comps[number].compare(plus, minus);
            }
        }
        if !self.timers[0].break_enabled(0) && !self.timers[0].break_enabled(1) {
            return;
        }
        let sources = from_fn(|input| {
            from_fn(|source| match source {
                0 => self.break_level(input, now),
                comparator => Some(self.comps[comparator - 1].output()),
            })
        });
        if self.timers[0].set_breaks(sources, now) {
            self.refresh_gates(now);
        }
    }

    /// Level at the pin that carries a break input.
    fn break_level(&self, input: usize, now: Cycle) -> Option<bool> {
        const PINS: [Pin; 9] = [
            Pin::of(b'A', 6),
            Pin::of(b'B', 12),
            Pin::of(b'A', 15),
            Pin::of(b'B', 8),
            Pin::of(b'B', 10),
            Pin::of(b'C', 13),
            Pin::of(b'A', 14),
            Pin::of(b'A', 11),
            Pin::of(b'C', 3),
        ];
        let carries = |pin: &&Pin| {
            matches!(self.mode(**pin), Mode::Alternate(af)
                if self.board.device.signal(**pin, af) == Some(Signal::Break(input)))
        };
        PINS.iter().find(carries).map(|pin| self.level(*pin, now).unwrap_or(false))
    }

    /// Voltage at a pin; the motor has been advanced.
    fn pin_volts(&mut self, pin: Pin) -> f64 {
        if let Some((net, _)) = self.board.net(pin) {
            return self.motor.volts(net);
        }
        let opamp = OPAMP_OUT[..self.board.device.opamps()].iter().position(|out| *out == pin);
        match opamp {
            Some(number) if self.opamps[number].enabled() && !self.opamps[number].internal() => {
                self.opamp_volts(number)
            }
            _ => 0.0,
        }
    }

    fn opamp_volts(&mut self, number: usize) -> f64 {
        let opamp = self.opamps[number];
        match (opamp.enabled(), opamp.plus(number), opamp.gain()) {
            (true, Some(pin), Some(gain)) => (self.pin_volts(pin) * gain).clamp(0.0, VDDA),
            _ => 0.0,
        }
    }

    /// What a converter holds after sampling a channel for so long, V.
    pub(crate) fn sample(&mut self, converter: usize, channel: u32, sampled_s: f64, at_s: f64) -> f64 {
        let common = usize::from(converter >= 2);
        let (volts, ohm) = match self.board.device.input(converter, channel) {
            Some(Input::Pin(pin)) => {
                if self.mode(pin) != Mode::Analog {
                    let name = self.adcs[converter].name();
                    self.record.find(at_s, format!("{name}: samples {pin}, which is not analogue"));
                }
                let net = self.board.net(pin);
                (self.pin_volts(pin) + self.motor.noise_v(net.map(|(net, _)| net)), net.map_or(100.0, |(_, ohm)| ohm))
            }
            Some(Input::Opamp(number)) if self.opamps[number].internal() => {
                (self.opamp_volts(number) + self.motor.noise_v(None), 100.0)
            }
            Some(Input::Temperature) if self.commons[common].connects(23) => (0.76, 100.0),
            Some(Input::Battery) if self.commons[common].connects(24) => (VDDA / 3.0, 100.0),
            Some(Input::Reference) if self.commons[common].connects(22) => (VREFINT, 100.0),
            _ => {
                let name = self.adcs[converter].name();
                self.record.find(at_s, format!("{name}: channel {channel} is connected to nothing"));
                (0.0, 100.0)
            }
        };
        let left = (-sampled_s / ((ohm + ADC_OHM) * ADC_FARAD)).exp();
        let held = volts + (self.held_v[converter] - volts) * left;
        self.held_v[converter] = held;
        held
    }
}
