//! Checksums of what is stored and sent, bit by bit, for tables take flash. A crate's code serves every CRC that there is: for
//! these two it takes 148 bytes more.

/// Reflected polynomials of CRC-32/ISO-HDLC and CRC-16/IBM-SDLC.
const POLYNOMIAL_32: u32 = 0xEDB8_8320;
const POLYNOMIAL_16: u32 = 0x8408;

/// CRC-32/ISO-HDLC, that of Ethernet.
pub fn crc32(bytes: &[u8]) -> u32 {
    crc32_of([bytes])
}

/// That of pieces, as if they were one.
pub fn crc32_of<T: AsRef<[u8]>>(pieces: impl IntoIterator<Item = T>) -> u32 {
    !pieces.into_iter().fold(u32::MAX, |crc, piece| update(POLYNOMIAL_32, crc, piece.as_ref()))
}

/// CRC-16/IBM-SDLC, that of X.25.
pub(crate) fn crc16(bytes: &[u8]) -> u16 {
    !update(POLYNOMIAL_16, 0xFFFF, bytes) as u16
}

#[inline(never)]
fn update(polynomial: u32, crc: u32, bytes: &[u8]) -> u32 {
    bytes.iter().fold(crc, |crc, byte| {
        (0..8).fold(crc ^ u32::from(*byte), |crc, _| if crc & 1 == 1 { crc >> 1 ^ polynomial } else { crc >> 1 })
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values that the catalogue of CRCs (G. Cook) has for this text.
    #[test]
    fn checks_of_the_catalogue() {
        assert_eq!(crc32(b"123456789"), 0xCBF4_3926);
        assert_eq!(crc32_of([b"1234".as_slice(), b"", b"56789"]), 0xCBF4_3926);
        assert_eq!(crc16(b"123456789"), 0x906E);
        assert_eq!(crc32(b""), 0);
    }
}
