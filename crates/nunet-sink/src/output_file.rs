//! The file of a recording: its name, and whether it may be written.

use std::path::{Path, PathBuf};

use nunet_mcap::RecordingError;

/// Checks before any work is done that a recording may be written: the file does not exist, or `overwrite` is
/// set.
///
/// # Errors
/// It exists.
pub fn check_output(output: &Path, overwrite: bool) -> Result<(), RecordingError> {
    if output.exists() && !overwrite {
        Err(RecordingError::Exists { path: output.to_owned() })
    } else {
        Ok(())
    }
}

/// The file of a recording: `path` itself, or if it is a folder, a new file in it that is named by camera and
/// time. A name may be taken: a robot without a clock that runs while it is off boots at the same time again.
#[must_use]
pub fn recording_path(path: &Path, is_folder: bool, camera: &str, unix_nanos: i64) -> PathBuf {
    if !is_folder {
        return path.to_owned();
    }
    let name = format!("{camera}_{}", utc(unix_nanos));
    let (mut file, mut number) = (path.join(format!("{name}.mcap")), 1_u64);
    while file.exists() {
        number += 1;
        file = path.join(format!("{name}_{number}.mcap"));
    }
    file
}

/// `20261122T051500Z`, so that names sort by time.
fn utc(unix_nanos: i64) -> String {
    let seconds = unix_nanos.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Days to a date of the proleptic Gregorian calendar: Hinnant, "chrono-compatible low-level date
    // algorithms".
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
        for taken in ["front_19700101T000000Z.mcap", "front_19700101T000000Z_2.mcap"] {
            assert_eq!(name(0), taken);
            std::fs::write(folder.path().join(taken), "").unwrap();
        }
        assert_eq!(name(0), "front_19700101T000000Z_3.mcap");
        assert_eq!(recording_path(Path::new("a.mcap"), false, "front", 0), Path::new("a.mcap"));
    }

    #[test]
    fn an_output_that_exists_is_refused() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let exists = check_output(file.path(), false);
        assert!(matches!(exists, Err(RecordingError::Exists { .. })), "{exists:?}");
        check_output(file.path(), true).unwrap();
        check_output(&file.path().join("new.mcap"), false).unwrap();
    }
}
