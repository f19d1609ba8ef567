//! Text files that the user names: lists and tables.

use std::path::Path;

use nunet_core::plain_file;

use crate::error::Cause;

/// The largest list: a million ids of 64 characters.
const MAX_LIST_BYTES: u64 = 64 << 20;

/// A text file of bounded size, with the line ends of Unix: the CSV reader counts lines wrongly where they
/// end with carriage return and line feed.
pub(crate) fn read_list(list: &Path) -> Result<String, Cause> {
    Ok(plain_file::read_text(list, MAX_LIST_BYTES)?.replace("\r\n", "\n"))
}
