//! A frame as one binary message.
//!
//! Little-endian. A header of 80 bytes, then sections: kind (`u32`), length in bytes (`u32`), content, and
//! zeros up to a multiple of 4. A reader skips sections of a kind that it does not know.
//!
//! | offset | type | field |
//! |---|---|---|
//! | 0 | 4 bytes | `NUVF` |
//! | 4 | `u16` | version, 1 |
//! | 6 | `u16` | length of the header: where the sections begin |
//! | 8 | `u64` | sequence: counts the source's frames from 0 |
//! | 16 | `i64` | time of capture, nanoseconds since 1970 |
//! | 24 | `u32` | from capture to publishing, microseconds |
//! | 28 | `u16`, `u16` | width and height of the whole depth map |
//! | 32 | `u16`, `u16` | width and height of the sections `depth`, `labels` and `confidence` |
//! | 36 | `u16` | stride: pixel `(x, y)` of a section is pixel `(x * stride, y * stride)` of the whole map |
//! | 38 | `u8` | units: 0 none, 1 meters, 2 relative |
//! | 39 | `u8` | source of the scale, as in shared memory |
//! | 40 | `f32`, `f32` | near and far: the first and the last percentile of depth |
//! | 48 | `u8` | curve of depth codes: 0 linear, 1 logarithmic |
//! | 49 | 3 bytes | 0 |
//! | 52 | `f32`, `f32` | first value and step of the curve |
//! | 60 | 4 bytes | 0 |
//! | 64 | 4 x `f32` | the part of the image that depth covers: left, top, width, height, as shares of the image |
//!
//! The first version of the header ended at byte 64: depth covered the whole image.

use bytes::Bytes;
use nunet_types::ImageSize;

use crate::encode::{DepthMap, DepthMapError, LevelCurve, inflate};
use crate::frame::{DepthInfo, WHOLE_IMAGE};

/// The version of requests and messages.
pub const PROTOCOL_VERSION: u16 = 1;
const MAGIC: [u8; 4] = *b"NUVF";
const HEADER_BYTES: usize = 80;
/// The first version of the header.
const MIN_HEADER_BYTES: usize = 64;
/// The longest message that is accepted. An image of 32768x32768 pixels would exceed it.
const MAX_MESSAGE_BYTES: usize = 256 << 20;

/// What a section contains.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Section {
    /// The image as JPEG.
    Image = 1,
    /// Depth codes: the low bytes of all pixels, then the high bytes, zlib.
    Depth = 2,
    /// Class indices, `u8`, zlib.
    Labels = 3,
    /// Obstacles from above: sectors and points.
    Obstacles = 4,
    /// Confidence of depth, `u8`, 255 = certain, zlib.
    Confidence = 5,
}

/// A frame to be sent.
#[derive(Debug, Clone)]
pub(crate) struct FrameParts {
    pub(crate) sequence: u64,
    pub(crate) capture_unix_nanos: i64,
    pub(crate) total_micros: u32,
    pub(crate) depth: Option<DepthInfo>,
    pub(crate) map_size: ImageSize,
    pub(crate) stride: u32,
    pub(crate) range: (f32, f32),
    pub(crate) curve: LevelCurve,
    pub(crate) sections: Vec<(Section, Bytes)>,
}

/// The message of a frame.
pub(crate) fn encode(parts: &FrameParts) -> Vec<u8> {
    let content: usize = parts.sections.iter().map(|(_, bytes)| 12 + bytes.len()).sum();
    let mut message = Vec::with_capacity(HEADER_BYTES + content);
    // Sides are at most 32768.
    let short = |number: u32| u16::try_from(number).unwrap_or(u16::MAX).to_le_bytes();
    let depth = parts.depth;
    let size = depth.map_or(ImageSize::new(0, 0), |depth| depth.size);
    message.extend(MAGIC);
    message.extend(PROTOCOL_VERSION.to_le_bytes());
    message.extend(short(HEADER_BYTES as u32));
    message.extend(parts.sequence.to_le_bytes());
    message.extend(parts.capture_unix_nanos.to_le_bytes());
    message.extend(parts.total_micros.to_le_bytes());
    for side in [size.width, size.height, parts.map_size.width, parts.map_size.height, parts.stride] {
        message.extend(short(side));
    }
    message.push(depth.map_or(0, |depth| u32::from(depth.units) as u8));
    message.push(depth.map_or(0, |depth| u32::from(depth.scale_source) as u8));
    let (first, step) = parts.curve.parts();
    message.extend([parts.range.0, parts.range.1].map(f32::to_le_bytes).as_flattened());
    message.extend([parts.curve.number(), 0, 0, 0]);
    message.extend([first, step].map(f32::to_le_bytes).as_flattened());
    message.extend([0; 4]);
    message.extend(depth.map_or(WHOLE_IMAGE, |depth| depth.view).map(f32::to_le_bytes).as_flattened());
    for (kind, bytes) in &parts.sections {
        message.extend((*kind as u32).to_le_bytes());
        message.extend(u32::try_from(bytes.len()).unwrap_or(u32::MAX).to_le_bytes());
        message.extend_from_slice(bytes);
        message.resize(message.len().next_multiple_of(4), 0);
    }
    message
}

/// A frame that was received, for clients in Rust.
#[derive(Debug, Clone, PartialEq)]
pub struct FrameMessage<'a> {
    /// Counts the source's frames from 0.
    pub sequence: u64,
    /// Time of capture, nanoseconds since 1970.
    pub capture_unix_nanos: i64,
    /// From capture to publishing, microseconds.
    pub total_micros: u32,
    /// Size of the whole depth map.
    pub depth_size: ImageSize,
    /// Size of the sections `depth`, `labels` and `confidence`.
    pub map_size: ImageSize,
    /// A pixel of a section is every `stride`-th of the whole map.
    pub stride: u32,
    /// The first and the last percentile of depth.
    pub range: (f32, f32),
    curve: Option<LevelCurve>,
    sections: Vec<(u32, &'a [u8])>,
}

/// Why bytes are not a frame.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum MessageError {
    /// It does not begin with the bytes of a frame message.
    #[error("the message does not begin with `NUVF`")]
    Magic,
    /// It is of another version.
    #[error("the message has version {version}, expected {PROTOCOL_VERSION}")]
    Version {
        /// The version.
        version: u16,
    },
    /// It ends within its header or a section.
    #[error("the message ends after {bytes} bytes, within its {part}")]
    Truncated {
        /// Its length.
        bytes: usize,
        /// What is cut off.
        part: &'static str,
    },
    /// It is longer than any frame.
    #[error("the message has {bytes} bytes, expected at most {MAX_MESSAGE_BYTES}")]
    TooLong {
        /// Its length.
        bytes: usize,
    },
    /// Depth cannot be unpacked.
    #[error(transparent)]
    Depth(#[from] DepthMapError),
    /// Labels or confidence cannot be unpacked.
    #[error("the section `{section}` is not a deflated map of {size} bytes")]
    Bytes {
        /// The section.
        section: &'static str,
        /// The size of the map.
        size: ImageSize,
    },
}

/// Reads little-endian numbers in sequence. The caller checks the length; missing bytes read as 0.
struct ByteReader<'a>(&'a [u8]);

impl ByteReader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (number, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *number
    }

    fn short(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn real(&mut self) -> f32 {
        f32::from_le_bytes(self.take())
    }

    fn size(&mut self) -> ImageSize {
        ImageSize::new(self.short().into(), self.short().into())
    }
}

impl<'a> FrameMessage<'a> {
    /// Reads a message. Its sections are unpacked by [`depth`](Self::depth), [`labels`](Self::labels) and
    /// [`confidence`](Self::confidence).
    ///
    /// # Errors
    /// It is not a frame, of another version, or cut off.
    pub fn parse(message: &'a [u8]) -> Result<Self, MessageError> {
        let bytes = message.len();
        if !message.starts_with(&MAGIC) {
            return Err(MessageError::Magic);
        }
        if bytes > MAX_MESSAGE_BYTES {
            return Err(MessageError::TooLong { bytes });
        }
        if bytes < MIN_HEADER_BYTES {
            return Err(MessageError::Truncated { bytes, part: "header" });
        }
        let numbers = &mut ByteReader(&message[MAGIC.len()..]);
        let version = numbers.short();
        if version != PROTOCOL_VERSION {
            return Err(MessageError::Version { version });
        }
        let start = usize::from(numbers.short()).max(MIN_HEADER_BYTES);
        let content = message.get(start..).ok_or(MessageError::Truncated { bytes, part: "header" })?;
        let sections = sections(content).ok_or(MessageError::Truncated { bytes, part: "sections" })?;
        Ok(Self::from_header(numbers, sections))
    }

    fn from_header(numbers: &mut ByteReader<'_>, sections: Vec<(u32, &'a [u8])>) -> Self {
        let sequence = u64::from_le_bytes(numbers.take());
        let capture_unix_nanos = i64::from_le_bytes(numbers.take());
        let total_micros = numbers.word();
        let (depth_size, map_size, stride) = (numbers.size(), numbers.size(), numbers.short().into());
        let [_units, _scale_source] = numbers.take();
        let range = (numbers.real(), numbers.real());
        let [curve, ..] = numbers.take::<4>();
        let curve = LevelCurve::from_parts(curve, numbers.real(), numbers.real());
        Self {
            sequence,
            capture_unix_nanos,
            total_micros,
            depth_size,
            map_size,
            stride,
            range,
            curve,
            sections,
        }
    }

    /// The bytes of a section, as they were sent.
    #[must_use]
    pub fn section(&self, section: Section) -> Option<&'a [u8]> {
        self.sections.iter().find(|(kind, _)| *kind == section as u32).map(|(_, bytes)| *bytes)
    }

    /// The depth map; `None` if it was not sent.
    ///
    /// # Errors
    /// The section is damaged.
    pub fn depth(&self) -> Result<Option<DepthMap>, MessageError> {
        let (Some(bytes), Some(curve)) = (self.section(Section::Depth), self.curve) else { return Ok(None) };
        Ok(Some(DepthMap::decode(bytes, self.map_size, curve)?))
    }

    /// The labels; `None` if they were not sent.
    ///
    /// # Errors
    /// The section is damaged.
    pub fn labels(&self) -> Result<Option<Vec<u8>>, MessageError> {
        self.bytes(Section::Labels, "labels")
    }

    /// The confidence of depth, 255 = certain; `None` if it was not sent.
    ///
    /// # Errors
    /// The section is damaged.
    pub fn confidence(&self) -> Result<Option<Vec<u8>>, MessageError> {
        self.bytes(Section::Confidence, "confidence")
    }

    /// A map of one byte per pixel.
    fn bytes(&self, kind: Section, section: &'static str) -> Result<Option<Vec<u8>>, MessageError> {
        let Some(bytes) = self.section(kind) else { return Ok(None) };
        let map = inflate(bytes, self.map_size.pixel_count());
        map.map(Some).ok_or(MessageError::Bytes { section, size: self.map_size })
    }
}

/// All sections; `None` if the last one is cut off.
fn sections(mut content: &[u8]) -> Option<Vec<(u32, &[u8])>> {
    let mut sections = Vec::new();
    while !content.is_empty() {
        let (head, rest) = content.split_first_chunk::<8>()?;
        let numbers = &mut ByteReader(head);
        let (kind, length) = (numbers.word(), numbers.word() as usize);
        sections.push((kind, rest.get(..length)?));
        content = rest.get(length.checked_next_multiple_of(4)?..)?;
    }
    Some(sections)
}

#[cfg(test)]
mod tests {
    use nunet_types::{ScaleSource, Units};
    use proptest::prelude::*;

    use super::*;
    use crate::encode::{encode_bytes, encode_depth, levels_of};

    fn message() -> Vec<u8> {
        let size = ImageSize::new(4, 2);
        let depth = [1.0, 2.0, f32::NAN, 4.0, 5.0, 6.0, 7.0, 8.0];
        let curve = levels_of(&depth, Units::Metre);
        encode(&FrameParts {
            sequence: 7,
            capture_unix_nanos: -1,
            total_micros: 40_000,
            depth: Some(DepthInfo {
                size: ImageSize::new(8, 4),
                units: Units::Metre,
                scale_source: ScaleSource::FocalScaled,
                view: [0.0, 0.0, 1.0, 1.0],
            }),
            map_size: size,
            stride: 2,
            range: (1.0, 8.0),
            curve,
            sections: vec![
                (Section::Image, Bytes::from_static(&[1, 2, 3])),
                (Section::Depth, encode_depth(&depth, size, curve).into()),
                (Section::Labels, encode_bytes(&[3; 8]).into()),
                (Section::Confidence, encode_bytes(&[255, 254, 7, 6, 5, 4, 3, 0]).into()),
            ],
        })
    }

    #[test]
    fn a_frame_is_read_back() {
        let bytes = message();
        let frame = FrameMessage::parse(&bytes).unwrap();
        assert_eq!((frame.sequence, frame.capture_unix_nanos, frame.total_micros), (7, -1, 40_000));
        assert_eq!(
            (frame.depth_size, frame.map_size, frame.stride),
            (ImageSize::new(8, 4), ImageSize::new(4, 2), 2)
        );
        assert_eq!((frame.range, frame.section(Section::Image)), ((1.0, 8.0), Some(&[1, 2, 3][..])));
        let depth = frame.depth().unwrap().unwrap();
        assert!((depth.values[3] - 4.0).abs() < 0.009 && depth.values[2].is_nan(), "{depth:?}");
        assert_eq!(frame.labels().unwrap(), Some(vec![3; 8]));
        assert_eq!(frame.confidence().unwrap(), Some(vec![255, 254, 7, 6, 5, 4, 3, 0]));
        assert_eq!(frame.section(Section::Obstacles), None);
    }

    #[test]
    fn a_frame_that_is_cut_anywhere_is_an_error_or_has_fewer_sections() {
        let whole = message();
        for length in 0..whole.len() {
            if let Ok(frame) = FrameMessage::parse(&whole[..length]) {
                assert!(frame.sections.len() < 4, "{length} bytes");
            }
        }
    }

    #[test]
    fn other_messages_and_versions_are_not_confused() {
        let mut bytes = message();
        bytes[4] = 9;
        assert_eq!(FrameMessage::parse(&bytes), Err(MessageError::Version { version: 9 }));
        bytes[0] = b'X';
        assert_eq!(FrameMessage::parse(&bytes), Err(MessageError::Magic));
    }

    #[test]
    fn a_section_of_an_unknown_kind_and_a_longer_header_are_skipped() {
        let mut bytes = message();
        bytes.extend([99, 0, 0, 0, 1, 0, 0, 0, 5, 0, 0, 0]);
        let labels =
            |bytes: &[u8]| FrameMessage::parse(bytes).and_then(|frame| frame.labels()).unwrap().unwrap();
        let mut longer = bytes.clone();
        longer.splice(HEADER_BYTES..HEADER_BYTES, [0; 8]);
        longer[6] = 88;
        assert_eq!(labels(&longer), [3; 8]);
        bytes.drain(MIN_HEADER_BYTES..HEADER_BYTES);
        bytes[6] = 64;
        assert_eq!(labels(&bytes), [3; 8], "the first version of the header");
    }

    proptest! {
        #[test]
        fn a_damaged_frame_is_a_frame_or_an_error(at in 0_usize..200, value: u8) {
            let mut bytes = message();
            let at = at % bytes.len();
            bytes[at] = value;
            if let Ok(frame) = FrameMessage::parse(&bytes) {
                let _ = (frame.depth(), frame.labels(), frame.confidence());
            }
        }
    }
}
