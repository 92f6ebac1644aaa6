//! A stop is heard before its turn comes: by who receives frames, while what serves them is busy.

use crate::frame::{SubFrame, SubFrames};
use crate::register::{self, Content, Quantity};
use crate::server::DIAGNOSTIC;

/// Whether a frame commands the mode "stopped"; with `text` also whether it carries the line `d stop`.
///
/// Who serves the frame may refuse it for something else that is in it: the motor is off then, which is the safe side.
/// One that names a drive by its UUID is left to who knows that.
pub fn stops(frame: &[u8], text: bool) -> bool {
    let (mut mode, mut line) = (None, false);
    for sub_frame in SubFrames::of(frame) {
        match sub_frame {
            Err(_) => return false,
            Ok(SubFrame::Write(values)) => {
                for (register, number) in values.iter() {
                    match register {
                        register::MODE => mode = Some(register::decode(number, Quantity::Integer)),
                        register::UUID_MASK_1..=register::UUID_MASK_4 => return false,
                        _ => {}
                    }
                }
            }
            Ok(SubFrame::ToDrive { channel: DIAGNOSTIC, bytes }) if text => line |= has_line(bytes),
            Ok(_) => {}
        }
    }
    line || mode == Some(Content::Bits(0))
}

/// Whether a line in it is `d stop`, as the diagnostic channel reads lines. One that is cut in pieces is none.
fn has_line(bytes: &[u8]) -> bool {
    let mut lines = bytes.split(|byte| matches!(byte, b'\r' | b'\n'));
    // What comes last has no end.
    lines.next_back();
    lines.any(|line| line.trim_ascii().strip_prefix(b"d ").is_some_and(|motion| motion.trim_ascii() == b"stop"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mode_is_what_counts() {
        // int8, with what pads it; int16, int32, float.
        for frame in [&[1, 0, 0, 0x50, 0x50][..], &[5, 0, 0, 0], &[9, 0, 0, 0, 0, 0], &[13, 0, 0, 0, 0, 0]] {
            assert!(stops(frame, false), "{frame:x?}");
        }
        // With a query behind it, or as the last of two.
        assert!(stops(&[1, 0, 0, 0x11, 0, 0x1f, 1], false) && stops(&[1, 0, 10, 1, 0, 0], false));
        let others = [&[][..], &[1, 0, 10], &[1, 1, 0], &[0x11, 0], &[1, 0, 0, 1, 0, 10], &[1, 0], &[1, 0, 0, 0xff]];
        for frame in others {
            assert!(!stops(frame, true), "{frame:x?}");
        }
        // For another drive, perhaps.
        assert!(!stops(&[9, 0xd4, 2, 1, 2, 3, 4, 1, 0, 0], false));
    }

    #[test]
    fn a_line_of_text_counts_as_a_whole() {
        let carried = |line: &[u8]| stops(&[&[0x40, 1, line.len() as u8], line].concat(), true);
        for line in [&b"d stop\n"[..], b"\nd stop\r\n", b" d  stop \nconf list\n", b"tel stop\nd stop\n"] {
            assert!(carried(line), "{line:?}");
        }
        for line in [&b"d stop"[..], b"tel stop\n", b"d stopp\n", b"dstop\n", b"d\nstop\n", b"xd stop\n"] {
            assert!(!carried(line), "{line:?}");
        }
        // Nobody reads them, or it is another channel.
        assert!(!stops(b"\x40\x01\x07d stop\n", false) && !stops(b"\x40\x02\x07d stop\n", true));
    }
}
