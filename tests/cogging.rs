//! The drive learns the cogging and balances it, against what the simulated motor's magnets do.

use hallservo::commutation::Commutation;
use hallservo::control::cogging::Table;
use hallservo::drive::Command;
use hallservo::mode::Mode;
use hallservo::service::learning::Plan;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{Friction, PlantParameters};
use sim::rig::Rig;
use sim::statistics::Statistics;
use std::f64::consts::TAU;

/// Bandwidths of the speed control and the tracker: for turning evenly, and the default for holding against loads.
const SMOOTH: [f32; 2] = [20.0, 140.0];
const STIFF: [f32; 2] = [60.0, 280.0];

fn calibrated(plant: &PlantParameters, [speed_hz, tracking_hz]: [f32; 2], seed: u64) -> Rig {
    let guard = GuardSettings { command_timeout_s: 60.0, ..GuardSettings::default() };
    let control =
        Control { guard, speed_bandwidth_hz: speed_hz, position_bandwidth_hz: speed_hz / 4.0, ..Control::default() };
    let settings = Settings { control: Some(control), tracking_bandwidth_hz: tracking_hz, ..Settings::default() };
    let mut rig = Rig::new(plant, &settings, seed).unwrap();
    rig.calibrate(|_| ()).unwrap();
    // The amplifiers' zeros are averaged while the bridge is off.
    rig.run(0.05, |_, _| ());
    rig
}

/// RMS of the torque of currents and cogging, at zero command and turned slowly.
fn net_torque(rig: &mut Rig) -> f64 {
    rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
    rig.arm().unwrap();
    rig.command(Command::Current(rig.control().unwrap().current(0.0).unwrap())).unwrap();
    rig.plant.set_dyno(Some(3.0)).unwrap();
    rig.run(0.1, |_, _| ());
    // The mean over the angle, for the currents are noisy.
    let mut by_angle = sim::statistics::ByAngle::new(360);
    rig.run(TAU / 3.0, |_, period| {
        let truth = &period.truth;
        by_angle.push(truth.electrical_angle_rad.to_degrees(), truth.torque_nm + truth.cogging_nm);
    });
    rig.plant.set_dyno(Some(0.0)).unwrap();
    rig.run(0.05, |_, _| ());
    rig.plant.set_dyno(None).unwrap();
    rig.command(Command::Disarm).unwrap();
    by_angle.means(1.0).map(|(_, torque)| torque).collect::<Statistics>().rms()
}

#[test]
fn the_procedure_balances_the_cogging_and_ends_at_rest() {
    for (seed, bandwidths) in [(1, SMOOTH), (2, SMOOTH), (3, STIFF)] {
        let mut plant = PlantParameters::imperfect(seed);
        // Twice the friction: it must not get into the table.
        plant.motor.friction = Friction { viscous_nms: 2e-6, coulomb_nm: 1e-3, breakaway_nm: 1.2e-3 };
        let mut rig = calibrated(&plant, bandwidths, seed);
        let off = net_torque(&mut rig);
        let table = rig.learn(&Plan::new(&rig.config).unwrap()).unwrap();
        assert_eq!(rig.drive.mode(), Mode::Ready);
        assert!(rig.plant.truth().speed_rad_s.abs() < 1.0);
        let on = net_torque(&mut rig);
        println!("seed {seed}: {:.3} mN·m without, {:.3} with, {:.1}", 1e3 * off, 1e3 * on, off / on);
        assert!(off / on > 5.0, "seed {seed}: {off} {on}");
        // No longer, and again, as after a power-up.
        rig.service.set_anti_cogging(None).unwrap();
        rig.run(0.01, |_, _| ());
        let again = net_torque(&mut rig);
        assert!(again > 0.85 * off, "{again} {off}");
        rig.service.set_anti_cogging(Some(&table)).unwrap();
        rig.run(0.05, |_, _| ());
        let again = net_torque(&mut rig);
        assert!(again < 1.5 * on, "{again} {on}");
    }
}

#[test]
fn lent_tables_are_two_and_come_back() {
    let mut rig = calibrated(&PlantParameters::imperfect(1), STIFF, 1);
    let add_table = |rig: &mut Rig| rig.service.add_table(Box::leak(Box::new(Table::ZERO)));
    assert!(rig.service.set_anti_cogging(Some(&Table::ZERO)).is_err());
    assert!(add_table(&mut rig).is_none() && add_table(&mut rig).is_none());
    assert!(add_table(&mut rig).is_some());
    for _ in 0..20 {
        rig.service.set_anti_cogging(Some(&Table::ZERO)).unwrap();
        rig.run(0.001, |_, _| ());
    }
}
