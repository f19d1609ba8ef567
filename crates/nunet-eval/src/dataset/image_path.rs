//! The file of an image, of its depth or of its labels.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use nunet_source::SourceError;

use crate::error::EvalError;
use crate::image_name::ImageName;

/// The file of `id` in a folder, with one of `endings` in lower case or in capitals. If there is none, the
/// expected path.
///
/// # Errors
/// Several files: nothing says which one is meant.
pub(super) fn image_path(folder: &Path, id: &str, endings: &[&str]) -> Result<PathBuf, EvalError> {
    let named = |ending: &str| folder.join(format!("{id}.{ending}"));
    let spellings = endings.iter().flat_map(|ending| [named(ending), named(&ending.to_uppercase())]);
    let mut found = spellings.filter(|path| path.is_file());
    let Some(first) = found.next() else { return Ok(named(endings[0])) };
    let Some(other) = found.find(|other| identity(other) != identity(&first)) else { return Ok(first) };
    let message = format!("`{}` has the same name, and only one of them can be meant", other.display());
    let source = SourceError::bad_frame(message).with_hint("remove one of the two files");
    Err(EvalError::ReadImage { image: ImageName::from(&*first).into(), source })
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
    fn a_file_is_found_by_each_ending_and_a_missing_one_has_the_first() {
        let folder = folder(&["a.npy", "b.PNG", "c.jpg"]);
        for (id, file) in [("a", "a.npy"), ("b", "b.PNG"), ("c", "c.png"), ("d", "d.png")] {
            assert_eq!(image_path(folder.path(), id, &ENDINGS).unwrap(), folder.path().join(file));
        }
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
        assert_eq!(image_path(folder.path(), "a", &ENDINGS).unwrap(), folder.path().join("a.png"));
    }
}
