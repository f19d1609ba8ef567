//! The file of an image, of its depth or of its labels.

use std::io::ErrorKind;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nunet_source::SourceError;

use crate::error::EvalError;
use crate::image_name::ImageName;

/// The file of `id` in a folder, with one of `endings` in lower case or in capitals; `None` without one. What
/// has its name and cannot be a file is returned too: reading it says why.
///
/// # Errors
/// Several files: nothing says which one is meant.
pub(super) fn image_path(folder: &Path, id: &str, endings: &[&str]) -> Result<Option<PathBuf>, EvalError> {
    let named = |ending: &str| folder.join(format!("{id}.{ending}"));
    let mut spellings = endings.iter().flat_map(|ending| [named(ending), named(&ending.to_uppercase())]);
    let mut found = spellings.clone().filter(|path| path.is_file());
    let Some(first) = found.next() else { return Ok(spellings.find(|path| !is_missing(path))) };
    let Some(other) = found.find(|other| identity(other) != identity(&first)) else {
        return Ok(Some(first));
    };
    let message = format!("`{}` has the same name, and only one of them can be meant", other.display());
    let source = SourceError::bad_frame(message).with_hint("remove one of the two files");
    Err(EvalError::ReadImage { image: ImageName::from(&*first).into(), source })
}

/// How errors name a file that is missing: with the names that [`image_path`] has looked for.
pub(super) fn missing_image(folder: &Path, id: &str, endings: &[&str]) -> ImageName {
    let names = endings.iter().map(|ending| format!("{id}.{ending}")).collect();
    ImageName::OneOf { folder: folder.to_owned(), names }
}

/// Whether nothing is there. A file whose folder may not be searched is not missing.
fn is_missing(path: &Path) -> bool {
    path.symlink_metadata().is_err_and(|error| error.kind() == ErrorKind::NotFound)
}

/// Device and number of a file. They are equal for links, and for two spellings where the file system ignores
/// case.
fn identity(path: &Path) -> Option<(u64, u64)> {
    path.metadata().ok().map(|file| (file.dev(), file.ino()))
}

#[cfg(test)]
mod tests {
    use nunet_types::text_with_causes;

    use super::*;

    const ENDINGS: [&str; 2] = ["png", "npy"];

    fn folder(files: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        files.iter().for_each(|file| std::fs::write(folder.path().join(file), "").unwrap());
        folder
    }

    #[test]
    fn a_file_is_found_by_each_ending_and_a_missing_one_is_named_with_all_of_them() {
        let folder = folder(&["a.npy", "b.PNG", "c.jpg"]);
        for (id, file) in [("a", Some("a.npy")), ("b", Some("b.PNG")), ("c", None), ("d", None)] {
            let found = image_path(folder.path(), id, &ENDINGS).unwrap();
            assert_eq!(found, file.map(|file| folder.path().join(file)), "{id}");
        }
        let name = missing_image(folder.path(), "d", &ENDINGS).to_string();
        assert!(name.ends_with("/d.png` or `d.npy`"), "{name}");
    }

    #[test]
    fn what_has_the_name_and_is_no_file_is_not_missing() {
        let folder = folder(&[]);
        std::fs::create_dir(folder.path().join("a.npy")).unwrap();
        let found = image_path(folder.path(), "a", &ENDINGS).unwrap();
        assert_eq!(found, Some(folder.path().join("a.npy")));
    }

    #[test]
    fn two_files_of_one_name_are_refused_with_both_names() {
        for files in [["a.png", "a.npy"], ["a.png", "a.PNG"], ["a.NPY", "a.npy"]] {
            let folder = folder(&files);
            let error = image_path(folder.path(), "a", &ENDINGS).unwrap_err();
            let text = text_with_causes(&error);
            assert!(matches!(error, EvalError::ReadImage { .. }), "{text}");
            assert!(files.iter().all(|file| text.contains(&format!("/{file}`"))), "{text}");
        }
    }

    #[test]
    fn a_link_is_no_second_file() {
        let folder = folder(&["a.npy"]);
        std::os::unix::fs::symlink("a.npy", folder.path().join("a.png")).unwrap();
        assert_eq!(image_path(folder.path(), "a", &ENDINGS).unwrap(), Some(folder.path().join("a.png")));
    }
}
