//! Images on standard input: Y4M, whose header states everything, or raw ones of a size and format that the user states.

mod raw;
mod y4m;

use std::io::Read;
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::Duration;

use nunet_ipc::{Clock, monotonic_nanos, unix_nanos};
use nunet_types::{ImageSize, PixelFormat};

use crate::error::{SourceError, SourceErrorKind};
use crate::source::Fused;
use crate::source_type::{Exclusive, Properties, SizeUse, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Pixels, Source};

/// How long one call may wait, so that a stop is noticed.
const POLL_TIMEOUT: Duration = Duration::from_millis(100);

/// Standard input.
pub(crate) struct StandardInput;

impl SourceType for StandardInput {
    fn is_named(&self, name: &str) -> bool {
        name == "-"
    }

    fn properties(&self) -> Properties {
        Properties {
            exclusive: Some(Exclusive::StandardInput),
            size: SizeUse::Raw,
            no_repeat: Some("standard input cannot begin again"),
            camera: "camera",
            default_rate: Some("max"),
            ..Properties::default()
        }
    }

    /// Standard input may be a file.
    fn files(&self, _name: &str) -> Vec<PathBuf> {
        vec!["/dev/stdin".into()]
    }

    fn open(&self, _name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        open_pipe(std::io::stdin(), options)
    }
}

/// Opens a pipe: raw images if `options` states a size and a format, else Y4M.
///
/// # Errors
/// No thread can be started.
pub fn open_pipe(
    input: impl Read + Send + 'static,
    options: OpenOptions<'_>,
) -> Result<Box<dyn Source>, SourceError> {
    let layout = options.size.zip(options.format).map(|(size, format)| RawFormat { size, format });
    Ok(Box::new(Fused::new(Pipe::open(input, layout)?)))
}

/// The size and format of raw images on standard input.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct RawFormat {
    size: ImageSize,
    /// How pixels are laid out; rows follow each other without padding.
    pub format: PixelFormat,
}

/// An image from the pipe, in memory that is returned and reused.
#[derive(Debug)]
struct PipeImage {
    bytes: Vec<u8>,
    size: ImageSize,
    row_stride: u32,
    format: Option<PixelFormat>,
    /// Nanoseconds of the stream's own clock, if it has one.
    media_nanos: Option<i64>,
}

impl Default for PipeImage {
    fn default() -> Self {
        let size = ImageSize { width: 0, height: 0 };
        Self { bytes: Vec::new(), size, row_stride: 0, format: None, media_nanos: None }
    }
}

/// A message from the thread that reads the pipe.
#[derive(Debug)]
enum PipeMessage {
    Image(PipeImage),
    /// The pipe ended between two images.
    End,
    /// The pipe ended within an image, or its data cannot be read.
    Cut(SourceError),
}

/// Reads images one after the other.
trait ImageReader: Send {
    /// Reads the next image into `image`; false at the end.
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError>;
}

/// A pipe. It is read on a thread of its own: reading may block forever, but a stop must be handled in time.
struct Pipe {
    messages: Receiver<PipeMessage>,
    used: Sender<PipeImage>,
    sequence: u64,
}

impl Pipe {
    /// Begins to read. The thread ends with the pipe or with the process.
    fn open(input: impl Read + Send + 'static, layout: Option<RawFormat>) -> Result<Self, SourceError> {
        let (send, messages) = sync_channel(1);
        let (used, returned) = channel();
        let read = move || match layout {
            Some(layout) => pass_on(&mut raw::RawReader::new(input, layout), &send, &returned),
            None => match y4m::Y4mReader::open(input) {
                Ok(mut reader) => pass_on(&mut reader, &send, &returned),
                // An error here means that the source was dropped.
                Err(error) => drop(send.send(PipeMessage::Cut(error))),
            },
        };
        std::thread::Builder::new().name("stdin".into()).spawn(read).map_err(|error| {
            let message = "cannot start the thread for standard input";
            SourceError::new(SourceErrorKind::Unavailable, message).with_cause(error)
        })?;
        Ok(Self { messages, used, sequence: 0 })
    }

    fn take(&mut self, image: PipeImage, frame: &mut Frame) {
        frame.sequence = self.sequence;
        self.sequence += 1;
        frame.size = image.size;
        frame.row_stride = image.row_stride;
        frame.format = image.format;
        frame.camera = None;
        let (clock, nanos) = match image.media_nanos {
            Some(nanos) => (Clock::Media, nanos),
            None => (Clock::Monotonic, monotonic_nanos()),
        };
        frame.capture = CaptureTime { nanos, clock, unix_nanos: unix_nanos() };
        let bytes = std::mem::replace(&mut frame.pixels, Pixels::Owned(image.bytes));
        if let Pixels::Owned(bytes) = bytes {
            // If the thread has ended, the memory is not needed.
            let _ = self.used.send(PipeImage { bytes, ..PipeImage::default() });
        }
    }
}

impl Source for Pipe {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.messages.recv_timeout(POLL_TIMEOUT) {
            Ok(PipeMessage::Image(image)) => {
                self.take(image, frame);
                Fill::Frame
            }
            Ok(PipeMessage::Cut(error)) if self.sequence == 0 => Fill::Broken(error),
            Ok(PipeMessage::Cut(error)) => Fill::Cut(error),
            Err(RecvTimeoutError::Timeout) => Fill::Nothing,
            Ok(PipeMessage::End) if self.sequence == 0 => Fill::Broken(
                SourceError::new(
                    SourceErrorKind::NothingReadable,
                    "standard input ended before its first image",
                )
                .with_hint("check the program that should have written it"),
            ),
            Ok(PipeMessage::End) => Fill::End,
            Err(RecvTimeoutError::Disconnected) => {
                let message = "the thread for standard input has failed";
                Fill::Broken(SourceError::new(SourceErrorKind::Unavailable, message))
            }
        }
    }
}

/// Reads until the end; the channel has room for one image, so the writer of the pipe has to wait.
fn pass_on(reader: &mut dyn ImageReader, send: &SyncSender<PipeMessage>, returned: &Receiver<PipeImage>) {
    loop {
        let mut image = returned.try_recv().unwrap_or_default();
        let message = match reader.next(&mut image) {
            Ok(true) => PipeMessage::Image(image),
            Ok(false) => PipeMessage::End,
            Err(error) => PipeMessage::Cut(error),
        };
        let over = !matches!(message, PipeMessage::Image(_));
        if send.send(message).is_err() || over {
            return;
        }
    }
}

/// Memory for an image is allocated in steps of this size, as its bytes arrive: a large stated size alone
/// allocates nothing.
const GROWTH_BYTES: usize = 16 << 20;

/// Reads up to `length` bytes into `bytes`, which grows as they arrive. Returns the number of bytes before
/// the end.
fn read_growing(input: &mut impl Read, bytes: &mut Vec<u8>, length: usize) -> std::io::Result<usize> {
    bytes.truncate(length);
    let mut filled = 0;
    while filled < length {
        let end = bytes.len().max(length.min(filled + GROWTH_BYTES));
        let more = end - bytes.len();
        bytes.try_reserve(more).map_err(|_| std::io::Error::from(std::io::ErrorKind::OutOfMemory))?;
        bytes.resize(end, 0);
        let read = read_up_to(input, &mut bytes[filled..end])?;
        filled += read;
        if filled < end {
            break;
        }
    }
    Ok(filled)
}

/// An image that does not fit into memory.
fn too_large(size: ImageSize) -> SourceError {
    let message = format!("there is not enough memory for an image of {size} on standard input");
    SourceError::new(SourceErrorKind::Unavailable, message)
        .with_hint("make it smaller: networks use some hundred pixels a side")
}

/// Fills `bytes` from `input`. Returns the number of bytes before its end.
fn read_up_to(input: &mut impl Read, bytes: &mut [u8]) -> std::io::Result<usize> {
    let mut filled = 0;
    while let Some(rest) = bytes.get_mut(filled..).filter(|rest| !rest.is_empty()) {
        match input.read(rest) {
            Ok(0) => break,
            Ok(count) => filled += count,
            Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {}
            Err(error) => return Err(error),
        }
    }
    Ok(filled)
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    /// The images' bytes, and how the pipe ended.
    fn drain(input: &[u8], layout: Option<RawFormat>) -> (Vec<Vec<u8>>, Fill) {
        let mut pipe = Pipe::open(Cursor::new(input.to_vec()), layout).unwrap();
        let (mut frame, mut seen) = (Frame::default(), Vec::new());
        loop {
            match pipe.fill(&mut frame) {
                Fill::Frame => seen.push(frame.view().unwrap().bytes().to_vec()),
                Fill::Nothing => {}
                end => return (seen, end),
            }
        }
    }

    const GRAY: RawFormat = RawFormat { size: ImageSize { width: 3, height: 2 }, format: PixelFormat::Mono8 };

    #[test]
    fn raw_images_follow_each_other() {
        let (seen, end) = drain(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], Some(GRAY));
        assert_eq!(seen, [[1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12]]);
        assert!(matches!(end, Fill::End));
    }

    #[test]
    fn a_pipe_that_ends_in_the_middle_of_an_image_is_cut() {
        let (seen, end) = drain(&[1; 10], Some(GRAY));
        assert_eq!(seen.len(), 1);
        let Fill::Cut(error) = end else { panic!("{end:?}") };
        assert_eq!(error.to_string(), "standard input ended after 4 of an image's 6 bytes");
    }

    #[test]
    fn a_stated_size_takes_no_memory_before_its_bytes_come() {
        let mut bytes = Vec::new();
        let read = read_growing(&mut Cursor::new([7; 100]), &mut bytes, usize::MAX / 2).unwrap();
        assert_eq!((read, bytes.len() <= GROWTH_BYTES), (100, true));
        let read = read_growing(&mut Cursor::new([8; 100]), &mut bytes, 90).unwrap();
        assert_eq!((read, bytes.as_slice()), (90, &[8; 90][..]));
        let huge = RawFormat { size: ImageSize::new(32_768, 32_768), format: PixelFormat::Rgb8 };
        let (_, end) = drain(&[1; 100], Some(huge));
        assert!(matches!(&end, Fill::Broken(error) if error.to_string().contains("after 100 of")), "{end:?}");
    }

    #[test]
    fn a_pipe_without_any_image_is_a_failure_of_its_writer() {
        let broken = |input: &[u8], layout| match drain(input, layout) {
            (_, Fill::Broken(error)) => error.to_string(),
            (_, end) => panic!("{end:?}"),
        };
        for (input, layout) in [(&b""[..], Some(GRAY)), (b"YUV4MPEG2 W4 H2 F30:1 C420\n", None)] {
            let error = broken(input, layout);
            assert!(error == "standard input ended before its first image", "{error}");
        }
        let error = broken(&[], None);
        assert!(error.starts_with("standard input is not Y4M: it ended before the header did"), "{error}");
    }
}
