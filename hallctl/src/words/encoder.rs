//! What the drive says of its encoder.

use hallservo::vernier::settings;
use hallservo_protocol::EncoderRefusal;

/// Why something is refused, and what to do.
pub fn refusal(refusal: &EncoderRefusal) -> String {
    match refusal {
        EncoderRefusal::None => "this drive has no encoder".into(),
        EncoderRefusal::Setting(error) => setting_error(error),
        EncoderRefusal::Calibration(error) => format!("the encoder cannot be calibrated: {error}"),
        EncoderRefusal::NotCalibrated => {
            "the encoder is not calibrated\n  `hallctl encoder calibrate` first: it turns the shaft.".into()
        }
        EncoderRefusal::NoAngle(Some(fault)) => {
            format!(
                "the encoder has no angle: {fault}\n  Check its heads and their wires; `hallctl encoder status` tells more."
            )
        }
        EncoderRefusal::NoAngle(None) => "the encoder has no angle yet".into(),
        EncoderRefusal::NotAbsolute(Some(ahead)) => format!(
            "the position is not known: the Halls are {ahead:+.1}° electrical from where the encoder has them\n  Have the \
             rings turned on the shaft? Is a head broken? `hallctl encoder calibrate` when all is well. Were the Halls \
             moved? `hallctl encoder align`. Or `hallctl settings set encoder_on_loss halls` to go on without."
        ),
        EncoderRefusal::HallsTooFar(ahead) => format!(
            "the Halls are {ahead:+.1}° electrical ahead of the encoder, too far to be a Hall that was moved a little\n  \
             `hallctl calibrate`, then `hallctl encoder calibrate`: both turn the shaft."
        ),
        EncoderRefusal::NotAbsolute(None) => {
            "the position is not known: Halls and encoder have not been compared yet\n  Wait a moment, with the bridge off."
                .into()
        }
    }
}

fn setting_error(error: &settings::Error) -> String {
    match error {
        settings::Error::Rings(error) => {
            format!("{error}\n  Two rings need pole pairs without a common divisor, like 37 and 45.")
        }
        error => error.to_string(),
    }
}
