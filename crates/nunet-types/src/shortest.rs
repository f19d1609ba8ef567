//! Numbers as they were written.

use std::io::Write as _;

/// The longest text is `-1.17549435e-38`.
const MAX_TEXT_BYTES: usize = 16;

/// The number with the shortest text that means `value`: 0.05 and not 0.05000000074505806. For everything
/// that prints an `f64`, such as JSON: a mere conversion adds digits that nobody wrote.
///
/// Allocates nothing.
#[must_use]
pub fn shortest(value: f32) -> f64 {
    let mut text = [0; MAX_TEXT_BYTES];
    let mut free = &mut text[..];
    let written = write!(free, "{value:e}");
    let length = MAX_TEXT_BYTES - free.len();
    let text = written.ok().and_then(|()| std::str::from_utf8(&text[..length]).ok());
    text.and_then(|text| text.parse().ok()).unwrap_or(value.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_number_has_no_more_digits_than_it_needs() {
        for (value, text) in
            [(0.05, "0.05"), (0.83, "0.83"), (1.8, "1.8"), (-0.1, "-0.1"), (20.0, "20"), (0.0, "0")]
        {
            assert_eq!(shortest(value).to_string(), text);
        }
    }

    #[test]
    fn no_number_changes() {
        let longest =
            [f32::MIN_POSITIVE, -f32::MIN_POSITIVE, f32::MAX, f32::MIN, f32::from_bits(1), 16_777_216.0];
        for value in longest.into_iter().chain([f32::INFINITY, f32::NEG_INFINITY, -0.0, 1.0 / 3.0]) {
            assert_eq!((shortest(value) as f32).to_bits(), value.to_bits(), "{value}");
        }
        assert!(shortest(f32::NAN).is_nan());
    }
}
