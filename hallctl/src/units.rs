//! Quantities as a person writes them: `100rpm`, `-90deg`, `0.05Nm`; without a unit, in the one that was chosen.

use clap::ValueEnum;
use serde::Deserialize;
use std::f64::consts::TAU;
use std::ops::RangeInclusive;

/// Of a speed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
pub enum SpeedUnit {
    /// Radians a second
    #[default]
    #[value(name = "rad/s")]
    #[serde(rename = "rad/s")]
    RadiansPerSecond,
    /// Turns a minute
    #[value(name = "rpm")]
    #[serde(rename = "rpm")]
    TurnsPerMinute,
    /// Turns a second
    #[value(name = "turns/s")]
    #[serde(rename = "turns/s")]
    TurnsPerSecond,
    /// Degrees a second
    #[value(name = "deg/s")]
    #[serde(rename = "deg/s")]
    DegreesPerSecond,
}

/// Of a position.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum PositionUnit {
    /// Turns
    #[default]
    Turns,
    /// Degrees
    Deg,
    /// Radians
    Rad,
}

impl SpeedUnit {
    /// One of it, in rad/s.
    pub const fn rad_s(self) -> f64 {
        match self {
            Self::RadiansPerSecond => 1.0,
            Self::TurnsPerMinute => TAU / 60.0,
            Self::TurnsPerSecond => TAU,
            Self::DegreesPerSecond => TAU / 360.0,
        }
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::RadiansPerSecond => "rad/s",
            Self::TurnsPerMinute => "rpm",
            Self::TurnsPerSecond => "turns/s",
            Self::DegreesPerSecond => "deg/s",
        }
    }
}

impl PositionUnit {
    /// One of it, in turns.
    pub const fn turns(self) -> f64 {
        match self {
            Self::Turns => 1.0,
            Self::Deg => 1.0 / 360.0,
            Self::Rad => 1.0 / TAU,
        }
    }

    /// Its name.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Turns => "turns",
            Self::Deg => "deg",
            Self::Rad => "rad",
        }
    }
}

/// In which units a person thinks.
#[derive(Clone, Copy, Debug, Default)]
pub struct Units {
    /// Of speeds.
    pub speed: SpeedUnit,
    /// Of positions.
    pub position: PositionUnit,
}

impl Units {
    /// A speed in rad/s, in words.
    pub fn speed(self, rad_s: f32) -> String {
        self.speed_to(rad_s.into(), 2)
    }

    /// The same with so many digits behind the point.
    pub fn speed_to(self, rad_s: f64, digits: usize) -> String {
        format!("{:.digits$} {}", rad_s / self.speed.rad_s(), self.speed.name())
    }

    /// An acceleration in rad/s², in words.
    pub fn acceleration(self, rad_s2: f64) -> String {
        let unit = match self.speed {
            SpeedUnit::RadiansPerSecond => "rad/s²",
            SpeedUnit::TurnsPerMinute => "rpm/s",
            SpeedUnit::TurnsPerSecond => "turns/s²",
            SpeedUnit::DegreesPerSecond => "deg/s²",
        };
        format!("{:.0} {unit}", rad_s2 / self.speed.rad_s())
    }

    /// A position in turns, in words.
    pub fn position(self, turns: f64) -> String {
        let digits = if self.position == PositionUnit::Deg { 2 } else { 4 };
        format!("{:.digits$} {}", turns / self.position.turns(), self.position.name())
    }
}

/// A number, and what one of its unit is in the drive's, if it has one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Quantity {
    number: f64,
    unit: Option<f64>,
}

impl Quantity {
    /// In the drive's unit; without a unit, one is worth `usual`.
    pub fn value(self, usual: f64) -> f64 {
        self.number * self.unit.unwrap_or(usual)
    }
}

/// Reads a number with one of these units, or none.
fn quantity(text: &str, units: &[(&str, f64)]) -> Result<Quantity, String> {
    let text = text.trim();
    let (unit, number) = units
        .iter()
        .filter_map(|(name, worth)| Some((Some(*worth), text.strip_suffix(name)?.trim_end())))
        .find(|(_, number)| number.parse::<f64>().is_ok())
        .unwrap_or((None, text));
    let names = || units.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ");
    let point = if number.contains(',') { ", with a point and no comma" } else { "" };
    let wanted = || format!("a number is wanted{point}, alone or with one of: {}", names());
    let number: f64 = number.parse().map_err(|_| wanted())?;
    if !number.is_finite() || !((number * unit.unwrap_or(1.0)) as f32).is_finite() {
        return Err(format!("{text} is beyond what a drive can be told"));
    }
    Ok(Quantity { number, unit })
}

/// A speed.
///
/// # Errors
/// What is wrong with it.
pub fn speed(text: &str) -> Result<Quantity, String> {
    const HERTZ: (&str, f64) = ("Hz", TAU);
    let of = |unit: SpeedUnit| (unit.name(), unit.rad_s());
    let units = SpeedUnit::value_variants().iter().copied().map(of).chain([HERTZ, ("°/s", TAU / 360.0)]);
    quantity(text, &units.collect::<Vec<_>>())
}

/// A position.
///
/// # Errors
/// What is wrong with it.
pub fn position(text: &str) -> Result<Quantity, String> {
    let of = |unit: PositionUnit| (unit.name(), unit.turns());
    let units = PositionUnit::value_variants().iter().copied().map(of).chain([("turn", 1.0), ("°", 1.0 / 360.0)]);
    quantity(text, &units.collect::<Vec<_>>())
}

/// A torque.
///
/// # Errors
/// What is wrong with it.
pub fn torque(text: &str) -> Result<Quantity, String> {
    quantity(text, &[("mNm", 1e-3), ("Nm", 1.0), ("N·m", 1.0)])
}

/// A current or a voltage.
///
/// # Errors
/// What is wrong with it.
pub fn plain(text: &str) -> Result<Quantity, String> {
    quantity(text, &[("A", 1.0), ("V", 1.0)])
}

/// The size of what is to be measured.
///
/// # Errors
/// It is zero.
pub fn not_zero(size: Quantity) -> Result<Quantity, String> {
    if size.number == 0.0 { Err("a size other than 0 is wanted".into()) } else { Ok(size) }
}

/// A number in the drive's own unit; the drive says what is wrong with one that is none.
///
/// # Errors
/// What is wrong with it.
pub fn real(text: &str) -> Result<f32, String> {
    match text.parse::<f32>() {
        Ok(number) if number.is_infinite() => Err(format!("{text} is beyond what a drive can be told")),
        Ok(number) => Ok(number),
        Err(_) => Err("a number is wanted".into()),
    }
}

/// A whole number from one to another.
pub fn whole<T: TryFrom<u64>>(range: RangeInclusive<u64>) -> impl Fn(&str) -> Result<T, String> + Clone {
    move |text| {
        let number = text.parse().ok().filter(|number| range.contains(number));
        let wanted = || format!("a whole number from {} to {} is wanted", range.start(), range.end());
        number.and_then(|number| T::try_from(number).ok()).ok_or_else(wanted)
    }
}

/// A fraction.
///
/// # Errors
/// What is wrong with it.
pub fn fraction(text: &str) -> Result<Quantity, String> {
    quantity(text, &[("%", 0.01)])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_unit_may_follow_the_number() {
        for (text, worth) in [
            ("10", 10.0),
            ("60rpm", TAU),
            ("-60 rpm", -TAU),
            ("1turns/s", TAU),
            ("180deg/s", TAU / 2.0),
            ("2rad/s", 2.0),
        ] {
            assert!((speed(text).unwrap().value(1.0) - worth).abs() < 1e-12, "{text}");
        }
        assert_eq!(speed("60").map(|speed| speed.value(SpeedUnit::TurnsPerMinute.rad_s())), Ok(TAU));
        assert_eq!(position("90deg").map(|position| position.value(1.0)), Ok(0.25));
        assert_eq!(position("-90°").map(|position| position.value(1.0)), Ok(-0.25));
        assert_eq!(torque("5mNm").map(|torque| torque.value(1.0)), Ok(0.005));
        assert_eq!(fraction("50%").map(|share| share.value(1.0)), Ok(0.5));
    }

    #[test]
    fn what_is_no_number_or_too_large_is_named_as_written() {
        for text in ["1e99", "nan", "inf", "-infinity", "1e99rpm"] {
            let why = speed(text).unwrap_err();
            assert!(why.contains(text) || why.contains("a number is wanted"), "{text}: {why}");
        }
        assert!(speed("1e99").unwrap_err().contains("1e99"));
        for text in ["", "rpm", "5 parsecs", "5turns", "1 2"] {
            assert!(speed(text).is_err(), "{text}");
        }
    }
}
