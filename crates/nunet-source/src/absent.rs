//! Kinds of sources that this build was made without.

use crate::error::SourceError;
use crate::source_type::{Properties, SourceType};
use crate::{OpenOptions, Source};

/// A kind of source that needs a Cargo feature which this build does not have. Its names are refused, because
/// they would otherwise count as missing image files.
pub(crate) struct Absent {
    /// How its names begin.
    pub(crate) prefixes: &'static [&'static str],
    /// What cannot be read.
    pub(crate) what: &'static str,
    /// The Cargo features of which one is needed.
    pub(crate) features: &'static str,
}

#[cfg(not(feature = "v4l2"))]
pub(crate) const CAMERAS: Absent = Absent {
    prefixes: &["/dev/video", "/dev/v4l/", "/dev/nunet/"],
    what: "V4L2 cameras",
    features: "`v4l2`",
};

#[cfg(not(feature = "ros2"))]
pub(crate) const ROS2_TOPICS: Absent =
    Absent { prefixes: &["ros2:"], what: "ROS 2 topics", features: "`ros2-dds` or `ros2-zenoh`" };

impl Absent {
    fn error(&self) -> SourceError {
        SourceError::bad_arguments(format!("this build does not read {}", self.what))
            .with_hint(format!("build it with the Cargo feature {}", self.features))
    }
}

impl SourceType for Absent {
    fn is_named(&self, name: &str) -> bool {
        self.prefixes.iter().any(|prefix| name.starts_with(prefix))
    }

    fn properties(&self) -> Properties {
        Properties { camera: "camera", ..Properties::default() }
    }

    fn open(&self, _name: &str, _options: OpenOptions<'_>) -> Result<Box<dyn Source>, SourceError> {
        Err(self.error())
    }

    fn check(&self, _name: &str) -> Result<(), SourceError> {
        Err(self.error())
    }
}

/// Reports that no camera can be found.
#[cfg(not(feature = "v4l2"))]
#[must_use]
pub fn cameras() -> Vec<crate::CameraReport> {
    let offer = Ok(format!("{} (Cargo feature {})", CAMERAS.error(), CAMERAS.features));
    vec![crate::CameraReport { path: "/dev/video*".into(), offer }]
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;
    use crate::{SourceErrorKind, SourceName};

    #[test]
    fn a_source_that_this_build_does_not_read_is_refused_with_the_feature_that_reads_it() {
        let kinds = [("ros2:/a", "`ros2-dds`", cfg!(feature = "ros2"))];
        let kinds = kinds.into_iter().chain([("/dev/video0", "`v4l2`", cfg!(feature = "v4l2"))]);
        for (name, feature, _) in kinds.filter(|(_, _, is_read)| !is_read) {
            let error = SourceName::parse(name).check(&OpenOptions::default()).unwrap_err();
            assert_eq!(error.kind(), SourceErrorKind::Argument, "{name}");
            assert!(error.hint().unwrap().contains(feature), "{name}");
        }
    }

    #[cfg(not(feature = "v4l2"))]
    #[test]
    fn a_report_without_v4l2_says_why_there_are_no_cameras() {
        let [report]: [_; 1] = cameras().try_into().unwrap();
        assert!(report.offer.unwrap().contains("`v4l2`"));
    }
}
