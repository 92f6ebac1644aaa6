//! The motor as the drive measures it, beside the true one.

use anyhow::Result;
use hallservo::service::identification::Plan;
use hallservo::service::identify::{Estimate, Report};
use hallservo::settings::Control;
use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::Rig;
use serde::Serialize;

/// Has a drive that was told a motor off by a fifth measure the one that it has.
pub fn identified(seed: u64) -> Result<Identification> {
    let right = Control::default();
    let control = Control {
        resistance_ohm: 1.2 * right.resistance_ohm,
        inductance_h: 0.8 * right.inductance_h,
        flux_linkage_wb: 0.8 * right.flux_linkage_wb,
        inertia_kgm2: 0.8 * right.inertia_kgm2,
        ..right
    };
    let plant = PlantParameters::imperfect(seed);
    let mut rig = Rig::new(&plant, &Settings { control: Some(control), ..Settings::default() }, seed)?;
    rig.calibrate(|_| ())?;
    let report = rig.identify(&Plan::new(&rig.config)?)?;
    Ok(Identification::new(&plant, &report))
}

/// Something identified, and what it really is.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Compared {
    /// What the drive found.
    pub measured: f64,
    /// What it expects to be off by at most.
    pub expected_error: f64,
    /// The motor's.
    pub exact: f64,
}

/// The identified motor beside the true one; SI units.
#[derive(Clone, Copy, Debug, Serialize)]
pub struct Identification {
    /// Resistance of a phase and the switch in series.
    pub resistance_ohm: Compared,
    /// Inductance of a phase.
    pub inductance_h: Compared,
    /// Flux linkage.
    pub flux_linkage_wb: Compared,
    /// Torque constant.
    pub torque_constant_nm_a: Compared,
    /// L/R.
    pub time_constant_s: Compared,
    /// Inertia.
    pub inertia_kgm2: Compared,
    /// Coulomb friction.
    pub coulomb_nm: Compared,
    /// Viscous friction.
    pub viscous_nms: Compared,
}

impl Identification {
    fn new(plant: &PlantParameters, report: &Report) -> Self {
        let motor = &plant.motor;
        let flux = motor.back_emf.flux_linkage_vs;
        let resistance = motor.resistance_ohm + plant.inverter.switch_ohm;
        let compared =
            |Estimate { value, error }, exact| Compared { measured: value.into(), expected_error: error.into(), exact };
        Self {
            resistance_ohm: compared(report.resistance_ohm, resistance),
            inductance_h: compared(report.inductance_h, motor.inductance_h),
            flux_linkage_wb: compared(report.flux_linkage_wb, flux),
            torque_constant_nm_a: compared(report.torque_constant_nm_a(), 1.5 * f64::from(motor.pole_pairs) * flux),
            time_constant_s: compared(report.time_constant_s(), motor.inductance_h / resistance),
            inertia_kgm2: compared(report.inertia_kgm2, motor.inertia_kgm2),
            coulomb_nm: compared(report.coulomb_nm, motor.friction.coulomb_nm),
            viscous_nms: compared(report.viscous_nms, motor.friction.viscous_nms),
        }
    }

    pub(super) fn table(&self) -> Vec<Vec<String>> {
        let head = ["measured by the drive itself, told a fifth too much or too little", "measured", "±", "exact"];
        let rows = [
            ("resistance, switches included / Ω", self.resistance_ohm, 1.0),
            ("inductance / mH", self.inductance_h, 1e3),
            ("flux linkage / mWb", self.flux_linkage_wb, 1e3),
            ("torque constant / mN·m/A", self.torque_constant_nm_a, 1e3),
            ("time constant L/R / µs", self.time_constant_s, 1e6),
            ("inertia / g·cm²", self.inertia_kgm2, 1e7),
            ("Coulomb friction / mN·m", self.coulomb_nm, 1e3),
            ("viscous friction / µN·m·s", self.viscous_nms, 1e6),
        ];
        let row = |(name, compared, scale): (&str, Compared, f64)| {
            let values = [compared.measured, compared.expected_error, compared.exact];
            std::iter::once(name.to_string()).chain(values.map(|value| format!("{:.3}", value * scale))).collect()
        };
        std::iter::once(head.map(String::from).to_vec()).chain(rows.into_iter().map(row)).collect()
    }
}
