//! The arguments that say what is done to depth.

use clap::Args;
use nunet_core::filter::{FilterError, FilterOptions, FilterSpec};

use crate::exit::parsed;

/// What is done to depth after the network.
#[derive(Debug, Args, Clone, Default)]
pub struct FilterArgs {
    /// Filter depth: `decimation`, `spatial`, `temporal` or `holes`; may be given once for each
    ///
    /// They run in this order, librealsense's, whatever the order given, and with its defaults:
    ///
    /// decimation=2: blocks of 2x2 to 8x8 pixels become one, their median, or from 4x4 on their mean; labels and cloud follow
    ///
    /// spatial=magnitude:2,alpha:0.5,delta:0.02,fill:0: smooths within surfaces, 1 to 5 times, with 0.25 to 1 of a
    /// pixel's own depth; neighbours that differ by `delta` metres or more are an edge; `fill` 0 to 5 fills holes along
    /// the row by 0, 2, 4, 8, 16 or any number of pixels
    ///
    /// temporal=alpha:0.4,delta:0.02,persistence:3: smooths over time, with 0 to 1 of the new depth where it is within
    /// `delta` metres of the old; a pixel without depth keeps its last one: 0 never, or if it had depth in 1: 8 of the
    /// last 8 frames, 2: 2 of 3, 3: 2 of 4, 4: 2 of 8, 5: 1 of 2, 6: 1 of 5, 7: 1 of 8, 8: ever
    ///
    /// holes=farthest: fills pixels without depth from the `left`, or with the `farthest` or `nearest` around
    #[arg(long = "filter", value_name = "NAME[=key:value,...]", value_parser = parsed::<FilterSpec>)]
    pub filters: Vec<FilterSpec>,
}

impl FilterArgs {
    /// The filters that are on.
    ///
    /// # Errors
    /// One that is given twice.
    pub fn options(&self) -> Result<FilterOptions, FilterError> {
        FilterOptions::new(&self.filters)
    }
}
