//! Pictures on stdin: Y4M, whose header says it all, or raw ones of a size and format that the user names.

mod raw;
mod y4m;

use std::io::Read;
use std::str::FromStr;
use std::sync::mpsc::{Receiver, RecvTimeoutError, Sender, SyncSender, channel, sync_channel};
use std::time::Duration;

use anyhow::Context as _;
use nunet_core::frame::{MAX_SIDE_PX, PixelFormat};
use nunet_ipc::{Clock, monotonic_nanos, unix_nanos};

use super::{Capture, Fill, Frame, Pixels, Source};

/// How long one call may wait, so that a stop is seen.
const PATIENCE: Duration = Duration::from_millis(100);

/// What raw pictures on stdin are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct RawLayout {
    /// Width and height, pixels.
    pub size: (u32, u32),
    /// How pixels lie; rows follow each other without padding.
    pub format: PixelFormat,
}

/// `WxH`
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureSize(pub u32, pub u32);

impl FromStr for PictureSize {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let sides = text.split_once(['x', 'X']).map(|(width, height)| (width.parse(), height.parse()));
        match sides {
            Some((Ok(width), Ok(height)))
                if [width, height].iter().all(|side| (1..=MAX_SIDE_PX).contains(side)) =>
            {
                Ok(Self(width, height))
            }
            _ => Err(format!("expected `WxH` of 1 to {MAX_SIDE_PX} pixels, such as `640x480`, got `{text}`")),
        }
    }
}

/// A picture from the pipe, in memory that travels back.
#[derive(Debug, Default)]
struct Shot {
    bytes: Vec<u8>,
    size: (u32, u32),
    row_stride: u32,
    format: Option<PixelFormat>,
    /// Nanoseconds of the stream's own clock, where it has one.
    media_nanos: Option<i64>,
}

/// What comes out of a pipe.
#[derive(Debug)]
enum Message {
    Shot(Shot),
    /// The pipe ended between two pictures.
    End,
    /// The pipe ended in the middle of something, or what it carries cannot be read.
    Cut(anyhow::Error),
}

/// Somebody who reads pictures, one after the other.
trait Shots: Send {
    /// Reads the next picture into `shot`; false at the end.
    fn next(&mut self, shot: &mut Shot) -> anyhow::Result<bool>;
}

/// A pipe. It is read on a thread of its own: reading may block for ever, and a stop must be seen.
pub(super) struct Pipe {
    messages: Receiver<Message>,
    used: Sender<Shot>,
    sequence: u64,
}

impl Pipe {
    /// Begins to read. The thread ends with the pipe or with the process.
    pub(super) fn open(input: impl Read + Send + 'static, layout: Option<RawLayout>) -> anyhow::Result<Self> {
        let (send, messages) = sync_channel(1);
        let (used, shelf) = channel();
        let read = move || match layout {
            Some(layout) => pass_on(&mut raw::RawShots::new(input, layout), &send, &shelf),
            None => match y4m::Y4mShots::open(input) {
                Ok(mut shots) => pass_on(&mut shots, &send, &shelf),
                // Nobody listens any more: it does not matter.
                Err(error) => drop(send.send(Message::Cut(error))),
            },
        };
        std::thread::Builder::new()
            .name("stdin".into())
            .spawn(read)
            .context("cannot start stdin's thread")?;
        Ok(Self { messages, used, sequence: 0 })
    }

    fn take(&mut self, shot: Shot, frame: &mut Frame) {
        frame.sequence = self.sequence;
        self.sequence += 1;
        frame.size = shot.size;
        frame.row_stride = shot.row_stride;
        frame.format = shot.format;
        frame.camera = None;
        let (clock, nanos) = match shot.media_nanos {
            Some(nanos) => (Clock::Media, nanos),
            None => (Clock::Monotonic, monotonic_nanos()),
        };
        frame.capture = Capture { nanos, clock, unix_nanos: unix_nanos() };
        let bytes = std::mem::replace(&mut frame.pixels, Pixels::Owned(shot.bytes));
        if let Pixels::Owned(bytes) = bytes {
            // The thread has ended: it needs no memory.
            let _ = self.used.send(Shot { bytes, ..Shot::default() });
        }
    }
}

impl Source for Pipe {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        match self.messages.recv_timeout(PATIENCE) {
            Ok(Message::Shot(shot)) => {
                self.take(shot, frame);
                Fill::Frame
            }
            Ok(Message::Cut(error)) if self.sequence == 0 => Fill::Broken(error),
            Ok(Message::Cut(error)) => Fill::Cut(error),
            Err(RecvTimeoutError::Timeout) => Fill::Nothing,
            Ok(Message::End) if self.sequence == 0 => Fill::Broken(anyhow::anyhow!(
                "stdin ended before its first picture\nhint: look at what should have written it"
            )),
            Ok(Message::End) => Fill::End,
            Err(RecvTimeoutError::Disconnected) => {
                Fill::Broken(anyhow::anyhow!("stdin's thread has failed: see the lines above"))
            }
        }
    }
}

/// Reads until the end; the channel has room for one picture, so the writer of the pipe waits for us.
fn pass_on(shots: &mut dyn Shots, send: &SyncSender<Message>, shelf: &Receiver<Shot>) {
    loop {
        let mut shot = shelf.try_recv().unwrap_or_default();
        let message = match shots.next(&mut shot) {
            Ok(true) => Message::Shot(shot),
            Ok(false) => Message::End,
            Err(error) => Message::Cut(error),
        };
        let over = !matches!(message, Message::Shot(_));
        if send.send(message).is_err() || over {
            return;
        }
    }
}

/// Fills `bytes` from `input`; how many came before its end.
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

    /// The pictures' bytes, and how the pipe ended.
    fn drain(input: &[u8], layout: Option<RawLayout>) -> (Vec<Vec<u8>>, Fill) {
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

    const GREY: RawLayout = RawLayout { size: (3, 2), format: PixelFormat::Mono8 };

    #[test]
    fn raw_pictures_follow_each_other() {
        let (seen, end) = drain(&[1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12], Some(GREY));
        assert_eq!(seen, [[1, 2, 3, 4, 5, 6], [7, 8, 9, 10, 11, 12]]);
        assert!(matches!(end, Fill::End));
    }

    #[test]
    fn a_pipe_that_ends_in_the_middle_of_a_picture_is_cut() {
        let (seen, end) = drain(&[1; 10], Some(GREY));
        assert_eq!(seen.len(), 1);
        let Fill::Cut(error) = end else { panic!("{end:?}") };
        assert_eq!(error.to_string(), "stdin ended after 4 of a picture's 6 bytes");
    }

    #[test]
    fn a_pipe_without_any_picture_is_a_producer_that_has_failed() {
        let broken = |input: &[u8], layout| match drain(input, layout) {
            (_, Fill::Broken(error)) => error.to_string(),
            (_, end) => panic!("{end:?}"),
        };
        for (input, layout) in [(&b""[..], Some(GREY)), (b"YUV4MPEG2 W4 H2 F30:1 C420\n", None)] {
            let error = broken(input, layout);
            assert!(error.starts_with("stdin ended before its first picture\nhint: "), "{error}");
        }
        let error = broken(&[], None);
        assert!(error.starts_with("stdin is no Y4M: it ended before the header did"), "{error}");
    }

    #[test]
    fn sizes_are_read_as_they_are_written_everywhere() {
        assert_eq!("640x480".parse(), Ok(PictureSize(640, 480)));
        for bad in ["640", "4294967295x4294967295", "0x4", "ax4", "4x", "-1x4"] {
            assert!(bad.parse::<PictureSize>().unwrap_err().contains("expected `WxH`"), "{bad}");
        }
    }
}
