//! Text in the fixed arrays of a message.

/// The text in a zero-filled array: up to the first zero byte, with anything that is not UTF-8 replaced.
pub(crate) fn text(bytes: &[u8]) -> std::borrow::Cow<'_, str> {
    let end = bytes.iter().position(|byte| *byte == 0).unwrap_or(bytes.len());
    String::from_utf8_lossy(&bytes[..end])
}

/// Fills a fixed array with a text: cut at a character's boundary if it is too long, zeros behind it.
pub(crate) fn set_text(bytes: &mut [u8], text: &str) {
    let end = text.floor_char_boundary(bytes.len());
    bytes.fill(0);
    bytes[..end].copy_from_slice(&text.as_bytes()[..end]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_text_that_is_too_long_is_cut_between_characters() {
        let mut bytes = [0xff; 4];
        set_text(&mut bytes, "abcß");
        assert_eq!(bytes, *b"abc\0");
        assert_eq!(text(&bytes), "abc");
    }

    #[test]
    fn a_text_that_fills_the_array_needs_no_final_zero() {
        let mut bytes = [0; 4];
        set_text(&mut bytes, "abcd");
        assert_eq!(text(&bytes), "abcd");
    }
}
