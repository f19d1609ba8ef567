//! Which part of the camera's image the network sees, and where in its own image.
//!
//! A network that was trained on 4:3 images estimates depth too near from a 16:9 image that is squeezed to
//! 4:3. The image is therefore cropped to the network's aspect ratio, or padded to it.

mod aspect;
mod mismatch;

pub use aspect::MAX_STRETCH;
pub use mismatch::AspectMismatch;
pub use nunet_types::{AspectMode, PixelRect};

use nunet_types::ImageSize;

use crate::camera::{Camera, CameraError};

/// Where the pixels of an image lie in the network's image, and which part of the image the results cover.
///
/// Results have the network's size and cover all of [`Framing::view`], each axis scaled by its own factor.
///
/// # Example: a 16:9 image before a 4:3 network
/// ```
/// use nunet_core::framing::{AspectMode, Framing};
/// use nunet_types::ImageSize;
///
/// let framing = Framing::new(AspectMode::Crop, ImageSize::new(1280, 720), ImageSize::new(640, 480));
/// assert_eq!(framing.view().to_string(), "960x720 at (160, 0)");
/// assert_eq!(framing.uncovered_share(), (0.25, 0.0));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Framing {
    image: ImageSize,
    network: ImageSize,
    /// Pixels of the image.
    view: PixelRect,
    /// Pixels of the network's image.
    target: PixelRect,
    /// Whether it was to be cropped, but has too few pixels for a part of the network's aspect ratio.
    is_too_small: bool,
}

impl Framing {
    /// For images of size `image` before a network of size `network`; no side is 0.
    #[must_use]
    pub fn new(mode: AspectMode, image: ImageSize, network: ImageSize) -> Self {
        let (mut view, mut target) = (PixelRect::whole(image), PixelRect::whole(network));
        let differs = aspect::differs(image, network);
        if differs {
            match mode {
                AspectMode::Crop => view = PixelRect::centered(image, network),
                AspectMode::Letterbox => target = PixelRect::centered(network, image),
                AspectMode::Stretch => {}
            }
        }
        let is_too_small = differs && mode == AspectMode::Crop && view == PixelRect::whole(image);
        Self { image, network, view, target, is_too_small }
    }

    /// For the same images and the same network with another mode.
    #[must_use]
    pub fn with_mode(&self, mode: AspectMode) -> Self {
        Self::new(mode, self.image, self.network)
    }

    /// The size of the image.
    #[must_use]
    pub fn image(&self) -> ImageSize {
        self.image
    }

    /// The part of the image that the results cover, pixels of the image.
    #[must_use]
    pub fn view(&self) -> PixelRect {
        self.view
    }

    /// Where the view lies in the network's image, pixels of it. The rest is padding.
    #[must_use]
    pub fn target(&self) -> PixelRect {
        self.target
    }

    /// Whether the network sees only a part of the image.
    #[must_use]
    pub fn is_cropped(&self) -> bool {
        self.view != PixelRect::whole(self.image)
    }

    /// Whether the network's image has padding.
    #[must_use]
    pub fn is_padded(&self) -> bool {
        self.target != PixelRect::whole(self.network)
    }

    /// Whether the whole image fills the whole network, but with another aspect ratio. False for an image
    /// of a few pixels that is too small to be cropped.
    #[must_use]
    pub fn is_stretched(&self) -> bool {
        let is_whole = !self.is_cropped() && !self.is_padded() && !self.is_too_small;
        is_whole && aspect::differs(self.image, self.network)
    }

    /// The shares of the image's width and height that the results do not cover, 0 to 1.
    #[must_use]
    pub fn uncovered_share(&self) -> (f64, f64) {
        let share = |covered: u32, side: u32| 1.0 - f64::from(covered) / f64::from(side);
        (share(self.view.width, self.image.width), share(self.view.height, self.image.height))
    }

    /// What a user should know about images of this size, in one sentence; `None` if nothing is lost.
    #[must_use]
    pub fn notice(&self) -> Option<String> {
        let Self { image, network, view, .. } = self;
        if self.is_stretched() {
            return Some(format!("images of {image} are stretched to {network}: depth is less accurate"));
        }
        if self.is_too_small {
            return Some(format!(
                "images of {image} are too small to be cropped to the aspect ratio of {network}: depth is \
                 less accurate"
            ));
        }
        let (horizontal, vertical) = self.uncovered_share();
        let (share, side) = if horizontal > vertical { (horizontal, "width") } else { (vertical, "height") };
        self.is_cropped().then(|| {
            let percent = 100.0 * share;
            format!("images of {image} are cropped to {view}: {percent:.0} % of their {side} have no depth")
        })
    }

    /// The camera of the results before decimation: that of the view, at the network's size.
    ///
    /// # Errors
    /// A size of 0 pixels.
    pub fn camera_of_results(&self, camera: &Camera) -> Result<Camera, CameraError> {
        let ImageSize { width, height } = self.network;
        if !self.is_cropped() {
            return camera.scaled_to(width, height);
        }
        let at_image = camera.scaled_to(self.image.width, self.image.height)?;
        at_image.cropped(self.view).scaled_to(width, height)
    }

    /// The camera of the network's image, with its padding.
    ///
    /// # Errors
    /// A size of 0 pixels.
    pub fn camera_of_network(&self, camera: &Camera) -> Result<Camera, CameraError> {
        if !self.is_padded() {
            return self.camera_of_results(camera);
        }
        let PixelRect { width, height, .. } = self.target;
        Ok(camera.scaled_to(width, height)?.padded(self.target, self.network))
    }

    /// The camera of the results that has `camera` as that of the network's image: the inverse of
    /// [`Framing::camera_of_network`] for a camera that is assumed.
    ///
    /// # Errors
    /// A size of 0 pixels.
    pub fn results_of_network_camera(&self, camera: &Camera) -> Result<Camera, CameraError> {
        if !self.is_padded() {
            return Ok(*camera);
        }
        camera.cropped(self.target).scaled_to(self.network.width, self.network.height)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_that_is_too_small_to_be_cropped_is_not_stretched_on_request() {
        let framing = |mode| Framing::new(mode, ImageSize::new(1, 1), ImageSize::new(640, 480));
        let (crop, stretch) = (framing(AspectMode::Crop), framing(AspectMode::Stretch));
        assert!(!crop.is_stretched() && stretch.is_stretched());
        let has = |framing: Framing, words: &str| framing.notice().is_some_and(|text| text.contains(words));
        assert!(has(crop, "1x1 are too small") && has(stretch, "are stretched"), "{:?}", crop.notice());
        assert_eq!(framing(AspectMode::Letterbox).notice(), None);
        let large = Framing::new(AspectMode::Crop, ImageSize::new(1280, 720), ImageSize::new(640, 480));
        assert!(has(large, "are cropped"), "{:?}", large.notice());
    }
}
