//! Errors of a camera.

use std::borrow::Cow;
use std::path::PathBuf;

use nunet_types::{Hint, ImageSize};

use super::device::{Errno, FourCc, Host};

/// Why there are no images.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum CameraFault {
    #[error("it does not exist")]
    Missing,
    #[error("this user may not open it")]
    Forbidden,
    #[error("another program uses it")]
    Busy,
    #[error("the USB bus has no room for its images")]
    NoBandwidth,
    #[error("it sends no images")]
    Stalled,
    #[error("it is not a video device of V4L2")]
    NoVideo,
    #[error("`{name}` captures no images here")]
    NoCapture { name: String },
    #[error("`{name}` captures {what}, which cannot be read")]
    OtherCapture { name: String, what: &'static str },
    #[error("it offers {}; expected one of {}", Letters(offered), Letters(readable))]
    NoFormat { offered: Vec<FourCc>, readable: Vec<FourCc> },
    #[error("asked for {asked}, its driver chose {got}")]
    OtherFormat { asked: FourCc, got: FourCc },
    #[error("its driver chose images of {size} with rows {row_stride} bytes apart, which is impossible")]
    NoLayout { size: ImageSize, row_stride: u32 },
    #[error("it has no control for {what}")]
    NoControl { what: &'static str },
    #[error("it takes {what} from {least} to {most}{unit}, not {given}{unit}")]
    OutOfRange { what: &'static str, given: u32, least: i64, most: i64, unit: &'static str },
    #[error("cannot {step}: {errno}")]
    Failed { step: &'static str, errno: Errno },
}

impl Hint for CameraFault {
    fn hint(&self) -> Option<Cow<'static, str>> {
        let hint = match self {
            Self::Forbidden => {
                "add the user to the device's group, usually `video`: sudo usermod -aG video USER, then log in again"
            }
            Self::Busy => "`fuser -v /dev/video*` names the program",
            Self::NoBandwidth => "choose a smaller size or rate, or another port",
            Self::NoCapture { .. } => {
                "a camera may have several devices: `nunetd doctor` lists those that capture"
            }
            Self::OtherCapture { .. } | Self::NoFormat { .. } => {
                "pipe its images into standard input, with ffmpeg or GStreamer"
            }
            Self::NoControl { .. } | Self::OutOfRange { .. } => "`v4l2-ctl --list-ctrls` lists its controls",
            _ => return None,
        };
        Some(hint.into())
    }
}

impl CameraFault {
    /// Converts an error of the system; `step` is what failed.
    pub(super) fn at(step: &'static str) -> impl Fn(Errno) -> Self {
        move |errno| match errno {
            Errno::NOENT | Errno::NODEV | Errno::NXIO => Self::Missing,
            Errno::ACCESS | Errno::PERM => Self::Forbidden,
            Errno::BUSY => Self::Busy,
            Errno::NOSPC => Self::NoBandwidth,
            Errno::NOTTY => Self::NoVideo,
            errno => Self::Failed { step, errno },
        }
    }

    /// Whether other arguments would fix it.
    pub(super) fn is_argument(&self) -> bool {
        matches!(self, Self::NoControl { .. } | Self::OutOfRange { .. })
    }

    /// The hint for an error at startup.
    pub(super) fn hint_on(&self, host: &dyn Host) -> Option<Cow<'static, str>> {
        match self {
            Self::Missing | Self::NoVideo => Some(what_is_there(&host.nodes()).into()),
            fault => fault.hint(),
        }
    }
}

fn what_is_there(nodes: &[PathBuf]) -> String {
    if nodes.is_empty() {
        return "this machine has no /dev/video*: plug the camera in or, in a container, pass it in (--device)".into();
    }
    let shown: Vec<_> = nodes.iter().map(|path| format!("`{}`", path.display())).collect();
    format!("the devices are {}; `nunetd doctor` lists those that are cameras", shown.join(", "))
}

/// Formats, separated by commas.
struct Letters<'a>(&'a [FourCc]);

impl std::fmt::Display for Letters<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let all: Vec<_> = self.0.iter().map(FourCc::to_string).collect();
        if all.is_empty() { f.write_str("no format") } else { f.write_str(&all.join(", ")) }
    }
}
