use hallservo::angle::ElectricalAngle;
use hallservo::hall::adapt::*;
use hallservo::hall::model::Model;
use plant::*;
use std::f64::consts::TAU;

fn wrap(a: f64) -> f64 {
    a - TAU * (a / TAU).round()
}

#[test]
fn scratch() {
    let hz: f64 = std::env::var("HZ").ok().and_then(|s| s.parse().ok()).unwrap_or(10.0);
    let seeds: u64 = std::env::var("SEEDS").ok().and_then(|s| s.parse().ok()).unwrap_or(200);
    let turns = 6.0;
    let n = (turns / hz * 1000.0) as usize;
    let bins = 24;
    let mut sq = vec![0.0; bins];
    let mut bsq = vec![0.0; bins];
    let mut cnt = vec![0.0; bins];
    let mut worst = vec![0.0_f64; bins];
    let mut faults = 0;
    let mut restarts = 0;
    let mut acq = 0;
    for seed in 0..seeds {
        let p = PlantParameters::unkind(seed);
        let damping_nms = 1.6e-4;
        let bp = BenchParameters {
            halls: p.halls,
            adc: p.adc,
            period_s: 1e-3,
            pole_pairs: 4,
            inertia_kgm2: 1e-5,
            damping_nms,
            torque_noise_nm_rthz: 1e-5,
        };
        let dir = if seed % 2 == 0 { 1.0 } else { -1.0 };
        let w = TAU * hz * dir;
        let mut bench = Bench::new(&bp, seed as f64 * 0.7, w, seed + 1000).unwrap();
        let torque = damping_nms * w / 4.0;
        let third: f32 = std::env::var("TH").map_or(0.05, |s| s.parse().unwrap());
        let known: f32 = std::env::var("KN").map_or(0.0, |s| s.parse().unwrap());
        let mut s = Settings { start: Spread { third, ..Settings::NOMINAL }, ..Settings::default() };
        s.drift.third = third * 4e-3;
        let c = s.validate().unwrap();
        let mut model = Model::nominal(12, 250.0, ElectricalAngle::THIRD);
        for x in &mut model.sensors {
            x.third = known;
        }
        let mut a = Adapter::new(&c, &model).unwrap();
        let lsb = 3.3 / 4096.0;
        let mut bound = Bound::new(&Prior {
            angle_rad: 1.8,
            speed_rad_s: TAU * 100.0,
            third: 0.05,
            offset_v: 25.0 * lsb / 3f64.sqrt(),
            amplitude_v: 75.0 * lsb / 3f64.sqrt(),
            placement_rad: 6.5f64.to_radians(),
        });
        for k in 0..n {
            let codes = bench.step(torque);
            bound.advance(1e-3, 16.0, 4.0);
            bound.observe(&p.halls, bench.angle_rad(), lsb);
            match a.update(&Observation { codes, elapsed: 1, torque_nm: torque as f32 }) {
                Outcome::Failed(f) => {
                    faults += 1;
                    println!("seed {seed} step {k} {f}");
                }
                Outcome::Acquiring if k > 0 => acq += 1,
                _ => {}
            }
            let truth = bench.angle_rad() - p.halls[0].placement_rad;
            let e = wrap(f64::from(a.hall_angle().to_radians()) - truth).to_degrees();
            let b = k * bins / n;
            sq[b] += e * e;
            cnt[b] += 1.0;
            bsq[b] += bound.angle_rad().to_degrees().powi(2);
            worst[b] = worst[b].max(e.abs());
        }
        let _ = &mut restarts;
    }
    for b in 0..bins {
        println!(
            "turns {:.2}: rms {:.3} bound {:.3} worst {:.2}",
            (b as f64 + 1.0) * turns / bins as f64,
            (sq[b] / cnt[b]).sqrt(),
            (bsq[b] / cnt[b]).sqrt(),
            worst[b]
        );
    }
    println!("faults {faults} acquiring {acq}");
}
