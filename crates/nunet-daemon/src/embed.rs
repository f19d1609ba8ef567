//! Parts that the Python package shares with nunetd besides the engine: reading images, calibrations and recordings, and
//! the texts and kinds of errors.

use std::path::Path;

use anyhow::Context as _;
use nunet_core::camera::{Calibration, Camera};
use nunet_engine::EngineErrorKind;
use nunet_ipc::FrameHeader;

use crate::exit::{self, is_usage};
use crate::source::{self, Frame};

/// The text of an error as `nunetd` prints it: one line per cause, then the hints.
#[must_use]
pub fn message(error: &anyhow::Error) -> String {
    let text = exit::chain_text(error);
    text.strip_prefix("error: ").unwrap_or(&text).trim_end().to_owned()
}

/// The kind of an error, which selects Python's exception. The innermost cause that has a kind decides.
#[must_use]
pub fn error_kind(error: &anyhow::Error) -> EngineErrorKind {
    let kinds = error.chain().filter_map(EngineErrorKind::of);
    let usage = || is_usage(error).then_some(EngineErrorKind::Argument);
    kinds.last().or_else(usage).unwrap_or(EngineErrorKind::Other)
}

/// Reads a `camera_info` file of ROS in YAML, as `--calibration` does.
///
/// # Errors
/// The file cannot be read or is not a calibration.
pub fn read_calibration(path: &Path) -> anyhow::Result<Calibration> {
    Ok(source::read_calibration(path)?)
}

/// A decoded file.
#[derive(Debug)]
pub struct ReadImage {
    /// RGB `[H, W, 3]`, upright.
    pub rgb: Vec<u8>,
    /// Width and height.
    pub size: nunet_types::ImageSize,
    /// A warning: it has 16 bits and uses only the lower ones.
    pub dim: Option<source::DimImages>,
}

/// Reads a JPEG or PNG file, as `nunetd infer` does.
///
/// # Errors
/// No such file, neither JPEG nor PNG, damaged, cut off, or larger than the limits.
pub fn read_image(path: &Path) -> anyhow::Result<ReadImage> {
    let mut frame = Frame::default();
    let decoded = source::decode(path, &mut frame)
        .with_context(|| format!("cannot read the image `{}`", path.display()))?;
    let place = format_args!("`{}`", path.display());
    let dim = source::BitDepthCheck::default().find(|| decoded.maximum_16_bit, place);
    Ok(ReadImage { rgb: frame.view()?.bytes().to_vec(), size: frame.size, dim })
}

/// The camera in the header of a message; `None` if it is unknown.
///
/// # Errors
/// Invalid intrinsics, or an unknown distortion model.
pub fn camera_of(header: &FrameHeader) -> anyhow::Result<Option<Camera>> {
    Ok(source::camera_in(header)?)
}

#[cfg(test)]
mod tests {
    use nunet_core::camera::CameraError;

    use super::*;
    use crate::exit::BadArguments;

    #[test]
    fn the_cause_decides_the_kind_whatever_context_it_has() {
        let camera = CameraError::Size { width: 0, height: 0 };
        let wrapped = Err::<(), _>(camera).context(BadArguments::new("cannot use the calibration"));
        assert_eq!(error_kind(&wrapped.unwrap_err()), EngineErrorKind::Camera);
        assert_eq!(error_kind(&BadArguments::new("no such camera").into()), EngineErrorKind::Argument);
        assert_eq!(error_kind(&anyhow::anyhow!("the disk is full")), EngineErrorKind::Other);
        let missing = std::io::Error::from(std::io::ErrorKind::NotFound);
        let missing = anyhow::Error::from(missing).context("cannot read `a`");
        assert_eq!(error_kind(&missing), EngineErrorKind::NotFound);
    }
}
