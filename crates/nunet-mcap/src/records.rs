//! The records of an MCAP file in file order, from whole or truncated files, in bounded memory.
//!
//! The outer framing (opcode, 64-bit length, body) is read here so that every length can be checked against the rest of
//! the file before memory is allocated for it. Only chunks go through mcap's own reader, which decompresses them and
//! verifies their checksum. Its record limit is the uncompressed size that the chunk states, so a wrong length inside a
//! chunk cannot request more than the chunk has.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::RecordingError;
use crate::record::{Record, U64};

/// No message is larger: an image of 48 megapixels has 144 MB.
const MAX_RECORD_BYTES: u64 = 256 << 20;
/// Opcode and length.
const FRAME_BYTES: usize = 1 + 8;
const MAGIC_BYTES: u64 = 8;
/// Opcode, length, start of the summary, start of its offsets, checksum.
const FOOTER_BYTES: u64 = 9 + 8 + 8 + 4;
/// Start and end time, uncompressed size, checksum, length of the compression's name.
const CHUNK_HEADER_BYTES: u64 = 8 + 8 + 8 + 4 + 4;

/// Reads a file from its beginning, or its summary.
pub(crate) struct Records {
    path: PathBuf,
    file: BufReader<File>,
    /// Bytes of the file that were consumed.
    position: u64,
    body: Vec<u8>,
    chunk: Option<Chunk>,
    started: bool,
    ended: bool,
}

/// A chunk that is being decompressed.
struct Chunk {
    reader: LinearReader,
    /// Bytes of the chunk that the reader has not received yet.
    remaining: u64,
    /// Size of the chunk's records as its header states it, and of those that were read.
    uncompressed: u64,
    records: u64,
}

impl Records {
    pub(crate) fn open(path: &Path) -> Result<Self, RecordingError> {
        Ok(Self::of(path, open(path)?))
    }

    fn of(path: &Path, file: File) -> Self {
        Self {
            path: path.to_owned(),
            file: BufReader::new(file),
            position: 0,
            body: Vec::new(),
            chunk: None,
            started: false,
            ended: false,
        }
    }

    /// The index at the end of a complete file; `None` if the file has none.
    pub(crate) fn open_summary(path: &Path) -> Result<Option<Self>, RecordingError> {
        let mut file = open(path)?;
        let failed = |source| io("read", path, source);
        let length = file.metadata().map_err(failed)?.len();
        if length == 0 {
            return Err(RecordingError::NotMcap { path: path.to_owned(), reason: "it is empty" });
        }
        let Some(start) = length.checked_sub(FOOTER_BYTES + MAGIC_BYTES) else { return Ok(None) };
        file.seek(SeekFrom::Start(start)).map_err(failed)?;
        let mut end = [0; (FOOTER_BYTES + MAGIC_BYTES) as usize];
        file.read_exact(&mut end).map_err(failed)?;
        let summary = U64::at(&end, FRAME_BYTES).filter(|&summary| (MAGIC_BYTES..start).contains(&summary));
        let Some(summary) = summary.filter(|_| end[0] == op::FOOTER && end.ends_with(mcap::MAGIC)) else {
            return Ok(None);
        };
        file.seek(SeekFrom::Start(summary)).map_err(failed)?;
        Ok(Some(Self { position: summary, started: true, ..Self::of(path, file) }))
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Hands the next record to `take`; `None` after the last one.
    ///
    /// # Errors
    /// The file cannot be read further, or is damaged from here on.
    pub(crate) fn next<T>(
        &mut self,
        take: impl FnOnce(Record<'_>) -> T,
    ) -> Result<Option<T>, RecordingError> {
        if !self.started {
            self.check_magic()?;
        }
        let mut take = Some(take);
        while !self.ended {
            let taken =
                if self.chunk.is_some() { self.step_chunk(&mut take)? } else { self.step(&mut take)? };
            if taken.is_some() {
                return Ok(taken);
            }
        }
        Ok(None)
    }

    /// Reads one record outside of chunks, or the start of a chunk.
    fn step<T>(
        &mut self,
        take: &mut Option<impl FnOnce(Record<'_>) -> T>,
    ) -> Result<Option<T>, RecordingError> {
        let Some(opcode) = self.read_frame()? else { return Ok(None) };
        let record = Record::parse(opcode, &self.body).map_err(|reason| damaged(&self.path, reason))?;
        Ok(take.take().map(|take| take(record)))
    }

    /// Takes the next record of the chunk, or feeds the chunk's reader.
    fn step_chunk<T>(
        &mut self,
        take: &mut Option<impl FnOnce(Record<'_>) -> T>,
    ) -> Result<Option<T>, RecordingError> {
        let Some(chunk) = &mut self.chunk else { return Ok(None) };
        match guarded(|| chunk.reader.next_event()) {
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                chunk.records += (FRAME_BYTES + data.len()) as u64;
                let record = Record::parse(opcode, data).map_err(|reason| damaged(&self.path, reason))?;
                Ok(take.take().map(|take| take(record)))
            }
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) if chunk.remaining > 0 => {
                self.feed_chunk(wanted)?;
                Ok(None)
            }
            // It asks for the record behind the chunk.
            Some(Ok(LinearReadEvent::ReadRequest(_))) | None if chunk.records == chunk.uncompressed => {
                self.chunk = None;
                Ok(None)
            }
            Some(Ok(LinearReadEvent::ReadRequest(_))) | None => {
                Err(damaged(&self.path, "a record is longer than its chunk"))
            }
            Some(Err(error)) => Err(damaged(&self.path, &plain(&error))),
        }
    }

    fn feed_chunk(&mut self, wanted: usize) -> Result<(), RecordingError> {
        let left = self.bytes_left()?;
        let Some(chunk) = &mut self.chunk else { return Ok(()) };
        let count = (wanted as u64).min(chunk.remaining).min(left) as usize;
        if count == 0 {
            return Err(self.cut_off());
        }
        let read = self.file.read(chunk.reader.insert(count));
        let read = read.map_err(|source| io("read", &self.path, source))?;
        if read == 0 {
            return Err(self.cut_off());
        }
        chunk.reader.notify_read(read);
        chunk.remaining -= read as u64;
        self.position += read as u64;
        Ok(())
    }

    fn check_magic(&mut self) -> Result<(), RecordingError> {
        let mut magic = [0; MAGIC_BYTES as usize];
        let read = read_up_to(&mut self.file, &mut magic).map_err(|source| io("read", &self.path, source))?;
        if magic[..read] != *mcap::MAGIC {
            let reason = crate::other_files::what_it_is(&magic[..read]);
            return Err(RecordingError::NotMcap { path: self.path.clone(), reason });
        }
        (self.position, self.started) = (MAGIC_BYTES, true);
        Ok(())
    }

    /// Reads a record into `body` and returns its opcode; `None` where a chunk began instead.
    fn read_frame(&mut self) -> Result<Option<u8>, RecordingError> {
        let mut frame = [0; FRAME_BYTES];
        self.read_exact(&mut frame)?;
        let (opcode, length) = (frame[0], U64::at(&frame, 1).unwrap_or_default());
        if opcode == op::CHUNK {
            self.begin_chunk(&frame, length)?;
            return Ok(None);
        }
        let left = self.bytes_left()?;
        if length > left {
            return Err(self.cut_off());
        }
        if length > MAX_RECORD_BYTES {
            return Err(damaged(&self.path, &format!("a record has {length} bytes")));
        }
        let mut body = std::mem::take(&mut self.body);
        body.resize(length as usize, 0);
        let read = self.read_exact(&mut body);
        self.body = body;
        read?;
        if opcode == op::FOOTER {
            self.read_end()?;
        }
        Ok(Some(opcode))
    }

    /// A complete file ends with the magic bytes; one that lacks them lost its end.
    fn read_end(&mut self) -> Result<(), RecordingError> {
        let mut magic = [0; MAGIC_BYTES as usize];
        self.read_exact(&mut magic)?;
        if magic != *mcap::MAGIC {
            return Err(damaged(
                &self.path,
                "the bytes after the last record are not the end of an MCAP file",
            ));
        }
        self.ended = true;
        Ok(())
    }

    fn begin_chunk(&mut self, frame: &[u8], length: u64) -> Result<(), RecordingError> {
        let mut header = [0; CHUNK_HEADER_BYTES as usize];
        self.read_exact(&mut header)?;
        let uncompressed = U64::at(&header, 16).unwrap_or_default();
        let name = u32::from_le_bytes([header[28], header[29], header[30], header[31]]);
        if length < CHUNK_HEADER_BYTES + u64::from(name) || u64::from(name) > self.bytes_left()? {
            return Err(damaged(&self.path, "the header of a chunk is longer than the chunk"));
        }
        // The limit holds for the chunk's header as well, which is short.
        let limit = uncompressed.clamp(1 << 16, MAX_RECORD_BYTES) as usize;
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_record_length_limit(limit);
        let mut reader = LinearReader::new_with_options(options);
        let start = [frame, &header].concat();
        reader.insert(start.len()).copy_from_slice(&start);
        reader.notify_read(start.len());
        self.chunk = Some(Chunk { reader, remaining: length - CHUNK_HEADER_BYTES, uncompressed, records: 0 });
        Ok(())
    }

    /// Of the file as it is now: it may be growing.
    fn bytes_left(&self) -> Result<u64, RecordingError> {
        let file = self.file.get_ref().metadata().map_err(|source| io("read", &self.path, source))?;
        Ok(file.len().saturating_sub(self.position))
    }

    fn read_exact(&mut self, bytes: &mut [u8]) -> Result<(), RecordingError> {
        let read = read_up_to(&mut self.file, bytes).map_err(|source| io("read", &self.path, source))?;
        self.position += read as u64;
        if read < bytes.len() { Err(self.cut_off()) } else { Ok(()) }
    }

    fn cut_off(&self) -> RecordingError {
        damaged(&self.path, "the file ends within a record")
    }
}

/// Fills `bytes`; returns how many were there before the end.
fn read_up_to(input: &mut impl std::io::Read, bytes: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while filled < bytes.len() {
        match input.read(&mut bytes[filled..]) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

/// mcap 0.26 counts below zero where a chunk's last record is longer than the chunk: a panic in a build with overflow
/// checks, which this workspace does not use for it.
fn guarded<T>(next: impl FnOnce() -> Option<Result<T, McapError>>) -> Option<Result<T, McapError>> {
    catch_unwind(AssertUnwindSafe(next)).unwrap_or(Some(Err(McapError::UnexpectedEoc)))
}

/// mcap's own text, without the parser's backtrace that some of its errors carry.
fn plain(error: &McapError) -> String {
    match error {
        McapError::Parse(_) => "a record's fields do not fit its length".to_owned(),
        McapError::Io(error) => format!("a chunk cannot be decompressed: {error:.200}"),
        McapError::DecompressionError(reason) => format!("a chunk cannot be decompressed: {reason:.200}"),
        McapError::UnsupportedCompression(name) => format!("a chunk is compressed as `{name:.20}`"),
        other => format!("{other:.200}"),
    }
}

fn open(path: &Path) -> Result<File, RecordingError> {
    let failed = |source| io("open", path, source);
    // Checked before it is opened: opening a named pipe waits for a writer.
    if !path.metadata().map_err(failed)?.is_file() {
        return Err(RecordingError::NotMcap { path: path.to_owned(), reason: "it is not a regular file" });
    }
    File::open(path).map_err(failed)
}

fn damaged(path: &Path, reason: &str) -> RecordingError {
    RecordingError::Damaged { path: path.to_owned(), reason: reason.to_owned() }
}

pub(crate) fn io(what: &'static str, path: &Path, source: std::io::Error) -> RecordingError {
    RecordingError::Io { what, path: path.to_owned(), source }
}
