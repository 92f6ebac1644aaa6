//! One built encoder, and its calibration by an unsteady shaft.

use anyhow::Result;
use hallservo::vernier::calibrate::{Calibrator, Error as CalibrationError, Report};
use hallservo::vernier::eccentricity::Geometry;
use hallservo::vernier::encoder::{Calibration, Reading};
use hallservo::vernier::rings::Rings;
use plant::construction::{Construction, Imperfections, UnsteadyShaft};
use std::f64::consts::TAU;

/// The paper's construction, 37 and 45 pole pairs of 2 mm under 12-bit heads, but for these.
#[derive(Clone, Copy, Debug, clap::Args)]
pub struct Build {
    /// Distance of the rings' centre from the axis, in mm
    #[arg(long, value_name = "MM", default_value_t = 0.02)]
    pub eccentricity: f64,
    /// From the heads of one ring to those of the other, in degrees
    #[arg(long, value_name = "DEG", default_value_t = 40.0)]
    pub head_angle: f64,
    /// Two opposite heads over each ring
    #[arg(long)]
    pub pairs: bool,
}

/// Placement error of opposite heads, degrees.
pub const MISPLACEMENT_DEG: f64 = 1.0;
/// Samples in a turn of the calibration run, and by how much its speed varies.
pub const SAMPLES_A_TURN: f64 = 8000.0;
pub const RIPPLE: f64 = 0.05;

impl Build {
    /// The paper's rings.
    ///
    /// # Errors
    /// None: they are coprime.
    pub fn rings(&self) -> Result<Rings> {
        Ok(Rings::new(37, 45, 12)?)
    }

    /// One built encoder: 2° of first and second harmonic, opposite heads up to 1° off, a count of noise.
    pub fn construction(&self, seed: u64) -> Construction {
        let harmonic = 2.0_f64.to_radians();
        let imperfections = Imperfections {
            eccentricity_mm: self.eccentricity,
            misplacement_rad: MISPLACEMENT_DEG.to_radians(),
            harmonics_rad: [harmonic, harmonic, 0.0, 0.0],
            displacement_rad: 0.0,
            noise: 1.0,
        };
        Construction::new([37, 45], 2.0, self.head_angle.to_radians(), 12, &imperfections, seed)
    }

    /// Eccentricity up to which ideal rings need no calibration, mm.
    pub fn tolerable_mm(&self) -> Result<f64> {
        let rings = self.rings()?;
        let geometry = Geometry::from_pole_length(&rings, 2.0, self.head_angle.to_radians() as f32);
        let misplacement = MISPLACEMENT_DEG.to_radians() as f32;
        let tolerable =
            if self.pairs { geometry.tolerable_with_pairs(&rings, misplacement) } else { geometry.tolerable(&rings) };
        Ok(tolerable.into())
    }
}

/// The codes of the heads as the decoder takes them.
pub fn read<const HEADS: usize>(rings: &Rings, construction: &mut Construction, shaft_rad: f64) -> Reading<HEADS> {
    let [reference, vernier] = construction.digital(shaft_rad).map(|codes| codes.map(|code| rings.reading(code)));
    Reading { reference, vernier }
}

/// Calibrates an encoder by turning it unsteadily.
///
/// # Errors
/// Why the run is not fit for a calibration.
pub fn calibrate<const HEADS: usize>(
    build: &Build,
    construction: &mut Construction,
    seed: u64,
) -> Result<(Calibration<HEADS>, Report), CalibrationError> {
    // The rings are coprime.
    let Ok(rings) = build.rings() else { return Err(CalibrationError::TooFast) };
    let mut shaft = UnsteadyShaft::new(TAU / SAMPLES_A_TURN, RIPPLE, seed);
    let mut calibrator = Calibrator::new(&rings, &Calibration::ideal(&rings));
    let most = 8 * SAMPLES_A_TURN as usize;
    for _ in 0..most {
        if calibrator.push(read(&rings, construction, shaft.turn()))? {
            break;
        }
    }
    calibrator.finish()
}
