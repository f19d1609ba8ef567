//! The flags for depth filters.

use clap::Args;
use nunet_core::filter::{FilterOptions, FilterSpec};
use serde::Deserialize;

use super::text::Text;
use crate::exit::BadArguments;

/// Depth filters.
#[derive(Debug, Args, Clone, Deserialize)]
pub struct FilterArgs {
    /// Filter depth with `decimation`, `spatial`, `temporal` or `holes`; repeat for several filters
    ///
    /// Each filter can be given once. They always run in this order, with the defaults of librealsense:
    ///
    /// decimation=2: replaces blocks of 2x2 to 8x8 pixels by one pixel, their median, or from 4x4 on their
    /// mean; labels and cloud get the same size.
    ///
    /// spatial=magnitude:2,alpha:0.5,delta:0.02,fill:0: smooths within surfaces. `magnitude` is the number of
    /// passes (1 to 5). `alpha` is the weight of the pixel itself (0.25 to 1). Neighbors that differ by
    /// `delta` meters or more are an edge. `fill` 0 to 5 fills holes along the row by up to 0, 2, 4, 8, 16 or
    /// any number of pixels.
    ///
    /// temporal=alpha:0.4,delta:0.02,persistence:3: smooths over time. `alpha` is the weight of the new depth
    /// (0 to 1) if it is within `delta` meters of the old one. `persistence` says when a pixel without depth
    /// keeps its last depth: 0: never, 1: with depth in 8 of the last 8 frames, 2: 2 of 3, 3: 2 of 4, 4: 2 of
    /// 8, 5: 1 of 2, 6: 1 of 5, 7: 1 of 8, 8: always.
    ///
    /// holes=farthest: fills pixels without depth from the `left`, or with the `farthest` or `nearest`
    /// neighbor.
    ///
    /// Depth that holes, fill and persistence put in is guessed or stale. Leave them off for collision
    /// avoidance.
    #[arg(long = "filter", value_name = "NAME[=key:value,...]")]
    #[serde(rename = "filter", default)]
    pub filters: Vec<Text<FilterSpec>>,
}

impl FilterArgs {
    /// The filters that are on. A filter that is given twice is an error, which clap cannot find.
    pub(crate) fn options(&self) -> Result<FilterOptions, BadArguments> {
        let filters: Vec<_> = self.filters.iter().map(|Text(filter)| *filter).collect();
        FilterOptions::new(&filters).map_err(|error| BadArguments::of(&error))
    }
}
