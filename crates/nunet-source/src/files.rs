//! Images of a folder or a glob, in the order of their names.

use std::path::{Path, PathBuf};

use nunet_ipc::{Clock, monotonic_nanos, unix_nanos};

use crate::bit_depth::BitDepthCheck;
use crate::error::{SourceError, SourceErrorKind};
use crate::image_file::{decode, first_bytes};
use crate::listing::{list, listed_files, would_list};
use crate::secret::shown_name;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source};

/// A folder, a glob, or one image.
pub(crate) struct ImageFiles;

impl SourceType for ImageFiles {
    /// All names that no other kind of source accepts.
    fn is_named(&self, _name: &str) -> bool {
        true
    }

    fn properties(&self) -> Properties {
        Properties { camera: "camera", default_rate: Some("max"), ..Properties::default() }
    }

    fn files(&self, name: &str) -> Vec<PathBuf> {
        listed_files(Path::new(name))
    }

    fn would_read(&self, name: &str, path: &Path) -> bool {
        would_list(Path::new(name), path)
    }

    fn open(&self, name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        Ok(Box::new(Fused::new(Files::open(name, options.repeat)?)))
    }
}

/// A list of images.
#[derive(Debug)]
pub(crate) struct Files {
    paths: Vec<PathBuf>,
    next: usize,
    sequence: u64,
    segment: u64,
    repeat: bool,
    /// Whether any image of this round could be read.
    any_good: bool,
    bit_depth: BitDepthCheck,
}

impl Files {
    /// Lists the images; each is decoded when it is requested.
    pub(crate) fn open(pattern: &str, repeat: bool) -> Result<Self, SourceError> {
        let path = Path::new(pattern);
        refuse_other_file(path)?;
        let paths = list(path)?;
        if paths.is_empty() {
            return Err(no_images(path));
        }
        Ok(Self {
            paths,
            next: 0,
            sequence: 0,
            segment: 0,
            repeat,
            any_good: false,
            bit_depth: BitDepthCheck::default(),
        })
    }
}

/// Ends a loop in which no image can be read: it would only write errors to the log, without a pause.
pub(crate) fn nothing_to_repeat() -> Fill {
    let message = "no image could be read in a whole round, and the loop would repeat forever";
    let error = SourceError::new(SourceErrorKind::NothingReadable, message);
    Fill::Broken(error.with_hint("check whether the images still exist; the errors above name them"))
}

impl Source for Files {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        if self.next == self.paths.len() && self.repeat {
            if !self.any_good {
                return nothing_to_repeat();
            }
            self.any_good = false;
            self.next = 0;
            self.segment += 1;
        }
        let Some(path) = self.paths.get(self.next) else { return Fill::End };
        self.next += 1;
        frame.sequence = self.sequence;
        self.sequence += 1;
        match decode(path, frame) {
            Ok(decoded) => {
                self.bit_depth.check(|| decoded.maximum_16_bit, format_args!("`{}`", path.display()));
            }
            Err(error) => {
                return Fill::Failed(error.context(format!("cannot read the image `{}`", path.display())));
            }
        }
        let nanos = monotonic_nanos();
        frame.capture = CaptureTime { nanos, clock: Clock::Monotonic, unix_nanos: unix_nanos() };
        frame.camera = None;
        frame.segment = self.segment;
        self.any_good = true;
        Fill::Frame
    }
}

/// Checks a file that is the only source: if it is not an image, that is reported before anything else is
/// prepared. Among several files, one may be unreadable.
fn refuse_other_file(path: &Path) -> Result<(), SourceError> {
    if !path.is_file() {
        return Ok(());
    }
    let shown = path.display();
    let start = first_bytes(path).map_err(|error| {
        SourceError::new(SourceErrorKind::Unavailable, format!("cannot read `{shown}`")).with_cause(error)
    })?;
    let start = start.unwrap_or_default();
    let (what, hint) = match image::guess_format(&start) {
        Ok(image::ImageFormat::Jpeg | image::ImageFormat::Png) => return Ok(()),
        Ok(_) => (None, "save it as JPEG or PNG".to_owned()),
        Err(_) => other_file(path, &start),
    };
    let what = what.unwrap_or("neither a JPEG or PNG image nor a recording");
    Err(SourceError::bad_arguments(format!("`{shown}` is not a source: {what}")).with_hint(hint))
}

/// The type of a file that is not an image, if it is known, and a hint.
fn other_file(path: &Path, start: &[u8]) -> (Option<&'static str>, String) {
    let shown = path.display();
    #[cfg(feature = "mcap")]
    if let Some(what) = nunet_mcap::recording_of_another_format(start) {
        let hint = nunet_mcap::conversion_hint(path, what).unwrap_or_default();
        return (Some(what), hint.into_owned());
    }
    let hint = if start.starts_with(b"YUV4MPEG2") {
        format!("read it from standard input, with `-` as the source: `< {shown}`")
    } else if start.is_empty() {
        return (Some("it is empty"), "copy or record it again".to_owned());
    } else if !is_video(path, start) {
        "expected JPEG or PNG images, or a recording in MCAP: convert it to one of them".to_owned()
    } else {
        format!(
            "pipe a video into standard input, with `-` as the source: `ffmpeg -i {shown} -f yuv4mpegpipe -pix_fmt yuv420p \
             -`"
        )
    };
    (None, hint)
}

/// Decided by the first bytes for MP4 and related containers, which HEIC and AVIF images also use, otherwise
/// by the extension.
fn is_video(path: &Path, start: &[u8]) -> bool {
    const IMAGES: [&[u8]; 5] = [b"heic", b"heix", b"mif1", b"avif", b"avis"];
    const VIDEOS: [&str; 16] = [
        "mp4", "m4v", "mov", "mkv", "webm", "avi", "mpg", "mpeg", "ts", "mts", "wmv", "flv", "ogv", "3gp",
        "h264", "h265",
    ];
    if start.get(4..8) == Some(b"ftyp") {
        return start.get(8..12).is_none_or(|brand| !IMAGES.contains(&brand));
    }
    path.extension().is_some_and(|ending| VIDEOS.iter().any(|video| ending.eq_ignore_ascii_case(video)))
}

/// A file in a folder that is a recording in another format.
#[cfg(feature = "mcap")]
fn recording_in(folder: &Path) -> Option<PathBuf> {
    let files = folder.read_dir().ok()?.flatten().map(|entry| entry.path());
    let is_bag = |file: &PathBuf| {
        file.extension().is_some_and(|ending| ["db3", "bag", "zstd"].iter().any(|bag| ending == *bag))
    };
    files.filter(is_bag).min()
}

fn no_images(path: &Path) -> SourceError {
    let name = path.to_string_lossy();
    if name.contains("://") {
        let name = shown_name(&name);
        let hint =
            format!("let ffmpeg read it: `exec:ffmpeg -i \"{name}\" -f yuv4mpegpipe -pix_fmt yuv420p -`");
        let message = format!("no source `{name}`: of URLs, only rtsp:// and rtsps:// are read");
        return SourceError::bad_arguments(message).with_hint(hint);
    }
    let shown = path.display();
    #[cfg(feature = "mcap")]
    if let Some(bag) = recording_in(path)
        && let (Some(what), hint) = other_file(&bag, &first_bytes(&bag).ok().flatten().unwrap_or_default())
    {
        return SourceError::bad_arguments(format!("`{}` is not a source: {what}", bag.display()))
            .with_hint(hint);
    }
    if path.is_dir() {
        return SourceError::bad_arguments(format!("the folder `{shown}` has no JPEG or PNG image"))
            .with_hint("name the folder that holds the images; folders in it are not searched");
    }
    SourceError::bad_arguments(format!("no source `{shown}`: no such file or folder, and no file matches it as a glob"))
        .with_hint(
            "expected demo, a folder of JPEG or PNG images, a glob such as 'frames/*.jpg' (quoted), a recording FILE.mcap or \
             its folder, a camera /dev/videoN, shm:CAMERA, ros2:TOPIC, exec:COMMAND, rtsp://..., or - for standard \
             input",
        )
}

#[cfg(test)]
mod tests;
