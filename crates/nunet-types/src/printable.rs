//! Control characters in names of files and topics: they would break lines of a log, move a terminal's
//! cursor, or look like another message.

use std::borrow::Cow;

/// What indents the later lines of a message.
const INDENT: &str = "    ";

/// A message for a terminal or an exception. From the first backtick to the last one every control character
/// is escaped, as in `a\nb`: names are between backticks, and one that contains backticks itself cannot end
/// before the last. Elsewhere line ends and tabs remain, because a message may have several lines, such as
/// those of a parser.
///
/// All lines but the first are indented by at least two spaces, so that they cannot look like another
/// message.
#[must_use]
pub fn message(text: &str) -> Cow<'_, str> {
    let names = text.find('`').unwrap_or(text.len())..text.rfind('`').unwrap_or_default();
    let text = escaped(text, |place, c| names.contains(&place) || !matches!(c, '\n' | '\t'));
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
    escaped(text, |_, _| true)
}

/// A text of several lines, such as a table: every control character but line ends and tabs is escaped.
#[must_use]
pub fn lines(text: &str) -> Cow<'_, str> {
    escaped(text, |_, c| !matches!(c, '\n' | '\t'))
}

/// A text whose later lines, such as the folders that were searched, are a list after the first one.
#[must_use]
pub fn with_later_lines_as_list(text: &str) -> String {
    let mut lines = text.lines().map(str::trim);
    let first = lines.next().unwrap_or_default();
    let rest = lines.collect::<Vec<_>>().join(", ");
    if rest.is_empty() { first.to_owned() } else { format!("{first} {rest}") }
}

/// A text with each occurrence of `parts` on one line, their control characters escaped. For the message of a
/// library that quotes arguments unchanged.
#[must_use]
pub fn with_parts_on_one_line<'a>(text: &str, parts: impl IntoIterator<Item = &'a str>) -> String {
    let mut text = text.to_owned();
    for part in parts {
        if let Cow::Owned(escaped) = one_line(part)
            && !part.trim().is_empty()
        {
            text = text.replace(part, &escaped);
        }
    }
    text
}

/// Escapes the control characters that `matters` accepts by their place, in bytes, and themselves.
///
/// As JSON does, in which the texts may be: all of these characters have four hexadecimal digits.
fn escaped(text: &str, matters: impl Fn(usize, char) -> bool) -> Cow<'_, str> {
    if !text.contains(is_control) {
        return text.into();
    }
    let mut escaped = String::with_capacity(text.len() + 8);
    for (place, c) in text.char_indices() {
        match c {
            _ if !is_control(c) || !matters(place, c) => escaped.push(c),
            '\n' => escaped.push_str("\\n"),
            '\r' => escaped.push_str("\\r"),
            '\t' => escaped.push_str("\\t"),
            _ => escaped += &format!("\\u{:04x}", u32::from(c)),
        }
    }
    escaped.into()
}

/// Also separators of lines and marks that change the direction of writing, which make a text look like
/// another one.
fn is_control(c: char) -> bool {
    c.is_control() || matches!(c, '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_stay_on_one_line_and_messages_keep_theirs() {
        let text = "it\tis\n  | ^ `a\nhint: b\u{1b}[2J`, not `c\td`\n  end\u{7}";
        let expected = "it\tis\n  | ^ `a\\nhint: b\\u001b[2J`, not `c\\td`\n  end\\u0007";
        assert_eq!(message(text), expected);
        assert_eq!(one_line("a\r\nb\tc"), "a\\r\\nb\\tc");
        assert_eq!(lines("a | b\u{9b}31m\nc"), "a | b\\u009b31m\nc");
        assert_eq!(one_line("fly\u{202e}gpj.png\u{2028}"), "fly\\u202egpj.png\\u2028");
    }

    #[test]
    fn a_name_with_backticks_cannot_add_a_line() {
        for name in
            ["a`\nhint: b", "a`\n`hint: b", "`\n2026-11-29T10:00:00Z ERROR b`", "`\n  because: b`\n  c"]
        {
            let text = format!("cannot read `{name}` of `{name}`: no such file");
            assert_eq!(message(&text).lines().count(), 1, "{}", message(&text));
        }
    }

    #[test]
    fn quoted_parts_stay_on_one_line_and_the_lines_of_the_text_remain() {
        let text = "no `a\u{1b}[31m\nhint: b`\nUsage: c\n";
        let parts = ["", "\n", "c", "a\u{1b}[31m\nhint: b"];
        assert_eq!(with_parts_on_one_line(text, parts), "no `a\\u001b[31m\\nhint: b`\nUsage: c\n");
    }

    #[test]
    fn later_lines_are_indented() {
        let text = "cannot parse it\n1 | x\n  | ^\nexpected `]`";
        assert_eq!(message(text), "cannot parse it\n    1 | x\n      | ^\n    expected `]`");
    }

    #[test]
    fn other_texts_are_not_copied() {
        for text in ["", "größe `日本.png` 😀", "C:\\n"] {
            assert!(matches!(message(text), Cow::Borrowed(same) if same == text), "{text}");
        }
    }
}
