//! What a compare channel makes of the count (RM0440, 28.3.9 to 28.3.12).

/// The reference OCxREF in output compare mode `mode` (OCxM).
///
/// In centre-aligned PWM the reference of mode 1 is on while the count is below the compare value on the way up, and
/// not above it on the way down: as many counts on either side of the peak.
pub fn reference(mode: u32, count: u32, down: bool, compare: u32, old: bool) -> bool {
    let pwm = if down { count <= compare } else { count < compare };
    match mode {
        1 if count == compare => true,
        2 if count == compare => false,
        3 if count == compare => !old,
        4 => false,
        5 => true,
        6 => pwm,
        7 => !pwm,
        _ => old,
    }
}

/// Whether [`reference`] has a model of the mode.
pub fn modelled(mode: u32) -> bool {
    mode < 8
}
