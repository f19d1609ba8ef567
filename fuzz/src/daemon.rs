//! What the daemon itself reads: pipes, configurations, images.

use std::ffi::OsString;
use std::io::{Cursor, Write as _};

use nunet_core::frame::PixelFormat;
use nunet_daemon::cli::Cli;
use nunet_source::{Fill, Frame, OpenOptions, Source, SourceError, decode_file, open_pipe};
use nunet_types::ImageSize;

/// No valid pipe of a few kilobytes has more images.
const MAX_IMAGES: usize = 100_000;

/// Y4M on stdin.
pub fn y4m(data: &[u8]) {
    drain(open_pipe(Cursor::new(data.to_vec()), OpenOptions::default()));
}

/// Raw images on stdin; the first byte chooses their format.
pub fn raw(data: &[u8]) {
    const FORMATS: [PixelFormat; 5] =
        [PixelFormat::Rgb8, PixelFormat::Bgr8, PixelFormat::Mono8, PixelFormat::Yuyv, PixelFormat::Nv12];
    let Some((&choice, data)) = data.split_first() else { return };
    let (format, side) = (FORMATS[usize::from(choice) % FORMATS.len()], u32::from(choice) / 8 + 1);
    let size = Some(ImageSize { width: side, height: 7 });
    let options = OpenOptions { size, format: Some(format), ..OpenOptions::default() };
    drain(open_pipe(Cursor::new(data.to_vec()), options));
}

fn drain(opened: Result<Box<dyn Source>, SourceError>) {
    let mut pipe = opened.expect("an invalid pipe is refused at its first image");
    let mut frame = Frame::default();
    for _ in 0..MAX_IMAGES {
        match pipe.fill(&mut frame) {
            Fill::Frame => assert!(frame.view().is_ok(), "an image has the bytes of its size"),
            Fill::Nothing => {}
            Fill::End => return,
            Fill::Cut(error) | Fill::Broken(error) => return check_message(&format!("{error:#}")),
            other => panic!("a pipe has no {other:?}"),
        }
    }
}

/// `--config`.
pub fn config(data: &[u8]) {
    let mut file = tempfile::NamedTempFile::new().expect("there is room for a small file");
    file.write_all(data).expect("there is room for a small file");
    let line = [OsString::from("nunetd"), "run".into(), "--config".into(), file.path().into()];
    if let Err(error) = Cli::parse_line(line) {
        let text = error.to_string();
        check_message(&text);
        assert!(text.contains(&*file.path().to_string_lossy()), "which file is wrong is not said: {text}");
    }
}

/// A JPEG or PNG file, as a camera or a recording delivers it.
pub fn image(data: &[u8]) {
    let mut frame = Frame { file: data.to_vec(), ..Frame::default() };
    match decode_file(&mut frame) {
        Err(error) => check_message(&format!("{error:#}")),
        Ok(_) => assert!(frame.view().is_ok(), "an image has the bytes of its size"),
    }
}

/// An error has a text, and does not repeat the file.
fn check_message(error: &str) {
    assert!((1..10_000).contains(&error.len()), "an error of {} bytes", error.len());
}
