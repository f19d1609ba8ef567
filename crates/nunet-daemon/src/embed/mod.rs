//! The pipeline inside another program: what the Python package is made of.
//!
//! The same search for files, the same model check and the same pipeline as in `nunetd`'s verbs; the host brings
//! pictures and takes results.

mod player;

use std::path::Path;

use anyhow::Context as _;
use nunet_core::camera::{Calibration, Camera};
use nunet_core::depth::{ScaleSource, Units};
use nunet_core::graph::Quality;
use nunet_ipc::FrameHeader;

pub use crate::sink::files::{Results, write as write_results, write_cloud};
pub use nunet_engine::{EngineErrorKind, Inferred, Installation, Model, ModelOptions, Pooled};
pub use player::{Played, Player, Step};

use crate::exit::{NotFound, is_usage};
use crate::source::{self, Frame};
use crate::{exit, stream};

/// The text of a failure as `nunetd` prints it: one line a cause, then the hints.
#[must_use]
pub fn message(error: &anyhow::Error) -> String {
    let text = exit::chain_text(error);
    text.strip_prefix("error: ").unwrap_or(&text).trim_end().to_owned()
}

/// The kind of a failure, which decides about Python's exception. The innermost cause that has a kind decides.
#[must_use]
pub fn error_kind(error: &anyhow::Error) -> EngineErrorKind {
    if error.chain().any(|cause| cause.is::<NotFound>()) {
        return EngineErrorKind::NotFound;
    }
    let kinds = error.chain().filter_map(|cause| EngineErrorKind::of(cause));
    let usage = || is_usage(error).then_some(EngineErrorKind::Argument);
    kinds.last().or_else(usage).unwrap_or(EngineErrorKind::Other)
}

/// Reads ROS's `camera_info` in YAML, as `--calibration` does.
///
/// # Errors
/// A file that cannot be read or is no calibration.
pub fn read_calibration(path: &Path) -> anyhow::Result<Calibration> {
    stream::read_calibration(path)
}

/// Reads a JPEG or PNG file, as `nunetd infer` does: RGB `[H, W, 3]` with its width and height, upright.
///
/// # Errors
/// No such file, neither JPEG nor PNG, damaged, cut off, or larger than the limits.
pub fn read_image(path: &Path) -> anyhow::Result<(Vec<u8>, (u32, u32))> {
    let mut frame = Frame::default();
    source::decode(path, &mut frame)
        .with_context(|| format!("cannot read the image `{}`", path.display()))?;
    Ok((frame.view()?.bytes().to_vec(), frame.size))
}

/// The camera that a message tells of; `None` where its sender does not know it.
///
/// # Errors
/// Numbers that no camera has, or a lens model without a meaning.
pub fn camera_of(header: &FrameHeader) -> anyhow::Result<Option<Camera>> {
    source::camera_in(header)
}

/// Says in a message what is known of its camera, which must be one of the message's size.
pub fn set_camera(header: &mut FrameHeader, camera: &Camera) {
    header.set_camera(&camera.into());
}

/// The contract's word for a unit.
#[must_use]
pub fn units_name(units: Units) -> &'static str {
    units.name()
}

/// The contract's word for where a scale comes from.
#[must_use]
pub fn scale_source_name(source: ScaleSource) -> &'static str {
    source.name()
}

/// The contract's word for whether a stage was skipped.
#[must_use]
pub fn quality_name(quality: Quality) -> &'static str {
    quality.name()
}

/// The depths of the reddest and the bluest colour: where one is not given, the map's own first or last percentile. A map
/// without any depth has no own ones, and gets some that are in order.
#[must_use]
pub fn colour_range(depth: &[f32], near: Option<f32>, far: Option<f32>) -> (f32, f32) {
    match (near, far) {
        (Some(near), Some(far)) => (near, far),
        (Some(near), None) if !depth.iter().any(|value| value.is_finite()) => (near, near + 1.0),
        (None, Some(far)) if !depth.iter().any(|value| value.is_finite()) => (far - 1.0, far),
        (near, far) => {
            let own = crate::sink::files::range(depth);
            (near.unwrap_or(own.0), far.unwrap_or(own.1))
        }
    }
}

/// Depth in the colours of `depth.png`, without its scale: `[H, W, 3]`, RGB, near is red, far is blue, no depth is
/// grey.
///
/// Colours are spread from `near` to `far`: see [`colour_range`].
///
/// # Panics
/// `depth` does not hold `width * height` numbers.
#[must_use]
pub fn colours(depth: &[f32], (width, height): (u32, u32), (near, far): (f32, f32)) -> Vec<u8> {
    assert_eq!(depth.len(), width as usize * height as usize, "a depth map of another size");
    crate::sink::files::paint(depth, (width, height), (near, far)).into_raw()
}

#[cfg(test)]
mod tests {
    use nunet_core::camera::CameraError;

    use super::*;
    use crate::exit::BadArguments;

    #[test]
    fn the_cause_decides_about_the_kind_whatever_context_it_has() {
        let camera = CameraError::Size { width: 0, height: 0 };
        let wrapped = Err::<(), _>(camera).context(BadArguments("cannot use the calibration".into()));
        assert_eq!(error_kind(&wrapped.unwrap_err()), EngineErrorKind::Camera);
        assert_eq!(error_kind(&BadArguments("no such camera".into()).into()), EngineErrorKind::Argument);
        assert_eq!(error_kind(&NotFound("no file `a`".into()).into()), EngineErrorKind::NotFound);
        assert_eq!(error_kind(&anyhow::anyhow!("the disk is full")), EngineErrorKind::Other);
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        let missing = anyhow::Error::from(missing).context("cannot read `a`");
        assert_eq!(error_kind(&missing), EngineErrorKind::NotFound);
    }
}
