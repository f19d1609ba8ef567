//! JPEG after JPEG, as `ffmpeg -f mjpeg` and the multipart streams of network cameras write them.

use std::io::{BufRead, Read};

use super::image_reader::{ImageReader, PipeImage, unreadable};
use crate::error::{SourceError, SourceErrorKind};

/// How a stream of JPEGs begins: the first byte of an image, or in a multipart stream that of a boundary, of
/// the end of the line before it, or of the header of a part (`Content-Type`). Cameras begin with each of
/// them.
pub(super) const STARTS: [u8; 6] = [MARKER, b'-', b'\r', b'\n', b'C', b'c'];
/// The longest header that a multipart stream may have before an image.
const MAX_BETWEEN_BYTES: usize = 1 << 16;
/// The largest file that is read.
const MAX_IMAGE_BYTES: usize = 64 << 20;

const MARKER: u8 = 0xff;
const START_OF_IMAGE: u8 = 0xd8;
const END_OF_IMAGE: u8 = 0xd9;
const START_OF_SCAN: u8 = 0xda;
/// The length of the start of an image, a marker.
const START_BYTES: usize = 2;

/// JPEGs one after the other. What is between them is skipped.
pub(super) struct JpegReader<R> {
    input: R,
    name: &'static str,
    max_image_bytes: usize,
    images: u64,
    /// Whether the start of the next image was read within the one before, which has no end.
    is_started: bool,
}

/// Why an image is not complete.
enum Incomplete {
    End,
    Read(std::io::Error),
    TooLong,
}

impl From<std::io::Error> for Incomplete {
    fn from(error: std::io::Error) -> Self {
        if error.kind() == std::io::ErrorKind::UnexpectedEof { Self::End } else { Self::Read(error) }
    }
}

impl<R: BufRead + Send> JpegReader<R> {
    pub(super) fn new(input: R, name: &'static str) -> Self {
        Self { input, name, max_image_bytes: MAX_IMAGE_BYTES, images: 0, is_started: false }
    }

    /// Skips to an image; false if the stream ends before one.
    fn find_start(&mut self) -> Result<bool, SourceError> {
        if std::mem::take(&mut self.is_started) {
            return Ok(true);
        }
        let mut last = 0;
        for _ in 0..=MAX_BETWEEN_BYTES {
            let mut byte = [0];
            match self.input.read_exact(&mut byte) {
                Ok(()) if (last, byte[0]) == (MARKER, START_OF_IMAGE) => return Ok(true),
                Ok(()) => last = byte[0],
                Err(error) if error.kind() == std::io::ErrorKind::UnexpectedEof => return Ok(false),
                Err(error) => return Err(unreadable(self.name, error)),
            }
        }
        let message =
            format!("{} has no JPEG in {MAX_BETWEEN_BYTES} bytes after image {}", self.name, self.images);
        Err(SourceError::new(SourceErrorKind::Unavailable, message))
    }

    fn byte(&mut self, file: &mut Vec<u8>) -> Result<u8, Incomplete> {
        // Checked for each byte: data without a marker has no end.
        if file.len() >= self.max_image_bytes {
            return Err(Incomplete::TooLong);
        }
        let mut byte = [0];
        self.input.read_exact(&mut byte)?;
        file.push(byte[0]);
        Ok(byte[0])
    }

    /// Reads the rest of an image. Segments are skipped by their length: a thumbnail in one has a start and
    /// an end of its own. A start outside of segments is that of the next image; the decoder reports what
    /// this one lacks.
    fn read_image(&mut self, file: &mut Vec<u8>) -> Result<(), Incomplete> {
        loop {
            while self.byte(file)? != MARKER {}
            let mut marker = MARKER;
            while marker == MARKER {
                marker = self.byte(file)?;
            }
            match marker {
                END_OF_IMAGE => return Ok(()),
                // Some cameras write the start twice.
                START_OF_IMAGE if file.len() == 2 * START_BYTES => file.truncate(START_BYTES),
                START_OF_IMAGE => {
                    file.truncate(file.len() - START_BYTES);
                    self.is_started = true;
                    return Ok(());
                }
                0x00 | 0x01 | 0xd0..=0xd7 => {}
                _ => {
                    self.read_segment(file)?;
                    if marker == START_OF_SCAN {
                        self.read_scan(file)?;
                    }
                }
            }
        }
    }

    fn read_segment(&mut self, file: &mut Vec<u8>) -> Result<(), Incomplete> {
        let length = u16::from_be_bytes([self.byte(file)?, self.byte(file)?]).saturating_sub(2);
        let read = self.input.by_ref().take(length.into()).read_to_end(file)?;
        if read < usize::from(length) { Err(Incomplete::End) } else { Ok(()) }
    }

    /// Copies entropy-coded data up to the byte before the next marker, in which a marker byte is followed by
    /// 0.
    fn read_scan(&mut self, file: &mut Vec<u8>) -> Result<(), Incomplete> {
        while file.len() < self.max_image_bytes {
            let buffer = self.input.fill_buf()?;
            if buffer.is_empty() {
                return Err(Incomplete::End);
            }
            let until = buffer.iter().position(|&byte| byte == MARKER);
            let count = until.unwrap_or(buffer.len());
            file.extend_from_slice(&buffer[..count]);
            self.input.consume(count);
            if until.is_some() {
                return Ok(());
            }
        }
        Err(Incomplete::TooLong)
    }
}

impl<R: BufRead + Send> ImageReader for JpegReader<R> {
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError> {
        if !self.find_start()? {
            return Ok(false);
        }
        image.bytes.clear();
        image.bytes.extend([MARKER, START_OF_IMAGE]);
        (image.format, image.media_nanos) = (None, None);
        self.images += 1;
        let number = self.images;
        let read = self.read_image(&mut image.bytes);
        let (name, most) = (self.name, self.max_image_bytes);
        read.map(|()| true).map_err(|incomplete| match incomplete {
            Incomplete::End => {
                SourceError::new(SourceErrorKind::CutOff, format!("{name} ended within image {number}"))
            }
            Incomplete::Read(error) => unreadable(name, error),
            Incomplete::TooLong => {
                let message = format!("image {number} of {name} is larger than {most} bytes");
                SourceError::new(SourceErrorKind::Unavailable, message)
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use std::io::{BufReader, Cursor};

    use image::codecs::jpeg::JpegEncoder;

    use super::*;

    fn jpeg(gray: u8) -> Vec<u8> {
        let mut file = Vec::new();
        let pixels: Vec<u8> = (0..32 * 24).map(|i| gray.wrapping_add((i * 37 % 251) as u8)).collect();
        JpegEncoder::new(&mut file).encode(&pixels, 32, 24, image::ExtendedColorType::L8).unwrap();
        file
    }

    /// With a segment that holds a whole JPEG, as a camera's thumbnail does.
    fn with_thumbnail(file: &[u8], thumbnail: &[u8]) -> Vec<u8> {
        let length = (thumbnail.len() as u16 + 2).to_be_bytes();
        [&file[..2], &[MARKER, 0xe1], &length, thumbnail, &file[2..]].concat()
    }

    fn read(stream: &[u8]) -> (Vec<Vec<u8>>, Option<SourceError>) {
        // A small buffer, so that images and markers lie across its end.
        let mut reader =
            JpegReader::new(BufReader::with_capacity(7, Cursor::new(stream.to_vec())), "the stream");
        let (mut images, mut image) = (Vec::new(), PipeImage::default());
        loop {
            match reader.next(&mut image) {
                Ok(true) => images.push(image.bytes.clone()),
                Ok(false) => return (images, None),
                Err(error) => return (images, Some(error)),
            }
        }
    }

    #[test]
    fn images_are_found_whole_with_and_without_something_between() {
        let images = [jpeg(0), with_thumbnail(&jpeg(90), &jpeg(30)), jpeg(200)];
        let (read_images, error) = read(&images.concat());
        assert!(error.is_none() && read_images == images);
        let part =
            |image: &Vec<u8>| [&b"--frame\r\nContent-Type: image/jpeg\r\n\r\n"[..], image, b"\r\n"].concat();
        let multipart: Vec<u8> = images.iter().flat_map(part).collect();
        let (read_images, error) = read(&multipart);
        assert!(error.is_none() && read_images == images);
    }

    #[test]
    fn an_image_without_its_end_does_not_swallow_the_next_one() {
        let whole = jpeg(90);
        let at = |marker: u8| whole.windows(2).position(|bytes| bytes == [MARKER, marker]).unwrap();
        // In the scan, before the end, within a marker, between two segments, and after the start.
        for cut in [whole.len() - 40, whole.len() - 2, whole.len() - 1, at(0xc4), 2] {
            let (images, error) = read(&[&jpeg(0)[..], &whole[..cut], &jpeg(200), &jpeg(30)].concat());
            assert!(error.is_none(), "{error:?}");
            let others = [jpeg(0), jpeg(200), jpeg(30)];
            let good: Vec<_> = images.iter().filter(|image| others.contains(image)).collect();
            assert_eq!(good.len(), 3, "cut at {cut}");
            assert_eq!(images.len(), if cut == 2 { 3 } else { 4 }, "cut at {cut}");
        }
    }

    #[test]
    fn an_image_that_is_cut_off_is_named() {
        let stream = [jpeg(0), jpeg(1)].concat();
        let texts = [1, 2, 30, jpeg(1).len() - 3].map(|missing| {
            let (images, error) = read(&stream[..stream.len() - missing]);
            let error = error.unwrap();
            assert_eq!((images.len(), error.kind()), (1, SourceErrorKind::CutOff), "{error:#}");
            error.to_string()
        });
        assert_eq!(texts.each_ref(), [&texts[0]; 4]);
        insta::assert_snapshot!(texts[0], @"the stream ended within image 2");
    }

    #[test]
    fn an_image_without_an_end_takes_bounded_memory_whatever_follows_its_start() {
        let segment = [MARKER, 0xe0, 0, 4, 7, 7];
        let endless: [(&[u8], u8); 4] = [
            (&[MARKER, START_OF_IMAGE], 0),
            (&[MARKER, START_OF_IMAGE], MARKER),
            (&[&[MARKER, START_OF_IMAGE][..], &segment].concat(), 7),
            (&[&[MARKER, START_OF_IMAGE][..], &[MARKER, START_OF_SCAN, 0, 2]].concat(), 7),
        ];
        let texts = endless.map(|(start, rest)| {
            let stream = Cursor::new(start.to_vec()).chain(std::io::repeat(rest));
            let mut reader = JpegReader::new(BufReader::with_capacity(7, stream), "the stream");
            reader.max_image_bytes = 1000;
            let mut image = PipeImage::default();
            let error = reader.next(&mut image).unwrap_err();
            assert_eq!(error.kind(), SourceErrorKind::Unavailable, "{error:#}");
            assert!(image.bytes.len() <= 1007, "{} bytes", image.bytes.len());
            error.to_string()
        });
        assert_eq!(texts.each_ref(), [&texts[0]; 4]);
        insta::assert_snapshot!(texts[0], @"image 1 of the stream is larger than 1000 bytes");
    }

    #[test]
    fn a_stream_without_images_does_not_read_forever() {
        let (images, error) = read(&vec![b'-'; 2 * MAX_BETWEEN_BYTES]);
        assert_eq!((images.len(), error.unwrap().kind()), (0, SourceErrorKind::Unavailable));
    }
}
