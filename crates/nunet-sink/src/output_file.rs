//! The file of a recording: its name, and whether it may be written.

use std::borrow::Cow;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nunet_mcap::RecordingError;
use nunet_types::Hint;

/// Why a file cannot be the output.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum OutputError {
    /// The input, perhaps under another name.
    #[error("`{}` is both input and output", path.display())]
    IsInput {
        /// The output.
        path: PathBuf,
    },
    /// It exists and must not be overwritten.
    #[error(transparent)]
    Exists(RecordingError),
}

impl Hint for OutputError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        match self {
            Self::IsInput { .. } => Some("pass another output".into()),
            Self::Exists(error) => error.hint(),
        }
    }
}

/// Checks before any work is done that a recording may be written: the file does not exist, or `overwrite` is set and it is
/// not `input` under another name.
///
/// # Errors
/// It must not be written.
pub fn check_output(output: &Path, input: Option<&Path>, overwrite: bool) -> Result<(), OutputError> {
    let Ok(existing) = std::fs::metadata(output) else { return Ok(()) };
    let is_input = input
        .and_then(|input| std::fs::metadata(input).ok())
        .is_some_and(|input| (input.dev(), input.ino()) == (existing.dev(), existing.ino()));
    if is_input {
        return Err(OutputError::IsInput { path: output.to_owned() });
    }
    if !overwrite {
        return Err(OutputError::Exists(RecordingError::Exists { path: output.to_owned() }));
    }
    Ok(())
}

/// The file of a recording: `path` itself, or in a folder one that is named by camera and time.
#[must_use]
pub fn recording_path(path: &Path, is_folder: bool, camera: &str, unix_nanos: i64) -> PathBuf {
    if is_folder { path.join(format!("{camera}_{}.mcap", utc(unix_nanos))) } else { path.to_owned() }
}

/// `20261122T051500Z`, so that names sort by time.
fn utc(unix_nanos: i64) -> String {
    let seconds = unix_nanos.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Days to a date of the proleptic Gregorian calendar: Hinnant, "chrono-compatible low-level date algorithms".
    let shifted = days + 719_468;
    let era = shifted.div_euclid(146_097);
    let day_of_era = shifted.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{:02}Z", second % 60)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_in_a_folder_are_named_by_camera_and_time() {
        let folder = tempfile::tempdir().unwrap();
        let name = |seconds: i64| {
            let path = recording_path(folder.path(), true, "front", seconds * 1_000_000_000);
            path.file_name().unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(name(0), "front_19700101T000000Z.mcap");
        assert_eq!(name(951_782_400), "front_20000229T000000Z.mcap");
        assert_eq!(name(1_795_324_515), "front_20261122T051515Z.mcap");
        assert_eq!(recording_path(Path::new("a.mcap"), false, "front", 0), Path::new("a.mcap"));
    }

    #[test]
    fn an_output_that_is_the_input_or_exists_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (input, link) = (folder.path().join("in.mcap"), folder.path().join("link.mcap"));
        std::fs::write(&input, "x").unwrap();
        std::fs::hard_link(&input, &link).unwrap();
        let is_input = check_output(&link, Some(&input), true);
        assert!(matches!(is_input, Err(OutputError::IsInput { .. })), "{is_input:?}");
        let exists = check_output(&link, None, false);
        assert!(matches!(exists, Err(OutputError::Exists(_))), "{exists:?}");
        assert!(check_output(&link, None, true).is_ok());
        assert!(check_output(&folder.path().join("new.mcap"), Some(&input), false).is_ok());
    }
}
