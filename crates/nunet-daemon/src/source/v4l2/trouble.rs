//! What can be wrong with a camera, in words.

use std::path::PathBuf;

use super::device::{Errno, FourCc, Host};

/// Why there are no pictures.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub(super) enum Trouble {
    #[error("it is not there")]
    Missing,
    #[error(
        "this user may not open it\nhint: add the user to the device's group, usually `video`: sudo usermod -aG video \
         USER, then log in again"
    )]
    Forbidden,
    #[error("another program uses it\nhint: `fuser -v /dev/video*` names the program")]
    Busy,
    #[error("the USB bus has no room for its pictures\nhint: a smaller --size or --rate, or another port")]
    NoBandwidth,
    #[error("it sends no pictures")]
    Stalled,
    #[error("it is no video device of V4L2")]
    NoVideo,
    #[error(
        "`{name}` captures no pictures here\nhint: a camera may have several devices: `nunetd doctor` lists those that \
         capture"
    )]
    NoCapture { name: String },
    #[error(
        "`{name}` captures {what}, which is not read here\nhint: pipe its pictures in with --source -, by ffmpeg or \
         GStreamer"
    )]
    OtherCapture { name: String, what: &'static str },
    #[error(
        "it offers {}; expected one of {}\nhint: pipe its pictures in with --source -, by ffmpeg or GStreamer",
        Letters(offered),
        Letters(readable)
    )]
    NoFormat { offered: Vec<FourCc>, readable: Vec<FourCc> },
    #[error("asked for {asked}, its driver chose {got}")]
    OtherFormat { asked: FourCc, got: FourCc },
    #[error("its driver chose pictures of {}x{} with rows {row_stride} bytes apart, which cannot be", size.0, size.1)]
    NoLayout { size: (u32, u32), row_stride: u32 },
    #[error("cannot {step}: {errno}")]
    Failed { step: &'static str, errno: Errno },
}

impl Trouble {
    /// What an error means, whatever step it came from.
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

    /// With what the user can do about it at start.
    pub(super) fn with_hint(self, host: &dyn Host) -> anyhow::Error {
        match self {
            Self::Missing | Self::NoVideo => {
                anyhow::anyhow!("{self}\nhint: {}", what_is_there(&host.nodes()))
            }
            trouble => trouble.into(),
        }
    }
}

fn what_is_there(nodes: &[PathBuf]) -> String {
    if nodes.is_empty() {
        return "this machine has no /dev/video* at all: is the camera plugged in, and, in a container, passed in \
                (--device)?"
            .into();
    }
    let shown: Vec<_> = nodes.iter().map(|path| format!("`{}`", path.display())).collect();
    format!("there are {}; `nunetd doctor` says which are cameras", shown.join(", "))
}

/// Formats in a sentence.
struct Letters<'a>(&'a [FourCc]);

impl std::fmt::Display for Letters<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let all: Vec<_> = self.0.iter().map(FourCc::to_string).collect();
        if all.is_empty() { f.write_str("no format") } else { f.write_str(&all.join(", ")) }
    }
}
