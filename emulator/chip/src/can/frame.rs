//! A frame, and how long it is on the wire (ISO 11898-1:2015, 10.4 to 10.6).

/// Bytes that a data length code stands for.
pub const LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// A frame with data, or a request for one.
#[derive(Clone, Debug, Default, PartialEq, Eq, Hash)]
pub struct Frame {
    /// 11 bits, or 29.
    pub id: u32,
    /// The identifier has 29 bits.
    pub extended: bool,
    /// It asks for data; not with `fd`.
    pub remote: bool,
    /// Of the FD format.
    pub fd: bool,
    /// Its data phase is at the data bit rate; only with `fd`.
    pub switched: bool,
    /// The sender is error-passive; only with `fd`.
    pub passive: bool,
    /// Up to 8 bytes, with `fd` any of [`LENGTHS`].
    pub data: Vec<u8>,
}

/// Bits before stuffing, and after how many of them the data phase begins.
struct Bits {
    bits: Vec<bool>,
    switch: usize,
}

impl Bits {
    fn push(&mut self, value: u32, length: u32) {
        self.bits.extend((0..length).rev().map(|at| value >> at & 1 != 0));
    }
}

impl Frame {
    /// With the bit rate switched; padded with zeros to a length that there is.
    pub fn switched(id: u32, extended: bool, data: &[u8]) -> Self {
        let mut data = data.to_vec();
        let length = LENGTHS.iter().find(|length| **length >= data.len()).copied().unwrap_or(64);
        data.resize(length, 0);
        Self { id, extended, fd: true, switched: true, data, ..Self::default() }
    }

    /// The data length code.
    pub fn code(&self) -> u32 {
        LENGTHS.iter().position(|length| *length >= self.data.len()).unwrap_or(15) as u32
    }

    /// What competes for the bus: the lower wins, bit by bit.
    pub fn priority(&self) -> u64 {
        let (base, rest) = if self.extended { (self.id >> 18, self.id & 0x3_ffff) } else { (self.id, 0) };
        let remote = u64::from(self.remote);
        // Base identifier; RTR, or SRR, which is recessive; IDE; the rest; RTR of the extended one.
        let substitute = if self.extended { 1 } else { remote };
        let last = if self.extended { remote } else { 0 };
        u64::from(base) << 21 | substitute << 20 | u64::from(self.extended) << 19 | u64::from(rest) << 1 | last
    }

    /// Up to the checksum.
    fn head(&self) -> Bits {
        let mut bits = Bits { bits: vec![false], switch: usize::MAX };
        let last = u32::from(self.remote);
        if self.extended {
            bits.push(self.id >> 18, 11);
            bits.push(0b11, 2);
            bits.push(self.id & 0x3_ffff, 18);
            bits.push(last, 1);
        } else {
            bits.push(self.id, 11);
            bits.push(last, 1);
            bits.push(0, 1);
        }
        if self.fd {
            // FDF, res, BRS, ESI.
            bits.push(0b10, 2);
            bits.push(u32::from(self.switched), 1);
            bits.switch = if self.switched { bits.bits.len() } else { usize::MAX };
            bits.push(u32::from(self.passive), 1);
        } else {
            bits.push(0, if self.extended { 2 } else { 1 });
        }
        bits.push(self.code(), 4);
        if !self.remote {
            for byte in &self.data {
                bits.push((*byte).into(), 8);
            }
        }
        bits
    }

    /// Bits from the start of frame to its end, at the nominal and at the data bit rate. The bit at which the rate is
    /// switched, and that at which it is switched back, are a bit of each together.
    pub fn bits(&self) -> [u32; 2] {
        let mut head = self.head();
        if !self.fd {
            let checksum = crc15(&head.bits);
            head.push(checksum, 15);
        }
        let mut lengths = [0, 0];
        let mut run = (false, 0);
        for (index, bit) in head.bits.iter().enumerate() {
            lengths[usize::from(index >= head.switch)] += 1;
            run = if run.1 > 0 && run.0 == *bit { (*bit, run.1 + 1) } else { (*bit, 1) };
            // What follows the last bit of the FD format is a fixed stuff bit.
            if run.1 == 5 && !(self.fd && index + 1 == head.bits.len()) {
                lengths[usize::from(index + 1 >= head.switch)] += 1;
                run = (!bit, 1);
            }
        }
        if self.fd {
            // The stuff count, the checksum, a fixed stuff bit before and after every four of them.
            let checksum: u32 = 4 + if self.data.len() > 16 { 21 } else { 17 };
            lengths[usize::from(self.switched)] += checksum + checksum.div_ceil(4);
        }
        // The delimiter of the checksum; acknowledgement, its delimiter, seven bits of the end.
        lengths[usize::from(self.switched)] += 1;
        lengths[0] += 9;
        lengths
    }
}

fn crc15(bits: &[bool]) -> u32 {
    bits.iter().fold(0, |crc, bit| {
        let out = (crc >> 14 & 1 != 0) != *bit;
        (crc << 1 & 0x7fff) ^ if out { 0x4599 } else { 0 }
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// 44 bits and 8 a byte for the base format, 64 for the extended, and at most one stuff bit in four of those that
    /// are stuffed.
    #[test]
    fn lengths_of_classic_frames_are_within_the_known_bounds() {
        for (extended, overhead, stuffed) in [(false, 44, 34), (true, 64, 54)] {
            for seed in 0..2000_u32 {
                let data: Vec<u8> = (0..seed % 9).map(|k| (seed.wrapping_mul(0x9e37_79b9) >> (3 * k)) as u8).collect();
                let bytes = 8 * data.len() as u32;
                let id = seed.wrapping_mul(0x85eb_ca6b) & if extended { 0x1fff_ffff } else { 0x7ff };
                let [nominal, data] = Frame { id, extended, data, ..Frame::default() }.bits();
                assert_eq!(data, 0);
                let most = overhead + bytes + (stuffed + bytes - 1) / 4;
                assert!((overhead + bytes..=most).contains(&nominal), "{id:#x} {nominal}");
            }
        }
    }

    #[test]
    fn a_frame_worked_out_by_hand() {
        // Identifier 0x555 alternates: no stuff bits there. RTR, IDE, r0 are 0, the code 0000: 0, 0, 0, 0 and with the
        // 1 of the identifier before them seven zeros, a stuff bit among them.
        let [nominal, _] = Frame { id: 0x555, ..Frame::default() }.bits();
        let head = [0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 1, 0, 0, 0, 0, 0, 0, 0].map(|bit| bit == 1);
        let checksum = crc15(&head);
        assert!((45..=48).contains(&nominal), "{nominal} {checksum:#x}");
    }

    /// ISO 11898-1: an FD frame of base format has 17 bits up to BRS, 5 to the data, 26 or 32 of the checksum.
    #[test]
    fn lengths_of_fd_frames() {
        // Alternating bits everywhere but where the format has its own.
        for (bytes, checksum) in [(0, 27), (16, 27), (20, 32), (64, 32)] {
            let [nominal, data] = Frame::switched(0x555, false, &vec![0x55; bytes]).bits();
            assert_eq!(nominal, 17 + 9, "{bytes}");
            let least = 5 + 8 * bytes as u32 + checksum + 1;
            assert!((least..least + 3).contains(&data), "{bytes}: {data} {least}");
        }
        let [nominal, data] = Frame { switched: false, ..Frame::switched(0x555, false, &[0x55; 8]) }.bits();
        assert_eq!((nominal > 100, data), (true, 0));
    }

    #[test]
    fn the_lower_identifier_wins_and_the_base_format_before_the_extended() {
        let base = |id| Frame { id, ..Frame::default() }.priority();
        let extended = |id| Frame { id, extended: true, ..Frame::default() }.priority();
        assert!(base(0x100) < base(0x101));
        assert!(base(0x100) < extended(0x100 << 18), "the same eleven bits");
        assert!(extended(0x0ff << 18) < base(0x100));
        assert!(extended(0x8001) < extended(0x8002));
        let remote = Frame { id: 0x100, remote: true, ..Frame::default() }.priority();
        assert!(base(0x100) < remote && remote < extended(0x100 << 18));
    }
}
