//! A recording's records in the order of the file, whole files or cut ones, in bounded memory.

use std::fs::File;
use std::io::{Read as _, Seek as _};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::{Record, op};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::sans_io::summary_reader::{SummaryReadEvent, SummaryReader, SummaryReaderOptions};

use crate::RecordingError;

/// No message is larger: a picture of 48 megapixels has 144 MB.
const MAX_RECORD_BYTES: usize = 256 << 20;

/// Reads a file from its beginning.
pub(crate) struct Records {
    path: PathBuf,
    file: File,
    reader: LinearReader,
    has_end: bool,
}

impl Records {
    pub(crate) fn open(path: &Path) -> Result<Self, RecordingError> {
        let file = open(path)?;
        let options = LinearReaderOptions::default()
            .with_validate_chunk_crcs(true)
            .with_skip_end_magic(true)
            .with_record_length_limit(MAX_RECORD_BYTES);
        Ok(Self {
            path: path.to_owned(),
            file,
            reader: LinearReader::new_with_options(options),
            has_end: false,
        })
    }

    /// Hands the next record to `take`; `None` behind the last.
    ///
    /// # Errors
    /// The file cannot be read further, or is damaged from here on.
    pub(crate) fn next<T>(
        &mut self,
        take: impl FnOnce(Record<'_>) -> T,
    ) -> Result<Option<T>, RecordingError> {
        let damaged = |source| match source {
            McapError::BadMagic => RecordingError::NotMcap {
                path: self.path.clone(),
                reason: "it does not begin with MCAP's magic bytes",
            },
            source => RecordingError::Damaged { path: self.path.clone(), source },
        };
        loop {
            match guarded(|| self.reader.next_event()) {
                None if self.has_end => return Ok(None),
                // Cut exactly between two records.
                None => return Err(damaged(McapError::UnexpectedEof)),
                Some(Err(error)) => return Err(damaged(error)),
                Some(Ok(LinearReadEvent::ReadRequest(wanted))) => {
                    let wanted = wanted.min(MAX_RECORD_BYTES);
                    let read = self.file.read(self.reader.insert(wanted));
                    self.reader.notify_read(read.map_err(|source| io("read", &self.path, source))?);
                }
                Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                    self.has_end |= opcode == op::FOOTER;
                    let record = mcap::parse_record(opcode, data).map_err(damaged)?;
                    return Ok(Some(take(record)));
                }
            }
        }
    }
}

/// The index at the end of a whole file; `None` of a file without one, or with one that cannot be read.
pub(crate) fn summary(path: &Path) -> Result<Option<mcap::Summary>, RecordingError> {
    let mut file = open(path)?;
    let length = file.metadata().map_err(|source| io("read", path, source))?.len();
    if length == 0 {
        return Err(RecordingError::NotMcap { path: path.to_owned(), reason: "it is empty" });
    }
    let options =
        SummaryReaderOptions::default().with_file_size(length).with_record_length_limit(MAX_RECORD_BYTES);
    let mut reader = SummaryReader::new_with_options(options);
    while let Some(event) = guarded(|| reader.next_event()) {
        match event {
            Ok(SummaryReadEvent::ReadRequest(wanted)) => {
                let read = file.read(reader.insert(wanted.min(MAX_RECORD_BYTES)));
                reader.notify_read(read.map_err(|source| io("read", path, source))?);
            }
            Ok(SummaryReadEvent::SeekRequest(to)) => {
                let Ok(place) = file.seek(to) else { return Ok(None) };
                reader.notify_seeked(place);
            }
            Err(_) => return Ok(None),
        }
    }
    Ok(reader.finish())
}

/// mcap 0.26 counts below zero where a chunk's last record is longer than the chunk: a panic in whoever builds it with
/// overflow checks, which this workspace does not.
fn guarded<T>(next: impl FnOnce() -> Option<Result<T, McapError>>) -> Option<Result<T, McapError>> {
    catch_unwind(AssertUnwindSafe(next)).unwrap_or(Some(Err(McapError::UnexpectedEoc)))
}

fn open(path: &Path) -> Result<File, RecordingError> {
    let failed = |source| io("open", path, source);
    // Looked at before it is opened: opening a pipe waits for a writer.
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(RecordingError::NotMcap { path: path.to_owned(), reason: "it is not a plain file" });
    }
    File::open(path).map_err(failed)
}

pub(crate) fn io(what: &'static str, path: &Path, source: std::io::Error) -> RecordingError {
    RecordingError::Io { what, path: path.to_owned(), source }
}
