//! Tables with a row for each image.

use std::collections::BTreeMap;
use std::path::Path;

use serde::de::DeserializeOwned;

use crate::error::Cause;
use crate::text_file::read_list;

/// The other separator of a table whose columns are not separated by commas, as a sentence; `None` if they
/// are, or if there is only one. Spreadsheets write semicolons in countries with a decimal comma.
pub(crate) fn wrong_separator(text: &str) -> Option<String> {
    let header = text.lines().find(|line| !line.trim().is_empty())?;
    // Names of columns may contain any of them.
    let is_separator = |separator: char| header.contains(separator) && !header.contains(',');
    let name = match [';', '\t'].map(is_separator) {
        [true, _] => "semicolons",
        [_, true] => "tabs",
        _ => return None,
    };
    let shown = header.replace('\t', "\\t");
    Some(format!("its columns are separated by {name}, expected commas: `{shown:.60}`"))
}

/// The rows of a CSV file; none if there is no such file.
pub(super) fn rows<Row: DeserializeOwned>(path: &Path) -> Result<Vec<Row>, Cause> {
    if !path.exists() {
        return Ok(Vec::new());
    }
    parsed_rows(&read_list(path)?)
}

/// The rows of a CSV table. Columns that `Row` does not name are ignored.
pub(super) fn parsed_rows<Row: DeserializeOwned>(text: &str) -> Result<Vec<Row>, Cause> {
    if let Some(reason) = wrong_separator(text) {
        return Err(reason.into());
    }
    let mut reader = csv::ReaderBuilder::new().trim(csv::Trim::All).from_reader(text.as_bytes());
    reader.deserialize().map(|row| Ok(row?)).collect()
}

/// The values of rows by the images' ids. Two rows of one image contradict each other.
pub(super) fn by_id<T>(
    rows: impl Iterator<Item = Result<(String, T), Cause>>,
) -> Result<BTreeMap<String, T>, Cause> {
    let mut values = BTreeMap::new();
    for row in rows {
        let (id, value) = row?;
        if values.contains_key(&id) {
            return Err(format!("it has the image `{id:.60}` twice").into());
        }
        values.insert(id, value);
    }
    Ok(values)
}

#[cfg(test)]
mod tests {
    use serde::Deserialize;

    use super::*;

    #[derive(Debug, PartialEq, Deserialize)]
    struct Row {
        id: String,
        x: f64,
    }

    fn rows_of(bytes: &[u8]) -> Result<Vec<Row>, String> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("rows.csv");
        std::fs::write(&path, bytes).unwrap();
        rows(&path).map_err(|error| error.to_string())
    }

    #[test]
    fn rows_are_read_as_spreadsheets_write_them() {
        let expected = vec![Row { id: "a".into(), x: 1.5 }];
        for text in ["id,x\na,1.5\n", "\u{feff}id,x\r\na,1.5\r\n", "x, more, id\n1.5, ?, a"] {
            assert_eq!(rows_of(text.as_bytes()).unwrap(), expected, "{text:?}");
        }
        assert_eq!(rows_of(b"id,x\n").unwrap(), []);
        assert_eq!(rows::<Row>(Path::new("missing.csv")).unwrap(), []);
    }

    #[test]
    fn another_separator_is_named() {
        for (text, named) in [
            ("id;x\na;1,5\n", "semicolons, expected commas: `id;x`"),
            ("\r\nid;x\r\n", "semicolons, expected commas: `id;x`"),
            ("id\tx\n", "tabs, expected commas: `id\\tx`"),
        ] {
            let reason = rows_of(text.as_bytes()).unwrap_err();
            assert!(reason.contains(named), "{text:?}: {reason}");
        }
        for text in ["", "\n", "id,x\na;b,1\n", "id,\"x;y\"\n", "id\n"] {
            assert_eq!(wrong_separator(text), None, "{text:?}");
        }
    }

    #[test]
    fn damaged_and_endless_files_are_errors() {
        for bytes in [&b"id\na\n"[..], b"id,x\na\n", b"id,x\na,far\n", b"id,x\n\xff\xfe,1\n", b"\0\0\0\na"] {
            assert!(rows_of(bytes).is_err(), "{bytes:?}");
        }
        assert!(rows::<Row>(Path::new("/dev/zero")).unwrap_err().to_string().contains("regular file"));
    }
}
