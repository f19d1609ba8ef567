//! Truncates a recording that cannot be continued, and writes its end.

use std::fs::File;
use std::io::{self, Seek as _, SeekFrom, Write as _};
use std::os::unix::fs::FileExt as _;

/// The records `DataEnd` and `Footer` without checksums and summary, and the magic bytes (MCAP
/// specification).
pub(crate) const END: [u8; 13 + 29 + 8] = {
    let mut end = [0; 50];
    end[0] = 0x0f;
    end[1] = 4;
    end[13] = 0x02;
    end[14] = 20;
    let magic = mcap::MAGIC;
    let mut index = 0;
    while index < magic.len() {
        end[42 + index] = magic[index];
        index += 1;
    }
    end
};

/// Keeps a file readable for strict readers when the disk fills up. A file is truncated to its last sync, and
/// its end is written there. The disk may not have room even for that, so the previous sync is remembered
/// too: truncating to it frees space. Before the first sync nothing can be freed, so the end is written after
/// the header when the file is created, and later data overwrite it.
pub(crate) struct FileEnd {
    /// A second handle of the writer's file, because another file may have its name by then.
    file: File,
    /// The lengths of the file at the last two syncs; everything before them can be read.
    synced: [u64; 2],
}

impl FileEnd {
    pub(crate) fn new(file: File) -> Self {
        Self { file, synced: [0; 2] }
    }

    /// Writes the end after the current data, without moving the writer's position. Does nothing for a
    /// device.
    pub(crate) fn reserve(&mut self) -> io::Result<()> {
        let file = self.file.metadata()?;
        if file.is_file() {
            self.synced = [file.len(); 2];
            self.file.write_all_at(&END, file.len())?;
        }
        Ok(())
    }

    /// Flushes the file to the disk.
    pub(crate) fn sync(&mut self) -> io::Result<()> {
        self.file.sync_data()?;
        // The reserved end may be longer than the data that replaced it.
        let written = self.file.stream_position()?;
        if written > self.synced[0] {
            self.synced = [written, self.synced[0]];
        }
        Ok(())
    }

    /// Truncates the file to the last sync, or to the one before, and writes the end.
    pub(crate) fn cut_back(&mut self) -> io::Result<()> {
        let [last, before] = self.synced;
        if last == 0 {
            return Ok(());
        }
        self.end_at(last).or_else(|_| self.end_at(before))
    }

    fn end_at(&mut self, place: u64) -> io::Result<()> {
        self.file.set_len(place)?;
        // The position was shared with the writer, which was dropped.
        self.file.seek(SeekFrom::Start(place))?;
        self.file.write_all(&END)?;
        self.file.sync_data()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_file_that_was_never_synced_ends_after_its_header() {
        let path = tempfile::NamedTempFile::new().unwrap();
        let mut file = File::options().write(true).open(path.path()).unwrap();
        file.write_all(b"header").unwrap();
        let mut end = FileEnd::new(file.try_clone().unwrap());
        end.reserve().unwrap();
        let expected = [b"header", &END[..]].concat();
        assert_eq!(std::fs::read(path.path()).unwrap(), expected, "even if the process is killed now");
        file.write_all(b"half a chunk").unwrap();
        assert!(std::fs::read(path.path()).unwrap().starts_with(b"headerhalf a chunk"));
        end.cut_back().unwrap();
        assert_eq!(std::fs::read(path.path()).unwrap(), expected);
    }
}
