//! The YAML parser with errors of this crate.

use serde::de::DeserializeOwned;

use super::CalibrationError;
use crate::text::shortened;

pub(super) fn parse_yaml<T: DeserializeOwned>(text: &str) -> Result<T, CalibrationError> {
    let options = serde_saphyr::options! { with_snippet: false };
    serde_saphyr::from_str_with_options(text, options).map_err(|error| CalibrationError::Syntax {
        reason: shortened(&error.render_with_formatter(&serde_saphyr::UserMessageFormatter)),
    })
}
