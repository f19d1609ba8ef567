//! Images from a pipe: Y4M or JPEGs, whose headers state everything, or raw ones of a size and format that
//! the user states.

mod image_reader;
mod jpegs;
mod raw;
mod waiting;
mod y4m;

use std::io::{BufRead as _, BufReader, Read};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::Duration;

use nunet_ipc::{Clock, monotonic_nanos, unix_nanos};

use self::image_reader::{ImageReader, PipeImage, RawFormat};
use self::waiting::Waiting;
use crate::error::{SourceError, SourceErrorKind};
use crate::source::Fused;
use crate::source_type::{Exclusive, Properties, SizeUse, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source};

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
        open_pipe(Waiting(std::io::stdin()), options)
    }
}

/// Opens a pipe: raw images if `options` states a size and a format, else Y4M or JPEGs.
///
/// # Errors
/// No thread can be started.
pub fn open_pipe(
    input: impl Read + Send + 'static,
    options: OpenOptions<'_>,
) -> Result<Box<dyn Source>, SourceError> {
    Ok(Box::new(Fused::new(Pipe::open(input, &options, "standard input")?)))
}

/// No images: the stream was empty.
struct Empty;

impl ImageReader for Empty {
    fn next(&mut self, _shot: &mut PipeImage) -> Result<bool, SourceError> {
        Ok(false)
    }
}

/// Chooses the reader: for raw images if `format` is given, else by the first byte. Errors call the stream
/// `name`.
///
/// # Errors
/// The stream cannot be read, or contains something else.
fn open_reader(
    input: impl Read + Send + 'static,
    format: Option<RawFormat>,
    name: &'static str,
) -> Result<Box<dyn ImageReader>, SourceError> {
    let mut input = BufReader::with_capacity(1 << 16, input);
    if let Some(format) = format {
        return Ok(Box::new(raw::RawReader::open(input, format, name)?));
    }
    let start = input.fill_buf().map_err(|error| image_reader::unreadable(name, error))?;
    match start.first() {
        None => Ok(Box::new(Empty)),
        Some(byte) if jpegs::STARTS.contains(byte) => Ok(Box::new(jpegs::JpegReader::new(input, name))),
        Some(_) => Ok(Box::new(y4m::Y4mReader::open(input, name)?)),
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

/// A pipe. It is read on a thread of its own: reading may block forever, but a stop must be handled in time.
pub(crate) struct Pipe {
    /// What errors call it.
    name: &'static str,
    messages: Receiver<PipeMessage>,
    used: Sender<PipeImage>,
    sequence: u64,
}

impl Pipe {
    /// Begins to read. The thread ends with the pipe or with the process.
    pub(crate) fn open(
        input: impl Read + Send + 'static,
        options: &OpenOptions<'_>,
        name: &'static str,
    ) -> Result<Self, SourceError> {
        let format = options.size.zip(options.format).map(|(size, format)| RawFormat { size, format });
        let (send, messages) = sync_channel(1);
        let (used, returned) = channel();
        let read = move || match open_reader(input, format, name) {
            Ok(mut reader) => pass_on(reader.as_mut(), &send, &returned),
            // An error here means that the source was dropped.
            Err(error) => drop(send.send(PipeMessage::Cut(error))),
        };
        std::thread::Builder::new().name("pipe".into()).spawn(read).map_err(|error| {
            let message = format!("cannot start the thread for {name}");
            SourceError::new(SourceErrorKind::Unavailable, message).with_cause(error)
        })?;
        Ok(Self { name, messages, used, sequence: 0 })
    }

    fn take(&mut self, mut image: PipeImage, frame: &mut Frame) -> Fill {
        frame.sequence = self.sequence;
        self.sequence += 1;
        let (clock, nanos) = match image.media_nanos {
            Some(nanos) => (Clock::Media, nanos),
            None => (Clock::Monotonic, monotonic_nanos()),
        };
        frame.capture = CaptureTime { nanos, clock, unix_nanos: unix_nanos() };
        let put = image.swap_into(frame);
        // If the thread has ended, the memory is not needed.
        let _ = self.used.send(image);
        match put {
            Ok(()) => Fill::Frame,
            Err(error) => Fill::Failed(error.context(format!("image {} of {}", self.sequence, self.name))),
        }
    }
}

impl Source for Pipe {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.messages.recv_timeout(POLL_TIMEOUT) {
            Ok(PipeMessage::Image(image)) => self.take(image, frame),
            Ok(PipeMessage::Cut(error)) if self.sequence == 0 => Fill::Broken(error),
            Ok(PipeMessage::Cut(error)) => Fill::Cut(error),
            Err(RecvTimeoutError::Timeout) => Fill::Nothing,
            Ok(PipeMessage::End) if self.sequence == 0 => Fill::Broken(
                SourceError::new(
                    SourceErrorKind::NothingReadable,
                    format!("{} ended before its first image", self.name),
                )
                .with_hint("check the program that should have written it"),
            ),
            Ok(PipeMessage::End) => Fill::End,
            Err(RecvTimeoutError::Disconnected) => {
                let message = format!("the thread for {} has failed", self.name);
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

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use nunet_types::{ImageSize, PixelFormat};

    use super::image_reader::{GROWTH_BYTES, read_growing};
    use super::*;

    /// The images' bytes, and how the pipe ended.
    fn drain(input: &[u8], layout: Option<RawFormat>) -> (Vec<Vec<u8>>, Fill) {
        let options = OpenOptions {
            size: layout.map(|layout| layout.size),
            format: layout.map(|layout| layout.format),
            ..OpenOptions::default()
        };
        let mut pipe = Pipe::open(Cursor::new(input.to_vec()), &options, "standard input").unwrap();
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
        assert_eq!(error.kind(), SourceErrorKind::CutOff);
        insta::assert_snapshot!(error, @"standard input ended after 4 of an image's 6 bytes");
    }

    /// Its header and its planes would be taken for pixels.
    #[test]
    fn y4m_is_not_read_as_raw_images() {
        let (seen, end) = drain(b"YUV4MPEG2 W3 H2 F25:1 Cmono\nFRAME\n123456", Some(GRAY));
        let Fill::Broken(error) = end else { panic!("{end:?}") };
        assert!(seen.is_empty() && nunet_types::Hint::hint(&error).is_some(), "{error}");
        insta::assert_snapshot!(error, @"standard input is Y4M, and no raw images");
        let (seen, end) = drain(b"YUV4MPEG3 YU", Some(GRAY));
        assert_eq!(seen, [b"YUV4MP", b"EG3 YU"]);
        assert!(matches!(end, Fill::End), "{end:?}");
    }

    #[test]
    fn a_damaged_jpeg_fails_alone() {
        let png = b"\xff\xd8\xff\xe0\x00\x04ab\xff\xd9";
        let mut pipe = Pipe::open(Cursor::new(png.repeat(2)), &OpenOptions::default(), "the stream").unwrap();
        let (mut frame, mut failed) = (Frame::default(), 0);
        let end = loop {
            match pipe.fill(&mut frame) {
                Fill::Failed(error) => {
                    assert_eq!(error.kind(), SourceErrorKind::BadFrame);
                    failed += 1;
                    assert_eq!(error.to_string(), format!("image {failed} of the stream"));
                }
                Fill::Nothing => {}
                end => break end,
            }
        };
        assert!(matches!(end, Fill::End) && failed == 2, "{end:?}");
    }

    #[test]
    fn a_multipart_stream_may_begin_with_a_line_end_or_with_the_header_of_a_part() {
        let mut jpeg = Cursor::new(Vec::new());
        image::GrayImage::new(8, 8).write_to(&mut jpeg, image::ImageFormat::Jpeg).unwrap();
        let (header, jpeg) = (&b"Content-Type: image/jpeg\r\n\r\n"[..], jpeg.into_inner());
        for start in [&b""[..], b"--frame\r\n", b"\r\n--frame\r\n"] {
            let stream = [start, header, &jpeg, b"\r\n--frame\r\n", header, &jpeg].concat();
            let (seen, end) = drain(&stream, None);
            assert!(seen.len() == 2 && matches!(end, Fill::End), "{start:?}: {end:?}");
        }
    }

    #[test]
    fn a_jpeg_without_its_end_fails_alone() {
        let jpeg = |gray: u8| {
            let mut file = Cursor::new(Vec::new());
            let image =
                image::GrayImage::from_fn(32, 24, |x, y| image::Luma([gray ^ (x * 37 + y * 59) as u8]));
            image.write_to(&mut file, image::ImageFormat::Jpeg).unwrap();
            file.into_inner()
        };
        let cut = jpeg(1);
        let stream = [&jpeg(0)[..], &cut[..cut.len() / 3 * 2], &jpeg(2), &jpeg(3)].concat();
        let mut pipe = Pipe::open(Cursor::new(stream), &OpenOptions::default(), "the stream").unwrap();
        let (mut frame, mut good, mut failed) = (Frame::default(), Vec::new(), Vec::new());
        let end = loop {
            match pipe.fill(&mut frame) {
                Fill::Frame => good.push(frame.sequence),
                Fill::Failed(_) => failed.push(frame.sequence),
                Fill::Nothing => {}
                end => break end,
            }
        };
        assert!(matches!(end, Fill::End), "{end:?}");
        assert_eq!((good, failed), (vec![0, 2, 3], vec![1]));
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
        let Fill::Broken(error) = end else { panic!("{end:?}") };
        assert_eq!(error.kind(), SourceErrorKind::CutOff);
        insta::assert_snapshot!(error, @"standard input ended after 100 of an image's 3221225472 bytes");
    }

    #[test]
    fn a_pipe_without_any_image_is_a_failure_of_its_writer() {
        let broken = |input: &[u8], layout| match drain(input, layout) {
            (_, Fill::Broken(error)) => error,
            (_, end) => panic!("{end:?}"),
        };
        let empty = broken(b"", Some(GRAY));
        insta::assert_snapshot!(empty, @"standard input ended before its first image");
        for error in [empty, broken(b"", None), broken(b"YUV4MPEG2 W4 H2 F30:1 C420\n", None)] {
            assert_eq!(error.kind(), SourceErrorKind::NothingReadable, "{error}");
        }
        let error = broken(b"YUV4", None);
        assert_eq!(error.kind(), SourceErrorKind::Unavailable);
        insta::assert_snapshot!(error, @"standard input is not Y4M: it ended before the header did");
    }
}
