//! Lists of image files: a folder, a glob, or a single file.

use std::path::{Path, PathBuf};

use tracing::debug;

use crate::error::{SourceError, SourceErrorKind};
use crate::image_file::IMAGE_EXTENSIONS;

/// The images of a folder, those that a glob matches, or a single one; sorted, and perhaps none.
///
/// # Errors
/// An invalid glob, or a folder that cannot be read.
pub fn list(path: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let mut paths = if path.is_dir() {
        images_in(path)?
    } else if path.is_file() {
        vec![path.to_owned()]
    } else {
        matches(&path.to_string_lossy())?
    };
    paths.sort();
    Ok(paths)
}

/// The paths that [`list`] reads: the folder as a whole, or each file.
#[must_use]
pub fn listed_files(path: &Path) -> Vec<PathBuf> {
    if path.is_dir() { vec![path.to_owned()] } else { list(path).unwrap_or_default() }
}

fn images_in(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let unreadable = |error: std::io::Error| {
        let message = format!("cannot list the folder `{}`", folder.display());
        SourceError::new(SourceErrorKind::Unavailable, message).with_cause(error)
    };
    let mut paths = Vec::new();
    for entry in folder.read_dir().map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        if is_image(&path) && is_hidden(&path) {
            debug!("`{}` is hidden and not read", path.display());
        } else if is_image(&path) {
            paths.push(path);
        }
    }
    Ok(paths)
}

/// Hidden files are skipped: macOS writes `._a.jpg`, which is not an image, next to `a.jpg`.
fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

fn is_image(path: &Path) -> bool {
    let extension = path.extension().map(|extension| extension.to_ascii_lowercase());
    extension.is_some_and(|extension| IMAGE_EXTENSIONS.iter().any(|known| extension == *known))
}

fn matches(pattern: &str) -> Result<Vec<PathBuf>, SourceError> {
    let paths = glob::glob(pattern).map_err(|error| {
        SourceError::bad_arguments(format!("`{pattern}` is neither a source nor a valid glob: {}", error.msg))
    })?;
    // A folder below the glob that cannot be read hides images: that is reported, not ignored.
    paths.collect::<Result<_, _>>().map_err(|error| {
        SourceError::new(SourceErrorKind::Unavailable, format!("cannot list `{pattern}`")).with_cause(error)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hidden_files_of_a_folder_are_no_images() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.jpg", "._a.jpg", ".b.png", "c.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(list(folder.path()).unwrap(), [folder.path().join("a.jpg")]);
    }
}
