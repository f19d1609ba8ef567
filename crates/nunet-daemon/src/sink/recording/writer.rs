//! Writes records into a file, images as JPEG or PNG.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use anyhow::bail;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder as _};
use nunet_core::pipeline::Pipeline;
use nunet_core::preprocess::Preprocessor;
use nunet_ipc::Clock;
use nunet_mcap::{EncodedImage, FrameRecord, Mount, RecordingError, RecordingWriter, WriterOptions};
use nunet_sink::archive::Archive;
use nunet_sink::record::{Record, describe};
use nunet_types::ImageSize;

use crate::config::MountOption;
use crate::exit::{BadArguments, WithHint};
use crate::sink::stats::ModelName;
use crate::source::Frame;
use tracing::info;

/// For raw images: lower qualities become visible, and the file is a tenth of the raw image.
const JPEG_QUALITY: u8 = 92;

/// The settings of a recording before its first frame.
pub(crate) struct About<'a> {
    pub(crate) camera: &'a str,
    pub(crate) frame_id: &'a str,
    pub(crate) mount: Option<MountOption>,
    pub(crate) model: &'a ModelName,
    pub(crate) provider: &'a str,
    /// From [`settings`].
    pub(crate) settings: [(&'static str, String); 2],
    /// Overwrite an existing file.
    pub(crate) force: bool,
    /// Raw images become PNG instead of JPEG.
    pub(crate) lossless: bool,
}

impl About<'_> {
    fn options(&self) -> WriterOptions {
        let about = [
            ("model", self.model.name.clone()),
            ("model_sha256", self.model.hash.clone()),
            ("provider", self.provider.to_owned()),
        ];
        let about = about.into_iter().chain(self.settings.clone());
        let mount = self.mount.map(|mount| Mount {
            translation_m: mount.translation_m,
            roll_pitch_yaw_rad: mount.roll_pitch_yaw_rad,
        });
        WriterOptions {
            camera: self.camera.to_owned(),
            frame_id: self.frame_id.to_owned(),
            mount,
            about: about.map(|(key, value)| (key.to_owned(), value)).collect(),
            force: self.force,
        }
    }
}

/// How depth is made beside the model: the filters in their order, and the stages that do not run for each frame.
pub(crate) fn settings(pipeline: &Pipeline) -> [(&'static str, String); 2] {
    let filters: Vec<_> = pipeline.filters().specs().map(|filter| filter.to_string()).collect();
    let stages = pipeline.graph().stages().iter().filter(|stage| stage.every > 1);
    let every: Vec<_> = stages.map(|stage| format!("{}={}", stage.name, stage.every)).collect();
    [("filters", filters.join(" ")), ("every", every.join(" "))]
}

/// Refuses an output that exists, or that is the input under another name, before any work is done.
pub(crate) fn refuse_output(output: &Path, input: Option<&Path>, force: bool) -> anyhow::Result<()> {
    let Ok(there) = std::fs::metadata(output) else { return Ok(()) };
    let is_input = input
        .and_then(|input| std::fs::metadata(input).ok())
        .is_some_and(|input| (input.dev(), input.ino()) == (there.dev(), there.ino()));
    if is_input {
        bail!(BadArguments(format!("`{}` is both input and output", output.display())));
    }
    if !force {
        let exists = RecordingError::Exists { path: output.to_owned() };
        bail!(WithHint::usage(exists.to_string(), "pass --force to overwrite it"));
    }
    Ok(())
}

/// The file of a recording: `path` itself, or in a folder one that is named by camera and time.
pub(crate) fn recording_path(path: &Path, is_folder: bool, camera: &str, unix_nanos: i64) -> PathBuf {
    if is_folder { path.join(format!("{camera}_{}.mcap", utc(unix_nanos))) } else { path.to_owned() }
}

/// `20261122T051500Z`, so that names sort by time.
fn utc(unix_nanos: i64) -> String {
    let seconds = unix_nanos.div_euclid(1_000_000_000);
    let (days, second) = (seconds.div_euclid(86_400), seconds.rem_euclid(86_400));
    // Days to a date of the proleptic Gregorian calendar: Hinnant, "chrono-compatible low-level date algorithms".
    let shifted = days + 719_468;
    let era = shifted.div_euclid(146_097);
    let day_of_era = shifted.rem_euclid(146_097);
    let year_of_era = (day_of_era - day_of_era / 1460 + day_of_era / 36_524 - day_of_era / 146_096) / 365;
    let day_of_year = day_of_era - (365 * year_of_era + year_of_era / 4 - year_of_era / 100);
    let march_month = (5 * day_of_year + 2) / 153;
    let day = day_of_year - (153 * march_month + 2) / 5 + 1;
    let month = if march_month < 10 { march_month + 3 } else { march_month - 9 };
    let year = year_of_era + era * 400 + i64::from(month <= 2);
    let (hour, minute) = (second / 3600, second / 60 % 60);
    format!("{year:04}{month:02}{day:02}T{hour:02}{minute:02}{:02}Z", second % 60)
}

impl Archive for FrameWriter {
    fn path(&self) -> &Path {
        &self.path
    }

    fn write(&mut self, record: &Record) -> anyhow::Result<()> {
        Self::write(self, record)
    }

    fn sync(&mut self) -> anyhow::Result<()> {
        Self::sync(self)
    }

    fn finish(self: Box<Self>) -> anyhow::Result<()> {
        Self::finish(*self)
    }
}

/// A file that takes records.
pub(crate) struct FrameWriter {
    path: PathBuf,
    writer: RecordingWriter,
    images: ImageEncoder,
}

impl FrameWriter {
    pub(crate) fn create(path: &Path, about: &About<'_>) -> anyhow::Result<Self> {
        let writer = RecordingWriter::create(path, about.options())?;
        let images = ImageEncoder { lossless: about.lossless, ..ImageEncoder::default() };
        Ok(Self { path: path.to_owned(), writer, images })
    }

    pub(crate) fn write(&mut self, record: &Record) -> anyhow::Result<()> {
        let frame = &record.frame;
        let capture = frame.capture;
        // What was recorded before keeps its log time; a camera's frame is logged when it was taken.
        let log_nanos = if capture.clock == Clock::Unix { capture.nanos } else { capture.unix_nanos };
        let camera = record.camera.as_ref().map(describe);
        let depth_camera = record.depth_camera.as_ref().map(describe);
        let log_nanos = log_nanos.try_into().unwrap_or_default();
        if let Some(obstacles) = record.obstacles() {
            self.writer.write_obstacles(&obstacles, log_nanos, capture.unix_nanos)?;
        }
        self.writer.write(&FrameRecord {
            log_nanos,
            stamp_nanos: capture.unix_nanos,
            image: Some(self.images.encoded(frame)?),
            camera: camera.as_ref(),
            depth: record.depth(),
            depth_camera: depth_camera.as_ref(),
            labels: record.labels(),
            cloud: record.cloud(),
        })?;
        Ok(())
    }

    pub(crate) fn sync(&mut self) -> anyhow::Result<()> {
        Ok(self.writer.sync()?)
    }

    pub(crate) fn finish(self) -> anyhow::Result<()> {
        Ok(self.writer.finish()?)
    }
}

/// Encodes images: files as they came, raw images as JPEG or PNG.
#[derive(Default)]
struct ImageEncoder {
    lossless: bool,
    to_rgb: Option<(ImageSize, Preprocessor)>,
    encoded: Vec<u8>,
    has_noted_jpeg: bool,
}

impl ImageEncoder {
    fn encoded<'a>(&'a mut self, frame: &'a Frame) -> anyhow::Result<EncodedImage<'a>> {
        if !frame.file.is_empty() {
            let format = if frame.file.starts_with(&[0xff, 0xd8]) { "jpeg" } else { "png" };
            return Ok(EncodedImage { format, data: &frame.file });
        }
        if !self.lossless && !std::mem::replace(&mut self.has_noted_jpeg, true) {
            info!(
                "raw images are recorded as JPEG (quality {JPEG_QUALITY}): a replay sees slightly different images; pass \
                 --record-lossless for PNG"
            );
        }
        let ImageSize { width, height } = frame.size;
        let (size, to_rgb) =
            self.to_rgb.get_or_insert_with(|| (frame.size, Preprocessor::new(width, height)));
        if *size != frame.size {
            (*size, *to_rgb) = (frame.size, Preprocessor::new(width, height));
        }
        let rgb = to_rgb.prepare(&frame.view()?).rgb;
        self.encoded.clear();
        if self.lossless {
            let encoder =
                PngEncoder::new_with_quality(&mut self.encoded, CompressionType::Fast, FilterType::Adaptive);
            encoder.write_image(rgb, width, height, ExtendedColorType::Rgb8)?;
            return Ok(EncodedImage { format: "png", data: &self.encoded });
        }
        let mut encoder = JpegEncoder::new_with_quality(&mut self.encoded, JPEG_QUALITY);
        encoder.encode(rgb, width, height, ExtendedColorType::Rgb8)?;
        Ok(EncodedImage { format: "jpeg", data: &self.encoded })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn recordings_in_a_folder_are_named_by_camera_and_time() {
        let folder = tempfile::tempdir().unwrap();
        let name = |seconds: i64| {
            let path = recording_path(folder.path(), true, "front", seconds * 1_000_000_000);
            path.file_name().unwrap().to_str().unwrap().to_owned()
        };
        assert_eq!(name(0), "front_19700101T000000Z.mcap");
        assert_eq!(name(951_782_400), "front_20000229T000000Z.mcap");
        assert_eq!(name(1_795_324_515), "front_20261122T051515Z.mcap");
        assert_eq!(recording_path(Path::new("a.mcap"), false, "front", 0), Path::new("a.mcap"));
    }

    #[test]
    fn raw_images_are_jpeg_by_default_and_exact_as_png() {
        let mut frame = Frame::default();
        let pixels: Vec<u8> = (0..12).map(|value| value * 20).collect();
        frame.rgb_buffer((2, 2).into()).copy_from_slice(&pixels);
        for (lossless, expected) in [(false, "jpeg"), (true, "png")] {
            let mut encoder = ImageEncoder { lossless, ..ImageEncoder::default() };
            let encoded = encoder.encoded(&frame).unwrap();
            assert_eq!(encoded.format, expected);
            let decoded = image::load_from_memory(encoded.data).unwrap().into_rgb8().into_raw();
            assert_eq!(decoded == pixels, lossless, "{expected}");
        }
        frame.file = vec![0xff, 0xd8];
        let encoder = &mut ImageEncoder { lossless: true, ..ImageEncoder::default() };
        assert_eq!(encoder.encoded(&frame).unwrap().data, [0xff, 0xd8], "files stay as they came");
    }

    #[test]
    fn an_output_that_is_the_input_or_is_there_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let (input, link) = (folder.path().join("in.mcap"), folder.path().join("link.mcap"));
        std::fs::write(&input, "x").unwrap();
        std::fs::hard_link(&input, &link).unwrap();
        let refused = |force| refuse_output(&link, Some(&input), force).unwrap_err().to_string();
        assert!(refused(true).ends_with("is both input and output"));
        assert!(refuse_output(&link, None, false).unwrap_err().to_string().contains("already exists"));
        assert!(refuse_output(&link, None, true).is_ok());
        assert!(refuse_output(&folder.path().join("new.mcap"), Some(&input), false).is_ok());
    }
}
