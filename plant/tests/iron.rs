//! Salience and saturation against closed formulas and an energy balance.
use crate::common::*;
use plant::{InverterModel, Iron, Legs, Plant, PlantParameters};
use std::f64::consts::TAU;

fn with(iron: Iron, change: impl Fn(&mut PlantParameters)) -> Plant {
    let mut parameters = PlantParameters::ideal();
    parameters.motor.iron = iron;
    change(&mut parameters);
    Plant::new(&parameters, 0).unwrap()
}

/// Duties of a voltage vector in the frame of the rotor, at an electrical angle.
fn vector([d_v, q_v]: [f64; 2], electrical_rad: f64) -> Legs {
    let duty = |shift: f64| {
        let angle = electrical_rad + shift;
        0.5 + (d_v * angle.cos() - q_v * angle.sin()) / BUS_V
    };
    Legs::pwm([duty(0.0), duty(-TAU / 3.0), duty(TAU / 3.0)])
}

/// Currents along d and q.
fn currents(plant: &Plant) -> [f64; 2] {
    let truth = plant.truth();
    let [mut d, mut q] = [0.0; 2];
    for (current, shift) in truth.currents_a.iter().zip([0.0, -TAU / 3.0, TAU / 3.0]) {
        let angle = truth.electrical_angle_rad + shift;
        d += current * angle.cos() / 1.5;
        q -= current * angle.sin() / 1.5;
    }
    [d, q]
}

#[test]
fn the_current_of_a_locked_rotor_grows_by_the_inductance_of_its_direction() {
    let salience = 0.25;
    for degrees in [0.0, 17.0, 100.0, 291.0_f64] {
        for (direction, inductance_h) in [([1.0, 0.0], L * (1.0 - salience)), ([0.0, 1.0], L * (1.0 + salience))] {
            let mut plant = with(Iron { salience, ..Iron::NONE }, |_| ());
            plant.set_dyno(Some(0.0)).unwrap();
            let electrical_rad = degrees.to_radians();
            plant.place(electrical_rad / PAIRS, 0.0).unwrap();
            let legs = vector(direction.map(|share| 3.0 * share), electrical_rad);
            plant.advance(&legs);
            for period in 1..=30 {
                plant.advance(&legs);
                let grown = 1.0 - (-f64::from(period) * plant.period_s() * R / inductance_h).exp();
                let [d, q] = currents(&plant);
                let expected = direction.map(|share| 3.0 / R * share * grown);
                close(d, expected[0], 4e-3 * 3.0 / R);
                close(q, expected[1], 4e-3 * 3.0 / R);
            }
        }
    }
}

/// v = R i + ω J L i + ω λ along q. 25 µs of held duties at 200 Hz electrical turn the vector by 1.8°, which the mean
/// shortens by 4e-5; the ripple of the sampled current sets the tolerance.
#[test]
fn a_turning_rotor_shows_both_inductances_and_their_torque() {
    let (salience, speed) = (0.25, TAU * 200.0);
    let [l_d, l_q] = [L * (1.0 - salience), L * (1.0 + salience)];
    for [d, q] in [[-1.5, 1.0], [0.5, -2.0], [-2.0, 0.0]] {
        let mut plant = with(Iron { salience, ..Iron::NONE }, |_| ());
        plant.set_dyno(Some(speed / PAIRS)).unwrap();
        let volts = [R * d - speed * l_q * q, R * q + speed * (l_d * d + FLUX)];
        let mut sums = [0.0; 4];
        for period in 0..2000 {
            let ahead = plant.truth().electrical_angle_rad + 1.5 * plant.period_s() * speed;
            plant.advance(&vector(volts, ahead));
            if period >= 1000 {
                let [along, across] = currents(&plant);
                for (sum, term) in sums.iter_mut().zip([along, across, plant.truth().torque_nm, 1.0]) {
                    *sum += term;
                }
            }
        }
        let [mean_d, mean_q, torque_nm] = [0, 1, 2].map(|k| sums[k] / sums[3]);
        close(mean_d, d, 0.02);
        close(mean_q, q, 0.02);
        let expected = 1.5 * PAIRS * (FLUX * mean_q + (l_d - l_q) * mean_d * mean_q);
        close(torque_nm, expected, 1e-3 * 1.5 * PAIRS * FLUX);
    }
}

/// At the current of its name the flux is 1/√2 of L I: a small step more sees L/2^1.5 along the current.
#[test]
fn a_saturated_winding_takes_a_step_with_less_inductance() {
    let mut plant = with(Iron { saturation_a: 3.0, ..Iron::NONE }, |_| ());
    plant.set_dyno(Some(0.0)).unwrap();
    plant.place(0.0, 0.0).unwrap();
    hold(&mut plant, vector([3.0 * R, 0.0], 0.0), 400);
    close(currents(&plant)[0], 3.0, 1e-6);
    let step = vector([3.03 * R, 0.0], 0.0);
    plant.advance(&step);
    plant.advance(&step);
    let grown = 1.0 - (-plant.period_s() * R / (L / 2.0_f64.powf(1.5))).exp();
    close(currents(&plant)[0], 3.0 + 0.03 * grown, 3e-4);
}

/// All that goes in is copper loss, motion or stored, for a motor whose inductances differ and saturate; co-energy and
/// energy of the iron are not needed where begin and end are without current.
#[test]
fn no_motion_makes_energy_of_nothing() {
    let iron = Iron { salience: 0.3, saturation_a: 6.0 };
    let mut plant = with(iron, |p| p.inverter.model = InverterModel::Averaged { steps: 4 });
    let (mut input, mut copper) = (0.0, 0.0);
    for period in 0..12_000 {
        let volts = match period {
            0..5000 => 8.0,
            5000..9000 => -8.0,
            _ => 0.0,
        };
        let mut old = plant.truth().currents_a;
        let legs = on_q_axis(&plant, volts);
        plant.advance_with(&legs, |slice| {
            for (k, old) in old.iter_mut().enumerate() {
                let end = slice.end_currents_a[k];
                input += slice.terminals_v[k] * slice.currents_a[k] * slice.span_s;
                copper += R * (*old * *old + *old * end + end * end) / 3.0 * slice.span_s;
                *old = end;
            }
        });
    }
    let truth = plant.truth();
    let moving = 0.5 * J * truth.speed_rad_s * truth.speed_rad_s;
    let gone = input.max(copper);
    assert!(gone > 0.5, "{input} J in, {copper} J lost");
    close(input, copper + moving, 2e-3 * gone);
}

#[test]
fn what_cannot_be_is_refused() {
    for (iron, name) in [
        (Iron { salience: 0.6, ..Iron::NONE }, "motor.iron.salience"),
        (Iron { salience: f64::NAN, ..Iron::NONE }, "motor.iron.salience"),
        (Iron { saturation_a: 0.0, ..Iron::NONE }, "motor.iron.saturation_a"),
        (Iron { saturation_a: f64::NAN, ..Iron::NONE }, "motor.iron.saturation_a"),
    ] {
        let mut parameters = PlantParameters::ideal();
        parameters.motor.iron = iron;
        let error = Plant::new(&parameters, 0).expect_err("refused").to_string();
        assert!(error.contains(name), "{error}");
    }
}
