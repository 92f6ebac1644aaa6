//! Words, times and numbers of the language. Numbers are finite, times are not negative.

/// Words of a line, and what is in quotes as one, with them; a comment ends the line.
///
/// # Errors
/// A quote that is not closed.
pub fn split(line: &str) -> Result<Vec<String>, String> {
    let mut words = Vec::new();
    let mut rest = line.trim_start();
    while !rest.is_empty() && !rest.starts_with('#') {
        let length = if rest.starts_with('"') {
            let mut escaped = false;
            let closing = rest.char_indices().skip(1).find(|&(_, character)| {
                let closes = character == '"' && !escaped;
                escaped = character == '\\' && !escaped;
                closes
            });
            closing.ok_or("the quote is not closed")?.0 + 1
        } else {
            rest.find(|character: char| character.is_whitespace() || character == '#').unwrap_or(rest.len())
        };
        words.push(rest[..length].to_owned());
        rest = rest[length..].trim_start();
    }
    Ok(words)
}

/// A time in seconds: `0.5s`, `20ms` or `300us`.
///
/// # Errors
/// Anything else, a negative time among it.
pub fn time(word: &str) -> Result<f64, String> {
    let units = [("ms", 1e-3), ("us", 1e-6), ("s", 1.0)];
    units
        .iter()
        .find_map(|(unit, scale)| Some(word.strip_suffix(unit)?.parse::<f64>().ok()? * scale))
        .filter(|seconds| seconds.is_finite() && *seconds >= 0.0)
        .ok_or_else(|| format!("a time is like 0.5s, 20ms or 300us, not {word:?}"))
}

/// A number with its unit behind it.
///
/// # Errors
/// Anything else, what is not finite among it.
pub fn quantity(word: &str, unit: &str) -> Result<f64, String> {
    let number = word.strip_suffix(unit).and_then(|number| number.parse::<f64>().ok());
    let expected = if unit.is_empty() { String::new() } else { format!(" with {unit}") };
    number.filter(|number| number.is_finite()).ok_or_else(|| format!("expected a number{expected}, found {word:?}"))
}

/// A number without a unit.
///
/// # Errors
/// As [`quantity`].
pub fn number(word: &str) -> Result<f64, String> {
    quantity(word, "")
}

/// A whole number from zero on.
///
/// # Errors
/// Anything else.
pub fn whole(word: &str) -> Result<u64, String> {
    word.parse().map_err(|_| format!("expected a whole number, found {word:?}"))
}

/// What is in quotes, with `\xNN`, `\n`, `\r`, `\0`, `\"` and `\\`.
///
/// # Errors
/// Other escapes, or no quotes.
pub fn bytes(quoted: &str) -> Result<Vec<u8>, String> {
    let inner = quoted.strip_prefix('"').and_then(|rest| rest.strip_suffix('"'));
    let inner = inner.ok_or_else(|| format!("expected text in quotes, found {quoted:?}"))?;
    let mut bytes = Vec::new();
    let mut rest = inner.chars();
    while let Some(character) = rest.next() {
        if character != '\\' {
            bytes.extend(character.encode_utf8(&mut [0; 4]).as_bytes());
            continue;
        }
        bytes.push(match rest.next() {
            Some('n') => b'\n',
            Some('r') => b'\r',
            Some('0') => 0,
            Some(same @ ('"' | '\\')) => same as u8,
            Some('x') => {
                let digits: String = rest.by_ref().take(2).collect();
                let two = digits.len() == 2 && digits.bytes().all(|digit| digit.is_ascii_hexdigit());
                let byte = u8::from_str_radix(&digits, 16).ok().filter(|_| two);
                byte.ok_or_else(|| format!("\\x takes two hexadecimal digits, not {digits:?}"))?
            }
            other => return Err(format!("unknown escape \\{}", other.map_or(String::new(), String::from))),
        });
    }
    Ok(bytes)
}
