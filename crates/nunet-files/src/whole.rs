//! Atomic file writes: a file is complete or does not exist.

use std::fs::File;
use std::io::{BufWriter, ErrorKind, Write as _};
use std::path::{Path, PathBuf};

use image::{DynamicImage, ImageFormat};

use crate::error::{Cause, FilesError};

/// Writes a file under a temporary name beside it, and renames it when it is complete: a full disk, an error
/// or a power loss leaves neither half a file nor a changed one. Waits for the disk. An existing device or
/// pipe is written directly.
///
/// # Errors
/// The file cannot be written, or `write` fails.
pub fn write_whole(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Cause>,
) -> Result<(), FilesError> {
    place(path, write, File::sync_all).map_err(FilesError::write_file(path))
}

/// Writes a file of results, as [`write_whole`] does, but does not wait for the disk, because there may be
/// several for each frame. After a power loss, those of the last seconds may be incomplete.
pub(crate) fn write_result(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Cause>,
) -> Result<(), FilesError> {
    place(path, write, |_| Ok(())).map_err(FilesError::write_file(path))
}

/// Writes a PNG file, as [`write_result`] does.
pub(crate) fn write_png(path: &Path, image: impl Into<DynamicImage>) -> Result<(), FilesError> {
    let image = image.into();
    write_result(path, |file| Ok(image.write_to(file, ImageFormat::Png)?))
}

/// `sync` is called with the complete file, before it gets its name.
fn place(
    path: &Path,
    write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Cause>,
    sync: impl FnOnce(&File) -> std::io::Result<()>,
) -> Result<(), Cause> {
    // A link stays a link, and what it points to is replaced.
    let path = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let existing = path.metadata().ok();
    if existing.as_ref().is_some_and(|existing| !existing.is_file()) {
        fill(File::create(&path)?, write)?;
        return Ok(());
    }
    let temporary = Temporary(beside(&path));
    match File::create(&temporary.0) {
        Ok(file) => {
            let file = fill(file, write)?;
            if let Some(existing) = existing {
                file.set_permissions(existing.permissions())?;
            }
            sync(&file)?;
            temporary.rename(&path)
        }
        // A file may be writable in a folder that is not.
        Err(error) if error.kind() == ErrorKind::PermissionDenied && existing.is_some() => {
            Ok(sync(&fill(File::create(&path)?, write)?)?)
        }
        Err(error) => Err(error.into()),
    }
}

/// Returns the written file.
fn fill(file: File, write: impl FnOnce(&mut BufWriter<File>) -> Result<(), Cause>) -> Result<File, Cause> {
    let mut file = BufWriter::new(file);
    let written = write(&mut file).and_then(|()| Ok(file.flush()?));
    // A failed write must not be tried again when the buffer is dropped.
    let (file, _) = file.into_parts();
    written.map(|()| file)
}

/// Hidden, so that nothing that lists the folder takes it for a result.
fn beside(path: &Path) -> PathBuf {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    path.with_file_name(format!(".{name}.{}.part", std::process::id()))
}

/// Is removed unless it was renamed.
struct Temporary(PathBuf);

impl Temporary {
    fn rename(self, path: &Path) -> Result<(), Cause> {
        std::fs::rename(&self.0, path)?;
        std::mem::forget(self);
        Ok(())
    }
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // It may not have been created.
        let _ = std::fs::remove_file(&self.0);
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::PermissionsExt as _;

    use super::*;

    fn files(folder: &Path) -> Vec<String> {
        let names = folder.read_dir().unwrap().map(|entry| entry.unwrap().file_name());
        names.map(|name| name.into_string().unwrap()).collect()
    }

    #[test]
    fn an_error_leaves_the_old_file_and_no_part_of_the_new_one() {
        let folder = tempfile::tempdir().unwrap();
        let (old, new) = (folder.path().join("old.json"), folder.path().join("new.json"));
        std::fs::write(&old, "precious").unwrap();
        for path in [&old, &new] {
            let error = write_whole(path, |file| {
                file.write_all(&[0; 100_000])?;
                Err("the disk is full".into())
            });
            assert!(error.unwrap_err().to_string().contains("cannot write"));
        }
        assert_eq!(std::fs::read_to_string(&old).unwrap(), "precious");
        assert_eq!(files(folder.path()), ["old.json"]);
    }

    #[test]
    fn a_link_and_the_mode_of_a_file_stay() {
        let folder = tempfile::tempdir().unwrap();
        let (file, link) = (folder.path().join("a"), folder.path().join("link"));
        std::fs::write(&file, "old").unwrap();
        std::fs::set_permissions(&file, std::fs::Permissions::from_mode(0o640)).unwrap();
        std::os::unix::fs::symlink(&file, &link).unwrap();
        write_whole(&link, |file| Ok(file.write_all(b"new")?)).unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read_to_string(&file).unwrap(), "new");
        assert_eq!(file.metadata().unwrap().permissions().mode() & 0o777, 0o640);
    }

    #[test]
    fn devices_are_written_directly() {
        write_whole(Path::new("/dev/null"), |file| Ok(file.write_all(b"gone")?)).unwrap();
        let error = write_whole(Path::new("/dev/full"), |file| Ok(file.write_all(b"gone")?)).unwrap_err();
        assert!(error.to_string().contains("/dev/full"), "{error}");
        assert!(!Path::new("/dev/null").is_file());
    }
}
