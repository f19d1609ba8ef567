//! Where the document is in a file of YAML.

use std::ops::Range;

/// Some editors begin a file with it.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// The first document with content, with its line numbers.
pub(super) fn first_document(text: &str) -> String {
    let place = document_range(text);
    "\n".repeat(text[..place.start].matches('\n').count()) + &text[place]
}

/// Where the first document with content is. `ros2 topic echo` ends each message with `---`, and OpenCV
/// begins with `%YAML:1.0`, which is not YAML.
pub(super) fn document_range(text: &str) -> Range<usize> {
    let is_marker = |line: &str| ["---", "..."].contains(&line.trim_end());
    let is_before = |line: &str| line.trim().is_empty() || line.starts_with(['#', '%']) || is_marker(line);
    let bytes = |lines: &mut dyn Iterator<Item = &str>| lines.map(str::len).sum::<usize>();
    let mark = if text.starts_with(BYTE_ORDER_MARK) { BYTE_ORDER_MARK.len_utf8() } else { 0 };
    let start = mark + bytes(&mut text[mark..].split_inclusive('\n').take_while(|line| is_before(line)));
    start..start + bytes(&mut text[start..].split_inclusive('\n').take_while(|line| !is_marker(line)))
}
