use sim::experiment::coil::*;
use sim::commissioning::{Bench, commission};
use sim::motors::MOTORS;
use sim::rig::Rig;
fn main() {
    let name = std::env::args().nth(1).unwrap();
    let share: f64 = std::env::args().nth(2).unwrap().parse().unwrap();
    let motor = MOTORS.iter().find(|m| m.name == name).unwrap();
    for seed in 1..4 {
        let plant = with_windings(motor.plant(seed), share, motor.limit_a.into(), seed);
        let mut bench = Bench::new(Rig::new(&plant, &motor.settings(), seed).unwrap());
        let outcome = match commission(&mut bench, motor.settings(), motor.limit_a) { Ok(o) => o, Err(e) => { println!("commission: {e}"); continue } };
        let c = outcome.settings.control.unwrap();
        println!("R {} L {} flux {} J {} speed bw {} tracking {} pos {} acc {} max {}", c.resistance_ohm, c.inductance_h, c.flux_linkage_wb, c.inertia_kgm2, c.speed_bandwidth_hz, outcome.settings.tracking_bandwidth_hz, c.position_bandwidth_hz, c.max_acceleration_rad_s2, c.max_speed_rad_s);
        println!("{:?}", measure(&mut bench.rig).map_err(|e| format!("{e:#}")));
    }
}
