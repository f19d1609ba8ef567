//! Input that another program made non-blocking: programs that share a pipe or a terminal share its mode.

use std::io::{ErrorKind, Read};
use std::os::fd::AsFd;

use rustix::event::{PollFd, PollFlags, poll};
use rustix::io::Errno;

/// Waits for bytes in any mode.
pub(super) struct Waiting<R>(pub(super) R);

impl<R: Read + AsFd> Read for Waiting<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        loop {
            match self.0.read(buffer) {
                Err(error) if error.kind() == ErrorKind::WouldBlock => {}
                read => return read,
            }
            match poll(&mut [PollFd::new(&self.0, PollFlags::IN)], None) {
                Ok(_) | Err(Errno::INTR) => {}
                Err(error) => return Err(error.into()),
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;
    use std::os::unix::net::UnixStream;

    use nunet_types::{ImageSize, PixelFormat};

    use super::super::Pipe;
    use super::*;
    use crate::{Fill, Frame, OpenOptions, Source as _};

    #[test]
    fn images_are_waited_for_in_input_that_does_not_wait() {
        let (input, mut writer) = UnixStream::pair().unwrap();
        input.set_nonblocking(true).unwrap();
        let options = OpenOptions {
            size: Some(ImageSize::new(2, 2)),
            format: Some(PixelFormat::Mono8),
            ..OpenOptions::default()
        };
        let mut pipe = Pipe::open(Waiting(input), &options, "standard input").unwrap();
        let mut frame = Frame::default();
        assert!(matches!(pipe.fill(&mut frame), Fill::Nothing));
        writer.write_all(&[7; 4]).unwrap();
        drop(writer);
        let mut next = || {
            loop {
                match pipe.fill(&mut frame) {
                    Fill::Nothing => {}
                    fill => return fill,
                }
            }
        };
        assert!(matches!(next(), Fill::Frame));
        assert!(matches!(next(), Fill::End));
    }
}
