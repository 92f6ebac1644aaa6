//! From ADC codes to SI.

use crate::housekeeping::Readings;
use hallservo::board::TemperatureCode;
use hallservo::commutation::frames::Dq;
use hallservo::control::cogging::Table;
use hallservo::settings::Settings;
use hallservo::settings::{Control, Thermistor};
use hallservo::telemetry::Measurement;
use hallservo_protocol::Cogging;

/// Of a code that the ADC's whole range is 1.
#[inline(never)]
fn share(code: u16, adc_bits: u8) -> f32 {
    f32::from(code) / (1_u32 << adc_bits.min(16)) as f32
}

/// Bus voltage; not a number without current control.
pub(crate) fn bus_v(settings: &Settings, readings: Readings) -> f32 {
    settings.control.map_or(f32::NAN, |control| share(readings.bus, settings.adc_bits) * control.bus_full_scale_v)
}

/// Temperatures of bridge and motor; not numbers without current control or without a thermistor.
pub(crate) fn temperatures_c(settings: &Settings, readings: Readings) -> [f32; 2] {
    let Some(control) = &settings.control else { return [f32::NAN; 2] };
    let of = |thermistor: &Thermistor, code: TemperatureCode| {
        let Some(code) = code.code() else { return f32::NAN };
        // The end of the range is an open one.
        let open = u32::from(code) + 1 >= 1 << settings.adc_bits;
        if open { f32::NAN } else { celsius(thermistor, share(code, settings.adc_bits)) }
    };
    let [bridge, motor] = readings.temperatures;
    [of(&control.guard.bridge, bridge), of(&control.guard.motor, motor)]
}

/// The inverse of [`Thermistor::code`]. One that is shorted reads −273 °C.
fn celsius(thermistor: &Thermistor, share: f32) -> f32 {
    let resistance = thermistor.pull_up_ohm * share / (1.0 - share);
    1.0 / (1.0 / 298.15 + hallservo::float::ln(resistance / thermistor.nominal_ohm) / thermistor.beta_k) - 273.15
}

/// A table of the cogging in SI, and beside it what differs from pole to pole.
pub(crate) fn cogging(table: &Table, full_scale_a: f32, by_pole_a: f32) -> Cogging {
    let amperes = |current: &i16| f32::from(*current) / 32_768.0 * full_scale_a;
    let largest_a = table.0.iter().map(|current| amperes(current).abs()).fold(0.0, f32::max);
    let squares: f32 = table.0.iter().map(|current| amperes(current) * amperes(current)).sum();
    Cogging { largest_a, by_pole_a, rms_a: hallservo::float::root(squares / table.0.len() as f32) }
}

/// Voltages along d and q, V.
pub(crate) fn voltage_v(control: &Control, measurement: &Measurement) -> [f32; 2] {
    let Dq { d, q } = measurement.state.voltage;
    [d, q].map(|voltage| voltage as f32 / 32_768.0 * control.bus_full_scale_v)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn no_thermistor_is_no_temperature() {
        let settings = Settings { adc_bits: 12, control: Some(Control::default()), ..Settings::default() };
        let read = |motor| {
            let temperatures = [TemperatureCode::new(2048), motor];
            temperatures_c(&settings, Readings { temperatures, ..Readings::default() })
        };
        let [bridge, motor] = read(TemperatureCode::MISSING);
        assert!((bridge - 25.0).abs() < 0.1 && motor.is_nan(), "{bridge} {motor}");
        // One that is as cold as can be told.
        assert!(read(TemperatureCode::new(4094))[1] < -90.0);
        assert!(read(TemperatureCode::new(4095))[1].is_nan());
    }

    #[test]
    fn a_thermistor_is_read_as_it_was_made() {
        let ntc = Thermistor::ntc_10k(80.0, 100.0);
        for degrees in [-20.0, 0.0, 25.0, 60.0, 100.0, 150.0] {
            let read = celsius(&ntc, ntc.code(degrees) / 65_536.0);
            assert!((read - degrees).abs() < 0.01, "{degrees} {read}");
        }
        let shorted = celsius(&ntc, share(0, 12));
        assert!((shorted + 273.15).abs() < 0.01, "{shorted}");
    }
}
