//! A chunk that is being decompressed by mcap's own reader, which also verifies its checksum.

use std::panic::{AssertUnwindSafe, catch_unwind};

use mcap::McapError;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::record::{Record, U64};

/// The largest record. An image of 48 megapixels has 144 MB.
pub(crate) const MAX_RECORD_BYTES: u64 = 256 << 20;
/// Opcode and length.
pub(crate) const FRAME_BYTES: usize = 1 + 8;
/// Start and end time, uncompressed size, checksum, length of the compression's name.
pub(crate) const HEADER_BYTES: u64 = 8 + 8 + 8 + 4 + 4;
/// The length of a chunk that is not complete yet.
pub(crate) const OPEN: u64 = u64::MAX;
/// The largest plausible compression ratio. A chunk that states more is wrong, or contains an image of
/// one color; its checksum is verified at its end instead of before the first record.
const MAX_COMPRESSION: u64 = 1024;

/// A chunk of a file, from which records are taken.
pub(crate) struct Chunk {
    reader: LinearReader,
    /// Bytes of the chunk that the reader has not received yet.
    pub(crate) remaining: u64,
    /// Size of the chunk's records as its header states it, and of those that were read.
    uncompressed: u64,
    records: u64,
    /// Whether the file contains the whole chunk. Records of a whole chunk are returned only after
    /// its checksum was verified; of a truncated chunk, all remaining records are returned.
    pub(crate) is_whole: bool,
}

/// The outcome of [`Chunk::next`].
pub(crate) enum ChunkEvent<T> {
    Record(T),
    /// The reader needs up to this many bytes.
    Needs(usize),
    End,
}

impl Chunk {
    /// `start` contains the chunk's first bytes, at least up to the name of its compression.
    pub(crate) fn new(start: &[u8], remaining: u64, is_whole: bool) -> Self {
        let uncompressed = U64::at(start, FRAME_BYTES + 16).unwrap_or_default();
        // The limit also applies to the chunk's header, which is short.
        let limit = uncompressed.clamp(1 << 16, MAX_RECORD_BYTES);
        let is_plausible = uncompressed <= limit.min(remaining.saturating_mul(MAX_COMPRESSION));
        let options = LinearReaderOptions::default()
            .with_skip_start_magic(true)
            .with_skip_end_magic(true)
            .with_validate_chunk_crcs(true)
            .with_prevalidate_chunk_crcs(is_whole && is_plausible)
            .with_record_length_limit(limit as usize);
        let mut reader = LinearReader::new_with_options(options);
        reader.insert(start.len()).copy_from_slice(start);
        reader.notify_read(start.len());
        Self { reader, remaining, uncompressed, records: 0, is_whole }
    }

    /// Passes the next record to `take`, if the reader has enough bytes for it.
    ///
    /// # Errors
    /// Why the chunk is damaged.
    pub(crate) fn next<T>(&mut self, take: impl FnOnce(Record<'_>) -> T) -> Result<ChunkEvent<T>, String> {
        match guarded(|| self.reader.next_event()) {
            Some(Ok(LinearReadEvent::Record { data, opcode })) => {
                self.records += (FRAME_BYTES + data.len()) as u64;
                Ok(ChunkEvent::Record(take(Record::parse(opcode, data)?)))
            }
            Some(Ok(LinearReadEvent::ReadRequest(wanted))) if self.remaining > 0 || !self.is_whole => {
                // It requests the record after the chunk.
                let is_over = self.remaining == 0 && self.records == self.uncompressed;
                Ok(if is_over { ChunkEvent::End } else { ChunkEvent::Needs(wanted) })
            }
            Some(Ok(LinearReadEvent::ReadRequest(_))) | None if self.records == self.uncompressed => {
                Ok(ChunkEvent::End)
            }
            Some(Ok(LinearReadEvent::ReadRequest(_))) | None => {
                Err("a record is longer than its chunk".to_owned())
            }
            Some(Err(error)) => Err(plain(&error)),
        }
    }

    /// A buffer for `count` bytes of the chunk. Report the number of bytes read to [`Self::filled`].
    pub(crate) fn room(&mut self, count: usize) -> &mut [u8] {
        self.reader.insert(count)
    }

    pub(crate) fn filled(&mut self, count: usize) {
        self.reader.notify_read(count);
        self.remaining -= count as u64;
    }
}

/// mcap 0.26 subtracts below zero if a chunk's last record is longer than the chunk. That panics in a
/// build with overflow checks, which this workspace disables for mcap.
fn guarded<T>(next: impl FnOnce() -> Option<Result<T, McapError>>) -> Option<Result<T, McapError>> {
    catch_unwind(AssertUnwindSafe(next)).unwrap_or(Some(Err(McapError::UnexpectedEoc)))
}

/// The error text of mcap, without the parser's backtrace that some of its errors contain.
fn plain(error: &McapError) -> String {
    match error {
        McapError::Parse(_) => "a record's fields do not fit its length".to_owned(),
        McapError::Io(error) => format!("a chunk cannot be decompressed: {error:.200}"),
        McapError::DecompressionError(reason) => format!("a chunk cannot be decompressed: {reason:.200}"),
        McapError::UnsupportedCompression(name) => format!("a chunk is compressed as `{name:.20}`"),
        other => format!("{other:.200}"),
    }
}
