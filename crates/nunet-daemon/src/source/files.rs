//! Pictures of a folder or a glob, in the order of their names.

use std::io::{Cursor, Read as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow, bail};
use image::error::LimitErrorKind;
use image::metadata::Orientation;
use image::{ColorType, DynamicImage, ImageDecoder, ImageError, ImageFormat, ImageReader, Limits};
use nunet_core::frame::MAX_SIDE_PX;
use nunet_core::plain_file;
use nunet_ipc::{Clock, monotonic_nanos, unix_nanos};

use super::recording::recordings_in;
use super::{Capture, Fill, Frame, Source};
use crate::exit::BadArguments;

/// Endings of files that are taken for pictures; cameras write them in capitals as well.
pub(crate) const PICTURE_ENDINGS: [&str; 3] = ["jpg", "jpeg", "png"];
/// The most bytes of a picture's file.
const MAX_FILE_BYTES: u64 = 256 << 20;
/// The most memory that decoding one picture may take, bytes: a 16-bit RGBA picture of 48 megapixels and its RGB.
const MAX_DECODE_BYTES: u64 = 512 * 1024 * 1024;

/// The hint for pictures beyond the limits.
const SMALLER: &str = "make it smaller: a network sees some hundred pixels a side";
/// As many bytes of a file as tell what it is.
const MAGIC_BYTES: u64 = 32;

/// A list of pictures.
#[derive(Debug)]
pub(super) struct Files {
    paths: Vec<PathBuf>,
    next: usize,
    sequence: u64,
    stretch: u64,
    repeat: bool,
    /// Whether any picture of this round could be read.
    any_good: bool,
}

impl Files {
    /// Lists the pictures; they are decoded one at a time, when their turn comes.
    pub(super) fn open(pattern: &str, repeat: bool) -> anyhow::Result<Self> {
        let path = Path::new(pattern);
        refuse_no_picture(path)?;
        let paths = list(path)?;
        if paths.is_empty() {
            bail!(BadArguments(no_pictures(path)));
        }
        Ok(Self { paths, next: 0, sequence: 0, stretch: 0, repeat, any_good: false })
    }
}

/// Rounds without a picture would only fill the log, as fast as it takes lines.
pub(super) fn nothing_good_to_repeat() -> Fill {
    Fill::Broken(anyhow!(
        "a whole round gave no picture that can be read, and --loop would repeat it for ever\nhint: look whether the \
         pictures are still there; the lost ones are named above"
    ))
}

impl Source for Files {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        if self.next == self.paths.len() && self.repeat {
            if !self.any_good {
                return nothing_good_to_repeat();
            }
            self.any_good = false;
            self.next = 0;
            self.stretch += 1;
        }
        let Some(path) = self.paths.get(self.next) else { return Fill::End };
        self.next += 1;
        frame.sequence = self.sequence;
        self.sequence += 1;
        if let Err(error) = decode(path, frame) {
            return Fill::Failed(error.context(format!("cannot read the picture `{}`", path.display())));
        }
        let nanos = monotonic_nanos();
        frame.capture = Capture { nanos, clock: Clock::Monotonic, unix_nanos: unix_nanos() };
        frame.camera = None;
        frame.stretch = self.stretch;
        self.any_good = true;
        Fill::Frame
    }
}

/// Decodes one JPEG or PNG as RGB, turned as its EXIF orientation says, into the frame's own memory; the file stays in
/// the frame too.
///
/// # Errors
/// No such file, neither JPEG nor PNG, damaged, cut off, or larger than the limits.
pub(crate) fn decode(path: &Path, frame: &mut Frame) -> anyhow::Result<()> {
    let mut file = std::mem::take(&mut frame.file);
    file.clear();
    read(path, &mut file)?;
    frame.file = file;
    decode_file(frame)
}

/// Decodes the file that lies in the frame.
///
/// # Errors
/// As [`decode`].
pub(crate) fn decode_file(frame: &mut Frame) -> anyhow::Result<()> {
    let file = std::mem::take(&mut frame.file);
    let decoded = decode_bytes(&file, frame);
    frame.file = file;
    // A picture that was turned is another than its file, which readers show as it lies.
    if !matches!(decoded, Ok(Orientation::NoTransforms)) {
        frame.file.clear();
    }
    decoded.map(drop)
}

fn decode_bytes(file: &[u8], frame: &mut Frame) -> anyhow::Result<Orientation> {
    if format_of(file)? == ImageFormat::Jpeg {
        refuse_cut_off_jpeg(file)?;
    }
    let mut decoder = decoder_of(file)?;
    let (size, orientation) = (decoder.dimensions(), decoder.orientation()?);
    let as_it_is = decoder.color_type() == ColorType::Rgb8 && orientation == Orientation::NoTransforms;
    check_memory(&decoder, as_it_is)?;
    if as_it_is {
        decoder.read_image(frame.rgb_buffer(size))?;
        return Ok(orientation);
    }
    let mut picture = DynamicImage::from_decoder(decoder)?;
    picture.apply_orientation(orientation);
    let picture = picture.into_rgb8();
    frame.rgb_buffer(picture.dimensions()).copy_from_slice(&picture);
    Ok(orientation)
}

/// A picture of one channel as its numbers stand: true depth, or labels.
#[derive(Debug)]
pub(crate) struct Numbers {
    /// Width and height, pixels.
    pub(crate) size: (u32, u32),
    /// Rows from the top.
    pub(crate) values: Vec<u16>,
    /// 8 or 16 bits a number in the file.
    pub(crate) bits: u8,
}

/// Decodes a PNG of one channel.
///
/// # Errors
/// As [`decode`], and a picture of several channels.
pub(crate) fn decode_numbers(path: &Path) -> anyhow::Result<Numbers> {
    let mut file = Vec::new();
    read(path, &mut file)?;
    let decoder = decoder_of(&file)?;
    check_memory(&decoder, false)?;
    let size = decoder.dimensions();
    match DynamicImage::from_decoder(decoder)? {
        DynamicImage::ImageLuma8(picture) => {
            Ok(Numbers { size, values: picture.iter().map(|&value| value.into()).collect(), bits: 8 })
        }
        DynamicImage::ImageLuma16(picture) => Ok(Numbers { size, values: picture.into_raw(), bits: 16 }),
        other => bail!("the picture has {} channels; expected one", other.color().channel_count()),
    }
}

fn read(path: &Path, bytes: &mut Vec<u8>) -> anyhow::Result<()> {
    let Some(mut file) = plain_file::open(path, MAX_FILE_BYTES + 1)? else {
        bail!("it is not a plain file\nhint: pictures from a pipe are read from stdin, by --source -");
    };
    file.read_to_end(bytes)?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        bail!("the file is larger than {} MB\nhint: {SMALLER}", MAX_FILE_BYTES >> 20);
    }
    Ok(())
}

/// Whether a file looks like a picture, without decoding it. What is no plain file does: what is read of a pipe is gone.
///
/// # Errors
/// It cannot be read, or is neither JPEG nor PNG.
pub(crate) fn glance(path: &Path) -> anyhow::Result<()> {
    first_bytes(path)?.map_or(Ok(()), |start| format_of(&start).map(drop))
}

/// What tells a file's format; `None` of what is no plain file.
fn first_bytes(path: &Path) -> std::io::Result<Option<Vec<u8>>> {
    let Some(mut file) = plain_file::open(path, MAGIC_BYTES)? else { return Ok(None) };
    let mut start = Vec::new();
    file.read_to_end(&mut start)?;
    Ok(Some(start))
}

/// What a file is, by its first bytes.
fn format_of(file: &[u8]) -> anyhow::Result<ImageFormat> {
    const EXPECTED: &str = "expected JPEG or PNG\nhint: save it as one of them";
    match image::guess_format(file) {
        Ok(format @ (ImageFormat::Jpeg | ImageFormat::Png)) => Ok(format),
        Ok(other) => bail!("the picture is {other:?}; {EXPECTED}"),
        Err(_) if file.is_empty() => {
            bail!("the file is empty; expected JPEG or PNG\nhint: copy or record it again")
        }
        Err(_) => bail!("the file is no picture of a known format; {EXPECTED}"),
    }
}

fn decoder_of(file: &[u8]) -> anyhow::Result<impl ImageDecoder + '_> {
    let mut reader = ImageReader::with_format(Cursor::new(file), format_of(file)?);
    reader.limits(limits());
    reader.into_decoder().map_err(|error| match error {
        ImageError::Limits(limit) if matches!(limit.kind(), LimitErrorKind::DimensionError) => {
            let size = claimed_size(file).map(|(width, height)| format!(" of {width}x{height} pixels"));
            let size = size.unwrap_or_default();
            anyhow!("a picture{size}; expected at most {MAX_SIDE_PX} a side\nhint: {SMALLER}")
        }
        error => error.into(),
    })
}

/// What the header says of a picture that the decoder refuses.
fn claimed_size(file: &[u8]) -> Option<(u32, u32)> {
    let side = |at: usize| Some(u32::from_be_bytes(file.get(at..at + 4)?.try_into().ok()?));
    match format_of(file).ok()? {
        // The first chunk is IHDR, which begins with both (PNG specification, 11.2.2).
        ImageFormat::Png => side(16).zip(side(20)),
        format => {
            let mut reader = ImageReader::with_format(Cursor::new(file), format);
            reader.no_limits();
            reader.into_dimensions().ok()
        }
    }
}

/// The decoder fills what is missing of a JPEG with grey; grey is not what the camera saw.
///
/// Behind the last start of a scan (`FF DA`) there must be an end of the picture (`FF D9`): within a scan's own data
/// neither can occur (ITU T.81, B.1.1.5), and a thumbnail's end comes before the picture's scans.
fn refuse_cut_off_jpeg(file: &[u8]) -> anyhow::Result<()> {
    let last = |marker: [u8; 2]| file.windows(2).rposition(|pair| pair == marker);
    match (last([0xff, 0xda]), last([0xff, 0xd9])) {
        (Some(scan), Some(end)) if scan < end => Ok(()),
        _ => bail!("the JPEG is cut off: it has no end-of-image marker\nhint: copy or record it again"),
    }
}

/// Before anything of the picture's size is allocated.
fn check_memory(decoder: &impl ImageDecoder, as_it_is: bool) -> anyhow::Result<()> {
    let (width, height) = decoder.dimensions();
    let rgb = 3 * u64::from(width) * u64::from(height);
    let needed = if as_it_is { rgb } else { decoder.total_bytes().saturating_add(rgb) };
    if needed > MAX_DECODE_BYTES {
        bail!(
            "a picture of {width}x{height} takes {} MB to decode, over the limit of {} MB\nhint: {SMALLER}",
            needed >> 20,
            MAX_DECODE_BYTES >> 20
        );
    }
    Ok(())
}

fn limits() -> Limits {
    let mut limits = Limits::default();
    limits.max_image_width = Some(MAX_SIDE_PX);
    limits.max_image_height = Some(MAX_SIDE_PX);
    limits.max_alloc = Some(MAX_DECODE_BYTES);
    limits
}

/// The pictures of a folder, those that a glob matches, or a single one; sorted, and perhaps none.
///
/// # Errors
/// It is no glob, or a folder cannot be read.
pub(crate) fn list(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let mut paths = if path.is_dir() {
        pictures_in(path)?
    } else if path.is_file() {
        vec![path.to_owned()]
    } else {
        matches(&path.to_string_lossy())?
    };
    paths.sort();
    Ok(paths)
}

/// A file that is named alone is a picture, or a mistake that is told before anything is made ready. Of several one may
/// be bad.
fn refuse_no_picture(path: &Path) -> anyhow::Result<()> {
    if !path.is_file() {
        return Ok(());
    }
    let shown = path.display();
    let start = first_bytes(path).with_context(|| format!("cannot read `{shown}`"))?.unwrap_or_default();
    let hint = match image::guess_format(&start) {
        Ok(ImageFormat::Jpeg | ImageFormat::Png) => return Ok(()),
        Ok(_) => "save it as JPEG or PNG".to_owned(),
        Err(_) if start.starts_with(b"\x89MCAP0") => "the name of a recording ends in `.mcap`".to_owned(),
        Err(_) if start.starts_with(b"YUV4MPEG2") => format!("nunetd --source - < {shown}"),
        Err(_) => format!(
            "a video comes through a pipe: ffmpeg -i {shown} -f yuv4mpegpipe -pix_fmt yuv420p - | nunetd --source -"
        ),
    };
    bail!(BadArguments(format!(
        "`{shown}` is no source: neither a JPEG nor a PNG picture nor a recording\nhint: {hint}"
    )))
}

fn pictures_in(folder: &Path) -> anyhow::Result<Vec<PathBuf>> {
    let unreadable = || format!("cannot list the folder `{}`", folder.display());
    let mut paths = Vec::new();
    for entry in folder.read_dir().with_context(unreadable)? {
        let path = entry.with_context(unreadable)?.path();
        if is_picture(&path) {
            paths.push(path);
        }
    }
    Ok(paths)
}

fn is_picture(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    ending.is_some_and(|ending| PICTURE_ENDINGS.iter().any(|known| ending == *known))
}

fn matches(pattern: &str) -> anyhow::Result<Vec<PathBuf>> {
    let paths = glob::glob(pattern).map_err(|error| {
        BadArguments(format!("`{pattern}` is neither a source nor a glob: {}", error.msg))
    })?;
    // A folder below the glob that cannot be read hides pictures: say so rather than leave them out.
    paths.collect::<Result<_, _>>().with_context(|| format!("cannot list `{pattern}`"))
}

fn no_pictures(path: &Path) -> String {
    if path.is_dir() {
        let hint = recordings_in(path).map(|hint| format!("\nhint: {hint}")).unwrap_or_default();
        format!("no JPEG or PNG picture in the folder `{}`{hint}", path.display())
    } else {
        format!(
            "no source `{}`: no such file or folder, and no file matches it as a glob\nhint: demo, a folder of \
             JPEG or PNG pictures, a glob such as 'frames/*.jpg' (quoted), a recording FILE.mcap, a camera /dev/videoN, \
             shm:CAMERA, or - for stdin",
            path.display()
        )
    }
}

#[cfg(test)]
mod tests {
    use std::process::Command;
    use std::sync::mpsc::channel;
    use std::time::Duration;

    use image::{Rgb, RgbImage};

    use super::*;

    fn picture(colour: [u8; 3]) -> RgbImage {
        RgbImage::from_pixel(4, 2, Rgb(colour))
    }

    fn drain(source: &mut Files) -> (Vec<[u8; 3]>, Vec<String>) {
        let (mut colours, mut errors) = (Vec::new(), Vec::new());
        let mut frame = Frame::default();
        loop {
            match source.fill(&mut frame) {
                Fill::Frame => {
                    let view = frame.view().unwrap();
                    assert_eq!(view.size(), (4, 2));
                    colours.push([view.bytes()[0], view.bytes()[1], view.bytes()[2]]);
                }
                Fill::Failed(error) => errors.push(format!("{error:#}")),
                Fill::Nothing | Fill::Crowded | Fill::Cut(_) | Fill::Broken(_) => {
                    unreachable!("files are there at once and lend nothing")
                }
                Fill::End => return (colours, errors),
            }
        }
    }

    #[test]
    fn a_folder_gives_its_pictures_by_name_and_a_bad_one_does_not_end_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name| folder.path().join(name);
        picture([30, 0, 0]).save(path("c.png")).unwrap();
        picture([10, 0, 0]).save(path("a.png")).unwrap();
        std::fs::write(path("b.jpg"), b"not a picture").unwrap();
        std::fs::write(path("notes.txt"), b"ignored").unwrap();
        let mut source = Files::open(folder.path().to_str().unwrap(), false).unwrap();
        let (colours, errors) = drain(&mut source);
        assert_eq!(colours, [[10, 0, 0], [30, 0, 0]]);
        assert_eq!(errors.len(), 1);
        assert!(errors[0].contains("b.jpg`"), "{errors:?}");
    }

    #[test]
    fn a_pipe_among_the_pictures_is_passed_over() {
        let folder = tempfile::tempdir().unwrap();
        assert!(Command::new("mkfifo").arg(folder.path().join("a.png")).status().unwrap().success());
        picture([10, 0, 0]).save(folder.path().join("b.png")).unwrap();
        let mut source = Files::open(folder.path().join("*").to_str().unwrap(), false).unwrap();
        let (send, drained) = channel();
        // On a thread of its own: a pipe that is opened waits for ever.
        std::thread::spawn(move || send.send(drain(&mut source)));
        let (colours, errors) = drained.recv_timeout(Duration::from_secs(60)).unwrap();
        assert_eq!(colours, [[10, 0, 0]]);
        assert!(errors[0].contains("a.png`: it is not a plain file\nhint: "), "{errors:?}");
    }

    #[test]
    fn each_round_of_a_loop_is_a_stretch_of_its_own() {
        let folder = tempfile::tempdir().unwrap();
        picture([1, 0, 0]).save(folder.path().join("a.png")).unwrap();
        std::fs::write(folder.path().join("b.png"), b"not a picture").unwrap();
        picture([2, 0, 0]).save(folder.path().join("c.png")).unwrap();
        let mut source = Files::open(folder.path().to_str().unwrap(), true).unwrap();
        let mut frame = Frame::default();
        let mut seen = Vec::new();
        while seen.len() < 5 {
            if let Fill::Frame = source.fill(&mut frame) {
                seen.push((frame.sequence, frame.stretch));
            }
        }
        assert_eq!(seen, [(0, 0), (2, 0), (3, 1), (5, 1), (6, 2)]);
    }

    #[test]
    fn a_loop_ends_with_a_round_without_a_picture() {
        let folder = tempfile::tempdir().unwrap();
        let pictures = ["a.png", "b.png"].map(|name| folder.path().join(name));
        for path in &pictures {
            picture([1, 0, 0]).save(path).unwrap();
        }
        let mut source = Files::open(folder.path().to_str().unwrap(), true).unwrap();
        let mut frame = Frame::default();
        assert!(matches!(source.fill(&mut frame), Fill::Frame));
        for path in &pictures {
            std::fs::remove_file(path).unwrap();
        }
        for _ in 0..3 {
            assert!(
                matches!(source.fill(&mut frame), Fill::Failed(_)),
                "the rest of a round, and a whole one"
            );
        }
        let Fill::Broken(error) = source.fill(&mut frame) else { panic!("there is nothing to repeat") };
        assert!(error.to_string().starts_with("a whole round gave no picture that can be read"), "{error}");
    }

    #[test]
    fn a_glob_takes_only_what_it_matches() {
        let folder = tempfile::tempdir().unwrap();
        picture([1, 2, 3]).save(folder.path().join("left_1.png")).unwrap();
        picture([9, 9, 9]).save(folder.path().join("right_1.png")).unwrap();
        let mut source = Files::open(folder.path().join("left_*.png").to_str().unwrap(), false).unwrap();
        assert_eq!(drain(&mut source).0, [[1, 2, 3]]);
    }

    #[test]
    fn grey_and_transparent_pictures_become_rgb() {
        let folder = tempfile::tempdir().unwrap();
        let rgb = DynamicImage::ImageRgb8(picture([70, 70, 70]));
        rgb.to_luma8().save(folder.path().join("1.png")).unwrap();
        rgb.to_rgba8().save(folder.path().join("2.png")).unwrap();
        rgb.to_rgb16().save(folder.path().join("3.png")).unwrap();
        let mut source = Files::open(folder.path().to_str().unwrap(), false).unwrap();
        assert_eq!(drain(&mut source).0, [[70, 70, 70]; 3]);
    }

    #[test]
    fn a_picture_beyond_the_limits_is_refused_before_it_is_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("wide.png");
        image::GrayImage::new(MAX_SIDE_PX + 1, 1).save(&path).unwrap();
        let expected = "a picture of 32769x1 pixels; expected at most 32768 a side\nhint: make it smaller";
        let error = decode(&path, &mut Frame::default()).unwrap_err().to_string();
        assert!(error.starts_with(expected), "{error}");
        image::GrayImage::new(1, MAX_SIDE_PX + 1).save(path.with_extension("jpg")).unwrap();
        let error = decode(&path.with_extension("jpg"), &mut Frame::default()).unwrap_err().to_string();
        assert!(error.starts_with("a picture of 1x32769 pixels; expected at most 32768 a side\n"), "{error}");
        image::GrayImage::new(MAX_SIDE_PX, 1).save(&path).unwrap();
        decode(&path, &mut Frame::default()).unwrap();
    }

    #[test]
    fn what_is_no_jpeg_and_no_png_is_told_with_what_it_is_and_what_would_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.png");
        let refused = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            decode(&path, &mut Frame::default()).unwrap_err().to_string()
        };
        let hint = "expected JPEG or PNG\nhint: save it as one of them";
        assert_eq!(refused(b"BM\x46\0\0\0"), format!("the picture is Bmp; {hint}"));
        assert_eq!(refused(b"no picture"), format!("the file is no picture of a known format; {hint}"));
        assert!(refused(b"").starts_with("the file is empty; expected JPEG or PNG\nhint: "));
        std::fs::write(&path, b"GIF89a").unwrap();
        assert!(
            decode_numbers(&path).unwrap_err().to_string().starts_with("the picture is Gif; expected JPEG")
        );
    }

    #[test]
    fn a_picture_that_takes_too_much_memory_is_refused_before_it_is_decoded() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("large.png");
        image::GrayImage::new(12_000, 12_000).save(&path).unwrap();
        let error = decode(&path, &mut Frame::default()).unwrap_err().to_string();
        assert!(error.contains("takes 549 MB to decode, over the limit of 512 MB"), "{error}");
    }

    #[test]
    fn a_jpeg_that_is_cut_off_anywhere_is_refused_and_a_whole_one_is_not() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("picture.jpg");
        RgbImage::from_fn(64, 48, |x, y| Rgb([x as u8 * 3, y as u8 * 5, 90])).save(&path).unwrap();
        let whole = std::fs::read(&path).unwrap();
        decode(&path, &mut Frame::default()).unwrap();
        for keep in (0..whole.len() - 1).step_by(7) {
            std::fs::write(&path, &whole[..keep]).unwrap();
            assert!(decode(&path, &mut Frame::default()).is_err(), "{keep} of {} bytes pass", whole.len());
        }
    }

    /// An EXIF block that says nothing but the orientation 6: the camera was turned a quarter to the right.
    const EXIF_TURNED: [u8; 36] =
        *b"\xff\xe1\x00\x22Exif\0\0MM\0*\0\0\0\x08\0\x01\x01\x12\0\x03\0\0\0\x01\0\x06\0\0\0\0\0\0";

    #[test]
    fn a_turned_photograph_is_set_upright() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("turned.jpg");
        RgbImage::from_fn(32, 16, |x, _| Rgb([if x < 16 { 0 } else { 255 }; 3])).save(&path).unwrap();
        let plain = std::fs::read(&path).unwrap();
        std::fs::write(&path, [&plain[..2], &EXIF_TURNED, &plain[2..]].concat()).unwrap();
        let mut frame = Frame::default();
        decode(&path, &mut frame).unwrap();
        assert_eq!(frame.size, (16, 32), "what lay is standing");
        let bytes = frame.view().unwrap().bytes();
        assert!(bytes[0] < 20 && bytes[bytes.len() - 1] > 235, "the left edge is the upper one now");
    }

    #[test]
    fn a_single_file_that_is_no_picture_is_a_bad_argument_with_the_way_that_would_do() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("clip.any");
        let refused = |content: &[u8]| {
            std::fs::write(&path, content).unwrap();
            let error = Files::open(path.to_str().unwrap(), false).unwrap_err();
            assert!(error.is::<BadArguments>(), "{error:#}");
            error.to_string().replace(path.to_str().unwrap(), "CLIP")
        };
        let what = "`CLIP` is no source: neither a JPEG nor a PNG picture nor a recording\nhint: ";
        let video = "a video comes through a pipe: ffmpeg -i CLIP -f yuv4mpegpipe -pix_fmt yuv420p - | nunetd --source -";
        assert_eq!(refused(b"\0\0\0\x20ftypisom"), format!("{what}{video}"));
        assert_eq!(refused(b""), format!("{what}{video}"));
        assert_eq!(refused(b"YUV4MPEG2 W4 H2 F25:1\n"), format!("{what}nunetd --source - < CLIP"));
        assert_eq!(refused(b"\x89MCAP0\r\n"), format!("{what}the name of a recording ends in `.mcap`"));
        assert_eq!(refused(b"BM\x46\0\0\0"), format!("{what}save it as JPEG or PNG"));
        picture([1, 2, 3]).save_with_format(&path, ImageFormat::Png).unwrap();
        assert_eq!(
            drain(&mut Files::open(path.to_str().unwrap(), false).unwrap()).0,
            [[1, 2, 3]],
            "whatever its name"
        );
    }

    #[test]
    fn an_empty_folder_and_a_missing_one_are_bad_arguments() {
        let folder = tempfile::tempdir().unwrap();
        for pattern in [folder.path().to_owned(), folder.path().join("missing")] {
            let error = Files::open(pattern.to_str().unwrap(), false).unwrap_err();
            assert!(error.is::<BadArguments>(), "{error:#}");
        }
    }
}
