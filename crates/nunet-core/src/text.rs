//! Messages of other libraries, shortened so that an error does not repeat a whole file.

/// The most characters of a line.
const MAX_LINE: usize = 160;
/// The most lines.
const MAX_LINES: usize = 12;

/// A parser's message with its lines shortened: some repeat the invalid line, which may be the whole file.
#[must_use]
pub fn shortened(message: &str) -> String {
    let line = |line: &str| match line.char_indices().nth(MAX_LINE) {
        Some((end, _)) => format!("{}…", &line[..end]),
        None => line.to_owned(),
    };
    message.trim_end().lines().take(MAX_LINES).map(line).collect::<Vec<_>>().join("\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn long_lines_are_shortened_and_the_last_line_stays() {
        let long = "ß".repeat(5000);
        let short = shortened(&format!("at line 1\n1 | {long}\nexpected `]`\n"));
        assert!(short.starts_with("at line 1\n1 | ß"), "{short}");
        assert!(short.ends_with("…\nexpected `]`"), "{short}");
        assert!(short.len() < 500, "{short}");
        assert_eq!(shortened(&"a\n".repeat(100)).lines().count(), MAX_LINES);
        assert_eq!(shortened(""), "");
    }
}
