//! Sizes out of a linker's `memory.x`.

/// Bytes of a region: `NAME : ORIGIN = …, LENGTH = 116K`.
pub fn length(text: &str, region: &str) -> Option<u64> {
    let line = text.lines().find(|line| line.split([':', '(', ' ']).find(|word| !word.is_empty()) == Some(region))?;
    let word = line.split_once("LENGTH")?.1.trim_start().strip_prefix('=')?.trim();
    let digits = word.trim_end_matches(['K', 'M']);
    let scale = if word.ends_with('K') {
        10
    } else if word.ends_with('M') {
        20
    } else {
        0
    };
    let number = match digits.strip_prefix("0x") {
        Some(digits) => u64::from_str_radix(digits, 16).ok()?,
        None => digits.parse().ok()?,
    };
    Some(number << scale)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "/* RAM of a chip */
MEMORY
{
  FLASH   : ORIGIN = 0x08000000, LENGTH = 116K
  STACK   : ORIGIN = 0x20000000, LENGTH = 10752
  RAM (xrw) : ORIGIN = 0x20002A00, LENGTH = 0x5600
}";

    #[test]
    fn lengths_are_read_with_their_units() {
        assert_eq!(length(TEXT, "FLASH"), Some(116 << 10));
        assert_eq!(length(TEXT, "STACK"), Some(10_752));
        assert_eq!(length(TEXT, "RAM"), Some(0x5600));
        assert_eq!(length(TEXT, "STORAGE"), None);
    }
}
