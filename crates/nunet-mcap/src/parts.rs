//! The files of a recording: one MCAP file, or the folder of a split bag with all its parts in order.

use std::cmp::Ordering;
use std::collections::HashSet;
use std::fs::File;
use std::io::Read as _;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::RecordingError;
use crate::records::io;

/// The metadata file of `ros2 bag record`.
const METADATA: &str = "metadata.yaml";
/// The largest `metadata.yaml`. That of a bag with a thousand parts has about 100 kB.
const MAX_METADATA_BYTES: u64 = 16 << 20;

/// The used fields of `metadata.yaml`.
#[derive(Debug, Deserialize)]
struct Metadata {
    rosbag2_bagfile_information: Information,
}

#[derive(Debug, Deserialize)]
struct Information {
    #[serde(default)]
    storage_identifier: String,
    #[serde(default)]
    relative_file_paths: Vec<PathBuf>,
}

/// Whether a path is a recording by its name or its content: an MCAP file, a bag's folder, or its
/// `metadata.yaml`.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    let is_mcap = has_ending(path, "mcap");
    let is_metadata = path.file_name().is_some_and(|name| name == METADATA);
    let is_bag = || path.join(METADATA).is_file() || mcap_files(path).is_ok_and(|files| !files.is_empty());
    is_mcap || is_metadata || (path.is_dir() && is_bag()) || is_mcap_file(path)
}

/// Whether a regular file is MCAP by its first bytes: a recording may have any name.
fn is_mcap_file(path: &Path) -> bool {
    let mut start = [0; mcap::MAGIC.len()];
    let read = |mut file: File| file.read_exact(&mut start);
    path.is_file() && File::open(path).and_then(read).is_ok() && start == mcap::MAGIC
}

/// The files that are read of a recording, and its folder.
#[must_use]
pub fn files(path: &Path) -> Vec<PathBuf> {
    let folder = path.is_dir().then(|| path.to_owned());
    folder.into_iter().chain(parts(path).unwrap_or_default()).collect()
}

/// The files of a recording, in the order in which they were recorded.
///
/// # Errors
/// A folder without a recording or with several of them.
pub(crate) fn parts(path: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    if path.file_name().is_some_and(|name| name == METADATA) && path.is_file() {
        return parts_of_folder(path.parent().unwrap_or(Path::new("")));
    }
    if path.is_dir() { parts_of_folder(path) } else { Ok(vec![path.to_owned()]) }
}

fn parts_of_folder(folder: &Path) -> Result<Vec<PathBuf>, RecordingError> {
    let folder = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let refused = |reason: String, hint: String| {
        Err(RecordingError::NotARecordingFolder { path: folder.to_owned(), reason, hint })
    };
    let information = read_metadata(&folder.join(METADATA));
    if let Some(listed) =
        information.as_ref().filter(|information| !information.relative_file_paths.is_empty())
    {
        // Older versions wrote the folder's name before that of the file.
        let names = listed.relative_file_paths.iter().filter_map(|path| path.file_name());
        let mut seen = HashSet::new();
        let names = names.filter(|name| seen.insert(*name));
        let files: Vec<PathBuf> = names.map(|name| folder.join(name)).collect();
        let Some(other) = files.iter().find(|file| !has_ending(file, "mcap")) else { return Ok(files) };
        let storage = &listed.storage_identifier;
        let stored = if storage.is_empty() || storage == "mcap" {
            format!("its metadata.yaml lists `{:.80}`, expected `.mcap` files", shown_name(other))
        } else {
            format!("its parts are in `{storage:.20}`, expected `mcap`")
        };
        let is_zstd = has_ending(other, "zstd") || has_ending(other, "zst");
        let unpacking = || {
            format!("decompress its files and metadata.yaml's names: `zstd -d {}/*.zstd`", folder.display())
        };
        return refused(stored, if is_zstd { unpacking() } else { conversion(folder) });
    }
    let files = mcap_files(folder).map_err(|source| io("list the folder of", folder, source))?;
    match files.as_slice() {
        [] => {
            refused("it has no MCAP file".to_owned(), "name an MCAP file or the folder of a bag".to_owned())
        }
        [_] => Ok(files),
        _ if information.is_some() || are_parts(&files) => Ok(files),
        [first, ..] => {
            let hint = format!("name one of its files, such as `{}`", first.display());
            refused(format!("its {} MCAP files are not parts of one recording", files.len()), hint)
        }
    }
}

fn has_ending(file: &Path, ending: &str) -> bool {
    file.extension().is_some_and(|found| found.eq_ignore_ascii_case(ending))
}

fn shown_name(file: &Path) -> String {
    file.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// An error for each gap in the numbers of the parts.
pub(crate) fn gaps(files: &[PathBuf]) -> Vec<RecordingError> {
    if files.len() < 2 || !are_parts(files) {
        return Vec::new();
    }
    let mut numbers: Vec<(u64, &PathBuf)> =
        files.iter().filter_map(|file| Some((numbered(&stem(file)).1?, file))).collect();
    numbers.sort();
    let gap = |pair: &[(u64, &PathBuf)]| {
        let first = pair[0].0.saturating_add(1);
        let count = pair[1].0.saturating_sub(first);
        (count > 0).then(|| RecordingError::MissingParts { path: pair[1].1.clone(), first, count })
    };
    numbers.windows(2).filter_map(gap).collect()
}

fn conversion(folder: &Path) -> String {
    let shown = folder.display();
    format!(
        "convert it: `rosbags-convert --src {shown} --dst {shown}_mcap --dst-storage mcap` (`pip install rosbags`)"
    )
}

/// `None` if the file is missing or is not a bag's metadata.
fn read_metadata(path: &Path) -> Option<Information> {
    let length = path.metadata().ok().filter(std::fs::Metadata::is_file)?.len();
    let text = (length <= MAX_METADATA_BYTES).then(|| std::fs::read_to_string(path).ok())??;
    let metadata: Metadata = serde_saphyr::from_str(&text).ok()?;
    Some(metadata.rosbag2_bagfile_information)
}

/// The MCAP files of a folder, part 2 before part 10.
fn mcap_files(folder: &Path) -> std::io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in folder.read_dir()? {
        let path = entry?.path();
        if has_ending(&path, "mcap") && !is_hidden(&path) && path.is_file() {
            files.push(path);
        }
    }
    files.sort_by(|a, b| by_number(&stem(a), &stem(b)).then_with(|| a.cmp(b)));
    Ok(files)
}

/// Hidden files are skipped: macOS writes `._drive.mcap` next to `drive.mcap`.
fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.as_encoded_bytes().starts_with(b"."))
}

fn stem(path: &Path) -> String {
    path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Splits `drive_10` into `drive_` and 10.
fn numbered(stem: &str) -> (&str, Option<u64>) {
    let name = stem.trim_end_matches(|c: char| c.is_ascii_digit());
    (name, stem[name.len()..].parse().ok())
}

fn by_number(a: &str, b: &str) -> Ordering {
    numbered(a).cmp(&numbered(b))
}

/// Whether the files have the names of `ros2 bag`'s parts: a common name, and a number each.
fn are_parts(files: &[PathBuf]) -> bool {
    let stems: Vec<String> = files.iter().map(|file| stem(file)).collect();
    let first = numbered(&stems[0]).0;
    stems.iter().all(|stem| matches!(numbered(stem), (name, Some(_)) if name == first))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::RecordingErrorKind;

    fn folder(files: &[&str], metadata: Option<&str>) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for file in files {
            std::fs::write(folder.path().join(file), b"").unwrap();
        }
        if let Some(text) = metadata {
            std::fs::write(folder.path().join(METADATA), text).unwrap();
        }
        folder
    }

    fn names(folder: &tempfile::TempDir) -> Result<Vec<String>, RecordingErrorKind> {
        let parts = parts(folder.path()).map_err(|error| error.kind())?;
        assert!(is_recording(folder.path()));
        Ok(parts.iter().map(|part| part.file_name().unwrap().to_string_lossy().into_owned()).collect())
    }

    #[test]
    fn parts_are_in_the_order_of_their_numbers() {
        let found = names(&folder(&["d_10.mcap", "d_2.MCAP", "d_0.mcap", "notes.txt"], None));
        assert_eq!(found.unwrap(), ["d_0.mcap", "d_2.MCAP", "d_10.mcap"]);
    }

    #[test]
    fn the_metadata_says_which_files_and_in_which_order() {
        let metadata = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n  relative_file_paths:\n    - bag/b.mcap\n    - a.mcap\n";
        let bag = folder(&["a.mcap", "b.mcap", "c.mcap"], Some(metadata));
        assert_eq!(names(&bag).unwrap(), ["b.mcap", "a.mcap"]);
        let marked = folder(&["a.mcap", "b.mcap", "c.mcap"], Some(&format!("\u{feff}{metadata}")));
        assert_eq!(names(&marked).unwrap(), ["b.mcap", "a.mcap"], "it begins with a byte order mark");
        assert_eq!(parts(&bag.path().join(METADATA)).unwrap().len(), 2, "named itself, it means its folder");
        let silent = "rosbag2_bagfile_information:\n  storage_identifier: mcap\n";
        assert_eq!(names(&folder(&["x.mcap", "b.mcap"], Some(silent))).unwrap(), ["b.mcap", "x.mcap"]);
    }

    #[test]
    fn missing_numbers_repeated_names_and_hidden_files_are_noticed() {
        let bag = folder(&["d_10.mcap", "d_2.mcap", "d_0.mcap", "._d_0.mcap"], None);
        let found = parts(bag.path()).unwrap();
        assert_eq!(found.len(), 3);
        let gaps: Vec<String> = gaps(&found).iter().map(ToString::to_string).collect();
        assert_eq!(gaps.len(), 2, "{gaps:?}");
        assert!(gaps[0].ends_with("d_2.mcap`: 1, from number 1"), "{gaps:?}");
        assert!(gaps[1].ends_with("d_10.mcap`: 7, from number 3"), "{gaps:?}");
        let twice = "rosbag2_bagfile_information: {relative_file_paths: [d_0.mcap, d_0.mcap, d_2.mcap]}";
        assert_eq!(names(&folder(&["d_0.mcap", "d_2.mcap"], Some(twice))).unwrap(), ["d_0.mcap", "d_2.mcap"]);
        let packed =
            "rosbag2_bagfile_information: {storage_identifier: mcap, relative_file_paths: [a.mcap.zstd]}";
        let error = parts(folder(&[], Some(packed)).path()).unwrap_err().to_string();
        assert!(error.ends_with("lists `a.mcap.zstd`, expected `.mcap` files"), "{error}");
    }

    #[test]
    fn a_file_is_a_recording_by_its_name_or_its_first_bytes() {
        let bag = folder(&["empty.mcap", "empty"], None);
        for (name, content) in
            [("drive", &b"\x89MCAP0\r\n\x01"[..]), ("a.png", b"\x89PNG\r\n\x1a\n"), ("b", b"\x89MCAP")]
        {
            std::fs::write(bag.path().join(name), content).unwrap();
        }
        let is_recording = |name: &str| is_recording(&bag.path().join(name));
        assert!(is_recording("empty.mcap") && is_recording("drive"));
        assert!(!["empty", "a.png", "b", "missing"].into_iter().any(is_recording));
        assert_eq!(parts(&bag.path().join("drive")).unwrap(), [bag.path().join("drive")]);
    }

    #[test]
    fn the_largest_number_of_a_part_has_no_gap_after_it() {
        let bag = folder(&[&format!("d_{}.mcap", u64::MAX), &format!("d_0{}.mcap", u64::MAX)], None);
        let found = parts(bag.path()).unwrap();
        assert_eq!((found.len(), gaps(&found).len()), (2, 0));
    }

    #[test]
    fn a_folder_without_a_recording_or_with_several_is_refused() {
        assert_eq!(parts(folder(&["a.txt"], None).path()).unwrap_err().kind(), RecordingErrorKind::Format);
        assert_eq!(names(&folder(&["front.mcap", "rear.mcap"], None)), Err(RecordingErrorKind::Format));
        let sqlite =
            "rosbag2_bagfile_information: {storage_identifier: sqlite3, relative_file_paths: [a.db3]}";
        assert_eq!(names(&folder(&["a.db3"], Some(sqlite))), Err(RecordingErrorKind::Format));
        assert!(!is_recording(folder(&["a.png"], None).path()));
    }
}
