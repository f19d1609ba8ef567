//! Counts in messages.

use std::fmt::Display;

/// A count with its noun, which gets an `s` unless the count is 1: `1 frame`, `2 frames`.
#[must_use]
pub fn counted<N: Display + PartialEq + From<u8>>(count: N, noun: &str) -> String {
    let ending = if count == N::from(1) { "" } else { "s" };
    format!("{count} {noun}{ending}")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_one_is_singular() {
        assert_eq!([0_u64, 1, 2].map(|count| counted(count, "frame")), ["0 frames", "1 frame", "2 frames"]);
        assert_eq!([counted(1_usize, "image"), counted(1_u32, "image")], ["1 image"; 2]);
    }
}
