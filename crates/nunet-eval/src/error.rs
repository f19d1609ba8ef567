//! The errors of an evaluation.

use std::borrow::Cow;
use std::error::Error;
use std::io;
use std::path::{Path, PathBuf};

use nunet_core::camera::CameraError;
use nunet_core::frame::FrameError;
use nunet_core::obstacle::ObstacleError;
use nunet_core::pipeline::PipelineError;
use nunet_files::FilesError;
use nunet_source::{SourceError, SourceErrorKind};
use nunet_types::ImageSize;

pub use crate::error_kind::EvalErrorKind;
use crate::image_name::ImageName;
use crate::metrics::IGNORE;

/// The error of a library below this one.
pub(crate) type Cause = Box<dyn Error + Send + Sync>;

/// Why an image, or a whole dataset, could not be measured.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum EvalError {
    /// Neither a folder of images and depth nor a recording.
    #[error("`{}` is not a dataset: it has no folder `{missing}`", path.display())]
    NotADataset {
        /// The folder.
        path: PathBuf,
        /// What is missing.
        missing: &'static str,
    },
    /// A folder without any image.
    #[error("`{}` has no images", path.display())]
    NoImages {
        /// The folder.
        path: PathBuf,
    },
    /// A recording of nunetd: compared with its own depth, the same network would have no error.
    #[error("`{}` was written by nunetd: its depth is a prediction of `{model:.60}`, not truth", path.display())]
    OwnDepth {
        /// The recording.
        path: PathBuf,
        /// The model whose depth it is.
        model: String,
    },
    /// A recording whose images and depth do not belong together.
    #[error("`{}` has no image with depth within {apart_ms} ms of it", path.display())]
    NoPairs {
        /// The recording.
        path: PathBuf,
        /// The largest difference of time stamps.
        apart_ms: u64,
    },
    /// A list of ids that cannot be used.
    #[error("{0}")]
    Ids(String),
    /// A file that is not a mean image.
    #[error("`{}` is not a mean image: {reason}", path.display())]
    NotAMeanImage {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
    },
    /// An image of the dataset cannot be read.
    #[error("cannot read the image {image}")]
    ReadImage {
        /// The image.
        image: Box<ImageName>,
        /// Why.
        source: SourceError,
    },
    /// Two images that belong together have different sizes.
    #[error("{image} is {got}, its image {expected}")]
    Size {
        /// The depth or labels.
        image: ImageName,
        /// Its size.
        got: ImageSize,
        /// The size of the image.
        expected: ImageSize,
        /// Whether these are labels.
        is_labels: bool,
    },
    /// A depth image of 8 bits, whose unit is not known.
    #[error("{depth}: depth of 8 bits cannot be millimeters")]
    UnknownUnit {
        /// The depth image.
        depth: ImageName,
    },
    /// A unit was stated for depth in floating point, which is in meters.
    #[error("{depth} is floating point, so it is in meters: it has no other scale and no offset")]
    FixedUnit {
        /// The depth image or its topic.
        depth: String,
    },
    /// An image without depth near in time, or depth without an image.
    #[error("`{folder}/` has no file that is named `{id}` or within {apart_ms} ms of it")]
    NoPartner {
        /// The folder without it.
        folder: &'static str,
        /// The id.
        id: String,
        /// The largest difference of time stamps.
        apart_ms: u64,
    },
    /// A true label that is not a class.
    #[error("`{}`: the label {label}; expected 0 to {last}, or {IGNORE} for none", path.display())]
    UnknownLabel {
        /// The file.
        path: PathBuf,
        /// The label.
        label: u16,
        /// The last class.
        last: usize,
        /// Whether the labels are NYU's 40 classes, or else the network's own.
        is_nyu40: bool,
    },
    /// Images of different sizes have no mean.
    #[error("images of {first} and of {other} have no mean image")]
    NoMean {
        /// The size of the first image.
        first: ImageSize,
        /// Another size.
        other: ImageSize,
    },
    /// The mean image has another size than an image.
    #[error("the mean image is {mean}, this image {image}")]
    MeanSize {
        /// The size of the mean image.
        mean: ImageSize,
        /// The size of the image.
        image: ImageSize,
    },
    /// The protocol is for images of another size.
    #[error("protocol `eigen` is for images of 640x480, this one is {size}")]
    ProtocolSize {
        /// The size of the image.
        size: ImageSize,
    },
    /// Obstacles need the camera's mount.
    #[error("obstacles need the pose of the camera on the robot, and `{}` has no `mounts.csv`", path.display())]
    NoMount {
        /// The dataset.
        path: PathBuf,
    },
    /// An image without a row in `mounts.csv`.
    #[error("`mounts.csv` has no row for the image `{id:.60}`, only for others such as `{other:.60}`")]
    NoMountOfImage {
        /// The image.
        id: String,
        /// An image with a row.
        other: String,
    },
    /// A file of mounts that cannot be used.
    #[error("cannot use `{}`: {reason}", path.display())]
    Mounts {
        /// The file.
        path: PathBuf,
        /// Why not.
        reason: String,
        /// What to change.
        hint: Option<Cow<'static, str>>,
    },
    /// Obstacles of a network whose depth has no unit.
    #[error("obstacles need depth in meters, and the model's depth has no unit")]
    NoMeters,
    /// The options of obstacles are invalid.
    #[error(transparent)]
    Obstacles(#[from] ObstacleError),
    /// The camera does not fit the image.
    #[error(transparent)]
    Camera(#[from] CameraError),
    /// No image has true depth in the compared region.
    #[error("no image has true depth where depth is compared")]
    NoTruth,
    /// All true depth is outside of what is compared.
    #[error(
        "no true depth is between {from_m} and {cap_m} m, where depth is compared: it is {near_m} to {far_m} m"
    )]
    TruthOutOfRange {
        /// Depth is compared from here on, in meters.
        from_m: f32,
        /// Depth is compared up to here, in meters.
        cap_m: f32,
        /// The nearest true depth, in meters.
        near_m: f32,
        /// The farthest true depth, in meters.
        far_m: f32,
        /// Whether the dataset states meters (floating point), so that no other unit can be stated.
        is_meters: bool,
    },
    /// No image could be measured; the last error.
    #[error("no image could be measured")]
    NothingMeasured {
        /// The last error.
        source: Box<EvalError>,
    },
    /// The recording, the calibration or the camera cannot be used.
    #[error(transparent)]
    Source(#[from] SourceError),
    /// The network did not run.
    #[error(transparent)]
    Pipeline(#[from] PipelineError),
    /// An image whose numbers do not fit its size.
    #[error(transparent)]
    Frame(#[from] FrameError),
    /// Files cannot be written.
    #[error(transparent)]
    Files(#[from] FilesError),
    /// An operation of the system failed, or a file is damaged.
    #[error("{action}")]
    System {
        /// The failed operation: `cannot ...`.
        action: String,
        /// Why it failed.
        source: Cause,
    },
}

impl EvalError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> EvalErrorKind {
        match self {
            Self::NotADataset { .. }
            | Self::NoImages { .. }
            | Self::OwnDepth { .. }
            | Self::Ids(_)
            | Self::FixedUnit { .. }
            | Self::NoMount { .. }
            | Self::NoMeters
            | Self::Mounts { .. }
            | Self::Obstacles(_)
            | Self::NotAMeanImage { .. } => EvalErrorKind::Argument,
            Self::Source(error) if error.kind() == SourceErrorKind::Argument => EvalErrorKind::Argument,
            Self::NoPairs { .. } | Self::NoTruth | Self::TruthOutOfRange { .. } => EvalErrorKind::Truth,
            Self::NothingMeasured { source } => source.kind(),
            Self::Pipeline(_) => EvalErrorKind::Model,
            Self::Files(_) | Self::System { .. } => EvalErrorKind::System,
            Self::Source(_)
            | Self::ReadImage { .. }
            | Self::Size { .. }
            | Self::UnknownUnit { .. }
            | Self::NoPartner { .. }
            | Self::UnknownLabel { .. }
            | Self::NoMean { .. }
            | Self::MeanSize { .. }
            | Self::ProtocolSize { .. }
            | Self::NoMountOfImage { .. }
            | Self::Camera(_)
            | Self::Frame(_) => EvalErrorKind::Image,
        }
    }

    /// For `map_err`: `action` failed.
    pub(crate) fn system<E: Into<Cause>>(action: impl Into<String>) -> impl FnOnce(E) -> Self {
        let action = action.into();
        move |error| Self::System { action, source: error.into() }
    }

    /// For `map_err`: `path` cannot be listed.
    pub(crate) fn list(path: &Path) -> impl Fn(io::Error) -> Self {
        move |error| Self::system(format!("cannot list the folder `{}`", path.display()))(error)
    }

    /// For `map_err`: `path` cannot be read.
    pub(crate) fn read<E: Into<Cause>>(path: &Path) -> impl Fn(E) -> Self {
        move |error| Self::system(format!("cannot read `{}`", path.display()))(error)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_error_has_the_kind_of_what_failed() {
        let path = || PathBuf::from("a");
        let wrong = || EvalError::from(SourceError::bad_arguments("no such topic"));
        let unit = EvalError::FixedUnit { depth: "`/depth`".into() };
        let cases = [
            (unit, EvalErrorKind::Argument),
            (EvalError::NoImages { path: path() }, EvalErrorKind::Argument),
            (wrong(), EvalErrorKind::Argument),
            (EvalError::from(SourceError::bad_frame("cut off")), EvalErrorKind::Image),
            (EvalError::NothingMeasured { source: wrong().into() }, EvalErrorKind::Argument),
            (EvalError::UnknownUnit { depth: ImageName::File(path()) }, EvalErrorKind::Image),
            (EvalError::NoTruth, EvalErrorKind::Truth),
        ];
        for (error, kind) in cases {
            assert_eq!(error.kind(), kind, "{error}");
        }
    }
}
