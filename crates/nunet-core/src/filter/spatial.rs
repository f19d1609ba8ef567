//! Smoothing within surfaces: along the rows and the columns, never across an edge.

use std::fmt;
use std::ops::RangeInclusive;

use nunet_types::ImageSize;

use super::settings::Settings;
use super::{DepthFilter, FilterError, check_size};

const MAGNITUDE: RangeInclusive<u32> = 1..=5;
const MAGNITUDE_DEFAULT: u32 = 2;
const ALPHA: RangeInclusive<f32> = 0.25..=1.0;
const ALPHA_DEFAULT: f32 = 0.5;
/// librealsense ends at 50 steps, 5 cm: too little for depth from one image, which scatters more.
const DELTA_M: RangeInclusive<f32> = 0.001..=1.0;
const DELTA_M_DEFAULT: f32 = 0.02; // 20 steps of a D400
const FILL: RangeInclusive<usize> = 0..=5;
/// How many pixels `fill` 0 to 5 fills from each side of a hole.
const FILL_PX: [usize; 6] = [0, 2, 4, 8, 16, usize::MAX];

/// The options of spatial smoothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpatialOptions {
    magnitude: u32,
    alpha: f32,
    delta_m: f32,
    fill: usize,
}

impl SpatialOptions {
    pub(super) const NAME: &str = "spatial";
    pub(super) const EXAMPLE: &str = "spatial=magnitude:2,alpha:0.5,delta:0.02,fill:0";

    pub(super) fn parse(text: &str) -> Result<Self, FilterError> {
        let known = &["magnitude", "alpha", "delta", "fill"];
        let settings = Settings::parse(Self::NAME, text, known, None, Self::EXAMPLE)?;
        Ok(Self {
            magnitude: settings.number("magnitude", &MAGNITUDE, MAGNITUDE_DEFAULT)?,
            alpha: settings.number("alpha", &ALPHA, ALPHA_DEFAULT)?,
            delta_m: settings.number("delta", &DELTA_M, DELTA_M_DEFAULT)?,
            fill: settings.number("fill", &FILL, 0)?,
        })
    }
}

impl fmt::Display for SpatialOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { magnitude, alpha, delta_m, fill } = self;
        write!(f, "magnitude:{magnitude},alpha:{alpha},delta:{delta_m},fill:{fill}")
    }
}

/// The recursive edge-preserving filter of Gastal and Oliveira, "Domain Transform for Edge-Aware Image and
/// Video Processing" (2011), as librealsense simplifies it.
///
/// The paper's recursion is `J[n] = (1 - a^d) I[n] + a^d J[n - 1]`, forth and back along each line, where `d`
/// grows with the difference of neighbors. Here the distance has two values: `a^d` is `1 - alpha` where two
/// neighbors differ by less than `delta`, and 0 where they differ by more. Nothing crosses such an edge, and
/// nothing crosses a pixel without depth, which stays without. Each of `magnitude` rounds goes right, left,
/// down and up, with the same `a` (the paper shortens its reach from round to round).
///
/// With `fill` holes are then filled along their row, first from the left and then from the right.
#[derive(Debug)]
pub struct Spatial {
    options: SpatialOptions,
    width: usize,
    height: usize,
    /// A row as it was before it was smoothed.
    raw: Vec<f32>,
}

impl Spatial {
    /// Makes all buffers, for depth maps of `size`: width and height.
    #[must_use]
    pub fn new(options: SpatialOptions, size: ImageSize) -> Self {
        let (width, height) = (size.width as usize, size.height as usize);
        Self { options, width, height, raw: vec![f32::NAN; width] }
    }

    /// The recursion along all columns at once, one row after the other.
    fn smooth_columns<'a>(&mut self, rows: impl Iterator<Item = &'a mut [f32]>) {
        let step = self.options.step();
        let mut row_before: Option<&[f32]> = None;
        for row in rows {
            match row_before {
                None => self.raw.copy_from_slice(row),
                Some(row_before) => {
                    for ((value, raw_before), before) in row.iter_mut().zip(&mut self.raw).zip(row_before) {
                        let raw = *value;
                        *value = step(raw, *raw_before, *before);
                        *raw_before = raw;
                    }
                }
            }
            row_before = Some(row);
        }
    }
}

impl SpatialOptions {
    /// A pixel's depth after the recursion, from its own, its neighbor's own, and its neighbor's after the
    /// recursion.
    ///
    /// Written so that equal numbers stay equal to the bit, and that NaN on either side is an edge.
    fn step(self) -> impl Fn(f32, f32, f32) -> f32 {
        let Self { alpha, delta_m, .. } = self;
        let carried = 1.0 - alpha;
        move |value, raw_before, before| {
            if (value - raw_before).abs() < delta_m { value + carried * (before - value) } else { value }
        }
    }
}

impl DepthFilter for Spatial {
    fn name(&self) -> &'static str {
        SpatialOptions::NAME
    }

    fn apply(&mut self, depth_m: &mut [f32]) -> Result<(), FilterError> {
        check_size(self.name(), "depth", depth_m.len(), self.width * self.height)?;
        for _ in 0..self.options.magnitude {
            for row in depth_m.chunks_exact_mut(self.width) {
                smooth(row.iter_mut(), self.options.step());
                smooth(row.iter_mut().rev(), self.options.step());
            }
            self.smooth_columns(depth_m.chunks_exact_mut(self.width));
            self.smooth_columns(depth_m.chunks_exact_mut(self.width).rev());
        }
        let most = FILL_PX[self.options.fill];
        if most > 0 {
            for row in depth_m.chunks_exact_mut(self.width) {
                fill(row.iter_mut(), most);
                fill(row.iter_mut().rev(), most);
            }
        }
        Ok(())
    }
}

/// The recursion along one line, one way.
fn smooth<'a>(line: impl Iterator<Item = &'a mut f32>, step: impl Fn(f32, f32, f32) -> f32) {
    let (mut raw_before, mut before) = (f32::NAN, f32::NAN);
    for value in line {
        let raw = *value;
        *value = step(raw, raw_before, before);
        (raw_before, before) = (raw, *value);
    }
}

/// Carries the last depth into the first `most` pixels of each hole.
fn fill<'a>(line: impl Iterator<Item = &'a mut f32>, most: usize) {
    let (mut last, mut filled) = (f32::NAN, 0);
    for value in line {
        if !value.is_nan() {
            (last, filled) = (*value, 0);
        } else if filled < most {
            *value = last;
            filled += 1;
        }
    }
}
