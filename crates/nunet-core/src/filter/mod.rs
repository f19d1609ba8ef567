//! Filters of depth maps: librealsense's post-processing, in meters.
//!
//! All are off by default. They always run in librealsense's order, `decimation`, `spatial`, `temporal`,
//! `holes`: decimation first because the others are then cheaper, hole filling last because filled depth must
//! not be smoothed into measured depth.
//!
//! Parameters and defaults are those of librealsense's [post-processing
//! filters](https://github.com/IntelRealSense/librealsense/blob/master/doc/post-processing-filters.md) where
//! they have the same meaning. Only `delta` has another unit: librealsense counts steps of the depth image,
//! by default millimeters of a D400, so its 20 is 0.02 m here. (In its disparity domain 20 is 2 cm at 1 m as
//! well, and grows with the square of the distance; here it does not.) For a network whose depth has no unit,
//! `delta` is in the network's unit.

mod decimation;
mod error;
mod holes;
mod options;
mod settings;
mod spatial;
mod temporal;

pub use decimation::{Appearance, Decimation, DecimationOptions};
pub use error::FilterError;
pub use holes::{HoleFilling, HolesOptions};
pub use options::{FilterOptions, FilterSpec};
pub use spatial::{Spatial, SpatialOptions};
pub use temporal::{Temporal, TemporalOptions};

use nunet_types::ImageSize;

use crate::clock::Clock;
use crate::graph::StageTimes;

/// A filter of depth maps of one size, in place.
pub trait DepthFilter: Send {
    /// Its name in options, headers and statistics.
    fn name(&self) -> &'static str;

    /// Filters `[H, W]` depth, rows top to bottom, NaN where nothing was measured. Allocates nothing.
    ///
    /// # Errors
    /// A depth map of another size than the filter's.
    fn apply(&mut self, depth_m: &mut [f32]) -> Result<(), FilterError>;

    /// Marks a discontinuity: the next depth map does not follow the earlier ones.
    fn reset(&mut self) {}
}

/// The filters that keep the size, in their order.
#[derive(Default)]
pub struct FilterChain(Vec<Box<dyn DepthFilter>>);

impl FilterChain {
    /// Allocates all buffers, for depth maps of `size`: width and height, after decimation.
    #[must_use]
    pub fn new(options: &FilterOptions, size: ImageSize) -> Self {
        let filters: [Option<Box<dyn DepthFilter>>; 3] = [
            options.spatial.map(|options| -> Box<dyn DepthFilter> { Box::new(Spatial::new(options, size)) }),
            options
                .temporal
                .map(|options| -> Box<dyn DepthFilter> { Box::new(Temporal::new(options, size)) }),
            options
                .holes
                .map(|options| -> Box<dyn DepthFilter> { Box::new(HoleFilling::new(options, size)) }),
        ];
        Self(filters.into_iter().flatten().collect())
    }

    /// The filters' names in their order.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.0.iter().map(|filter| -> &str { filter.name() })
    }

    /// Applies all filters in place and adds the time of each to `stages`.
    ///
    /// # Errors
    /// A depth map of another size.
    pub fn apply(
        &mut self,
        depth_m: &mut [f32],
        clock: &dyn Clock,
        stages: &mut StageTimes,
    ) -> Result<(), FilterError> {
        for filter in &mut self.0 {
            let start = clock.nanos();
            filter.apply(depth_m)?;
            stages.push(start, clock.nanos());
        }
        Ok(())
    }

    /// Marks a discontinuity: the next depth map does not follow the earlier ones.
    pub fn reset(&mut self) {
        self.0.iter_mut().for_each(|filter| filter.reset());
    }
}

/// How many pixels are NaN.
#[must_use]
pub fn count_invalid(depth_m: &[f32]) -> u32 {
    depth_m.iter().map(|depth| u32::from(depth.is_nan())).sum()
}

/// A buffer of another size would be filtered with the wrong neighbors.
fn check_size(
    filter: &'static str,
    buffer: &'static str,
    got: usize,
    expected: usize,
) -> Result<(), FilterError> {
    if got == expected { Ok(()) } else { Err(FilterError::Size { filter, buffer, got, expected }) }
}

#[cfg(test)]
mod tests;
