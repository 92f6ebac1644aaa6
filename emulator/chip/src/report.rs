//! What was seen, as the report has it.

use crate::chip::Chip;
use crate::facts::{Clock, Facts, Leg, Pwm, Watchdog, WindowWatchdog};
use crate::signals::PHASES;
use measure::Range;
use std::collections::BTreeMap;

impl Chip {
    /// All of it.
    pub(crate) fn report(&self) -> Facts {
        Facts {
            clocks: self.clock_facts(),
            pwm: self.pwm_facts(),
            legs: core::array::from_fn(|leg| self.leg_facts(leg)),
            sampling: self.record.sampling.clone(),
            triggers: self.record.triggers,
            missed_triggers: self.adcs.iter().map(|adc| adc.missed).sum(),
            unread_sequences: self.record.unread,
            moe: self.record.moe.clone(),
            brake: self.record.brake.clone(),
            watchdog: (self.iwdg.runs() || self.record.bites > 0).then(|| Watchdog {
                timeout_s: self.iwdg.timeout_s(),
                interval_s: self.iwdg.interval_s,
                bites: self.record.bites,
            }),
            window_watchdog: (self.wwdg.runs() || self.record.window_bites > 0)
                .then_some(WindowWatchdog { used: self.wwdg.used, bites: self.record.window_bites }),
            flash_operations: self.flash.operations,
            findings: self.record.findings.clone(),
            events: self.record.events.clone(),
            motor: self.motor_facts(),
        }
    }

    fn clock_facts(&self) -> Vec<Clock> {
        let clocks = &self.clocks;
        let mut list = vec![("SYSCLK", clocks.sysclk), ("HCLK", clocks.hclk)];
        list.extend([("PCLK1", clocks.pclk1), ("PCLK2", clocks.pclk2)]);
        list.extend(
            [0, 1].map(|bus| (["APB1 timers", "APB2 timers"][bus], clocks.hclk / clocks.timer_ratio[bus] as f64)),
        );
        for (group, name) in [(0, "ADC12"), (1, "ADC345")] {
            let ratio = self.commons[group].clock(&self.rcc, clocks).ratio;
            if 2 * group < self.adcs.len() && ratio.is_finite() {
                list.push((name, clocks.hclk / ratio));
            }
        }
        for direction in [0, 1] {
            if let Some(port) = self.serial_port(direction) {
                list.push((
                    ["serial TX, baud", "serial RX, baud"][direction],
                    clocks.hclk / self.usarts[port].bit_cycles(),
                ));
            }
        }
        if self.can.runs() {
            let timing = self.can.timing();
            list.push(("FDCAN1 nominal, bit/s", 1.0 / timing.nominal.bit_s()));
            list.push(("FDCAN1 data, bit/s", 1.0 / timing.data.bit_s()));
        }
        list.into_iter().map(|(name, hz)| Clock { name: name.into(), hz }).collect()
    }

    fn pwm_facts(&self) -> Option<Pwm> {
        let timer = &self.timers[0];
        let settings = timer.settings();
        settings.runs.then(|| Pwm {
            hz: self.clocks.hclk / timer.period() as f64,
            mode: settings.mode,
            reload: settings.reload,
            dead_time_ns: settings.dead_time as f64 / self.clocks.hclk * 1e9,
            off_state: if timer.outputs.driven_when_off() {
                "forced to the idle level".into()
            } else {
                "left to the pull resistors".into()
            },
            breaks: [0, 1].into_iter().flat_map(|input| timer.break_names(input)).collect(),
        })
    }

    fn leg_facts(&self, leg: usize) -> Leg {
        let seen = &self.bridge.legs[leg];
        let level = |high: bool| if high { "high".to_string() } else { "low".to_string() };
        let ns = |range: &Range| Range { min: range.min * 1e9, max: range.max * 1e9, count: range.count };
        Leg {
            pins: self.board.gates[leg].map(|pin| pin.to_string()),
            driver_on_level: [level(true), level(!self.board.driver.low_inverted)],
            timer_on_level: self.timers[0].outputs.active_low(leg).map(|low| level(!low)),
            dead_time_rising_ns: ns(&seen.rising_s),
            dead_time_falling_ns: ns(&seen.falling_s),
            shoot_through: seen.shoot_through.0,
            first_shoot_through_s: seen.shoot_through.1,
        }
    }

    fn motor_facts(&self) -> BTreeMap<String, f64> {
        let truth = self.motor.truth();
        let mut facts = BTreeMap::from([
            ("angle_turns".to_string(), truth.mechanical_angle_rad / core::f64::consts::TAU),
            ("electrical_angle_rad".to_string(), truth.electrical_angle_rad),
            ("speed_rad_s".to_string(), truth.speed_rad_s),
            ("torque_nm".to_string(), truth.torque_nm),
            ("bus_v".to_string(), truth.bus_v),
        ]);
        for (phase, current) in PHASES.iter().zip(truth.currents_a) {
            facts.insert(format!("current_{}_a", phase.to_lowercase()), current);
        }
        facts
    }
}
