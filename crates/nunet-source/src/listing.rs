//! Lists of image files: a folder, a glob, or a single file.

use std::path::{Path, PathBuf};

use glob::{MatchOptions, Pattern};
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

/// Whether a pattern such as `frames/*.png` would list a file at `path`, an absolute path, once it exists.
/// Never for the name of a file or a folder.
#[must_use]
pub fn would_list(pattern: &Path, path: &Path) -> bool {
    if pattern.exists() {
        return false;
    }
    // Of the pattern's folders, those without wildcards may be links, and may hold characters that look like
    // wildcards.
    let is_plain = |folder: &&Path| folder.is_dir();
    let base = pattern.ancestors().find(is_plain).unwrap_or(Path::new(""));
    let wildcards = pattern.strip_prefix(base).unwrap_or(pattern);
    let Ok(base) = if base.as_os_str().is_empty() { Path::new(".") } else { base }.canonicalize() else {
        return false;
    };
    let whole = Path::new(&Pattern::escape(&base.to_string_lossy())).join(wildcards);
    let options = MatchOptions { require_literal_separator: true, ..MatchOptions::new() };
    Pattern::new(&whole.to_string_lossy()).is_ok_and(|pattern| pattern.matches_path_with(path, options))
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
    fn a_pattern_would_list_a_file_that_does_not_exist_yet() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().canonicalize().unwrap();
        std::fs::create_dir(root.join("a[b]")).unwrap();
        std::os::unix::fs::symlink(root.join("a[b]"), root.join("link")).unwrap();
        let lists = |pattern: &str, path: &str| would_list(&root.join(pattern), &root.join(path));
        for (pattern, path) in [
            ("a[b]/*.png", "a[b]/depth.png"),
            ("link/*.png", "a[b]/depth.png"),
            ("*/*.png", "new/depth.png"),
            ("**/*.png", "a[b]/c/d/depth.png"),
        ] {
            assert!(lists(pattern, path), "{pattern} {path}");
        }
        for (pattern, path) in [
            ("a[b]/*.png", "a[b]/c/depth.png"),
            ("a[b]/*.jpg", "a[b]/depth.png"),
            ("*.png", "a[b]/depth.png"),
            ("a[b]", "a[b]"),
        ] {
            assert!(!lists(pattern, path), "{pattern} {path}");
        }
    }

    #[test]
    fn hidden_files_of_a_folder_are_no_images() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.jpg", "._a.jpg", ".b.png", "c.txt"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        assert_eq!(list(folder.path()).unwrap(), [folder.path().join("a.jpg")]);
    }
}
