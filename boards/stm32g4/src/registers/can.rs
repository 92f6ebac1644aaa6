//! CAN-FD (RM0440, chapter 44): bit timing, acceptance filters, and the elements of FDCAN1's message RAM.
//!
//! 1 Mbit/s and, in the data phase, 5 Mbit/s, sampled at two thirds, with jumps as wide as they can be: what moteus
//! clients and adapters have. A bit has 85 and 17 periods of PCLK1.

use super::clock::PCLK1_HZ;
use super::{bit, field};

/// Bit rates of arbitration and of the data phase, bit/s.
pub const RATES: [u32; 2] = [1_000_000, 5_000_000];

/// Periods of the clock in the segments of a bit: before and after the sample point, without the first one.
const fn segments(rate: u32) -> [u32; 2] {
    assert!(PCLK1_HZ.is_multiple_of(rate), "a bit is no whole number of periods");
    let periods = PCLK1_HZ / rate;
    let after = (periods + 1) / 3;
    [periods - 1 - after, after]
}

/// FDCAN_NBTP.
pub const NBTP: u32 = {
    let [before, after] = segments(RATES[0]);
    field(after - 1, 25, 7) | field(before - 1, 8, 8) | field(after - 1, 0, 7)
};

/// FDCAN_DBTP. The delay of the transceiver is longer than it is to the sample point, and so is compensated.
pub const DBTP: u32 = {
    let [before, after] = segments(RATES[1]);
    bit(true, 23) | field(before - 1, 8, 5) | field(after - 1, 4, 4) | field(after - 1, 0, 4)
};

/// FDCAN_TDCR: sent bits are sampled as late within them as received ones.
pub const TDCR: u32 = field(1 + segments(RATES[1])[0], 8, 7);

/// How far off both clocks together may be, as a share: edges ten bits apart move the sample point by a jump, and
/// thirteen bits of error flags have to fit (ISO 11898-1, 11.3.2.4).
pub const fn tolerance() -> f32 {
    let [[before, after], [_, fast]] = [segments(RATES[0]), segments(RATES[1])];
    let periods = (1 + before + after) as f32;
    let edges = after as f32 / (10.0 * periods);
    let flags = after as f32 / (13.0 * periods - after as f32);
    let data = fast as f32 / (10 * (PCLK1_HZ / RATES[1])) as f32;
    edges.min(flags).min(data)
}

/// FDCAN_CCCR: initialisation; its registers may be written.
pub const INIT: u32 = 1;
/// The same, with the change enabled that INIT allows.
pub const CONFIGURE: u32 = INIT | 1 << 1;
/// FDOE and BRSE: FD frames, and their bit rate switched.
pub const RUN: u32 = bit(true, 8) | bit(true, 9);

/// FDCAN_RXGFC: two filters of each kind; what none of them knows, and remote frames, are rejected.
pub const RXGFC: u32 =
    bit(true, 0) | bit(true, 1) | field(2, 2, 2) | field(2, 4, 2) | field(2, 16, 5) | field(2, 24, 4);
/// FDCAN_IE: a frame in FIFO 0.
pub const IE: u32 = 1;
/// FDCAN_IR: a frame was lost for want of room.
pub const LOST: u32 = 1 << 2;

/// First words of the message RAM's parts.
pub const EXTENDED: usize = 28;
/// FIFO 0.
pub const FIFO: usize = 44;
/// Buffers to send from.
pub const BUFFERS: usize = 158;
/// Words of an element of these two.
pub const ELEMENT: usize = 18;
/// Words of all that is FDCAN1's.
pub const WORDS: usize = 212;

/// The address that every drive listens to.
pub const BROADCAST: u32 = 0x7f;

/// Filters for what is sent to a drive or to all, whoever sends it: in the lowest byte of an identifier is the
/// destination, in the next one the source. Those of eleven bits have room for no prefix.
pub const fn filters(id: u8, prefix: u16) -> ([u32; 2], [u32; 4]) {
    let [own, all] = [id as u32, BROADCAST];
    // Bits that have to be as given; to FIFO 0. Without them the filter is off.
    const STANDARD: u32 = field(0b10, 30, 2) | field(1, 27, 3) | 0xff;
    let standard = if prefix == 0 { [STANDARD | field(own, 16, 11), STANDARD | field(all, 16, 11)] } else { [0; 2] };
    let above = field(prefix as u32, 16, 13);
    let mask = field(0b10, 30, 2) | 0x1fff_00ff;
    (standard, [field(1, 29, 3) | above | own, mask, field(1, 29, 3) | above | all, mask])
}

/// Bytes that a data length code stands for.
const LENGTHS: [u8; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// Identifier of a received element, and how many bytes it has, by its first two words.
pub fn received([first, second]: [u32; 2]) -> (u32, usize) {
    let identifier = if first >> 30 & 1 != 0 { first & 0x1fff_ffff } else { first >> 18 & 0x7ff };
    let length = LENGTHS[(second >> 16 & 0xf) as usize];
    // A classic frame has eight bytes at most, whatever its code says.
    let most = if second >> 21 & 1 != 0 { 64 } else { 8 };
    (identifier, length.min(most).into())
}

/// First two words of an element to send, and how many bytes it has then: FD with the bit rate switched, of 29 bits
/// where 11 do not do.
pub fn to_send(identifier: u32, bytes: usize) -> ([u32; 2], usize) {
    let first = if identifier > 0x7ff { bit(true, 30) | identifier & 0x1fff_ffff } else { identifier << 18 };
    let code = LENGTHS.iter().position(|&length| usize::from(length) >= bytes).unwrap_or(15);
    ([first, bit(true, 21) | bit(true, 20) | (code as u32) << 16], LENGTHS[code].into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::vec::Vec;

    #[test]
    fn bits_are_sampled_at_two_thirds() {
        assert_eq!([segments(RATES[0]), segments(RATES[1])], [[56, 28], [10, 6]]);
        // NSJW = 27, NBRP = 0, NTSEG1 = 55, NTSEG2 = 27; TDC, DTSEG1 = 9, DTSEG2 = 5, DSJW = 5; TDCO = 11.
        assert_eq!((NBTP, DBTP, TDCR), (0x3600_371b, 0x0080_0955, 0x0b00));
    }

    /// The internal oscillator has 1 % (DS12288, 0 to 85 °C), and so may the other one have.
    #[test]
    fn two_internal_oscillators_understand_each_other() {
        assert!(tolerance() > 0.02, "{}", tolerance());
    }

    #[test]
    fn filters_are_of_one_drive() {
        let passes = |id: u8, prefix: u16, identifier: u32, extended: bool| {
            let (standard, long) = filters(id, prefix);
            if extended {
                long.chunks(2).any(|words| (identifier ^ words[0]) & words[1] & 0x1fff_ffff == 0)
            } else {
                standard.iter().any(|word| word >> 27 & 7 == 1 && (identifier ^ word >> 16) & word & 0x7ff == 0)
            }
        };
        for extended in [false, true] {
            assert!(passes(5, 0, 0x105, extended) && passes(5, 0, 0x005, extended) && passes(5, 0, 0x07f, extended));
            assert!(!passes(5, 0, 0x104, extended) && !passes(5, 0, 0x501, extended) && !passes(5, 0, 0x085, extended));
        }
        assert!(passes(5, 0, 0x8005, true) && !passes(5, 0, 0x1_8005, true));
        assert!(passes(5, 0x123, 0x123_8005, true) && passes(5, 0x123, 0x123_807f, true));
        assert!(!passes(5, 0x123, 0x8005, true) && !passes(5, 0x123, 0x005, false));
    }

    #[test]
    fn elements() {
        assert_eq!(received([1 << 30 | 0x8001, 1 << 21 | 13 << 16]), (0x8001, 32));
        assert_eq!(received([0x101 << 18, 9 << 16]), (0x101, 8));
        assert_eq!(to_send(0x100, 0), ([0x100 << 18, 1 << 21 | 1 << 20], 0));
        assert_eq!(to_send(0x1_0100, 9), ([1 << 30 | 0x1_0100, 1 << 21 | 1 << 20 | 9 << 16], 12));
        let padded: Vec<usize> = (0..=64).map(|bytes| to_send(1, bytes).1).collect();
        assert!(padded.iter().enumerate().all(|(bytes, &length)| length >= bytes && length < bytes + 16));
    }
}
