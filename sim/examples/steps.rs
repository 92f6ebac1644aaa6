use hallservo::drive::Command;
use hallservo::commutation::Commutation;
use hallservo::mode::Mode;
use sim::commissioning::{Bench, commission};
use sim::motors::MOTORS;
use sim::rig::Rig;
use rayon::prelude::*;
fn main() {
    let rows: Vec<String> = MOTORS.par_iter().map(|motor| {
        let seed = 5;
        let mut bench = Bench::new(Rig::new(&motor.plant(seed), &motor.settings(), seed).unwrap());
        let outcome = match commission(&mut bench, motor.settings(), motor.limit_a) { Ok(o) => o, Err(e) => return format!("{}: commission: {e}", motor.name) };
        let mut rig = bench.rig;
        let c = outcome.settings.control.unwrap();
        let accel = 1.5 * f64::from(motor.pairs) * motor.flux_vs * f64::from(motor.limit_a) / motor.inertia_kgm2;
        let seconds = (0.3 * f64::from(c.max_speed_rad_s) / accel).min(0.012).max(0.001);
        let mut out = String::new();
        for share in [0.5_f32, 1.0] {
            rig.command(Command::Commutate(Commutation::FieldOriented)).unwrap();
            rig.arm().unwrap();
            let mut faults = 0; let mut last = None;
            let mut x = 12345_u64;
            for k in 0..1000 {
                let a = if k % 2 == 0 { share } else { -share } * rig.control().unwrap().largest_current_a();
                x = x.wrapping_mul(6364136223846793005).wrapping_add(1442695040888963407);
                let r = rig.command(Command::Current(rig.control().unwrap().current(a).unwrap()));
                let s = seconds * if k == 0 { 0.5 } else { 1.0 } ;
                for _ in 0..((x >> 60) as u32) { rig.step(); }
                rig.run(s, |_, _| ());
                if let (Mode::Faulted(f), _) = (rig.drive.mode(), r) { faults += 1; last = Some(f);
                    rig.command(Command::Clear).unwrap(); rig.run(0.5, |_, _| ()); 
                    if rig.arm().is_err() { rig.run(2.0, |_, _| ()); let _ = rig.arm(); } }
                if k % 20 == 19 { let _ = rig.command(Command::Speed(rig.control().unwrap().speed(0.0).unwrap())); rig.run(0.3, |_, _| ()); }
            }
            out += &format!(" {share}: {faults} {last:?}");
            let _ = rig.command(Command::Speed(rig.control().unwrap().speed(0.0).unwrap())); rig.run(1.0, |_, _| ());
            let _ = rig.command(Command::Disarm); rig.run(0.5, |_, _| ());
            if matches!(rig.drive.mode(), Mode::Faulted(_)) { rig.command(Command::Clear).unwrap(); }
        }
        format!("{} ({:.1} ms):{out}", motor.name, seconds * 1e3)
    }).collect();
    for row in rows { println!("{row}"); }
}
