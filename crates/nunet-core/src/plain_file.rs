//! Regular files: opening a pipe would wait for its writer, and a device may have no end.

use std::fs::File;
use std::io::{self, ErrorKind, Read as _, Take};
use std::path::Path;

/// How some editors begin a text in UTF-8. Most parsers refuse it.
const BYTE_ORDER_MARK: char = '\u{feff}';

/// Opens a regular file for reading its first `most` bytes; `None` for a folder, a pipe, a socket or a
/// device, which is not opened.
///
/// # Errors
/// As [`File::open`].
pub fn open(path: &Path, most: u64) -> io::Result<Option<Take<File>>> {
    // Checked before it is opened, because opening a pipe waits.
    if !path.metadata()?.is_file() {
        return Ok(None);
    }
    File::open(path).map(|file| Some(file.take(most)))
}

/// Reads a text file of at most `most` bytes. A byte order mark at its start is skipped.
///
/// # Errors
/// As [`File::open`]; not a regular file, longer, or not UTF-8.
pub fn read_text(path: &Path, most: u64) -> io::Result<String> {
    let text = read_marked_text(path, most)?;
    Ok(text.strip_prefix(BYTE_ORDER_MARK).map(str::to_owned).unwrap_or(text))
}

/// As [`read_text`], with the byte order mark, for a text that is written again.
///
/// # Errors
/// As [`read_text`].
pub fn read_marked_text(path: &Path, most: u64) -> io::Result<String> {
    let irregular = || io::Error::new(ErrorKind::InvalidInput, "it is not a regular file");
    let mut bytes = Vec::new();
    let length = open(path, most.saturating_add(1))?.ok_or_else(irregular)?.read_to_end(&mut bytes)?;
    if length as u64 > most {
        return Err(io::Error::new(ErrorKind::InvalidData, format!("it is longer than {most} bytes")));
    }
    String::from_utf8(bytes).map_err(|_| io::Error::new(ErrorKind::InvalidData, "it is not UTF-8 text"))
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use super::*;

    #[test]
    fn a_regular_file_is_read_up_to_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, b"12345").unwrap();
        for (most, expected) in [(3, "123"), (9, "12345")] {
            let mut text = String::new();
            open(&path, most).unwrap().unwrap().read_to_string(&mut text).unwrap();
            assert_eq!(text, expected);
        }
        assert_eq!(open(&folder.path().join("b"), 1).unwrap_err().kind(), io::ErrorKind::NotFound);
    }

    #[test]
    fn a_text_is_read_without_a_byte_order_mark() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        for (written, read) in [("\u{feff}1\u{e9}", "1\u{e9}"), ("\u{feff}", ""), ("1\u{feff}", "1\u{feff}")]
        {
            std::fs::write(&path, written).unwrap();
            assert_eq!(read_text(&path, 6).unwrap(), read);
            assert_eq!(read_marked_text(&path, 6).unwrap(), written);
        }
    }

    #[test]
    fn a_text_that_is_too_long_or_not_utf8_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a");
        std::fs::write(&path, "\u{feff}1\u{e9}").unwrap();
        // The limit is inside of a character.
        let too_long = read_text(&path, 4).unwrap_err();
        assert!(too_long.to_string().contains("4 bytes"), "{too_long}");
        std::fs::write(&path, b"\xff").unwrap();
        let not_text = read_text(&path, 6).unwrap_err();
        assert!(not_text.to_string().contains("UTF-8"), "{not_text}");
        assert_eq!([&too_long, &not_text].map(io::Error::kind), [ErrorKind::InvalidData; 2]);
        let error = read_text(Path::new("/dev/zero"), 6).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::InvalidInput);
    }

    #[test]
    fn a_pipe_a_device_and_a_folder_are_not_opened() {
        let folder = tempfile::tempdir().unwrap();
        let pipe = folder.path().join("pipe");
        assert!(Command::new("mkfifo").arg(&pipe).status().unwrap().success());
        for path in [pipe, "/dev/zero".into(), folder.path().to_owned()] {
            let (send, opened) = channel();
            let shown = path.display().to_string();
            // On another thread, because opening a pipe would wait forever.
            std::thread::spawn(move || send.send(open(&path, 1).unwrap().is_some()));
            assert_eq!(opened.recv_timeout(Duration::from_secs(60)), Ok(false), "{shown}");
        }
    }
}
