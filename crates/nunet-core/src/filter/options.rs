//! Filters as a user writes them, `NAME[=key:value,...]`, checked once.

use std::fmt;
use std::str::FromStr;

use super::{DecimationOptions, FilterError, HolesOptions, SpatialOptions, TemporalOptions};

/// One filter with its settings.
///
/// # Example: omitted settings have their defaults
/// ```
/// # use nunet_core::filter::{FilterError, FilterSpec};
/// let filter: FilterSpec = "spatial=alpha:0.4".parse()?;
/// assert_eq!(filter.to_string(), "spatial=magnitude:2,alpha:0.4,delta:0.02,fill:0");
/// # Ok::<(), FilterError>(())
/// ```
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FilterSpec {
    /// Decimation.
    Decimation(DecimationOptions),
    /// Smoothing within surfaces.
    Spatial(SpatialOptions),
    /// Smoothing over time.
    Temporal(TemporalOptions),
    /// Hole filling.
    Holes(HolesOptions),
}

impl FilterSpec {
    fn name(self) -> &'static str {
        match self {
            Self::Decimation(_) => DecimationOptions::NAME,
            Self::Spatial(_) => SpatialOptions::NAME,
            Self::Temporal(_) => TemporalOptions::NAME,
            Self::Holes(_) => HolesOptions::NAME,
        }
    }

    fn example(self) -> &'static str {
        match self {
            Self::Decimation(_) => DecimationOptions::EXAMPLE,
            Self::Spatial(_) => SpatialOptions::EXAMPLE,
            Self::Temporal(_) => TemporalOptions::EXAMPLE,
            Self::Holes(_) => HolesOptions::EXAMPLE,
        }
    }
}

impl FromStr for FilterSpec {
    type Err = FilterError;

    fn from_str(text: &str) -> Result<Self, FilterError> {
        let (name, settings) = text.split_once('=').unwrap_or((text, ""));
        match name.trim() {
            DecimationOptions::NAME => DecimationOptions::parse(settings).map(Self::Decimation),
            SpatialOptions::NAME => SpatialOptions::parse(settings).map(Self::Spatial),
            TemporalOptions::NAME => TemporalOptions::parse(settings).map(Self::Temporal),
            HolesOptions::NAME => HolesOptions::parse(settings).map(Self::Holes),
            name => Err(FilterError::UnknownFilter { text: name.to_owned() }),
        }
    }
}

impl fmt::Display for FilterSpec {
    /// With all settings; reads back as the same filter.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = self.name();
        match self {
            Self::Decimation(options) => write!(f, "{name}={options}"),
            Self::Spatial(options) => write!(f, "{name}={options}"),
            Self::Temporal(options) => write!(f, "{name}={options}"),
            Self::Holes(options) => write!(f, "{name}={options}"),
        }
    }
}

/// Which filters are on; none by default.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct FilterOptions {
    pub(super) decimation: Option<DecimationOptions>,
    pub(super) spatial: Option<SpatialOptions>,
    pub(crate) temporal: Option<TemporalOptions>,
    pub(super) holes: Option<HolesOptions>,
}

impl FilterOptions {
    /// The requested filters; their order does not matter.
    ///
    /// # Errors
    /// A filter that is given twice.
    pub fn new(specs: &[FilterSpec]) -> Result<Self, FilterError> {
        let mut options = Self::default();
        for &spec in specs {
            let was_there = match spec {
                FilterSpec::Decimation(decimation) => options.decimation.replace(decimation).is_some(),
                FilterSpec::Spatial(spatial) => options.spatial.replace(spatial).is_some(),
                FilterSpec::Temporal(temporal) => options.temporal.replace(temporal).is_some(),
                FilterSpec::Holes(holes) => options.holes.replace(holes).is_some(),
            };
            if was_there {
                return Err(FilterError::FilterTwice { filter: spec.name(), example: spec.example() });
            }
        }
        Ok(options)
    }

    /// The decimation, if it is on.
    #[must_use]
    pub fn decimation(&self) -> Option<DecimationOptions> {
        self.decimation
    }

    /// The filters that are on, in the order in which they run.
    pub fn specs(&self) -> impl Iterator<Item = FilterSpec> {
        let all = [
            self.decimation.map(FilterSpec::Decimation),
            self.spatial.map(FilterSpec::Spatial),
            self.temporal.map(FilterSpec::Temporal),
            self.holes.map(FilterSpec::Holes),
        ];
        all.into_iter().flatten()
    }
}
