//! The demo: images of rendered rooms that are installed with the models.
//!
//! A folder has `rgb/ID.jpg` and `camera.json` (size, intrinsics, frames per second). It is played in a loop,
//! with the times of its own frame rate. An `ID` is a scene and a number; another scene is another segment.

use std::path::{Path, PathBuf};

use nunet_core::camera::Camera;
use nunet_core::plain_file;
use nunet_ipc::{Clock, unix_nanos};

use crate::camera_file::CameraFile;
use crate::error::{SourceError, SourceErrorKind};
use crate::files::nothing_to_repeat;
use crate::image_file::decode;
use crate::listing::list;
use crate::source::Fused;
use crate::source_type::{Properties, SourceType};
use crate::{CaptureTime, Fill, Frame, OpenOptions, Source};

/// Folders of rendered images beside the models, in the order in which they are searched: `drive` is a
/// robot's path, 0.25 m above the floor, with obstacles; the Python package contains only `clip`.
const NAMES: [&str; 2] = ["drive", "clip"];
const DEFAULT_HZ: f64 = 30.0;

pub(crate) struct Demo;

impl SourceType for Demo {
    fn is_named(&self, name: &str) -> bool {
        name == "demo"
    }

    fn properties(&self) -> Properties {
        Properties { camera: "demo", default_rate: Some("max"), ..Properties::default() }
    }

    fn open(&self, _name: &str, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        let folder = find(options.model_folders).ok_or_else(|| {
            let folders: Vec<_> =
                options.model_folders.iter().map(|folder| format!("`{}`", folder.display())).collect();
            let message =
                format!("the images of the demo are not installed; looked in {}", folders.join(", "));
            SourceError::new(SourceErrorKind::Unavailable, message)
                .with_hint("name a source: a folder of images, a recording, or a camera such as /dev/video0")
        })?;
        Ok(Box::new(Fused::new(Clip::open(&folder)?)))
    }
}

/// The demo's folder: in one of the models' folders or beside it.
fn find(folders: &[PathBuf]) -> Option<PathBuf> {
    let places = || folders.iter().flat_map(|folder| [Some(folder.as_path()), folder.parent()]).flatten();
    let candidates = NAMES.iter().flat_map(|name| places().map(move |place| place.join(name)));
    candidates.into_iter().find(|folder| folder.join("camera.json").is_file())
}

/// A folder of rendered images that is played in a loop.
pub(crate) struct Clip {
    images: Vec<PathBuf>,
    camera: Camera,
    frame_nanos: f64,
    sequence: u64,
    segment: u64,
    scene: String,
    any_good: bool,
}

impl Clip {
    pub(crate) fn open(folder: &Path) -> Result<Self, SourceError> {
        let failed = |what: &str| {
            let message = format!("cannot play the demo `{}`: {what}", folder.display());
            SourceError::new(SourceErrorKind::Unavailable, message)
        };
        let text = plain_file::read_text(&folder.join("camera.json"), CameraFile::MAX_BYTES)
            .map_err(|error| failed("`camera.json` cannot be read").with_cause(error))?;
        let file: CameraFile = serde_json::from_str(&text)
            .map_err(|error| failed("`camera.json` is invalid").with_cause(error))?;
        let camera = file.camera().map_err(|error| failed("`camera.json` is invalid").with_cause(error))?;
        let images = list(&folder.join("rgb"))?;
        let scene = images.first().map(|path| scene(path)).ok_or_else(|| failed("it has no images"))?;
        let hz = file.frames_per_second.filter(|&hz| hz > 0.0).unwrap_or(DEFAULT_HZ);
        Ok(Self { images, camera, frame_nanos: 1e9 / hz, sequence: 0, segment: 0, scene, any_good: false })
    }
}

/// The scene of an image: its name without the number at its end.
fn scene(path: &Path) -> String {
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default();
    stem.trim_end_matches(|c: char| c.is_ascii_digit()).to_owned()
}

impl Source for Clip {
    fn fill(&mut self, frame: &mut Frame) -> Fill {
        let place = (self.sequence % self.images.len() as u64) as usize;
        if place == 0 && self.sequence > 0 && !std::mem::take(&mut self.any_good) {
            return nothing_to_repeat();
        }
        let path = &self.images[place];
        let scene = scene(path);
        if scene != self.scene || (place == 0 && self.sequence > 0) {
            self.segment += 1;
            self.scene = scene;
        }
        frame.sequence = self.sequence;
        self.sequence += 1;
        if let Err(error) = decode(path, frame) {
            return Fill::Failed(error.context(format!("cannot read the image `{}`", path.display())));
        }
        let nanos = (frame.sequence as f64 * self.frame_nanos) as i64;
        frame.capture = CaptureTime { nanos, clock: Clock::Media, unix_nanos: unix_nanos() };
        // A camera of another size would contradict the images.
        frame.camera = self.camera.fitted_to(frame.size.width, frame.size.height).ok();
        frame.segment = self.segment;
        self.any_good = true;
        Fill::Frame
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn clip(images: &[&str]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        let rgb = folder.path().join("clip/rgb");
        std::fs::create_dir_all(&rgb).unwrap();
        for name in images {
            image::RgbImage::new(4, 2).save(rgb.join(name)).unwrap();
        }
        let camera =
            r#"{"width": 4, "height": 2, "fx": 5, "fy": 6, "cx": 1.5, "cy": 0.5, "frames_per_second": 10}"#;
        std::fs::write(folder.path().join("clip/camera.json"), camera).unwrap();
        folder
    }

    #[test]
    fn the_demo_loops_and_each_scene_is_a_segment() {
        let models = clip(&["a_00.png", "a_01.png", "b_00.png"]);
        let folders = [models.path().join("tiny"), models.path().to_owned()];
        let options = OpenOptions { model_folders: &folders, ..OpenOptions::default() };
        let mut source = Demo.open("demo", options).unwrap();
        let mut frame = Frame::default();
        let mut seen = Vec::new();
        for _ in 0..5 {
            assert!(matches!(source.fill(&mut frame), Fill::Frame));
            seen.push((frame.sequence, frame.segment, frame.capture.nanos / 1_000_000));
            assert_eq!(frame.camera.unwrap().intrinsics.fx_px, 5.0);
        }
        assert_eq!(seen, [(0, 0, 0), (1, 0, 100), (2, 1, 200), (3, 2, 300), (4, 2, 400)]);
    }

    #[test]
    fn the_camera_file_may_begin_with_a_byte_order_mark() {
        let models = clip(&["a_00.png"]);
        let file = models.path().join("clip/camera.json");
        let text = std::fs::read_to_string(&file).unwrap();
        std::fs::write(&file, format!("\u{feff}{text}")).unwrap();
        Clip::open(&models.path().join("clip")).unwrap();
    }

    #[test]
    fn the_clip_is_played_where_there_is_no_drive_and_a_missing_demo_is_an_error() {
        let models = clip(&["a_00.png"]);
        let folders = [models.path().to_owned()];
        assert_eq!(find(&folders), Some(models.path().join("clip")));
        let drive = models.path().join("drive");
        std::fs::create_dir(&drive).unwrap();
        std::fs::copy(models.path().join("clip/camera.json"), drive.join("camera.json")).unwrap();
        assert_eq!(find(&folders), Some(drive));
        let error = Demo.open("demo", OpenOptions::default()).err().unwrap();
        assert_eq!(error.kind(), SourceErrorKind::Unavailable);
    }
}
