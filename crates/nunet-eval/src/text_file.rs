//! Text files that the user names: lists and tables.

use std::path::Path;

use nunet_core::plain_file;

use crate::error::Cause;

/// The byte order mark that some editors write.
const BYTE_ORDER_MARK: char = '\u{feff}';
/// The largest list: a million ids of 64 characters.
const MAX_LIST_BYTES: u64 = 64 << 20;

/// A text file of bounded size, without a byte order mark.
pub(crate) fn read_list(list: &Path) -> Result<String, Cause> {
    let text = plain_file::read_text(list, MAX_LIST_BYTES)?;
    Ok(text.trim_start_matches(BYTE_ORDER_MARK).to_owned())
}
