//! A load on a shaft that twists, as the options of `hallctl simulate` have it.

use super::within;
use plant::{LoadParameters, PlantParameters};

/// The load on the simulated motor's shaft.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct LoadOptions {
    /// A load on a shaft that twists: how many times the rotor's inertia it has
    #[arg(long, value_name = "TIMES", value_parser = times)]
    pub load_inertia: Option<f64>,
    /// Frequency at which rotor and load swing against each other
    #[arg(long, value_name = "HZ", default_value_t = 100.0, requires = "load_inertia", value_parser = hertz)]
    pub resonance_hz: f64,
    /// Damping ratio of that swing
    #[arg(long, value_name = "RATIO", default_value_t = 0.02, requires = "load_inertia", value_parser = damping)]
    pub load_damping: f64,
    /// Play between rotor and load: by how much the rotor turns from flank to flank
    #[arg(long, value_name = "DEG", default_value_t = 0.0, requires = "load_inertia", value_parser = degrees)]
    pub backlash_deg: f64,
}

impl LoadOptions {
    /// A motor with that load on it.
    pub fn on(&self, mut plant: PlantParameters) -> PlantParameters {
        let rotor_kgm2 = plant.motor.inertia_kgm2;
        plant.motor.load = self.load_inertia.map(|times| LoadParameters {
            backlash_rad: self.backlash_deg.to_radians(),
            ..LoadParameters::resonant(rotor_kgm2, times * rotor_kgm2, self.resonance_hz, self.load_damping)
        });
        plant
    }
}

fn times(text: &str) -> Result<f64, String> {
    within(text, 0.01..=1000.0, "times the rotor's inertia")
}

fn hertz(text: &str) -> Result<f64, String> {
    within(text, 1.0..=5000.0, "hertz")
}

fn damping(text: &str) -> Result<f64, String> {
    within(text, 0.0..=1.0, "of the damping at which nothing swings")
}

fn degrees(text: &str) -> Result<f64, String> {
    within(text, 0.0..=45.0, "degrees of the rotor")
}
