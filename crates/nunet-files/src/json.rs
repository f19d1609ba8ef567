//! Values as JSON files.

use std::io::{ErrorKind, Write as _};
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{FileTypeExt as _, OpenOptionsExt as _};
use std::path::Path;

use rustix::fs::OFlags;
use serde::Serialize;

use crate::error::FilesError;
use crate::whole::write_result;

/// Checks before a long run that a file can be written at its end. A file that did not exist does not exist
/// afterwards.
///
/// # Errors
/// Its folder is missing, it is a named pipe, or it cannot be opened for writing.
pub fn check_writable(path: &Path) -> Result<(), FilesError> {
    if is_named_pipe(path) {
        return Err(FilesError::NamedPipe { path: path.to_owned() });
    }
    if let Some(folder) = missing_folder(path) {
        return Err(FilesError::NoFolder { path: path.to_owned(), folder: folder.to_owned() });
    }
    let existed = path.exists();
    let mut options = std::fs::OpenOptions::new();
    // Opening a pipe without a reader must not block.
    let opened =
        options.create(true).append(true).custom_flags(OFlags::NONBLOCK.bits().cast_signed()).open(path);
    opened.map(drop).map_err(FilesError::write_file(path))?;
    if !existed {
        // A link whose target did not exist stays.
        let file = path.canonicalize().map_err(FilesError::write_file(path))?;
        std::fs::remove_file(file).map_err(FilesError::write_file(path))?;
    }
    Ok(())
}

/// The missing folder of a file, or a missing folder that a path with a trailing slash names.
fn missing_folder(path: &Path) -> Option<&Path> {
    let is_folder = path.as_os_str().as_bytes().ends_with(b"/");
    let folder = if is_folder { Some(path) } else { path.parent() };
    let missing = |folder: &Path| folder.metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound);
    folder.filter(|folder| !folder.as_os_str().is_empty() && missing(folder))
}

/// The reader of a named pipe would see its end when the check closes it. An unnamed pipe, which
/// `/dev/stdout` may be, stays open in the parent process.
fn is_named_pipe(path: &Path) -> bool {
    path.metadata().is_ok_and(|found| found.file_type().is_fifo()) && path.canonicalize().is_ok()
}

/// Writes `value` as indented JSON.
///
/// # Errors
/// The file cannot be written.
pub fn write_json(path: &Path, value: &impl Serialize) -> Result<(), FilesError> {
    let text = serde_json::to_string_pretty(value).map_err(FilesError::write_file(path))?;
    write_result(path, |file| Ok(writeln!(file, "{text}")?))
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;

    #[test]
    fn a_missing_folder_is_an_error_with_a_hint_and_a_new_file_is_not_left_behind() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("stats.json");
        check_writable(&file).unwrap();
        assert!(!file.exists());
        let link = folder.path().join("link.json");
        std::os::unix::fs::symlink("stats.json", &link).unwrap();
        check_writable(&link).unwrap();
        assert!(link.is_symlink() && !file.exists());
        let error = check_writable(&folder.path().join("runs/stats.json")).unwrap_err();
        assert!(matches!(error, FilesError::NoFolder { .. }), "{error}");
        assert!(error.hint().unwrap().starts_with("make it first: mkdir -p "), "{error}");
        std::fs::write(&file, "old").unwrap();
        check_writable(&file).unwrap();
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "old");
    }
}
