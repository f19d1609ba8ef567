//! Which camera a frame was taken with: what the user said, else what the source knows.

use std::io::{self, ErrorKind, Read as _};
use std::path::Path;

use anyhow::Context as _;
use nunet_core::camera::{Calibration, Camera, CameraError, IntrinsicsSpec};
use nunet_core::depth::ScaleSource;
use nunet_core::pipeline::Pipeline;
use nunet_core::plain_file;
use tracing::warn;

use crate::cli::GeometryArgs;
use crate::exit::{BadArguments, WithHint};
use crate::source::Frame;

/// The camera of a stream's frames, followed from frame to frame.
#[derive(Debug, Default)]
pub(crate) struct Optics {
    named: Option<Named>,
    told: Option<Key>,
    warned: bool,
}

/// What the user said of the camera.
#[derive(Debug)]
enum Named {
    Intrinsics(IntrinsicsSpec),
    Calibration(Calibration),
}

impl Named {
    fn at_size(&self, (width, height): (u32, u32)) -> Result<Camera, CameraError> {
        match self {
            Self::Intrinsics(spec) => spec.at_size(width, height).map(Camera::pinhole),
            Self::Calibration(calibration) => calibration.at_size(width, height),
        }
    }
}

/// What the camera depends on.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Key {
    size: (u32, u32),
    camera: Option<Camera>,
}

impl Optics {
    /// A camera that the user named comes before that of the source.
    ///
    /// # Errors
    /// A calibration file that cannot be read or is none.
    pub(crate) fn new(geometry: &GeometryArgs) -> anyhow::Result<Self> {
        let named = match (&geometry.calibration, geometry.intrinsics) {
            (Some(path), _) => Some(Named::Calibration(read_calibration(path)?)),
            (None, intrinsics) => intrinsics.map(Named::Intrinsics),
        };
        Ok(Self { named, told: None, warned: false })
    }

    /// The camera that took `frame`, at the frame's size; `None` when nobody knows it.
    ///
    /// # Errors
    /// The named camera does not fit the frame's size.
    pub(crate) fn camera_of(&self, frame: &Frame) -> Result<Option<Camera>, CameraError> {
        let named = self.named.as_ref().map(|named| named.at_size(frame.size)).transpose()?;
        Ok(named.or(frame.camera))
    }

    /// Tells the pipeline of a camera that is another than the last frame's, and the user, once, of a guess.
    ///
    /// # Errors
    /// A camera that does not fit the frame's or the network's size; the next frame tries again.
    pub(crate) fn follow(&mut self, frame: &Frame, pipeline: &mut Pipeline) -> anyhow::Result<()> {
        let key = Key { size: frame.size, camera: frame.camera };
        if self.told == Some(key) {
            return Ok(());
        }
        let camera = self.camera_of(frame)?;
        pipeline.set_camera(camera)?;
        self.told = Some(key);
        if camera.is_none() && !std::mem::replace(&mut self.warned, true) {
            let training_camera = pipeline.graph().description().camera.is_some();
            let guess = match pipeline.scale().source {
                ScaleSource::AssumedCamera => "metres and points assume the training camera",
                _ if training_camera => "points assume the training camera",
                _ => "points assume a camera of 60 degrees from left to right",
            };
            warn!("no intrinsics: {guess}\nhint: --intrinsics fx,fy,cx,cy or --calibration FILE.yaml");
        }
        Ok(())
    }
}

/// Reads a calibration that the user named.
///
/// # Errors
/// A file that cannot be read or is no calibration.
pub(crate) fn read_calibration(path: &Path) -> anyhow::Result<Calibration> {
    let path_shown = path.display();
    let text = read_start(path).map_err(|error| {
        let message = format!("cannot read the calibration `{path_shown}`");
        WithHint::usage(message, "pass a ROS `camera_info` file in YAML").because(error)
    })?;
    let calibration = Calibration::parse(&text)
        .with_context(|| BadArguments(format!("cannot use the calibration `{path_shown}`")))?;
    if let Some(skew) = calibration.ignored_skew() {
        warn!("calibration `{path_shown}`: {skew}");
    }
    Ok(calibration)
}

/// No more than tells that a file is too long, whatever it is. What is not UTF-8 is for the parser to refuse.
fn read_start(path: &Path) -> io::Result<String> {
    let Some(mut file) = plain_file::open(path, Calibration::MAX_BYTES as u64 + 1)? else {
        return Err(io::Error::new(ErrorKind::InvalidInput, "it is not a plain file"));
    };
    let mut bytes = Vec::new();
    file.read_to_end(&mut bytes)?;
    Ok(String::from_utf8_lossy(&bytes).into_owned())
}
