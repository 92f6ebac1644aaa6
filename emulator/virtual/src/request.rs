//! A request of the drive's protocol, out of the words of a script.

use hallservo::commutation::Commutation;
use hallservo_protocol::{Ask, EncoderAsk, FRAME, Request, encode};
use script::words::{number, whole};

/// The bytes that carry it.
///
/// # Errors
/// What the drive cannot be asked for, and numbers that are none.
pub fn frame(words: &[String], id: usize) -> Result<Vec<u8>, String> {
    let words: Vec<_> = words.iter().map(String::as_str).collect();
    let mut frame = [0; FRAME];
    // A script asks once, and is no tool that lives on.
    let request = Request { id: id as u16, client: 1, unattended: true, ask: ask(&words)? };
    let length = encode(&request, &mut frame).map_err(|error| format!("{error:?}"))?;
    Ok(frame[..length].to_vec())
}

fn ask<'a>(words: &[&'a str]) -> Result<Ask<'a>, String> {
    Ok(match words {
        ["hello"] => Ask::Hello,
        ["status"] => Ask::Status,
        ["arm"] => Ask::Arm,
        ["disarm"] => Ask::Disarm,
        ["clear"] => Ask::Clear,
        ["voltage", value] => Ask::Voltage(number(value)? as f32),
        ["torque", value] => Ask::Torque(number(value)? as f32),
        ["speed", value] => Ask::Speed(number(value)? as f32),
        ["position", value] => Ask::Position(number(value)?),
        ["commutate", "block"] => Ask::Commutate(Commutation::Block),
        ["commutate", "sinusoidal"] => Ask::Commutate(Commutation::Sinusoidal),
        ["commutate", "field-oriented"] => Ask::Commutate(Commutation::FieldOriented),
        ["calibrate"] => Ask::Calibrate,
        ["calibration"] => Ask::Calibration,
        ["identify"] => Ask::Identify,
        ["identification"] => Ask::Identification,
        ["learn-cogging"] => Ask::LearnCogging,
        ["cogging"] => Ask::Cogging,
        ["anti-cogging", "on"] => Ask::AntiCogging(true),
        ["anti-cogging", "off"] => Ask::AntiCogging(false),
        ["get", name] => Ask::Get(name),
        ["set", name, value] => Ask::Set { name, value: number(value)? as f32 },
        ["save"] => Ask::Save,
        ["load"] => Ask::Load,
        ["restore"] => Ask::Restore,
        ["release"] => Ask::Release,
        ["accept"] => Ask::Accept,
        ["telemetry", rate] => Ask::Telemetry(number(rate)? as f32),
        ["encoder", what] => Ask::Encoder(match *what {
            "status" => EncoderAsk::Status,
            "calibrate" => EncoderAsk::Calibrate { by_hand: false },
            "zero" => EncoderAsk::Zero,
            "align" => EncoderAsk::Align,
            "forget" => EncoderAsk::Forget,
            _ => return Err(format!("an encoder cannot be asked for {what:?}")),
        }),
        ["history", entry] => {
            Ask::History(u8::try_from(whole(entry)?).map_err(|_| format!("entries are 0 to 255, not {entry:?}"))?)
        }
        _ => return Err(format!("the drive cannot be asked for {:?}", words.join(" "))),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_sent_is_a_frame() {
        let frame = frame(&["speed".into(), "-3.5".into()], 7).unwrap();
        let mut decoder = hallservo_protocol::Decoder::new();
        let mut last = None;
        for byte in frame {
            last = decoder
                .push::<Request>(byte)
                .map(|request| request.unwrap())
                .map(|one| (one.id, one.ask == Ask::Speed(-3.5)))
                .or(last);
        }
        assert_eq!(last, Some((7, true)));
    }
}
