//! YUV4MPEG2, as `ffmpeg -f yuv4mpegpipe` writes it.

use std::io::{Chain, Cursor, Read};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};

use nunet_types::{ImageSize, MAX_SIDE_PX, PixelFormat};
use y4m::{Colorspace, Decoder};

use super::image_reader::{ImageReader, PipeImage, read_up_to, too_large, unreadable};
use crate::error::{SourceError, SourceErrorKind};

/// The longest header that is read.
const MAX_HEADER_BYTES: usize = 1024;
pub(super) const MAGIC: &[u8] = b"YUV4MPEG2";
const NANOS_PER_SEC: u128 = 1_000_000_000;

/// A stream of images with a header.
pub(super) struct Y4mReader<R: Read> {
    decoder: Decoder<Counted<Chain<Cursor<Vec<u8>>, R>>>,
    frames: u64,
    read_before: Arc<AtomicU64>,
    name: &'static str,
}

/// Counts bytes: the decoder reports an end between two images and one within an image by the same error.
struct Counted<R> {
    input: R,
    count: Arc<AtomicU64>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.input.read(buffer)?;
        self.count.fetch_add(read as u64, Ordering::Relaxed);
        Ok(read)
    }
}

impl<R: Read + Send> Y4mReader<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// Not Y4M, interlaced images, an unknown color space, an impossible size.
    pub(super) fn open(mut input: R, name: &'static str) -> Result<Self, SourceError> {
        let header = header(&mut input, name)?;
        check(&header)?;
        let size = stated_size(&header);
        check_memory(size, name)?;
        let count = Arc::default();
        let input = Counted { input: Cursor::new(header).chain(input), count: Arc::clone(&count) };
        let decoder = Decoder::new(input).map_err(|error| match error {
            y4m::Error::OutOfMemory => too_large(size, name),
            error => invalid(format!("{name} is not Y4M: {error}")),
        })?;
        Ok(Self { decoder, frames: 0, read_before: count, name })
    }
}

/// The size in the header; 0 for a side that is missing.
fn stated_size(header: &[u8]) -> ImageSize {
    let text = String::from_utf8_lossy(header);
    let side = |name: char| {
        let value = text.split_ascii_whitespace().skip(1).find_map(|parameter| parameter.strip_prefix(name));
        value.and_then(|value| value.parse().ok()).unwrap_or_default()
    };
    ImageSize::new(side('W'), side('H'))
}

/// Checks that there is memory for an image, because the decoder does not.
fn check_memory(size: ImageSize, name: &str) -> Result<(), SourceError> {
    // Three bytes a pixel at most, in the decoder and in the frame.
    let bytes = size.pixel_count().saturating_mul(2 * 3);
    Vec::<u8>::new().try_reserve_exact(bytes).map_err(|_| too_large(size, name))
}

fn invalid(message: String) -> SourceError {
    SourceError::new(SourceErrorKind::Unavailable, message)
}

/// The first line, with its end.
fn header(input: &mut impl Read, name: &str) -> Result<Vec<u8>, SourceError> {
    let not_y4m = |what: &str| invalid(format!("{name} is not Y4M: {what}")).with_hint(HINT);
    let mut header = Vec::new();
    let mut byte = [0];
    while header.last() != Some(&b'\n') {
        let read = read_up_to(input, &mut byte).map_err(|error| unreadable(name, error))?;
        if read == 0 {
            return Err(not_y4m("it ended before the header did"));
        }
        header.push(byte[0]);
        let begins_well = header.iter().zip(MAGIC).all(|(a, b)| a == b);
        if !begins_well || header.len() > MAX_HEADER_BYTES {
            return Err(not_y4m("it does not begin with `YUV4MPEG2`"));
        }
    }
    Ok(header)
}

const HINT: &str = "write Y4M, as `ffmpeg -i ... -f yuv4mpegpipe -pix_fmt yuv420p -` does, or JPEGs (`-f mjpeg`), or state size \
                    and format of raw images";

/// Checks the parameters that the decoder would ignore or misread.
fn check(header: &[u8]) -> Result<(), SourceError> {
    let text = String::from_utf8_lossy(header);
    text.split_ascii_whitespace().skip(1).try_for_each(|parameter| check_parameter(parameter, &text))
}

fn check_parameter(parameter: &str, header: &str) -> Result<(), SourceError> {
    let (name, value) = parameter.split_at_checked(1).unwrap_or((parameter, ""));
    let states = |what: &str| invalid(format!("the Y4M header states `{parameter}`{what}"));
    match name {
        "W" | "H" if !value.parse::<u32>().is_ok_and(|side| (1..=MAX_SIDE_PX).contains(&side)) => {
            Err(states(&format!(", expected a side of 1 to {MAX_SIDE_PX} pixels")))
        }
        "I" if !matches!(value, "p" | "?") => {
            let error = states(": interlaced images show two moments at once");
            Err(error.with_hint("deinterlace it: `ffmpeg -vf yadif`"))
        }
        // Gray images are read as full range.
        "X" if value == "COLORRANGE=FULL" && !header.contains(" Cmono") => {
            let error = states(": full range would be read as limited range, with wrong brightness");
            Err(error.with_hint("convert it: `ffmpeg -vf scale=out_range=tv -pix_fmt yuv420p`"))
        }
        "C" if !KNOWN.contains(&value) => {
            Err(states(&format!(", a color space that cannot be read; expected one of {}", KNOWN.join(", "))))
        }
        _ => Ok(()),
    }
}

const KNOWN: [&str; 7] = ["420", "420jpeg", "420paldv", "420mpeg2", "422", "444", "mono"];

impl<R: Read + Send> ImageReader for Y4mReader<R> {
    fn next(&mut self, image: &mut PipeImage) -> Result<bool, SourceError> {
        let count = |counter: &std::sync::atomic::AtomicU64| counter.load(Ordering::Relaxed);
        let before = count(&self.read_before);
        let (width, height) = (self.decoder.get_width(), self.decoder.get_height());
        let (colors, rate) = (self.decoder.get_colorspace(), self.decoder.get_framerate());
        let frame = match self.decoder.read_frame() {
            Ok(frame) => frame,
            Err(y4m::Error::EOF) if count(&self.read_before) == before => return Ok(false),
            Err(y4m::Error::EOF) => return Err(cut_off(self.frames + 1, self.name)),
            Err(error) => return Err(damaged(&error, self.frames + 1, self.name)),
        };
        let planes =
            Planes { width, height, y: frame.get_y_plane(), u: frame.get_u_plane(), v: frame.get_v_plane() };
        image.bytes.clear();
        image.format = Some(match colors {
            Colorspace::Cmono => planes.gray(&mut image.bytes),
            Colorspace::C422 => planes.yuyv(1, &mut image.bytes),
            Colorspace::C444 => planes.yuyv(2, &mut image.bytes),
            _ => planes.nv12(&mut image.bytes),
        });
        // Both were checked with the header.
        image.size = ImageSize { width: width as u32, height: height as u32 };
        image.row_stride = image.format.map_or(0, |format| format.min_stride(image.size.width));
        let nanos = u128::from(self.frames) * rate.den as u128 * NANOS_PER_SEC / (rate.num as u128).max(1);
        image.media_nanos = Some(i64::try_from(nanos).unwrap_or(i64::MAX));
        self.frames += 1;
        Ok(true)
    }
}

fn cut_off(image: u64, name: &str) -> SourceError {
    SourceError::new(SourceErrorKind::CutOff, format!("{name} ended within image {image}"))
}

/// What follows is no image. It is not cut off: its writer did not end, but wrote something else.
fn damaged(error: &y4m::Error, image: u64, name: &str) -> SourceError {
    let found = match error {
        y4m::Error::ParseError(_) => "it does not begin with a line `FRAME`".to_owned(),
        error => error.to_string(),
    };
    let message = format!("image {image} of {name} cannot be read: {found}");
    SourceError::new(SourceErrorKind::Unavailable, message)
        .with_hint("write images of the size in the header, and no other output between them")
}

/// An image in three planes, rows without padding.
struct Planes<'a> {
    width: usize,
    height: usize,
    y: &'a [u8],
    u: &'a [u8],
    v: &'a [u8],
}

impl Planes<'_> {
    fn gray(&self, out: &mut Vec<u8>) -> PixelFormat {
        out.extend_from_slice(self.y);
        PixelFormat::Mono8
    }

    /// Chroma of half the width and height: the planes of U and V become one.
    fn nv12(&self, out: &mut Vec<u8>) -> PixelFormat {
        let odd = !self.width.is_multiple_of(2);
        for row in self.y.chunks_exact(self.width) {
            out.extend_from_slice(row);
            out.extend(odd.then_some(0)); // rows of Y are as long as those of U and V
        }
        out.extend(self.u.iter().zip(self.v).flat_map(|(&u, &v)| [u, v]));
        PixelFormat::Nv12
    }

    /// Chroma of half the width (`step` 1) or the whole width (`step` 2, of which each second is taken).
    fn yuyv(&self, step: usize, out: &mut Vec<u8>) -> PixelFormat {
        let chroma_width = if step == 2 { self.width } else { self.width.div_ceil(2) };
        let rows = self.y.chunks_exact(self.width).zip(self.u.chunks_exact(chroma_width));
        for ((y, u), v) in rows.zip(self.v.chunks_exact(chroma_width)).take(self.height) {
            let chroma = u.iter().step_by(step).zip(v.iter().step_by(step));
            for (pair, (&u, &v)) in y.chunks(2).zip(chroma) {
                let first = pair.first().copied().unwrap_or_default();
                out.extend([first, u, pair.get(1).copied().unwrap_or(first), v]);
            }
        }
        PixelFormat::Yuyv
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(input: &[u8]) -> Result<Vec<PipeImage>, SourceError> {
        let mut reader = Y4mReader::open(Cursor::new(input.to_vec()), "standard input")?;
        let mut all = Vec::new();
        loop {
            let mut image = PipeImage::default();
            if !reader.next(&mut image)? {
                return Ok(all);
            }
            all.push(image);
        }
    }

    fn stream(header: &str, frames: &[&[u8]]) -> Vec<u8> {
        let frames = frames.iter().flat_map(|frame| [b"FRAME\n", *frame]);
        [header.as_bytes(), b"\n"].into_iter().chain(frames).collect::<Vec<_>>().concat()
    }

    #[test]
    fn planes_of_half_the_size_become_nv12_also_of_odd_sizes() {
        let even = read(&stream("YUV4MPEG2 W2 H2 F25:1 Ip C420jpeg", &[&[1, 2, 3, 4, 5, 6]])).unwrap();
        assert_eq!(
            (even[0].bytes.as_slice(), even[0].format),
            (&[1, 2, 3, 4, 5, 6][..], Some(PixelFormat::Nv12))
        );
        let odd = read(&stream("YUV4MPEG2 W3 H1 F25:1", &[&[1, 2, 3, 10, 11, 20, 21]])).unwrap();
        assert_eq!((odd[0].bytes.as_slice(), odd[0].row_stride), (&[1, 2, 3, 0, 10, 20, 11, 21][..], 4));
    }

    #[test]
    fn planes_of_the_whole_height_become_yuyv() {
        let half = read(&stream("YUV4MPEG2 W3 H1 F25:1 C422", &[&[1, 2, 3, 10, 11, 20, 21]])).unwrap();
        assert_eq!(half[0].bytes, [1, 10, 2, 20, 3, 11, 3, 21]);
        let whole = read(&stream("YUV4MPEG2 W2 H1 F25:1 C444", &[&[1, 2, 10, 11, 20, 21]])).unwrap();
        assert_eq!(whole[0].bytes, [1, 10, 2, 20]);
        let gray = read(&stream("YUV4MPEG2 W2 H1 F25:1 Cmono", &[&[1, 2]])).unwrap();
        assert_eq!((gray[0].bytes.as_slice(), gray[0].format), (&[1, 2][..], Some(PixelFormat::Mono8)));
    }

    #[test]
    fn the_streams_own_clock_follows_from_its_rate() {
        let frames = read(&stream("YUV4MPEG2 W1 H1 F30000:1001 Cmono", &[&[1], &[2], &[3]])).unwrap();
        let nanos: Vec<_> = frames.iter().map(|image| image.media_nanos.unwrap()).collect();
        assert_eq!(nanos, [0, 33_366_666, 66_733_333]);
    }

    /// The text of the error for a stream that is not Y4M as it can be read.
    #[track_caller]
    fn refused(header: &str) -> String {
        let error = read(&stream(header, &[])).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Unavailable, "{error}");
        error.to_string()
    }

    #[test]
    fn streams_that_cannot_be_read_are_refused_by_name() {
        insta::assert_snapshot!(
            refused("YUV4MPEG2 W2 H2 F25:1 It"),
            @"the Y4M header states `It`: interlaced images show two moments at once"
        );
        insta::assert_snapshot!(
            refused("YUV4MPEG2 W2 H2 F25:1 C420p10"),
            @"the Y4M header states `C420p10`, a color space that cannot be read; expected one of 420, 420jpeg, 420paldv, 420mpeg2, 422, 444, mono"
        );
        insta::assert_snapshot!(
            refused("YUV4MPEG2 W99999999999999999999 H2"),
            @"the Y4M header states `W99999999999999999999`, expected a side of 1 to 32768 pixels"
        );
        insta::assert_snapshot!(
            refused("YUV4MPEG2 W0 H2"),
            @"the Y4M header states `W0`, expected a side of 1 to 32768 pixels"
        );
        insta::assert_snapshot!(
            refused("YUV4MPEG2 F25:1"),
            @"standard input is not Y4M: General parsing error"
        );
        insta::assert_snapshot!(
            refused("RIFF....AVI LIST"),
            @"standard input is not Y4M: it does not begin with `YUV4MPEG2`"
        );
    }

    #[test]
    fn an_image_that_no_memory_holds_is_refused_by_its_size() {
        insta::assert_snapshot!(
            refused("YUV4MPEG2 W32768 H32768 F25:1 C444"),
            @"there is not enough memory for an image of 32768x32768 from standard input"
        );
    }

    #[test]
    fn an_end_within_an_image_is_an_error_and_one_between_images_is_the_end() {
        let whole = stream("YUV4MPEG2 W2 H1 F25:1 Cmono", &[&[1, 2], &[3, 4]]);
        assert_eq!(read(&whole).unwrap().len(), 2);
        let error = read(&whole[..whole.len() - 1]).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::CutOff);
        insta::assert_snapshot!(error, @"standard input ended within image 2");
    }

    #[test]
    fn what_is_no_image_is_an_error_of_its_writer_and_no_end() {
        let mut input = stream("YUV4MPEG2 W2 H1 F25:1 Cmono", &[&[1, 2]]);
        input.extend(b"Warning: low memory\nFRAME\n34");
        let error = read(&input).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Unavailable);
        assert_eq!(
            error.to_string(),
            "image 2 of standard input cannot be read: it does not begin with a line `FRAME`"
        );
    }
}
