//! Control characters in names of files and topics: they would break lines of a log, move a terminal's cursor, or look like
//! another message.

use std::borrow::Cow;

/// What indents the later lines of a message.
const INDENT: &str = "    ";

/// A message for a terminal or an exception. Between backticks, where names are, every control character is escaped, as in
/// `a\nb`. Elsewhere line ends and tabs remain, because a message may have several lines.
///
/// All lines but the first are indented by at least two spaces, so that they cannot look like another message: a name that
/// contains backticks itself seems to end before its line end.
#[must_use]
pub fn message(text: &str) -> Cow<'_, str> {
    let mut is_name = false;
    let text = escaped(text, |c| {
        is_name ^= c == '`';
        is_name || !matches!(c, '\n' | '\t')
    });
    let is_beside_margin = |line: &str| !line.is_empty() && !line.starts_with("  ");
    if !text.lines().skip(1).any(is_beside_margin) {
        return text;
    }
    // All of them by the same width: some point into the line above.
    text.replace('\n', &format!("\n{INDENT}")).into()
}

/// A text that stays on one line: every control character is escaped.
#[must_use]
pub fn one_line(text: &str) -> Cow<'_, str> {
    escaped(text, |_| true)
}

/// A text of several lines, such as a table: every control character but line ends and tabs is escaped.
#[must_use]
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |c| !matches!(c, '\n' | '\t'))
}

/// Escapes the control characters that `matters` accepts. It is called with every character, in order.
fn escaped(text: &str, mut matters: impl FnMut(char) -> bool) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return text.into();
    }
    let mut escaped = String::with_capacity(text.len() + 8);
    for c in text.chars() {
        if matters(c) && is_control(c) {
            escaped.extend(c.escape_default());
        } else {
            escaped.push(c);
        }
    }
    escaped.into()
}

/// Also separators of lines and marks that change the direction of writing, which make a text look like another one.
fn is_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_on_one_line_and_messages_keep_theirs() {
        let text = "cannot read `a\nhint: b\u{1b}[2J`\n  because: it\tis `c\td`\u{7}";
        let expected = "cannot read `a\\nhint: b\\u{1b}[2J`\n  because: it\tis `c\\td`\\u{7}";
        assert_eq!(message(text), expected);
        assert_eq!(one_line("a\r\nb\tc"), "a\\r\\nb\\tc");
        assert_eq!(lines("a | b\u{9b}31m\nc"), "a | b\\u{9b}31m\nc");
        assert_eq!(one_line("fly\u{202e}gpj.png\u{2028}"), "fly\\u{202e}gpj.png\\u{2028}");
    }

    #[test]
    fn a_name_with_backticks_cannot_begin_a_line() {
        for name in ["a`\nhint: b", "a`\n`hint: b", "`\n2026-11-29T10:00:00Z ERROR b`", "`\n hint: b`\n  c"] {
            let text = format!("cannot read `{name}`");
            let message = message(&text);
            assert!(message.lines().skip(1).all(|line| line.starts_with("  ")), "{message}");
        }
        let text = "cannot parse it\n1 | x\n  | ^";
        assert_eq!(message(text), "cannot parse it\n    1 | x\n      | ^");
    }

    #[test]
    fn other_texts_are_not_copied() {
        for text in ["", "größe `日本.png` 😀", "C:\\n"] {
            assert!(matches!(message(text), Cow::Borrowed(same) if same == text), "{text}");
        }
    }
}
