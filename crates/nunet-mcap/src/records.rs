//! The records of an MCAP file in file order, from whole or truncated files, in bounded memory.
//!
//! The outer framing (opcode, 64-bit length, body) is read here so that every length can be checked against
//! the rest of the file before memory is allocated for it. Only chunks go through mcap's own reader, which
//! decompresses them and verifies their checksum. Its record limit is the uncompressed size that the chunk
//! states, so a wrong length inside a chunk cannot allocate more than the chunk's size.

use std::fs::File;
use std::io::{BufReader, Read as _, Seek as _, SeekFrom};
use std::path::{Path, PathBuf};

use mcap::records::op;

use crate::RecordingError;
use crate::chunk::{Chunk, ChunkEvent, FRAME_BYTES, HEADER_BYTES, MAX_RECORD_BYTES, OPEN};
use crate::record::{Record, U64};

const MAGIC_BYTES: u64 = 8;
/// Opcode, length, start of the summary, start of its offsets, checksum.
const FOOTER_BYTES: u64 = 9 + 8 + 8 + 4;
/// The largest open chunk. Writers complete a chunk after a few megabytes.
const MAX_OPEN_BYTES: u64 = 1 << 32;
/// The longest name of an open chunk's compression. MCAP knows `zstd` and `lz4`.
const MAX_COMPRESSION_NAME_BYTES: u32 = 64;

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

    /// Passes the next record to `take`; `None` after the last one.
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
        match chunk.next(|record| take.take().map(|take| take(record))) {
            Ok(ChunkEvent::Record(taken)) => return Ok(taken),
            Ok(ChunkEvent::Needs(wanted)) => self.feed_chunk(wanted)?,
            Ok(ChunkEvent::End) => self.chunk = None,
            Err(reason) => return Err(self.skip_chunk(reason)?),
        }
        Ok(None)
    }

    /// Skips the rest of a damaged chunk. Fails if the file ends before that.
    fn skip_chunk(&mut self, reason: String) -> Result<RecordingError, RecordingError> {
        let Some(chunk) = self.chunk.take_if(|chunk| chunk.is_whole) else {
            let is_over = self.chunk.as_ref().is_some_and(|chunk| chunk.remaining == 0);
            return Err(if is_over { self.cut_off() } else { damaged(&self.path, &reason) });
        };
        let rest = i64::try_from(chunk.remaining).unwrap_or_default();
        self.file.seek_relative(rest).map_err(|source| io("read", &self.path, source))?;
        self.position += chunk.remaining;
        Ok(RecordingError::DamagedChunk { path: self.path.clone(), reason })
    }

    fn feed_chunk(&mut self, wanted: usize) -> Result<(), RecordingError> {
        let left = self.bytes_left()?;
        let Some(chunk) = &mut self.chunk else { return Ok(()) };
        let count = (wanted as u64).min(chunk.remaining).min(left) as usize;
        if count == 0 {
            return Err(self.cut_off());
        }
        let read = self.file.read(chunk.room(count));
        let read = read.map_err(|source| io("read", &self.path, source))?;
        if read == 0 {
            return Err(self.cut_off());
        }
        chunk.filled(read);
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

    /// Reads a record into `body` and returns its opcode; `None` if a chunk began instead.
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

    /// Checks the magic bytes at the end; a file without them is truncated.
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
        let mut header = [0; HEADER_BYTES as usize];
        self.read_exact(&mut header)?;
        let name = u32::from_le_bytes([header[28], header[29], header[30], header[31]]);
        let left = self.bytes_left()?;
        if length < HEADER_BYTES + u64::from(name) || u64::from(name) > left {
            return Err(damaged(&self.path, "the header of a chunk is longer than the chunk"));
        }
        let mut start = [frame, &header].concat();
        self.chunk = Some(if length == OPEN && left <= MAX_OPEN_BYTES {
            let remaining = self.close_chunk(&mut start, name)?;
            Chunk::new(&start, remaining, false)
        } else {
            let remaining = length - HEADER_BYTES;
            Chunk::new(&start, remaining, remaining <= left)
        });
        Ok(())
    }

    /// Completes the header of a chunk whose writer was stopped before it wrote the chunk's sizes.
    /// Such a chunk extends to the end of the file. Returns its length in bytes.
    fn close_chunk(&mut self, start: &mut Vec<u8>, name: u32) -> Result<u64, RecordingError> {
        if name > MAX_COMPRESSION_NAME_BYTES {
            let reason = format!("the name of a chunk's compression has {name} bytes");
            return Err(damaged(&self.path, &reason));
        }
        let mut rest = vec![0; name as usize + 8];
        self.read_exact(&mut rest)?;
        let left = self.bytes_left()?;
        rest.truncate(name as usize);
        rest.extend(left.to_le_bytes());
        let length = HEADER_BYTES + rest.len() as u64 + left;
        start[1..FRAME_BYTES].copy_from_slice(&length.to_le_bytes());
        start[FRAME_BYTES + 24..FRAME_BYTES + 28].fill(0); // no checksum
        start.extend(rest);
        Ok(left)
    }

    /// The number of remaining bytes at this moment; the file may be growing.
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

/// Fills `bytes`. Returns the number of bytes before the end.
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
