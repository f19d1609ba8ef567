//! The words of a command. `shlex` and `shell-words` do not say where a word is in the text.

use std::ops::Range;

/// The words of a command, with their quotes, as a shell separates them.
pub(super) fn words(text: &str) -> Vec<Range<usize>> {
    let (mut words, mut is_escaped) = (Vec::new(), false);
    let (mut start, mut quote): (Option<usize>, Option<char>) = (None, None);
    for (at, c) in text.char_indices() {
        match quote {
            _ if is_escaped => is_escaped = false,
            Some(open) if open == c => quote = None,
            open if c == '\\' && open != Some('\'') => {
                start.get_or_insert(at);
                is_escaped = true;
            }
            None if c.is_whitespace() => words.extend(start.take().map(|start| start..at)),
            None => {
                start.get_or_insert(at);
                quote = matches!(c, '\'' | '"').then_some(c);
            }
            Some(_) => {}
        }
    }
    words.extend(start.map(|start| start..text.len()));
    words
}
