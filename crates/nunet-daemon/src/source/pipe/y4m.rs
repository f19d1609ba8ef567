//! YUV4MPEG2, as `ffmpeg -f yuv4mpegpipe` writes it.

use std::io::{Chain, Cursor, Read};

use anyhow::{anyhow, bail};
use nunet_core::frame::{MAX_SIDE_PX, PixelFormat};
use y4m::{Colorspace, Decoder};

use super::{Shot, Shots};

/// The longest header that is read.
const MAX_HEADER_BYTES: usize = 1024;
const MAGIC: &[u8] = b"YUV4MPEG2";
const NANOS_PER_SEC: u128 = 1_000_000_000;

/// A stream of pictures with a header.
pub(super) struct Y4mShots<R: Read> {
    decoder: Decoder<Counted<Chain<Cursor<Vec<u8>>, R>>>,
    frames: u64,
    read_before: std::sync::Arc<std::sync::atomic::AtomicU64>,
}

/// Counts bytes: the decoder tells an end between two pictures and one within a picture by the same error.
struct Counted<R> {
    input: R,
    count: std::sync::Arc<std::sync::atomic::AtomicU64>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let read = self.input.read(buffer)?;
        self.count.fetch_add(read as u64, std::sync::atomic::Ordering::Relaxed);
        Ok(read)
    }
}

impl<R: Read + Send> Y4mShots<R> {
    /// Reads the header.
    ///
    /// # Errors
    /// No Y4M, interlaced pictures, an unknown colour space, a size that makes no sense.
    pub(super) fn open(mut input: R) -> anyhow::Result<Self> {
        let header = header(&mut input)?;
        check(&header)?;
        let count = std::sync::Arc::default();
        let input = Counted { input: Cursor::new(header).chain(input), count: std::sync::Arc::clone(&count) };
        let decoder = Decoder::new(input).map_err(|error| anyhow!("stdin is no Y4M: {error}"))?;
        Ok(Self { decoder, frames: 0, read_before: count })
    }
}

/// The first line, with its end.
fn header(input: &mut impl Read) -> anyhow::Result<Vec<u8>> {
    let mut header = Vec::new();
    let mut byte = [0];
    while header.last() != Some(&b'\n') {
        if super::read_up_to(input, &mut byte)? == 0 {
            bail!("stdin is no Y4M: it ended before the header did\nhint: {HINT}");
        }
        header.push(byte[0]);
        let begins_well = header.iter().zip(MAGIC).all(|(a, b)| a == b);
        if !begins_well || header.len() > MAX_HEADER_BYTES {
            bail!("stdin is no Y4M: it does not begin with `YUV4MPEG2`\nhint: {HINT}");
        }
    }
    Ok(header)
}

const HINT: &str = "ffmpeg -i ... -f yuv4mpegpipe -pix_fmt yuv420p - | nunetd --source -, or --size WxH --format \
                    rgb8|bgr8|mono8|yuyv|nv12 for raw pictures";

/// What the decoder would not notice, or take amiss.
fn check(header: &[u8]) -> anyhow::Result<()> {
    let text = String::from_utf8_lossy(header);
    for parameter in text.split_ascii_whitespace().skip(1) {
        let (name, value) = parameter.split_at_checked(1).unwrap_or((parameter, ""));
        match name {
            "W" | "H" if !value.parse::<u32>().is_ok_and(|side| (1..=MAX_SIDE_PX).contains(&side)) => {
                bail!("the Y4M header says `{parameter}`; expected a side of 1 to {MAX_SIDE_PX} pixels");
            }
            "I" if !matches!(value, "p" | "?") => {
                bail!(
                    "the Y4M header says `{parameter}`: interlaced pictures show two moments at once\nhint: ffmpeg -vf \
                     yadif makes whole ones"
                );
            }
            // Grey is taken as it is.
            "X" if value == "COLORRANGE=FULL" && !text.contains(" Cmono") => {
                bail!(
                    "the Y4M header says full range, which would be read as limited: too dark and too \
                     bright\nhint: ffmpeg -vf scale=out_range=tv -pix_fmt yuv420p"
                );
            }
            "C" if !KNOWN.contains(&value) => {
                bail!(
                    "colour space `{value}` of the Y4M header cannot be read; expected one of {}",
                    KNOWN.join(", ")
                );
            }
            _ => {}
        }
    }
    Ok(())
}

const KNOWN: [&str; 7] = ["420", "420jpeg", "420paldv", "420mpeg2", "422", "444", "mono"];

impl<R: Read + Send> Shots for Y4mShots<R> {
    fn next(&mut self, shot: &mut Shot) -> anyhow::Result<bool> {
        let count =
            |counter: &std::sync::atomic::AtomicU64| counter.load(std::sync::atomic::Ordering::Relaxed);
        let before = count(&self.read_before);
        let (width, height) = (self.decoder.get_width(), self.decoder.get_height());
        let (colours, rate) = (self.decoder.get_colorspace(), self.decoder.get_framerate());
        let frame = match self.decoder.read_frame() {
            Ok(frame) => frame,
            Err(y4m::Error::EOF) if count(&self.read_before) == before => return Ok(false),
            Err(y4m::Error::EOF) => bail!("stdin ended within picture {}", self.frames + 1),
            Err(error) => bail!("picture {} of stdin cannot be read: {error}", self.frames + 1),
        };
        let planes =
            Planes { width, height, y: frame.get_y_plane(), u: frame.get_u_plane(), v: frame.get_v_plane() };
        shot.bytes.clear();
        shot.format = Some(match colours {
            Colorspace::Cmono => planes.grey(&mut shot.bytes),
            Colorspace::C422 => planes.yuyv(1, &mut shot.bytes),
            Colorspace::C444 => planes.yuyv(2, &mut shot.bytes),
            _ => planes.nv12(&mut shot.bytes),
        });
        shot.size = (u32::try_from(width)?, u32::try_from(height)?);
        shot.row_stride = shot.format.map_or(0, |format| format.min_stride(shot.size.0));
        let nanos = u128::from(self.frames) * rate.den as u128 * NANOS_PER_SEC / (rate.num as u128).max(1);
        shot.media_nanos = Some(i64::try_from(nanos).unwrap_or(i64::MAX));
        self.frames += 1;
        Ok(true)
    }
}

/// A picture in three planes, rows without padding.
struct Planes<'a> {
    width: usize,
    height: usize,
    y: &'a [u8],
    u: &'a [u8],
    v: &'a [u8],
}

impl Planes<'_> {
    fn grey(&self, out: &mut Vec<u8>) -> PixelFormat {
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

    fn read(input: &[u8]) -> anyhow::Result<Vec<Shot>> {
        let mut shots = Y4mShots::open(Cursor::new(input.to_vec()))?;
        let mut all = Vec::new();
        loop {
            let mut shot = Shot::default();
            if !shots.next(&mut shot)? {
                return Ok(all);
            }
            all.push(shot);
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
        let grey = read(&stream("YUV4MPEG2 W2 H1 F25:1 Cmono", &[&[1, 2]])).unwrap();
        assert_eq!((grey[0].bytes.as_slice(), grey[0].format), (&[1, 2][..], Some(PixelFormat::Mono8)));
    }

    #[test]
    fn the_streams_own_clock_follows_from_its_rate() {
        let frames = read(&stream("YUV4MPEG2 W1 H1 F30000:1001 Cmono", &[&[1], &[2], &[3]])).unwrap();
        let nanos: Vec<_> = frames.iter().map(|shot| shot.media_nanos.unwrap()).collect();
        assert_eq!(nanos, [0, 33_366_666, 66_733_333]);
    }

    #[track_caller]
    fn assert_refused(header: &str, part: &str) {
        let error = read(&stream(header, &[])).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }

    #[test]
    fn what_cannot_be_read_is_told_with_the_way_out() {
        assert_refused(
            "YUV4MPEG2 W2 H2 F25:1 It",
            "`It`: interlaced pictures show two moments at once\nhint: ffmpeg",
        );
        assert_refused(
            "YUV4MPEG2 W2 H2 F25:1 C420p10",
            "colour space `420p10` of the Y4M header cannot be read",
        );
        assert_refused(
            "YUV4MPEG2 W99999999999999999999 H2",
            "`W99999999999999999999`; expected a side of 1 to",
        );
        assert_refused("YUV4MPEG2 W0 H2", "`W0`; expected a side");
        assert_refused("YUV4MPEG2 F25:1", "stdin is no Y4M");
        assert_refused(
            "RIFF....AVI LIST",
            "it does not begin with `YUV4MPEG2`\nhint: ffmpeg -i ... -f yuv4mpegpipe",
        );
    }

    #[test]
    fn an_end_within_a_picture_is_told_and_one_between_pictures_is_the_end() {
        let whole = stream("YUV4MPEG2 W2 H1 F25:1 Cmono", &[&[1, 2], &[3, 4]]);
        assert_eq!(read(&whole).unwrap().len(), 2);
        let error = read(&whole[..whole.len() - 1]).unwrap_err();
        assert_eq!(error.to_string(), "stdin ended within picture 2");
    }
}
