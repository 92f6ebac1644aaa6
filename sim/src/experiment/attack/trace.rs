//! What led to a breach, period by period, for somebody who looks into it.

use plant::Truth;
use std::collections::VecDeque;
use std::fmt::Write;

/// Control periods that are kept: a fifth of a second at 40 kHz.
const KEPT: usize = 8000;

/// The last periods.
#[derive(Clone, Debug, Default)]
pub struct Trace(VecDeque<[f64; 9]>);

impl Trace {
    /// One more.
    pub(super) fn push(&mut self, truth: &Truth, began_s: f64) {
        if self.0.len() == KEPT {
            self.0.pop_front();
        }
        let [a, b, c] = truth.currents_a;
        let Truth { speed_rad_s, mechanical_angle_rad, torque_nm, load_nm, bus_v, .. } = *truth;
        self.0.push_back([
            truth.time_s - began_s,
            a,
            b,
            c,
            bus_v,
            mechanical_angle_rad,
            speed_rad_s,
            torque_nm,
            load_nm,
        ]);
    }

    /// As a table with commas.
    pub fn csv(&self) -> String {
        let mut text = "time_s,a_a,b_a,c_a,bus_v,angle_rad,speed_rad_s,torque_nm,load_nm\n".to_string();
        for row in &self.0 {
            let cells: Vec<_> = row.iter().map(|value| format!("{value:.6}")).collect();
            // A text takes all.
            let _ = writeln!(text, "{}", cells.join(","));
        }
        text
    }
}
