//! The ids of a dataset's images: from a list, or from the names of the files.

use std::collections::HashSet;
use std::path::Path;

use crate::error::EvalError;
use crate::text_file::read_list;

/// Ids of a list, one per line.
pub(crate) fn read_ids(list: &Path) -> Result<Vec<String>, EvalError> {
    let unreadable = |error| EvalError::Ids(format!("cannot read `{}`: {error}", list.display()));
    let text = read_list(list).map_err(unreadable)?;
    let lines = text.lines().map(str::trim);
    let ids: Vec<String> = lines.filter(|id| !id.is_empty()).map(str::to_owned).collect();
    let mut seen = HashSet::new();
    if let Some(twice) = ids.iter().find(|id| !seen.insert(id.as_str())) {
        return Err(EvalError::Ids(format!("`{}` names the image `{twice}` twice", list.display())));
    }
    if ids.is_empty() {
        return Err(EvalError::Ids(format!("`{}` names no image", list.display())));
    }
    Ok(ids)
}

/// The files of one folder of a dataset.
pub(super) struct Listing {
    /// Names without their endings, in no order.
    pub(super) ids: Vec<String>,
    /// Files with other endings.
    pub(super) others: u64,
}

/// Lists a folder. Endings count in lower case and in capitals.
pub(super) fn list(folder: &Path, endings: &[&str]) -> Result<Listing, EvalError> {
    let mut listing = Listing { ids: Vec::new(), others: 0 };
    for entry in folder.read_dir().map_err(EvalError::list(folder))? {
        let path = entry.map_err(EvalError::list(folder))?.path();
        let ending = path.extension().map(|ending| ending.to_string_lossy());
        let is = |known: &str| {
            ending.as_ref().is_some_and(|ending| *ending == known || *ending == known.to_uppercase())
        };
        if endings.iter().any(|known| is(known)) {
            listing.ids.extend(path.file_stem().map(|stem| stem.to_string_lossy().into_owned()));
        } else {
            listing.others += 1;
        }
    }
    Ok(listing)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_id_is_a_line_of_a_list_and_may_have_spaces() {
        let list = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(list.path(), "\u{feff}kitchen 1\r\n\n  b  \n").unwrap();
        assert_eq!(read_ids(list.path()).unwrap(), ["kitchen 1", "b"]);
    }

    #[test]
    fn a_list_without_ids_with_one_twice_or_that_is_no_file_is_refused() {
        let list = tempfile::NamedTempFile::new().unwrap();
        for text in [" \n", "a\na\n"] {
            std::fs::write(list.path(), text).unwrap();
            assert!(matches!(read_ids(list.path()), Err(EvalError::Ids(_))), "{text}");
        }
        let error = read_ids(Path::new("/dev/zero")).unwrap_err();
        assert_eq!(error.to_string(), "cannot read `/dev/zero`: it is not a regular file");
    }

    #[test]
    fn files_with_other_endings_are_counted() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["a.png", "b.PNG", "c.Png", "notes.txt", "d"] {
            std::fs::write(folder.path().join(name), "").unwrap();
        }
        let mut listing = list(folder.path(), &["png"]).unwrap();
        listing.ids.sort();
        assert_eq!((listing.ids, listing.others), (vec!["a".to_owned(), "b".to_owned()], 3));
    }
}
