//! The pipeline for another camera, or for images of another size.

use nunet_types::ImageSize;

use super::lens::Lens;
use super::{Pipeline, PipelineError, PipelineOptions};
use crate::camera::{CalibratedScale, Camera};
use crate::depth::ScaleSource;
use crate::framing::{AspectMismatch, AspectMode, Framing};

impl Pipeline {
    /// Sets the camera of the frames from now on; `None` if it is not known.
    ///
    /// Without a camera, points and meters are those of an assumed one: the training camera, else a webcam
    /// with a horizontal field of view of 60 degrees. Computes the table of rays again.
    ///
    /// # Errors
    /// A camera that cannot be scaled to the network's size.
    pub fn set_camera(&mut self, camera: Option<Camera>) -> Result<(), PipelineError> {
        let options = PipelineOptions { camera, ..self.options };
        let size = camera.map_or(self.framing().image(), |camera| camera.intrinsics.size());
        self.set_framing(Framing::new(options.aspect, size, self.network.graph.size()), options)
    }

    /// Prepares for images of another size: which part of them the network sees, and the camera of that part.
    /// [`Self::process`] does it too. Called before, the camera of the results is known before the first
    /// frame.
    ///
    /// # Errors
    /// A camera that cannot be scaled to this size.
    pub fn fit_to(&mut self, image: ImageSize) -> Result<(), PipelineError> {
        let framing = Framing::new(self.options.aspect, image, self.network.graph.size());
        if framing == *self.framing() {
            return Ok(());
        }
        let is_whole = |framing: &Framing| !framing.is_cropped() && !framing.is_padded();
        if is_whole(&framing) && is_whole(self.framing()) {
            self.network.set_framing(framing); // the camera of the results is the same
            return Ok(());
        }
        self.set_framing(framing, self.options)
    }

    fn set_framing(&mut self, framing: Framing, options: PipelineOptions) -> Result<(), PipelineError> {
        self.lens = Lens::new(&options, &framing, &mut self.network.graph)?;
        self.network.set_framing(framing);
        self.set_options(options)
    }

    /// What is done with images of another aspect ratio than the network's.
    #[must_use]
    pub fn aspect(&self) -> AspectMode {
        self.options.aspect
    }

    /// Which part of the image the results cover.
    #[must_use]
    pub fn framing(&self) -> &Framing {
        self.network.framing()
    }

    /// Whether the calibrated factor, if it is used, was measured with images that were taken in another way
    /// than the last ones. `scale` is where the factor comes from.
    #[must_use]
    pub fn aspect_mismatch(&self, scale: &CalibratedScale) -> Option<AspectMismatch> {
        let is_used = self.scale().source == ScaleSource::Calibrated;
        AspectMismatch::of(scale, self.aspect(), self.framing()).filter(|_| is_used)
    }
}

/// For images of the camera's size, until another size comes.
pub(super) fn initial_framing(options: &PipelineOptions, network: ImageSize) -> Framing {
    let image = options.camera.map_or(network, |camera| camera.intrinsics.size());
    Framing::new(options.aspect, image, network)
}
