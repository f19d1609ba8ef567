//! The kinds of sources, and how a name chooses one.
//!
//! A new source is a file of its own that implements [`SourceType`], and a line in [`REGISTRY`].

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::error::SourceError;
use crate::secret::{Secrets, shown_name};
use crate::source_type::{Exclusive, Properties, SizeUse, SourceType};
use crate::{CameraSettings, Fill, Frame, OpenOptions, Rotated, Rotation, Source};

/// Every kind of source, in the order in which names are compared. Image files accept every remaining name.
const REGISTRY: &[&dyn SourceType] = &[
    &crate::demo::Demo,
    &crate::pipe::StandardInput,
    &crate::command::ShellCommand,
    &crate::command::NetworkCamera,
    &crate::shm::SharedMemoryCamera,
    #[cfg(feature = "ros2")]
    &crate::ros2::Ros2Topic,
    #[cfg(not(feature = "ros2"))]
    &crate::absent::ROS2_TOPICS,
    #[cfg(feature = "v4l2")]
    &crate::v4l2::VideoDevice,
    #[cfg(not(feature = "v4l2"))]
    &crate::absent::CAMERAS,
    #[cfg(feature = "mcap")]
    &crate::recording::RecordingFile,
    &crate::files::ImageFiles,
];

/// The place in [`REGISTRY`] of the kind of a name.
fn index_of(name: &str) -> usize {
    REGISTRY.iter().position(|kind| kind.is_named(name)).unwrap_or(REGISTRY.len() - 1)
}

/// A source that must not be read.
struct NoFrames;

impl Source for NoFrames {
    fn fill(&mut self, _frame: &mut Frame) -> Fill {
        Fill::End
    }
}

fn rotated(source: Box<dyn Source>, rotation: Option<Rotation>) -> Box<dyn Source> {
    if rotation.is_some() { Box::new(Rotated::new(source, rotation)) } else { source }
}

/// A source by its name.
#[derive(Clone)]
pub struct SourceName {
    name: String,
    kind: &'static dyn SourceType,
}

impl std::fmt::Debug for SourceName {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("SourceName").field(&self.shown()).finish()
    }
}

impl SourceName {
    /// Chooses the kind by the spelling of a name, and by the file at its path.
    #[must_use]
    pub fn parse(name: &str) -> Self {
        Self { name: name.to_owned(), kind: REGISTRY[index_of(name)] }
    }

    /// How many kinds there are, for tests that have a case for each.
    #[doc(hidden)]
    pub const KIND_COUNT: usize = REGISTRY.len();

    /// The number of its kind, less than [`KIND_COUNT`](Self::KIND_COUNT).
    #[doc(hidden)]
    #[must_use]
    pub fn kind_index(&self) -> usize {
        index_of(&self.name)
    }

    /// The demo images.
    #[must_use]
    pub fn demo() -> Self {
        Self::parse("demo")
    }

    /// As the user wrote it.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.name
    }

    /// As it may be shown: without a password that is recognized.
    #[must_use]
    pub fn shown(&self) -> Cow<'_, str> {
        shown_name(&self.name)
    }

    /// As a path.
    #[must_use]
    pub fn path(&self) -> &Path {
        Path::new(&self.name)
    }

    /// The properties of its kind.
    #[must_use]
    pub fn properties(&self) -> Properties {
        self.kind.properties()
    }

    /// The files and folders that are read: none of them may be written meanwhile.
    #[must_use]
    pub fn files(&self) -> Vec<PathBuf> {
        self.kind.files(&self.name)
    }

    /// Whether a file at `path`, an absolute path, would be a part of the source once it is written: the next
    /// run would read it too.
    #[must_use]
    pub fn would_read(&self, path: &Path) -> bool {
        self.kind.would_read(&self.name, path)
    }

    /// Refuses a name that cannot be right, and options that the source would ignore. Opens nothing.
    ///
    /// # Errors
    /// A bad name, or an option for another kind of source.
    pub fn check(&self, options: &OpenOptions<'_>) -> Result<(), SourceError> {
        let properties = self.properties();
        let bad = |text: String| Err(SourceError::bad_arguments(text));
        self.kind.check(&self.name).map_err(|error| self.without_secrets(error))?;
        if let (Some(topic), false) = (options.topic, properties.has_topics) {
            return bad(format!("topic `{topic}` is for recordings: `{}` has no topics", self.shown()));
        }
        if let (Some(reason), Some(_)) = (properties.own_pace, options.rate) {
            return bad(format!("a rate is for files and devices: {reason}"));
        }
        if !properties.has_settings && options.camera_settings != CameraSettings::UNCHANGED {
            return bad("exposure and gain are for V4L2 cameras, such as /dev/video0".to_owned());
        }
        match (properties.size, options.size, options.format) {
            (SizeUse::Raw, Some(_), None) => {
                return bad("a size without a format: raw images need both".to_owned());
            }
            (SizeUse::Requested, _, Some(_)) => {
                return bad(
                    "a format is for raw images: of a camera, the format that fits best is taken".to_owned()
                );
            }
            (SizeUse::None, Some(_), _) | (SizeUse::None, _, Some(_)) => {
                return bad(
                    "a size is for cameras and raw images, a format for raw images: omit them".to_owned()
                );
            }
            _ => {}
        }
        match properties.no_repeat.or(properties.own_pace).filter(|_| options.repeat) {
            Some(reason) => bad(format!("a loop is impossible: {reason}")),
            None => Ok(()),
        }
    }

    /// Opens the source.
    ///
    /// # Errors
    /// Nothing of that name, no images in a folder or a recording, an invalid glob, a camera that cannot be
    /// used, options for another kind of source.
    pub fn open(&self, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        self.check(&options)?;
        let source = self.kind.open(&self.name, options).map_err(|error| self.without_secrets(error))?;
        Ok(rotated(source, options.rotation))
    }

    fn without_secrets(&self, error: SourceError) -> SourceError {
        error.hiding(&Secrets::of_name(&self.name))
    }

    /// Checks the source without reading from it: a camera may be in use, data read from a pipe is lost, and
    /// a live topic is on the network. The returned source has no frames then.
    ///
    /// # Errors
    /// Those of [`open`](Self::open).
    pub fn probe(&self, options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        self.check(&options)?;
        let properties = self.properties();
        match properties.exclusive {
            Some(Exclusive::StandardInput) => Ok(Box::new(NoFrames)),
            Some(Exclusive::Device) if self.path().exists() => Ok(Box::new(NoFrames)),
            _ if properties.is_on_network => Ok(Box::new(NoFrames)),
            _ => self.open(options),
        }
    }

    /// The placeholder for this source if it cannot be opened, but others can.
    #[must_use]
    pub fn stand_in(&self, options: OpenOptions<'_>, error: SourceError) -> Box<dyn Source> {
        rotated(self.kind.stand_in(&self.name, options, error), options.rotation)
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::{ImageSize, PixelFormat};

    use super::*;
    use crate::{CameraSetting, Rate, SourceErrorKind};

    fn kind(name: &str) -> Properties {
        SourceName::parse(name).properties()
    }

    #[test]
    fn a_source_is_chosen_by_its_spelling() {
        assert_eq!(kind("demo").camera, "demo");
        assert_eq!(kind("./demo").camera, "camera");
        assert!(kind("shm:front").is_published);
        assert!(kind("exec:cat images.y4m").is_started && kind("rtsp://10.0.0.4/front").is_started);
        assert_eq!(kind("-").exclusive, Some(Exclusive::StandardInput));
        assert_eq!(kind("drive.mcap").has_attitude, cfg!(feature = "mcap"));
        assert!(!kind("drive/*.jpg").has_attitude);
    }

    #[cfg(all(feature = "ros2-dds", feature = "ros2-zenoh"))]
    #[test]
    fn a_ros_2_topic_is_checked_without_a_network() {
        let check = |name: &str| SourceName::parse(name).check(&OpenOptions::default());
        assert!(kind("ros2:/camera/image_raw@7").states_frame_id && !kind("./ros2:/a").states_frame_id);
        assert!(check("ros2:/camera/image_raw@7").is_ok() && check("ros2:camera/image_raw").is_ok());
        for name in ["ros2:/a@dds", "ros2:/a@dds:7", "ros2:/a@zenoh", "ros2:/a@zenoh:tcp/10.0.0.1:7447"] {
            assert!(check(name).is_ok(), "{name}");
        }
        for name in [
            "ros2:",
            "ros2:/a b",
            "ros2:/a@",
            "ros2:/a@233",
            "ros2:/a@b@1",
            "ros2:/a@zenoh:robot",
            "ros2:/a@dds:233",
        ] {
            assert_eq!(check(name).unwrap_err().kind(), SourceErrorKind::Argument, "{name}");
        }
        let mut probed = SourceName::parse("ros2:/a").probe(OpenOptions::default()).unwrap();
        assert!(matches!(probed.fill(&mut Frame::default()), Fill::End));
        let repeat = OpenOptions { repeat: true, ..OpenOptions::default() };
        let error = SourceName::parse("ros2:/a").check(&repeat).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Argument, "{error}");
        insta::assert_snapshot!(error, @"a loop is impossible: a topic has no end");
        let rate = OpenOptions { rate: Some(Rate::Max), ..OpenOptions::default() };
        let error = SourceName::parse("ros2:/a").check(&rate).unwrap_err();
        assert_eq!(error.kind(), SourceErrorKind::Argument);
    }

    #[cfg(feature = "v4l2")]
    #[test]
    fn cameras_are_recognized_by_their_place_or_by_being_devices() {
        for name in
            ["/dev/video7", "/dev/v4l/by-path/pci-0:1.0-video-index0", "/dev/nunet/ACME_42", "/dev/null"]
        {
            assert_eq!(kind(name).exclusive, Some(Exclusive::Device), "{name}");
        }
        assert_eq!(kind("/dev"), kind("video0"));
    }

    #[cfg(feature = "mcap")]
    #[test]
    fn a_folder_with_a_recording_is_a_recording() {
        let folder = tempfile::tempdir().unwrap();
        let name = folder.path().to_str().unwrap();
        assert!(!kind(name).has_attitude);
        std::fs::write(folder.path().join("drive_0.mcap"), b"").unwrap();
        assert!(kind(name).has_attitude);
    }

    #[test]
    fn a_source_says_which_files_and_folders_it_reads() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        let files = |name: &Path| SourceName::parse(name.to_str().unwrap()).files();
        for name in ["a.png", "bag_0.mcap", "bag_1.mcap"] {
            std::fs::create_dir_all(path("images")).unwrap();
            std::fs::write(path(if name.ends_with("png") { "images/a.png" } else { name }), b"").unwrap();
        }
        assert_eq!(files(&path("images")), [path("images")]);
        assert_eq!(files(&path("images/a.png")), [path("images/a.png")]);
        assert_eq!(files(&path("images/*.png")), [path("images/a.png")]);
        if cfg!(feature = "mcap") {
            assert_eq!(files(&path("bag_1.mcap")), [path("bag_1.mcap")]);
            let bag = [folder.path().to_owned(), path("bag_0.mcap"), path("bag_1.mcap")];
            assert_eq!(files(folder.path()), bag);
        }
        assert_eq!(files(Path::new("-")), [Path::new("/dev/stdin")]);
        assert!(files(Path::new("demo")).is_empty());
    }

    /// The text of the error for options that do not fit a source.
    #[track_caller]
    fn refused(source: &str, options: OpenOptions<'_>) -> String {
        let error = SourceName::parse(source).open(options).err().expect("it is refused");
        assert_eq!(error.kind(), SourceErrorKind::Argument, "{error:#}");
        error.to_string()
    }

    #[test]
    fn a_camera_in_shared_memory_has_its_own_pace() {
        let rate = OpenOptions { rate: Some(Rate::Max), ..OpenOptions::default() };
        let repeat = OpenOptions { repeat: true, ..OpenOptions::default() };
        insta::assert_snapshot!(
            refused("shm:front", rate),
            @"a rate is for files and devices: a camera in shared memory has its own pace"
        );
        insta::assert_snapshot!(
            refused("shm:front", repeat),
            @"a loop is impossible: a camera in shared memory has its own pace"
        );
    }

    #[test]
    fn options_of_another_kind_of_source_are_refused() {
        let size = Some(ImageSize { width: 640, height: 480 });
        let format = Some(PixelFormat::Yuyv);
        let sized = OpenOptions { size, ..OpenOptions::default() };
        let error = refused("demo", sized);
        insta::assert_snapshot!(
            error,
            @"a size is for cameras and raw images, a format for raw images: omit them"
        );
        for source in ["drive.mcap", "shm:front", "drive/*.jpg"] {
            assert_eq!(refused(source, sized), error, "{source}");
        }
        insta::assert_snapshot!(refused("-", sized), @"a size without a format: raw images need both");
        let both = OpenOptions { size, format, ..OpenOptions::default() };
        let repeat = OpenOptions { repeat: true, ..OpenOptions::default() };
        if cfg!(feature = "v4l2") {
            insta::assert_snapshot!(
                refused("/dev/video0", both),
                @"a format is for raw images: of a camera, the format that fits best is taken"
            );
            insta::assert_snapshot!(
                refused("/dev/video0", repeat),
                @"a loop is impossible: a camera has no end to begin again at"
            );
        }
        insta::assert_snapshot!(
            refused("-", repeat),
            @"a loop is impossible: standard input cannot begin again"
        );
        let topic = OpenOptions { topic: Some("/a"), ..OpenOptions::default() };
        let camera_settings = CameraSettings { gain: Some(CameraSetting::Auto), ..CameraSettings::UNCHANGED };
        let set = OpenOptions { camera_settings, ..OpenOptions::default() };
        insta::assert_snapshot!(
            refused("demo", set),
            @"exposure and gain are for V4L2 cameras, such as /dev/video0"
        );
        insta::assert_snapshot!(
            refused("demo", topic),
            @"topic `/a` is for recordings: `demo` has no topics"
        );
    }

    #[test]
    fn a_missing_camera_is_waited_for_and_missing_files_are_not() {
        let missing = |source: &str| {
            let source = SourceName::parse(source);
            let error = source.open(OpenOptions::default()).err().expect("there is none");
            source.stand_in(OpenOptions::default(), error)
        };
        if cfg!(feature = "v4l2") {
            let mut camera = missing("/dev/video-of-nobody");
            assert!(camera.is_live());
            for _ in 0..2 {
                assert!(matches!(camera.fill(&mut Frame::default()), Fill::Nothing));
                assert!(camera.is_waiting());
            }
        }
        let mut folder = missing("/nonexistent/images");
        assert!(matches!(folder.fill(&mut Frame::default()), Fill::Broken(_)));
        assert!(matches!(folder.fill(&mut Frame::default()), Fill::End));
    }
}
