//! What is done with images of another aspect ratio.

/// What is done with images whose aspect ratio differs from the network's by more than 5 %.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, Default)]
pub enum AspectMode {
    /// The network sees the largest centered part of its aspect ratio. Results cover only this part.
    #[default]
    Crop,
    /// The whole image is squeezed to the network's size. Results cover the whole image, but are less
    /// accurate.
    Stretch,
    /// The whole image is scaled by one factor and padded with the mean color of training. Results cover the
    /// whole image.
    Letterbox,
}

impl AspectMode {
    /// All modes.
    pub const ALL: [Self; 3] = [Self::Crop, Self::Stretch, Self::Letterbox];

    /// The name on the command line and in files.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Crop => "crop",
            Self::Stretch => "stretch",
            Self::Letterbox => "letterbox",
        }
    }

    /// The mode of this name.
    #[must_use]
    pub fn named(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|mode| mode.name() == name)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_mode_is_found_by_its_name() {
        for mode in AspectMode::ALL {
            assert_eq!(AspectMode::named(mode.name()), Some(mode));
        }
        assert_eq!(AspectMode::named("Crop"), None);
    }
}
