//! Words of others, cut to what a terminal bears: an error must not repeat a file.

/// The most characters of one line.
const MAX_LINE: usize = 160;
/// The most lines.
const MAX_LINES: usize = 12;

/// A parser's message with its lines cut: some repeat the line that is wrong, which may be the whole file.
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
    fn long_lines_are_cut_and_the_last_line_stays() {
        let long = "ß".repeat(5000);
        let short = shortened(&format!("at line 1\n1 | {long}\nexpected `]`\n"));
        assert!(short.starts_with("at line 1\n1 | ß"), "{short}");
        assert!(short.ends_with("…\nexpected `]`"), "{short}");
        assert!(short.len() < 500, "{short}");
        assert_eq!(shortened(&"a\n".repeat(100)).lines().count(), MAX_LINES);
        assert_eq!(shortened(""), "");
    }
}
