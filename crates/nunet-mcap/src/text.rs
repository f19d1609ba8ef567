//! The texts of messages in CDR.

use std::borrow::Cow;

use serde::{Deserialize, Deserializer};

/// The longest text that is read. Those that have a meaning are shorter.
const MAX_TEXT_BYTES: usize = 1024;

/// Reads a text: in CDR a sequence of bytes that ends with a zero.
///
/// ROS 2 sends texts unchecked, and one that is not UTF-8 must not make an image unreadable: its bytes are
/// replaced. A text that is too long is cut, because this is done for every message.
pub(crate) fn read<'de: 'a, 'a, D: Deserializer<'de>>(deserializer: D) -> Result<Cow<'a, str>, D::Error> {
    let bytes = <&'de [u8]>::deserialize(deserializer)?;
    let text = bytes.strip_suffix(&[0]).unwrap_or(bytes);
    Ok(String::from_utf8_lossy(&text[..text.len().min(MAX_TEXT_BYTES)]))
}
