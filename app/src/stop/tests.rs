use super::*;
use hallservo_protocol::{Ask, FRAME, Request, encode};

fn frame(id: u16, ask: Ask<'_>) -> ([u8; FRAME], usize) {
    let mut frame = [0; FRAME];
    // The longest there is.
    let length = encode(&Request { id, client: u32::MAX, unattended: true, ask }, &mut frame).unwrap();
    (frame, length)
}

fn dealt(bytes: u32) -> Dealt {
    let mut counts = [0; SOURCES];
    counts[LINE] = bytes;
    Dealt {
        counts,
        #[cfg(feature = "registers")]
        address: Address { id: 3, prefix: 0 },
    }
}

fn hear(listener: &mut Listener, stop: &Stop, id: u16, ask: Ask<'_>) -> u32 {
    let (frame, length) = frame(id, ask);
    frame[..length].iter().for_each(|byte| listener.hear(*byte, true, stop));
    length as u32
}

#[test]
fn a_request_to_disarm_of_any_number_holds_until_it_is_dealt_with() {
    let (mut listener, stop, mut bytes) = (Listener::new(), Stop::new(), 0);
    for id in [0, 1, 127, 128, 300, 0x7fff, 0xffff] {
        bytes += hear(&mut listener, &stop, id, Ask::Arm);
        bytes += hear(&mut listener, &stop, id, Ask::Get("command_timeout_s"));
        assert!(!stop.holds());
        let before = bytes;
        bytes += hear(&mut listener, &stop, id, Ask::Disarm);
        assert!(stop.holds(), "{id}");
        stop.release(&dealt(before));
        stop.release(&dealt(bytes - 1));
        assert!(stop.holds(), "{id}");
        stop.release(&dealt(bytes));
        assert!(!stop.holds(), "{id}");
    }
}

#[test]
fn no_bit_may_be_wrong() {
    for bit in 0..8 * frame(300, Ask::Disarm).1 {
        let (mut listener, stop) = (Listener::new(), Stop::new());
        let (mut bytes, length) = frame(300, Ask::Disarm);
        bytes[bit / 8] ^= 1 << (bit % 8);
        // The zero in front only ends what was before it.
        let harmless = bit < 8 && bytes[1..].starts_with(&frame(300, Ask::Disarm).0[1..]);
        bytes[..length].iter().for_each(|byte| listener.hear(*byte, true, &stop));
        assert!(!stop.holds() || harmless, "bit {bit}");
    }
}

#[test]
fn what_is_lost_on_the_way_to_the_tasks_does_not_count() {
    let (mut listener, stop) = (Listener::new(), Stop::new());
    let (bytes, length) = frame(7, Ask::Disarm);
    for (at, byte) in bytes[..length].iter().enumerate() {
        listener.hear(*byte, at < 3, &stop);
    }
    assert!(stop.holds());
    stop.release(&dealt(2));
    assert!(stop.holds());
    stop.release(&dealt(3));
    assert!(!stop.holds());
    // As many bytes as the count holds, and none to disarm.
    stop.release(&dealt(u32::MAX / 2 + 3));
    stop.release(&dealt(2));
    assert!(!stop.holds());
}

#[cfg(feature = "registers")]
mod with_lines_of_text {
    use super::*;

    fn say(listener: &mut Listener, stop: &Stop, line: &[u8]) -> u32 {
        let bytes = || b"can send ".iter().chain(line).chain(b"\n");
        bytes().for_each(|byte| listener.hear(*byte, true, stop));
        bytes().count() as u32
    }

    #[test]
    fn the_mode_stopped_holds_where_it_is_for_this_drive() {
        let (mut listener, stop) = (Listener::new(), Stop::new());
        stop.release(&dealt(0));
        let mut bytes = 0;
        // A query, a position, a stop for another drive, of another prefix, cut off, with a wrong check sum.
        for line in ["8003 1100", "8003 01000a", "8001 010000", "28003 010000", "3 0100", "8003 010000 *00"] {
            bytes += say(&mut listener, &stop, line.as_bytes());
            assert!(!stop.holds(), "{line}");
        }
        for line in ["8003 010000", "3 0100001100", "807f 010000"] {
            let before = bytes;
            bytes += say(&mut listener, &stop, line.as_bytes());
            assert!(stop.holds(), "{line}");
            stop.release(&dealt(before));
            assert!(stop.holds(), "{line}");
            stop.release(&dealt(bytes));
            assert!(!stop.holds(), "{line}");
        }
    }

    #[test]
    fn line_and_bus_are_waited_for_each() {
        let (mut listener, mut frames, stop) = (Listener::new(), FrameListener::new(), Stop::new());
        let of = |bytes: u32, frames: u32| Dealt { counts: [bytes, frames], ..dealt(0) };
        frames.hear(&[0x11, 0], true, &stop);
        assert!(!stop.holds());
        frames.hear(&[1, 0, 0], true, &stop);
        let bytes = say(&mut listener, &stop, b"8001 010000");
        for dealt in [of(0, 0), of(bytes - 1, 1), of(bytes - 1, 2)] {
            stop.release(&dealt);
            assert!(stop.holds(), "{dealt:?}");
        }
        stop.release(&of(bytes, 2));
        assert!(!stop.holds());
        // The line's mark is as old as can be: it says nothing of a stop at the bus.
        frames.hear(&[1, 0, 0], false, &stop);
        assert!(stop.holds());
        stop.release(&of(bytes.wrapping_add(u32::MAX / 2 + 9), 2));
        assert!(!stop.holds());
    }
}
