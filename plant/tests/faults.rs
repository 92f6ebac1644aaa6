//! What breaks at run time, against closed formulas.
use crate::common::*;
use plant::{
    AmplifierFault, InverterModel, Legs, Plant, PlantParameters, Thermistor, ThermistorFault, Transistor, Wires,
};
use std::f64::consts::TAU;

const LONG: usize = 400;

fn locked() -> Plant {
    let mut plant = ideal();
    plant.set_dyno(Some(0.0)).unwrap();
    plant
}

fn currents(plant: &Plant) -> [f64; 3] {
    plant.truth().currents_a
}

#[track_caller]
fn all_close(values: [f64; 3], expected: [f64; 3], tolerance: f64) {
    for (value, expected) in values.into_iter().zip(expected) {
        close(value, expected, tolerance);
    }
}

/// The two windings that are left are in series.
#[test]
fn an_open_phase_leaves_two_in_series() {
    for model in [InverterModel::Averaged { steps: 1 }, InverterModel::Averaged { steps: 4 }, InverterModel::Switched] {
        let mut parameters = PlantParameters::ideal();
        parameters.inverter.model = model;
        let mut plant = Plant::new(&parameters, 0).unwrap();
        plant.set_dyno(Some(0.0)).unwrap();
        plant.set_phase_open(0, true);
        hold(&mut plant, Legs::pwm([0.9, 0.6, 0.2]), LONG);
        let flows = 0.4 * BUS_V / (2.0 * R);
        // Switched, the ripple bends a little with R.
        all_close(currents(&plant), [0.0, flows, -flows], 5e-3);
        plant.set_phase_open(0, false);
        hold(&mut plant, Legs::pwm([0.9, 0.6, 0.2]), LONG);
        let mean = (0.9 + 0.6 + 0.2) / 3.0;
        all_close(currents(&plant), [0.9, 0.6, 0.2].map(|duty| (duty - mean) * BUS_V / R), 1e-2);
    }
}

/// The arc takes what the open winding carried; the flux of the loop of the other two, L (i_b − i_c), stays.
#[test]
fn the_loop_that_is_left_keeps_its_flux() {
    let mut plant = locked();
    hold(&mut plant, Legs::pwm([0.8, 0.5, 0.3]), LONG);
    let before = currents(&plant);
    plant.set_phase_open(0, true);
    let after = currents(&plant);
    assert!(before[0].abs() > 1.0);
    close(after[0], 0.0, 0.0);
    close(after[1] + after[2], 0.0, 1e-12);
    close(after[1] - after[2], before[1] - before[2], 1e-12);
    plant.set_phase_open(1, true);
    all_close(currents(&plant), [0.0; 3], 0.0);
    hold(&mut plant, Legs::pwm([0.8, 0.5, 0.3]), LONG);
    all_close(currents(&plant), [0.0; 3], 0.0);
}

/// The line-to-line EMF of two phases drives a current through twice the impedance of one.
#[test]
fn two_phases_short_circuited_at_a_turning_rotor() {
    let mut plant = ideal();
    let speed = 200.0;
    plant.set_dyno(Some(speed)).unwrap();
    plant.set_phase_open(2, true);
    let electrical = PAIRS * speed;
    let peak = 3_f64.sqrt() * FLUX * electrical / (2.0 * (R * R + (electrical * L).powi(2)).sqrt());
    let mut most = 0.0_f64;
    for period in 0..4000 {
        plant.advance(&Legs::pwm([0.0; 3]));
        let [a, b, c] = currents(&plant);
        close(c, 0.0, 0.0);
        close(a + b, 0.0, 1e-12);
        if period > LONG {
            most = most.max(a.abs());
        }
    }
    close(most, peak, 2e-3 * peak);
}

/// Beyond the bus, the EMF of a fast rotor flows through the diodes, but not through those of an open phase.
#[test]
fn an_open_phase_has_no_way_through_the_diodes() {
    for open in [false, true] {
        let mut plant = ideal();
        plant.set_dyno(Some(1.3 * BUS_V / (3_f64.sqrt() * FLUX * PAIRS))).unwrap();
        plant.set_phase_open(1, open);
        let mut most = [0.0_f64; 3];
        for _ in 0..2000 {
            plant.advance(&Legs::OFF);
            for (most, current) in most.iter_mut().zip(currents(&plant)) {
                *most = most.max(current.abs());
            }
        }
        assert!(most[0] > 0.1 && most[2] > 0.1, "{most:?}");
        assert_eq!(most[1] == 0.0, open, "{most:?}");
    }
}

/// Without its upper transistor, a leg carries current out of the motor only: by the diode while the lower is off.
#[test]
fn a_dead_upper_transistor() {
    let mut plant = locked();
    plant.set_dead_transistor(0, Some(Transistor::Upper));
    hold(&mut plant, Legs::pwm([0.5, 0.0, 0.0]), LONG);
    all_close(currents(&plant), [0.0; 3], 1e-9);
    // Ripple apart, which passes through zero at the valley.
    let duties = [0.2, 0.8, 0.8];
    hold(&mut plant, Legs::pwm(duties), LONG);
    let flows = -0.6 * BUS_V / (1.5 * R);
    all_close(currents(&plant), [flows, -0.5 * flows, -0.5 * flows], 0.02 * flows.abs());
    close(plant.shown_a()[0], flows, 0.02 * flows.abs());
}

/// Without its lower transistor, a leg carries current into the motor only, and its shunt shows what the diode passes.
#[test]
fn a_dead_lower_transistor() {
    let mut plant = locked();
    plant.set_dead_transistor(0, Some(Transistor::Lower));
    hold(&mut plant, Legs::pwm([0.0, 0.5, 0.5]), LONG);
    all_close(currents(&plant), [0.0; 3], 1e-9);
    hold(&mut plant, Legs::pwm([0.5, 0.0, 0.0]), LONG);
    let flows = 0.5 * BUS_V / (1.5 * R);
    all_close(currents(&plant), [flows, -0.5 * flows, -0.5 * flows], 0.02 * flows);
    close(plant.shown_a()[0], flows, 0.02 * flows);
    // A current out of the motor has to go up to the bus, past the shunt.
    plant.set_dead_transistor(0, None);
    hold(&mut plant, Legs::pwm([0.0, 0.5, 0.5]), LONG);
    plant.set_dead_transistor(0, Some(Transistor::Lower));
    assert!(plant.currents_a()[0] < -1.0);
    close(plant.shown_a()[0], 0.0, 0.0);
}

#[test]
fn wires_lead_where_they_are_put() {
    let every = [0, 1, 2].map(Wires::moved_on).into_iter().chain([0, 1, 2].map(Wires::swapped));
    let mut seen = Vec::new();
    for wires in every {
        let ends = [0, 1, 2].map(|wire| wires.of(wire));
        assert!(!seen.contains(&ends));
        seen.push(ends);
        let mut plant = locked();
        let straight = plant.sample().halls;
        plant.set_motor_wires(wires);
        plant.set_hall_wires(wires);
        let duties = [0.9, 0.5, 0.4];
        hold(&mut plant, Legs::pwm(duties), LONG);
        let legs = duties.map(|duty| (duty - 0.6) * BUS_V / R);
        all_close(plant.currents_a(), legs, 1e-3);
        for leg in 0..3 {
            close(currents(&plant)[ends[leg]], legs[leg], 1e-3);
            assert_eq!(plant.sample().halls[leg], straight[ends[leg]]);
            let code = (0.2 * legs[leg] + 1.65) * 4096.0 / 3.3;
            close(f64::from(plant.sample().currents[leg]), code, 1.0);
        }
    }
    assert_eq!(seen.len(), 6);
}

/// A field along leg A holds the rotor at 0° where A's wire is at winding A, and at 120° where it is at B.
#[test]
fn wires_moved_on_turn_the_field() {
    for (moved, expected) in [(0, 0.0), (1, TAU / 3.0), (2, -TAU / 3.0)] {
        let mut parameters = PlantParameters::ideal();
        parameters.motor.friction.viscous_nms = 1e-3;
        let mut plant = Plant::new(&parameters, 0).unwrap();
        plant.place(0.1, 0.0).unwrap();
        plant.set_motor_wires(Wires::moved_on(moved));
        hold(&mut plant, Legs::pwm([0.6, 0.4, 0.4]), 40_000);
        close(plant.truth().electrical_angle_rad, expected, 1e-3);
    }
}

#[test]
fn amplifiers_show_what_they_can() {
    let mut plant = locked();
    let legs = Legs::pwm([0.7, 0.5, 0.3]);
    hold(&mut plant, legs, LONG);
    let flows = currents(&plant);
    assert!(flows[0] > 1.0);
    let code = |plant: &mut Plant| f64::from(plant.sample().currents[0]);
    for (fault, shown) in
        [(AmplifierFault::Dead, 0.0), (AmplifierFault::Frozen(-0.7), -0.7), (AmplifierFault::Gain(0.4), 0.4 * flows[0])]
    {
        plant.set_amplifier_fault(0, Some(fault)).unwrap();
        close(code(&mut plant), (0.2 * shown + 1.65) * 4096.0 / 3.3, 0.51);
        // The others, and what flows, are as before.
        all_close(currents(&plant), flows, 0.0);
        all_close(plant.shown_a(), [shown, flows[1], flows[2]], 1e-12);
    }
    assert!(plant.set_amplifier_fault(0, Some(AmplifierFault::Gain(f64::NAN))).is_err());
    plant.set_amplifier_fault(0, None).unwrap();
    close(code(&mut plant), (0.2 * flows[0] + 1.65) * 4096.0 / 3.3, 0.51);
}

/// The last compare values stand, whatever comes after them in the control's mind.
#[test]
fn without_a_trigger_the_last_vector_stands() {
    let mut plant = locked();
    plant.advance(&Legs::pwm([0.6, 0.4, 0.4]));
    plant.advance_untriggered(LONG as u32);
    close(currents(&plant)[0], 0.2 * BUS_V / (1.5 * R), 1e-3);
    plant.advance(&Legs::OFF);
    plant.advance_untriggered(LONG as u32);
    all_close(currents(&plant), [0.0; 3], 1e-9);
}

/// A rotor driven from outside charges a bus that gives nothing back up to the peak of its line-to-line EMF.
#[test]
fn a_bus_that_takes_nothing_back_is_pumped_up() {
    let peak = 1.3 * BUS_V;
    let mut parameters = PlantParameters::ideal();
    parameters.bus.capacitance_f = 47e-6;
    parameters.bus.source_ohm = 0.1;
    for regenerative in [true, false] {
        let mut plant = Plant::new(&parameters, 0).unwrap();
        plant.set_regenerative(regenerative).unwrap();
        plant.set_dyno(Some(peak / (3_f64.sqrt() * FLUX * PAIRS))).unwrap();
        for _ in 0..40_000 {
            plant.advance(&Legs::OFF);
        }
        let expected = if regenerative { BUS_V } else { peak };
        close(plant.bus_v(), expected, 0.01 * expected);
    }
    assert!(ideal().set_regenerative(false).is_err());
}

#[test]
fn a_thermistor_open_shorted_and_whole() {
    let ntc = Thermistor { pull_up_ohm: 4700.0, nominal_ohm: 10e3, beta_k: 3425.0, fault: None };
    close(ntc.ratio(25.0), 10.0 / 14.7, 1e-12);
    // Half of the resistance at 25 °C, where 1/T is smaller by ln 2 / B.
    let half = 1.0 / (1.0 / 298.15 - 2_f64.ln() / 3425.0) - 273.15;
    close(ntc.ratio(half), 5.0 / 9.7, 1e-12);
    close(Thermistor { fault: Some(ThermistorFault::Open), ..ntc }.ratio(25.0), 1.0, 0.0);
    close(Thermistor { fault: Some(ThermistorFault::Shorted), ..ntc }.ratio(25.0), 0.0, 0.0);
}
