//! Speeds beyond what the supply's voltage gives, by a current against the magnets' field.

use crate::supply::{self, Case, speed};
use hallservo::board::LostPeriods;
use hallservo::commutation::Commutation;
use hallservo::drive::Command;
use hallservo::fault::Limits;
use hallservo::mode::Mode;
use hallservo::settings::{Control, GuardSettings, Settings};
use plant::{AmplifierFault, BackEmf, HallFault, Iron, PlantParameters, Rail, Transistor, Unevenness};
use rig::Rig;

impl Case {
    pub(crate) fn control(&self) -> Control {
        self.settings.control.unwrap()
    }

    pub(crate) fn with(mut self, change: impl Fn(&mut Control)) -> Self {
        self.settings.control.as_mut().map(change).unwrap();
        self
    }

    /// With other windings, and a speed that the supply's voltage does not give them.
    fn beyond(mut self, inductance_h: f64, speed_rad_s: f32, field_weakening_a: f32) -> Self {
        self.plant.motor.inductance_h = inductance_h;
        self.speed_rad_s = speed_rad_s;
        self.with(|control| {
            control.inductance_h = inductance_h as f32;
            (control.max_speed_rad_s, control.field_weakening_a) = (speed_rad_s, field_weakening_a);
        })
    }
}

/// The paper's motor with a smaller magnet and a larger bridge.
pub(crate) fn paper() -> Case {
    let mut plant = PlantParameters::imperfect(1);
    plant.motor.resistance_ohm = 1.0;
    let control = supply::plain(Control {
        resistance_ohm: 1.02,
        continuous_current_a: 5.0,
        max_current_a: 5.0,
        max_acceleration_rad_s2: 3000.0,
        guard: GuardSettings { over_current_a: 7.5, ..GuardSettings::default() },
        ..Control::default()
    });
    let settings = Settings { commutation: Commutation::FieldOriented, control: Some(control), ..Settings::default() };
    Case { name: "paper", plant, settings, speed_rad_s: 0.0 }.beyond(0.6e-3, 800.0, 3.5)
}

/// 50 mΩ, 25 µH, seven pole pairs, four lithium cells that take nothing back.
pub(crate) fn drone() -> Case {
    let mut case = supply::drone().with(|control| control.flux_linkage_wb = 1e-3);
    case.plant.motor.back_emf = BackEmf::sinusoidal(1e-3);
    case.beyond(25e-6, 1450.0, 20.0)
}

/// A wheel with magnets inside its rotor: 0.2 mH along and 0.3 mH across them.
pub(crate) fn hub() -> Case {
    let mut case = supply::hub().with(|control| control.max_acceleration_rad_s2 = 50.0);
    case.plant.motor.iron = Iron { salience: 0.2, saturation_a: 60.0 };
    case.beyond(0.25e-3, 56.0, 18.0)
}

/// Calibrated by itself: what is measured here is recorded.
pub(crate) fn armed(case: &Case) -> Rig {
    let mut rig = Rig::new(&case.plant, &case.settings, 1).unwrap();
    rig.calibrate(|_| ()).unwrap();
    rig.wait(0.1);
    rig.command(Command::Arm).unwrap();
    rig
}

/// What the drive is not told.
#[derive(Clone, Copy, Debug)]
struct Unlike {
    resistance: f64,
    inductance: f64,
    flux: f64,
    salience: f64,
    /// Current of the saturation, of the largest current.
    saturation: f64,
}

const ALIKE: Unlike = Unlike { resistance: 1.0, inductance: 1.0, flux: 1.0, salience: 0.0, saturation: 1e6 };

const UNLIKE: [Unlike; 6] = [
    ALIKE,
    Unlike { resistance: 1.25, inductance: 1.3, ..ALIKE },
    Unlike { resistance: 0.8, inductance: 0.8, flux: 0.95, ..ALIKE },
    Unlike { flux: 1.08, inductance: 1.3, ..ALIKE },
    Unlike { salience: 0.25, saturation: 2.0, ..ALIKE },
    Unlike { salience: -0.2, inductance: 1.3, ..ALIKE },
];

impl Case {
    fn unlike(mut self, unlike: &Unlike) -> Self {
        let motor = &mut self.plant.motor;
        motor.resistance_ohm *= unlike.resistance;
        motor.inductance_h *= unlike.inductance;
        motor.back_emf.flux_linkage_vs *= unlike.flux;
        let saturation_a = unlike.saturation * f64::from(self.settings.control.unwrap().max_current_a);
        motor.iron = Iron { salience: unlike.salience, saturation_a };
        self
    }

    pub(crate) fn most_a(&self) -> f64 {
        self.control().max_current_a.into()
    }

    pub(crate) fn over_v(&self) -> f64 {
        self.control().guard.over_voltage_v.into()
    }
}

/// Length of the current vector, A.
pub(crate) fn length(currents_a: &[f64; 3]) -> f64 {
    (currents_a.iter().map(|current| current * current).sum::<f64>() / 1.5).sqrt()
}

/// The largest of a stretch of time, and what the speed did.
#[derive(Debug, Default)]
pub(crate) struct Stretch {
    pub(crate) current_a: f64,
    pub(crate) bus_v: f64,
    pub(crate) mean_rad_s: f64,
    pub(crate) swing_rad_s: f64,
    /// Whether heat was said to limit the current.
    heat: bool,
}

pub(crate) fn watch(rig: &mut Rig, seconds: f64) -> Stretch {
    let mut stretch = Stretch::default();
    let (mut least, mut most, mut sum, mut count) = (f64::MAX, f64::MIN, 0.0, 0.0);
    rig.run(seconds, |rig, period| {
        let truth = &period.truth;
        stretch.heat |= rig.drive.limits().contains(Limits::HEAT);
        stretch.current_a = stretch.current_a.max(length(&truth.currents_a));
        stretch.bus_v = stretch.bus_v.max(truth.bus_v);
        (least, most) = (least.min(truth.speed_rad_s), most.max(truth.speed_rad_s));
        (sum, count) = (sum + truth.speed_rad_s, count + 1.0);
    });
    (stretch.mean_rad_s, stretch.swing_rad_s) = (sum / count, most - least);
    stretch
}

/// The current along d as the drive measures it, A.
fn along_d(rig: &Rig, case: &Case) -> f32 {
    rig.drive.state().current.d as f32 / 32_768.0 * case.control().current_full_scale_a
}

/// The short form has every third way to be unlike, in the one direction and in the other in turn.
#[test]
fn a_speed_beyond_the_supply_is_reached_and_held_by_motors_that_are_not_as_told() {
    for case in [paper(), drone(), hub()] {
        let (mut slowest, mut swings, mut current_a) = (f64::MAX, 0.0_f64, 0.0_f64);
        // Without: what the supply gives.
        let mut rig = armed(&case.with(|control| control.field_weakening_a = 0.0));
        speed(&mut rig, case.speed_rad_s);
        rig.wait(3.0);
        let base = rig.plant.truth().speed_rad_s;
        for (number, unlike) in UNLIKE.into_iter().step_by(sim::of(3, 1)).enumerate() {
            let case = case.unlike(&unlike);
            for direction in sim::either(number, [1.0, -1.0]) {
                let mut rig = armed(&case);
                speed(&mut rig, direction * case.speed_rad_s);
                let rising = watch(&mut rig, 2.5);
                let there = watch(&mut rig, 0.5);
                assert_eq!(rig.drive.mode(), Mode::Running, "{} {unlike:?}", case.name);
                assert!(!rising.heat && !there.heat, "{} {unlike:?}", case.name);
                let reached = there.mean_rad_s * f64::from(direction);
                slowest = slowest.min(reached);
                swings = swings.max(there.swing_rad_s / reached);
                current_a = current_a.max(rising.current_a.max(there.current_a) / case.most_a());
                assert!(
                    there.bus_v.max(rising.bus_v) < case.over_v(),
                    "{} {unlike:?}: {rising:?} {there:?}",
                    case.name
                );
            }
        }
        println!(
            "{}: {base:.0} rad/s without, {slowest:.0} rad/s of {} with, swings by {:.2} %, current {current_a:.2}",
            case.name,
            case.speed_rad_s,
            100.0 * swings,
        );
        assert!(slowest > 1.1 * base);
        assert!(swings < 0.02);
        assert!(current_a < 1.12);
    }
}

/// Torque of a share of the largest current, N·m.
pub(crate) fn torque_nm(case: &Case, share: f64) -> f64 {
    1.5 * f64::from(case.settings.pole_pairs) * case.plant.motor.back_emf.flux_linkage_vs * share * case.most_a()
}

/// The short form has another way to be unlike with each motor.
#[test]
fn it_reverses_stands_a_load_and_stops_from_there_into_a_supply_that_takes_nothing() {
    for (number, case) in [paper(), drone(), hub()].into_iter().enumerate() {
        for unlike in [ALIKE, UNLIKE[2], UNLIKE[4]].into_iter().skip(sim::of(number, 0)).take(sim::of(1, 3)) {
            let case = case.unlike(&unlike);
            let mut rig = armed(&case);
            speed(&mut rig, case.speed_rad_s);
            rig.wait(2.5);
            let check = |what: &str, rig: &mut Rig, seconds: f64| {
                let stretch = watch(rig, seconds);
                println!("{} {what}: {stretch:.2?}, d {:.2} A", case.name, along_d(rig, &case));
                assert_eq!(rig.drive.mode(), Mode::Running, "{} {what}: {stretch:?}", case.name);
                assert!(
                    stretch.bus_v < case.over_v() && stretch.current_a < 1.12 * case.most_a(),
                    "{what}: {stretch:?}"
                );
            };
            speed(&mut rig, -case.speed_rad_s);
            check("reversal", &mut rig, 4.0);
            // Against the motion, with it, and none.
            for share in [-0.2, 0.04, 0.0] {
                rig.plant.set_load(torque_nm(&case, share)).unwrap();
                check("load", &mut rig, 1.0);
            }
            speed(&mut rig, 0.0);
            check("stop", &mut rig, 4.0);
            assert!(rig.plant.truth().speed_rad_s.abs() < 1.0, "{}", rig.plant.truth().speed_rad_s);
            assert!(along_d(&rig, &case).abs() < 0.1 * case.control().max_current_a);
        }
    }
}

#[test]
fn a_supply_that_sags_and_comes_back_costs_speed_only() {
    for case in [paper(), drone(), hub()] {
        let case = case.unlike(&UNLIKE[1]);
        let mut rig = armed(&case);
        speed(&mut rig, case.speed_rad_s);
        rig.wait(2.5);
        let supply_v = case.plant.bus.supply_v;
        for share in [0.8, 1.0] {
            rig.plant.set_supply(share * supply_v).unwrap();
            let stretch = watch(&mut rig, 2.0);
            println!("{} at {share}: {stretch:.2?}, d {:.2} A", case.name, along_d(&rig, &case));
            assert_eq!(rig.drive.mode(), Mode::Running, "{} at {share}: {stretch:?}", case.name);
            assert!(stretch.current_a < 1.12 * case.most_a() && stretch.bus_v < 0.96 * case.over_v(), "{stretch:?}");
        }
        assert!(rig.plant.truth().speed_rad_s > 0.97 * f64::from(case.speed_rad_s));
    }
}

#[test]
fn switched_off_there_the_bus_stays_within_its_limit() {
    for case in [paper(), drone(), hub()] {
        let case = case.unlike(&UNLIKE[3]);
        let mut rig = armed(&case);
        speed(&mut rig, case.speed_rad_s);
        rig.wait(2.5);
        rig.command(Command::Disarm).unwrap();
        let off = watch(&mut rig, 0.5);
        println!("{} off: {off:.2?}", case.name);
        assert!(off.bus_v < case.over_v(), "{}: {off:?}", case.name);
    }
}

/// What breaks at the largest speed, in the motor or before the drive.
pub(crate) type Breaks = fn(&mut Rig);

const DEFECTS: [(&str, Breaks); 8] = [
    ("Hall at ground", |rig| rig.plant.set_hall_fault(1, Some(HallFault::Open(Rail::Low)))),
    ("Hall frozen", |rig| rig.plant.set_hall_fault(2, Some(HallFault::StuckAt(1.9)))),
    ("open phase", |rig| rig.plant.set_phase_open(1, true)),
    ("transistor dead", |rig| rig.plant.set_dead_transistor(0, Some(Transistor::Upper))),
    ("amplifier dead", |rig| rig.plant.set_amplifier_fault(0, Some(AmplifierFault::Dead)).unwrap()),
    ("amplifier of half the gain", |rig| rig.plant.set_amplifier_fault(2, Some(AmplifierFault::Gain(0.5))).unwrap()),
    ("lost period", |rig| rig.disturb = Some(Box::new(|sample| sample.lost = LostPeriods::counted(1)))),
    ("blocked", |rig| rig.plant.set_dyno(Some(0.0)).unwrap()),
];

/// What breaks with one of some motors: in the short form every other defect, in turn.
pub(crate) fn defects(number: usize) -> impl Iterator<Item = (&'static str, Breaks)> {
    DEFECTS.into_iter().skip(sim::of(number % 2, 0)).step_by(sim::of(2, 1))
}

/// A motor of which something breaks at the largest speed, and the second after it.
pub(crate) fn broken(case: &Case, name: &str, breaks: Breaks) -> (Rig, Stretch) {
    let mut rig = armed(case);
    speed(&mut rig, case.speed_rad_s);
    rig.wait(2.5);
    breaks(&mut rig);
    let stretch = watch(&mut rig, 1.0);
    println!("{} {name}: {:?}, {stretch:.2?}", case.name, rig.drive.mode());
    let most_a = f64::from(case.control().guard.over_current_a);
    assert!(stretch.current_a < most_a, "{} {name}: {stretch:?}", case.name);
    (rig, stretch)
}

#[test]
fn what_breaks_there_is_named_or_does_no_harm() {
    for (number, case) in [paper(), drone(), hub()].into_iter().enumerate() {
        for (name, breaks) in defects(number) {
            let (rig, stretch) = broken(&case, name, breaks);
            let motor = &case.plant.motor;
            // What the winding still holds when the bus is found to be too high goes there, too.
            let held_j = 0.75 * motor.inductance_h * case.most_a().powi(2) * 1.2;
            let most_v = (case.over_v().powi(2) + 2.0 * held_j / case.plant.bus.capacitance_f).sqrt();
            assert!(stretch.bus_v < most_v, "{} {name}: {stretch:?}, {most_v}", case.name);
            // The diode beside a dead transistor conducts where the back-EMF is above the bus.
            let may_run = matches!(name, "transistor dead" | "amplifier of half the gain");
            match rig.drive.mode() {
                Mode::Running => assert!(may_run && stretch.mean_rad_s > 0.99 * f64::from(case.speed_rad_s)),
                Mode::Faulted(fault) => println!("  {fault}"),
                mode => panic!("{} {name}: {mode:?}", case.name),
            }
        }
    }
}

/// An angle that lags makes a current against the field a driving one: 14° at the drone motor's largest speed, 29° where
/// the Halls are 50 µs late. The short form has every other kind of them with each motor, in turn.
#[test]
fn late_halls_and_uneven_magnets_do_not_make_the_weakening_current_drive() {
    for (motor, case) in [paper(), drone(), hub()].into_iter().enumerate() {
        let (mut current_a, mut swing) = (0.0_f64, 0.0_f64);
        // Without a map, what all of it makes the light motor brake and drive in every turn is too much for a supply that
        // takes nothing: it ends in OverVoltage.
        let cheap = Unevenness::CHEAP.scaled(if case.name == "drone" { 0.5 } else { 1.0 });
        for (number, (late_us, told, unevenness, unlike)) in [
            (25.0, false, Unevenness::NONE, ALIKE),
            (25.0, true, Unevenness::NONE, UNLIKE[4]),
            (50.0, false, Unevenness::NONE, UNLIKE[1]),
            (50.0, false, Unevenness::NONE, UNLIKE[2]),
            (0.0, false, cheap, ALIKE),
            (25.0, false, Unevenness { rated_a: case.most_a(), ..cheap }, UNLIKE[3]),
        ]
        .into_iter()
        .skip(sim::of(motor % 2, 0))
        .step_by(sim::of(2, 1))
        .enumerate()
        {
            for direction in sim::either(number, [1.0, -1.0]) {
                let mut case = case.unlike(&unlike);
                case.plant = case.plant.with_unevenness(&unevenness, 7);
                case.plant.halls.iter_mut().for_each(|hall| hall.delay_s = late_us * 1e-6);
                case = case.with(|control| control.hall_delay_us = if told { late_us as f32 } else { 0.0 });
                let mut rig = armed(&case);
                speed(&mut rig, direction * case.speed_rad_s);
                let rising = watch(&mut rig, 2.5);
                let there = watch(&mut rig, 0.5);
                let what = format!("{} {late_us} us, told {told}, {unlike:?}: {rising:.2?}, {there:.2?}", case.name);
                println!("{what}, d {:.2} A", along_d(&rig, &case));
                assert_eq!(rig.drive.mode(), Mode::Running, "{what}");
                let most_a = rising.current_a.max(there.current_a);
                assert!(most_a < 1.12 * case.most_a() && rising.bus_v.max(there.bus_v) < case.over_v(), "{what}");
                let reached = there.mean_rad_s * f64::from(direction) / f64::from(case.speed_rad_s);
                assert!((0.98..1.02).contains(&reached), "{what}");
                current_a = current_a.max(most_a / case.most_a());
                swing = swing.max(there.swing_rad_s / there.mean_rad_s.abs());
            }
        }
        println!("{}: late and uneven, current {current_a:.2}, swings by {:.2} %", case.name, 100.0 * swing);
    }
}

#[test]
fn a_torque_and_a_position_go_there_too() {
    let case = paper();
    let mut rig = armed(&case);
    let current = rig.control().unwrap().current(2.0).unwrap();
    rig.command(Command::Current(current)).unwrap();
    let torque = watch(&mut rig, 1.0);
    assert_eq!(rig.drive.mode(), Mode::Running);
    // A commanded torque ends a tenth beyond the largest speed.
    let speed_rad_s = rig.plant.truth().speed_rad_s;
    assert!((780.0..890.0).contains(&speed_rad_s), "{speed_rad_s}: {torque:?}");
    speed(&mut rig, 0.0);
    rig.wait(2.0);

    let here = rig.plant.truth().mechanical_angle_rad / std::f64::consts::TAU;
    let target = rig.drive.tracker().position().to_bits();
    rig.command(Command::Position(hallservo::angle::Position::from_bits(target + ((4 * 150) << 32)))).unwrap();
    let (mut most, mut fastest) = (f64::MIN, 0.0_f64);
    rig.run(3.0, |_, period| {
        most = most.max(period.truth.mechanical_angle_rad / std::f64::consts::TAU - here);
        fastest = fastest.max(period.truth.speed_rad_s);
    });
    let reached = rig.plant.truth().mechanical_angle_rad / std::f64::consts::TAU - here;
    println!("paper: {reached:.4} of 150 turns, at most {most:.4}, with {fastest:.0} rad/s");
    assert_eq!(rig.drive.mode(), Mode::Running);
    assert!((reached - 150.0).abs() < 0.02 && most < 150.05 && fastest > 780.0);
}

/// Two thirds of the voltage go into the resistance: a current along d would be heat and nothing else.
#[test]
fn a_slow_motor_at_the_end_of_its_voltage_weakens_nothing() {
    let mut case = paper().with(|control| {
        control.resistance_ohm = 3.75;
        control.max_current_a = 5.0;
    });
    case.plant.motor.resistance_ohm = 3.75;
    let mut rig = armed(&case);
    let current = rig.control().unwrap().current(5.0).unwrap();
    rig.plant.set_dyno(Some(100.0)).unwrap();
    rig.command(Command::Current(current)).unwrap();
    let mut along = 0.0_f32;
    rig.run(0.5, |rig, _| along = along.min(along_d(rig, &case)));
    let q = rig.drive.state().current.q as f32 / 32_768.0 * 8.25;
    println!("{q:.2} A of 5 along q, {along:.2} A along d");
    assert!(q < 4.0 && along > -0.3);
}

#[test]
fn settings_that_would_lift_the_bus_or_turn_the_field_round_are_refused() {
    let settings = paper().settings;
    // Eight tenths of λ/L = 8.33 A, but 7/8 of the largest current.
    let told = |name: &str, value: f32| settings.with(name, value).map(|_| ()).map_err(|error| error.to_string());
    assert!(told("field_weakening_a", 4.375).is_ok());
    assert!(
        told("field_weakening_a", 4.4).unwrap_err().contains("field_weakening_a is 4.4, but must be from 0 to 4.375")
    );
    assert!(told("field_weakening_a", -0.1).is_err() && told("field_weakening_a", f32::NAN).is_err());
    assert!(told("inductance_h", 2e-3).unwrap_err().contains("field_weakening_a is 3.5, but must be from 0 to 2"));
    // 32 V over 1.1 √3 5 mWb 4 pole pairs.
    assert!(told("max_speed_rad_s", 839.0).is_ok());
    assert!(told("max_speed_rad_s", 841.0).unwrap_err().contains("must be from 0.1 to 839.7"));
    assert!(told("over_voltage_v", 30.0).unwrap_err().contains("max_speed_rad_s is 800"));
    // Without field weakening, the largest frequency counts.
    let without = settings.with("field_weakening_a", 0.0).unwrap();
    assert!(without.with("max_speed_rad_s", 1500.0).is_ok());
}
