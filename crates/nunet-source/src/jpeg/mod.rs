//! Checks that a JPEG is complete. Its decoder does not report missing data, but fills it with gray.
//!
//! The entropy-coded data are read block by block, without computing pixels. Every block must be present,
//! every restart marker at its position, and no more data than the blocks need. Baseline and progressive
//! images are walked; what the decoder refuses anyway (lossless, arithmetic coding) is left to it. Source:
//! ITU T.81, annexes B, F.2.2 and G.2.

mod bits;
mod frame;
mod scan;
mod standard_tables;

use self::bits::HuffmanTable;
use self::frame::{JpegFrame, segment};
use self::scan::ScanHeader;
pub(crate) use self::standard_tables::with_tables;

const MARKER: u8 = 0xff;
const START_OF_IMAGE: u8 = 0xd8;
const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;
const TABLES: u8 = 0xc4;
const RESTART_INTERVAL: u8 = 0xdd;
/// The first bytes of each JPEG: the start of the image, and of another marker.
pub(crate) const START: [u8; 3] = [MARKER, START_OF_IMAGE, MARKER];
/// The last bytes of a JPEG.
pub(crate) const END: [u8; 2] = [MARKER, END_OF_IMAGE];
/// Larger images are refused by the decoder's limits.
const MAX_PIXELS: u64 = 256 << 20;
/// The most scans; the decoder has the same limit. Encoders write about 10. A scan of a progressive image can
/// pass over all blocks with hardly any data, so the size of the file does not limit the time.
const MAX_SCANS: usize = 100;

/// Why a JPEG is incomplete or damaged.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(crate) enum JpegError {
    #[error("the JPEG is cut off before its end-of-image marker")]
    NoEnd,
    #[error("the JPEG lost data: its scan ended early, after {read} of {expected} blocks")]
    EndedEarly { read: u64, expected: u64 },
    #[error("the JPEG is damaged: its scan has an invalid code after {read} of {expected} blocks")]
    InvalidCode { read: u64, expected: u64 },
    #[error("the JPEG lost data: zero bytes replace its scan before block {read} of {expected}")]
    Zeros { read: u64, expected: u64 },
    #[error("the JPEG lost data: restart marker {expected} of 0 to 7 is missing after {read} blocks")]
    NoRestart { expected: u8, read: u64 },
    #[error("the JPEG is damaged: its scan has {bytes} bytes more than its blocks need")]
    TooMuch { bytes: usize },
    #[error("the JPEG is damaged: {what}")]
    Header { what: &'static str },
    #[error("the JPEG lost data: scans are missing for component {component}")]
    ScansMissing { component: usize },
    #[error("the JPEG has more than {MAX_SCANS} scans")]
    TooManyScans,
}

/// The headers and tables that were read so far.
#[derive(Default)]
struct DecoderState {
    frame: Option<JpegFrame>,
    dc: [Option<HuffmanTable>; 4],
    ac: [Option<HuffmanTable>; 4],
    restart_interval: u32,
    scans: usize,
}

/// Checks a JPEG and returns its length. Other data may follow it, such as a phone's video. An image that has
/// all its blocks needs no end-of-image marker; libjpeg accepts it too.
///
/// # Errors
/// Missing, damaged or surplus data.
pub(crate) fn check(file: &[u8]) -> Result<usize, JpegError> {
    let (mut image, mut offset) = (DecoderState::default(), 2);
    loop {
        let Some((marker, after)) = next_marker(file, offset) else {
            let frame = image.frame.as_ref().ok_or(JpegError::NoEnd)?;
            return frame.check_complete().map(|()| offset);
        };
        offset = after;
        match marker {
            END_OF_IMAGE => {
                image.frame.as_ref().map_or(Ok(()), JpegFrame::check_complete)?;
                return Ok(offset);
            }
            // Markers without a segment.
            START_OF_IMAGE | 0x01 | 0xd0..=0xd7 => continue,
            _ => {}
        }
        let body = segment(file, offset).ok_or(JpegError::NoEnd)?;
        offset += 2 + body.len();
        match marker {
            0xc0..=0xc2 => image.frame = Some(JpegFrame::parse(body, marker == 0xc2)?),
            TABLES => image.read_tables(body)?,
            RESTART_INTERVAL => image.restart_interval = restart_interval(body)?,
            START_OF_SCAN => offset += image.check_scan(body, &file[offset..])?,
            // A frame that the decoder does not know.
            0xc3 | 0xc5..=0xc7 | 0xc9..=0xcb | 0xcd..=0xcf => return Ok(file.len()),
            _ => {}
        }
    }
}

/// The next marker and the offset behind it. Fill bytes before it are allowed (B.1.1.2), and other bytes are
/// skipped, as decoders do.
fn next_marker(file: &[u8], mut offset: usize) -> Option<(u8, usize)> {
    loop {
        offset += file.get(offset..)?.iter().position(|&byte| byte == MARKER)?;
        let kind = *file.get(offset + 1)?;
        match kind {
            MARKER => offset += 1,
            0 => offset += 2,
            kind => return Some((kind, offset + 2)),
        }
    }
}

fn restart_interval(body: &[u8]) -> Result<u32, JpegError> {
    let bytes = body.first_chunk().ok_or(JpegError::Header { what: "its restart interval is too short" })?;
    Ok(u16::from_be_bytes(*bytes).into())
}

impl DecoderState {
    fn read_tables(&mut self, mut body: &[u8]) -> Result<(), JpegError> {
        let broken = JpegError::Header { what: "a Huffman table is broken" };
        while let Some((&class_and_place, rest)) = body.split_first() {
            let (table, rest) = HuffmanTable::parse(rest).ok_or(broken.clone())?;
            let tables = if class_and_place >> 4 == 0 { &mut self.dc } else { &mut self.ac };
            *tables.get_mut(usize::from(class_and_place & 15)).ok_or(broken.clone())? = Some(table);
            body = rest;
        }
        Ok(())
    }

    /// Reads a scan and returns its length in bytes.
    fn check_scan(&mut self, header: &[u8], data: &[u8]) -> Result<usize, JpegError> {
        let Self { frame, dc, ac, restart_interval, scans } = self;
        let frame = frame.as_mut().ok_or(JpegError::Header { what: "it has a scan before its frame" })?;
        if frame.pixels() > MAX_PIXELS {
            return Ok(0);
        }
        *scans += 1;
        if *scans > MAX_SCANS {
            return Err(JpegError::TooManyScans);
        }
        let scan = ScanHeader::parse(header, frame, dc, ac)?;
        let length = scan.walk(frame, *restart_interval, data)?;
        scan.note(frame);
        Ok(length)
    }
}

#[cfg(test)]
mod tests;
