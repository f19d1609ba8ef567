//! The hints of the errors of an evaluation.

use std::borrow::Cow;
use std::error::Error as _;

use nunet_source::SourceError;
use nunet_types::Hint;

use crate::error::EvalError;
use crate::error_kind::EvalErrorKind;
use crate::far_truth;

impl EvalError {
    /// The error that a transparent variant shows. It is not in the chain of causes itself.
    fn transparent(&self) -> Option<&dyn Hint> {
        Some(match self {
            Self::Source(error) => error,
            Self::Pipeline(error) => error,
            Self::Frame(error) => error,
            Self::Obstacles(error) => error,
            Self::Camera(error) => error,
            Self::Files(error) => error,
            _ => return None,
        })
    }
}

impl Hint for EvalError {
    fn setting(&self) -> Option<&'static str> {
        match self {
            Self::Source(error) => error.setting(),
            _ => None,
        }
    }

    fn hint(&self) -> Option<Cow<'static, str>> {
        Some(match self {
            Self::NotADataset { .. } => {
                "pass a recording, or a folder with rgb/ID.jpg or .png and depth/ID.png or .npy".into()
            }
            Self::OwnDepth { .. } => "name the topic of the depth to compare the model with it anyway".into(),
            Self::NoPairs { .. } => "name the topics of the images and of the depth".into(),
            Self::NotAMeanImage { .. } => {
                "pass float32 (H, W), in meters, such as the `mean_image.npy` of another evaluation".into()
            }
            Self::UnknownUnit { .. } => "state the meters per unit of the depth images".into(),
            Self::FixedUnit { .. } => "state scale and offset only for depth of integers (16UC1, PNG)".into(),
            Self::Size { is_labels: false, .. } => "use depth that is aligned to the color image".into(),
            Self::Size { .. } => "use labels of the size of the color image".into(),
            Self::UnknownLabel { is_nyu40, .. } => label_hint(*is_nyu40).into(),
            Self::ProtocolSize { .. } => "compare whole images, with the protocol `full`".into(),
            Self::NoMount { .. } => {
                "state one mount for all images, or a row `id,x,y,z,roll,pitch,yaw` for each".into()
            }
            Self::NoMountOfImage { .. } => {
                "write each id as the image's name without its extension, also with leading \
                 zeros, or state one mount for all images"
                    .into()
            }
            Self::Mounts { hint, .. } => return hint.clone(),
            Self::NoTruth => "check window and protocol, which exclude parts; 0 and NaN mean no depth".into(),
            Self::TruthOutOfRange { far_m, is_meters, .. } => far_truth::hint(*far_m, *is_meters),
            Self::Source(_)
            | Self::Pipeline(_)
            | Self::Frame(_)
            | Self::Obstacles(_)
            | Self::Camera(_)
            | Self::Files(_) => return self.transparent()?.hint(),
            Self::NoImages { .. }
            | Self::Ids(_)
            | Self::ReadImage { .. }
            | Self::NoPartner { .. }
            | Self::NoMean { .. }
            | Self::MeanSize { .. }
            | Self::NoMeters
            | Self::NothingMeasured { .. }
            | Self::System { .. } => return None,
        })
    }

    fn is_usage(&self) -> bool {
        self.kind() == EvalErrorKind::Argument
    }
}

fn label_hint(is_nyu40: bool) -> &'static str {
    if is_nyu40 {
        "count NYU's classes from 0; 39 is \"otherprop\" or unlabeled"
    } else {
        "`labels/` holds the network's own classes; put NYU's 40 classes into `label40/`"
    }
}

/// The hint of the error or of its cause.
pub(crate) fn hint_of_chain(error: &EvalError) -> Option<String> {
    let of_source = || error.source()?.downcast_ref::<SourceError>()?.hint();
    error.hint().or_else(of_source).map(Cow::into_owned)
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::image_name::ImageName;

    #[test]
    fn the_hint_of_a_cause_is_found() {
        let source = SourceError::bad_frame("it is too large").with_hint("make it smaller");
        let error = EvalError::ReadImage { image: ImageName::from(Path::new("a.png")).into(), source };
        assert_eq!(hint_of_chain(&error).as_deref(), Some("make it smaller"));
    }

    #[test]
    fn depth_and_labels_of_another_size_have_hints_of_their_own() {
        let (image, got, expected) = (ImageName::File("a.png".into()), (8, 4).into(), (640, 480).into());
        let hint = |is_labels| {
            let error = EvalError::Size { image: image.clone(), got, expected, is_labels };
            error.hint().unwrap()
        };
        let (depth, labels) = (hint(false), hint(true));
        assert!(depth.contains("depth") && labels.contains("labels") && !labels.contains("depth"));
    }

    #[test]
    fn millimeters_in_floating_point_have_a_hint_of_their_own() {
        let hint = |is_meters| {
            let (from_m, cap_m, near_m, far_m) = (0.001, 10.0, 5000.0, 7000.0);
            let error = EvalError::TruthOutOfRange { from_m, cap_m, near_m, far_m, is_meters };
            error.hint().unwrap().into_owned()
        };
        assert!(hint(true).contains("millimeters") && hint(false).contains("unit"));
    }
}
