//! The calibration file that holds the factor.

use std::io::Write as _;
use std::path::Path;

use nunet_core::camera::{Calibration, Camera, ScaleNote};
use nunet_core::plain_file;
use nunet_files::write_whole;
use nunet_source::Rotation;

use super::{Agreement, CalibrateError, Calibrator};
use crate::error::EvalError;

impl Calibrator {
    /// The camera of the images before they were rotated, which a calibration describes.
    fn stored_camera(&self, camera: &Camera) -> Result<Camera, CalibrateError> {
        let rotation = self.resolver.rotation().map(Rotation::inverse);
        Ok(rotation.map_or(Ok(*camera), |rotation| rotation.camera(camera))?)
    }

    /// Writes a factor into the calibration file `out`: the text of the file `named`, which may be `out`
    /// itself, otherwise the intrinsics of the last image that has some. `model` has the name of the model
    /// and its SHA-256, hexadecimal.
    ///
    /// # Errors
    /// No intrinsics, a file that the factor cannot be added to, or a failure of the system. Nothing is
    /// written then.
    pub fn write_calibration(
        &self,
        out: &Path,
        named: Option<&Path>,
        found: &Agreement,
        model: (&str, &str),
    ) -> Result<(), CalibrateError> {
        let text = match (named, self.camera()) {
            (Some(path), _) => plain_file::read_marked_text(path, Calibration::MAX_BYTES as u64)
                .map_err(EvalError::read(path))?,
            (None, Some(camera)) => Calibration::file_of(&self.stored_camera(camera)?),
            (None, None) => return Err(CalibrateError::NoIntrinsics),
        };
        let note = ScaleNote {
            factor: found.factor,
            spread: found.spread,
            agreeing: found.agreeing,
            aspect: self.pipeline.aspect(),
            model: model.0.to_owned(),
            model_sha256: model.1.to_owned(),
        };
        let unwritable = |source| CalibrateError::Calibration { path: out.to_owned(), source };
        let text = note.written_into(&text).map_err(unwritable)?;
        Ok(write_whole(out, |file| Ok(file.write_all(text.as_bytes())?)).map_err(EvalError::from)?)
    }
}
