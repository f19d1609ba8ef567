//! Smoothing over time, for each pixel separately.

use std::fmt;
use std::ops::RangeInclusive;

use nunet_types::ImageSize;

use super::settings::Settings;
use super::{DepthFilter, FilterError, check_size};

const ALPHA: RangeInclusive<f32> = 0.0..=1.0;
const ALPHA_DEFAULT: f32 = 0.4;
/// librealsense ends at 100 steps, 10 cm: too little for depth from one image, which scatters more.
const DELTA_M: RangeInclusive<f32> = 0.001..=1.0;
const DELTA_M_DEFAULT: f32 = 0.02; // 20 steps of a D400
const PERSISTENCE: RangeInclusive<usize> = 0..=8;
const PERSISTENCE_DEFAULT: usize = 3;

/// When a pixel without depth keeps its last one: of the frames in `frames`, bit 0 the one before, at least
/// `measured` had depth.
struct Rule {
    frames: u8,
    measured: u32,
}

/// librealsense's rules by number.
const RULES: [Rule; 9] = [
    Rule { frames: 0, measured: 1 },           // never
    Rule { frames: 0b1111_1111, measured: 8 }, // in all of the last 8
    Rule { frames: 0b0000_0111, measured: 2 }, // in 2 of the last 3
    Rule { frames: 0b0000_1111, measured: 2 }, // in 2 of the last 4
    Rule { frames: 0b1111_1111, measured: 2 }, // in 2 of the last 8
    Rule { frames: 0b0000_0011, measured: 1 }, // in 1 of the last 2
    Rule { frames: 0b0001_1111, measured: 1 }, // in 1 of the last 5
    Rule { frames: 0b1111_1111, measured: 1 }, // in 1 of the last 8
    Rule { frames: 0, measured: 0 },           // always
];

/// The options of temporal smoothing.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TemporalOptions {
    alpha: f32,
    delta_m: f32,
    persistence: usize,
}

impl TemporalOptions {
    pub(super) const NAME: &str = "temporal";
    pub(super) const EXAMPLE: &str = "temporal=alpha:0.4,delta:0.02,persistence:3";

    pub(super) fn parse(text: &str) -> Result<Self, FilterError> {
        let known = &["alpha", "delta", "persistence"];
        let settings = Settings::parse(Self::NAME, text, known, None, Self::EXAMPLE)?;
        Ok(Self {
            alpha: settings.number("alpha", &ALPHA, ALPHA_DEFAULT)?,
            delta_m: settings.number("delta", &DELTA_M, DELTA_M_DEFAULT)?,
            persistence: settings.number("persistence", &PERSISTENCE, PERSISTENCE_DEFAULT)?,
        })
    }
}

impl fmt::Display for TemporalOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { alpha, delta_m, persistence } = self;
        write!(f, "alpha:{alpha},delta:{delta_m},persistence:{persistence}")
    }
}

/// An exponential mean of each pixel: `alpha` of the new depth and the rest of the old, where both differ by
/// less than `delta`; otherwise the new depth replaces the mean.
///
/// A pixel without depth keeps its last one as long as `persistence` allows. This depth is stale: on a robot
/// that moves, surfaces trail behind.
#[derive(Debug)]
pub struct Temporal {
    options: TemporalOptions,
    /// The last depth of each pixel, NaN before its first.
    last_m: Vec<f32>,
    /// In which of the last 8 frames each pixel had depth of this surface, bit 0 the last.
    history: Vec<u8>,
}

impl Temporal {
    /// Makes all buffers, for depth maps of `size`: width and height.
    #[must_use]
    pub fn new(options: TemporalOptions, size: ImageSize) -> Self {
        Self { options, last_m: vec![f32::NAN; size.pixel_count()], history: vec![0; size.pixel_count()] }
    }
}

impl DepthFilter for Temporal {
    fn name(&self) -> &'static str {
        TemporalOptions::NAME
    }

    fn apply(&mut self, depth_m: &mut [f32]) -> Result<(), FilterError> {
        check_size(self.name(), "depth", depth_m.len(), self.last_m.len())?;
        let TemporalOptions { alpha, delta_m, persistence } = self.options;
        let (kept, Rule { frames, measured }) = (1.0 - alpha, &RULES[persistence]);
        for ((depth, last), history) in depth_m.iter_mut().zip(&mut self.last_m).zip(&mut self.history) {
            let new = *depth;
            if new.is_nan() {
                if (*history & frames).count_ones() >= *measured {
                    *depth = *last;
                }
                *history <<= 1;
                continue;
            }
            // False where there is no last one.
            let agrees = (new - *last).abs() < delta_m;
            *depth = if agrees { new + kept * (*last - new) } else { new };
            *history = if agrees { *history << 1 | 1 } else { 1 };
            *last = *depth;
        }
        Ok(())
    }

    fn reset(&mut self) {
        self.last_m.fill(f32::NAN);
        self.history.fill(0);
    }
}
