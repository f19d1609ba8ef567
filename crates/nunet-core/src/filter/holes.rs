//! Fills holes with the depth of neighbors.

use std::fmt;

use nunet_types::ImageSize;

use super::settings::Settings;
use super::{DepthFilter, FilterError, check_size};

/// The neighbor that fills a hole.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
enum FillMode {
    /// The left one.
    Left,
    /// The farthest, because holes next to an edge are usually background.
    #[default]
    Farthest,
    /// The nearest: for robots that should stop too early rather than too late.
    Nearest,
}

impl FillMode {
    const ALL: [Self; 3] = [Self::Left, Self::Farthest, Self::Nearest];

    fn name(self) -> &'static str {
        match self {
            Self::Left => "left",
            Self::Farthest => "farthest",
            Self::Nearest => "nearest",
        }
    }
}

/// The options of hole filling.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HolesOptions {
    mode: FillMode,
}

impl HolesOptions {
    pub(super) const NAME: &str = "holes";
    pub(super) const EXAMPLE: &str = "holes=farthest";

    /// `mode:farthest`, or the word alone, or librealsense's number for it.
    pub(super) fn parse(text: &str) -> Result<Self, FilterError> {
        let settings = Settings::parse(Self::NAME, text, &["mode"], Some("mode"), Self::EXAMPLE)?;
        let Some(word) = settings.text("mode") else { return Ok(Self::default()) };
        let meant = |(number, mode): &(usize, FillMode)| mode.name() == word || number.to_string() == word;
        let mode = FillMode::ALL.into_iter().enumerate().find(meant);
        mode.map(|(_, mode)| Self { mode }).ok_or_else(|| {
            let expected = "`left` (or 0), `farthest` (1) or `nearest` (2)";
            settings.refuse("mode", word, expected.to_owned())
        })
    }
}

impl fmt::Display for HolesOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "mode:{}", self.mode.name())
    }
}

/// Fills each pixel without depth with the depth of a neighbor.
///
/// As librealsense's code does, from the left neighbor, or from the farthest or nearest of five: above, above
/// left, left, below left and below. Pixels are filled row by row from the left, and filled pixels fill the
/// next ones, so that holes of any size are filled. A pixel without any neighbor with depth stays without
/// depth.
#[derive(Debug)]
pub struct HoleFilling {
    options: HolesOptions,
    width: usize,
    height: usize,
}

impl HoleFilling {
    /// For depth maps of `size`: width and height.
    #[must_use]
    pub fn new(options: HolesOptions, size: ImageSize) -> Self {
        Self { options, width: size.width as usize, height: size.height as usize }
    }

    /// The depth for a hole at `index`; NaN where there is none around.
    fn depth_for(&self, depth_m: &[f32], index: usize) -> f32 {
        let column = index % self.width;
        let left = |index: usize| (column > 0).then(|| index - 1);
        let above = index.checked_sub(self.width);
        let below = Some(index + self.width).filter(|&below| below < depth_m.len());
        let around = [above, above.and_then(left), left(index), below.and_then(left), below];
        let depths = around.into_iter().flatten().map(|index| depth_m[index]);
        // Of NaN and a number, both `max` and `min` give the number.
        match self.options.mode {
            FillMode::Left => left(index).map_or(f32::NAN, |left| depth_m[left]),
            FillMode::Farthest => depths.fold(f32::NAN, f32::max),
            FillMode::Nearest => depths.fold(f32::NAN, f32::min),
        }
    }
}

impl DepthFilter for HoleFilling {
    fn name(&self) -> &'static str {
        HolesOptions::NAME
    }

    fn apply(&mut self, depth_m: &mut [f32]) -> Result<(), FilterError> {
        check_size(self.name(), "depth", depth_m.len(), self.width * self.height)?;
        for index in 0..depth_m.len() {
            if depth_m[index].is_nan() {
                depth_m[index] = self.depth_for(depth_m, index);
            }
        }
        Ok(())
    }
}
