//! The kinds of references.

/// What the network's depth is compared with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ReferenceKind {
    /// A point at a known distance.
    Point,
    /// The floor under the camera.
    Floor,
    /// Readings of a range sensor.
    Readings,
    /// Images with true depth.
    Truth,
}

impl ReferenceKind {
    /// How many observations a factor needs.
    pub(super) fn needed(self) -> usize {
        match self {
            // More images of a static scene would add no information.
            Self::Point => 1,
            // With fewer, no outlier can be found.
            Self::Floor | Self::Readings | Self::Truth => 3,
        }
    }

    /// What an observation is made of, in the plural.
    pub(super) fn observed(self) -> &'static str {
        match self {
            Self::Point | Self::Floor => "frames",
            Self::Readings => "readings",
            Self::Truth => "images",
        }
    }

    /// What to do if there are only `got` observations, fewer than needed.
    pub(super) fn hint(self, got: usize) -> &'static str {
        match (self, got) {
            (Self::Point, _) => "choose another point: the network has no depth around this one",
            (Self::Floor, 0) => {
                "check z (meters), roll and pitch (radians) of the mount: where it expects the floor, the frames show \
                 something else"
            }
            (Self::Floor, _) => "give more frames that show level floor",
            (Self::Readings, 0) => "choose points that the network sees, and where it has depth",
            (Self::Readings, _) => "give more readings, at points where the network has depth",
            (Self::Truth, 0) => {
                "check the depth files and the window: no image has true depth greater than 0 where the network has depth"
            }
            (Self::Truth, _) => "give more images that have true depth",
        }
    }
}
