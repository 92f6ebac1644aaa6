//! Drives that know their Halls from the start, as after a power-up: each motor is calibrated once in this program, and not
//! by every test that needs a calibrated one.

use hallservo::commutation::Commutation;
use hallservo::hall::model::Model;
use hallservo::settings::Settings;
use plant::PlantParameters;
use rig::Rig;
use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, OnceLock};

/// What a calibration has found, and where it has left the rotor; or why it has come to nothing.
type Found = Result<(Model, f64), String>;

/// By motor, settings and seed, on which all of it depends: a calibration turns the field, whatever commutates later.
static FOUND: Mutex<BTreeMap<String, Arc<OnceLock<Found>>>> = Mutex::new(BTreeMap::new());

fn calibrate(plant: &PlantParameters, settings: &Settings, seed: u64) -> Found {
    let mut rig = Rig::new(plant, settings, seed).map_err(|error| error.to_string())?;
    let model = rig.calibrate(|_| ()).map_err(|error| error.to_string())?.model;
    Ok((model, rig.plant.truth().mechanical_angle_rad))
}

fn found(plant: &PlantParameters, settings: &Settings, seed: u64) -> Found {
    let settings = Settings { commutation: Commutation::FieldOriented, ..*settings };
    let key = format!("{plant:?} {settings:?} {seed}");
    // Others look their own up meanwhile.
    let found = Arc::clone(FOUND.lock().unwrap().entry(key).or_default());
    found.get_or_init(|| calibrate(plant, &settings, seed)).clone()
}

/// The sensors of a motor.
pub(crate) fn model(plant: &PlantParameters, settings: &Settings, seed: u64) -> Model {
    found(plant, settings, seed).unwrap().0
}

/// A drive at a motor, the rotor at rest where its calibration has left it; the calibration may have refused it.
pub(crate) fn rig(plant: &PlantParameters, settings: &Settings, seed: u64) -> Result<Rig, String> {
    let (model, angle_rad) = found(plant, settings, seed)?;
    let mut rig = Rig::new(plant, settings, seed).map_err(|error| error.to_string())?;
    rig.plant.place(angle_rad, 0.0).unwrap();
    rig.wait(0.02);
    rig.service.install(&model).unwrap();
    rig.wait(0.02);
    Ok(rig)
}
