//! The folder of the files.

use std::path::Path;

use crate::error::FilesError;

/// Creates `folder` if it is missing, and makes sure that files can be created in it.
///
/// # Errors
/// It cannot be created, or is read-only.
pub fn make_folder(folder: &Path) -> Result<(), FilesError> {
    std::fs::create_dir_all(folder)
        .map_err(|error| FilesError::CreateFolder { path: folder.to_owned(), source: error.into() })?;
    probe(folder)
}

/// Makes sure, before long work, that [`make_folder`] will succeed. Nothing is created.
///
/// # Errors
/// As [`make_folder`].
pub fn check_folder(folder: &Path) -> Result<(), FilesError> {
    // A relative path ends in nothing, which is the current folder.
    let existing = folder.ancestors().find(|part| part.exists()).unwrap_or(Path::new("."));
    let path = folder.to_owned();
    if !existing.is_dir() {
        return Err(FilesError::NotAFolder { path, existing: existing.to_owned() });
    }
    match probe(existing) {
        Err(error) if existing != folder => Err(FilesError::CreateFolder { path, source: error.into() }),
        probed => probed,
    }
}

fn probe(folder: &Path) -> Result<(), FilesError> {
    let probe = folder.join(format!(".nunet-{}", std::process::id()));
    let written = std::fs::write(&probe, "").and_then(|()| std::fs::remove_file(&probe));
    written.map_err(|source| FilesError::WriteIntoFolder { path: folder.to_owned(), source })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::error::FilesErrorKind;

    #[test]
    fn a_folder_is_checked_without_a_trace_and_created_with_its_parents() {
        let root = tempfile::tempdir().unwrap();
        let folder = root.path().join("a/b");
        check_folder(&folder).unwrap();
        assert_eq!(root.path().read_dir().unwrap().count(), 0);
        make_folder(&folder).unwrap();
        assert_eq!(folder.read_dir().unwrap().count(), 0);
    }

    #[test]
    fn a_file_and_a_path_below_a_file_are_no_folders() {
        let file = tempfile::NamedTempFile::new().unwrap();
        for path in [file.path().to_owned(), file.path().join("a/b")] {
            let error = check_folder(&path).unwrap_err();
            assert!(matches!(&error, FilesError::NotAFolder { existing, .. } if existing == file.path()));
            assert_eq!(make_folder(&path).unwrap_err().kind(), FilesErrorKind::Folder);
        }
    }
}
