//! The serial port (RM0440, chapter "Universal synchronous/asynchronous receiver transmitter"): 8N1, with its FIFOs.

use super::bit;

/// USART_CR1: enabled both ways, with an interrupt where bytes have come; and where there is room for more, if there are any.
pub const fn cr1(sends: bool) -> u32 {
    bit(true, 0) | bit(true, 2) | bit(true, 3) | bit(true, 5) | bit(sends, 7) | bit(true, 29)
}

/// USART_ICR: parity, framing, noise and overrun are over.
pub const ERRORS: u32 = 0b1111;

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn interrupts() {
        // UE 0, RE 2, TE 3, RXFNEIE 5, TXFNFIE 7, FIFOEN 29.
        assert_eq!((cr1(false), cr1(true)), (0x2000_002D, 0x2000_00AD));
    }
}
