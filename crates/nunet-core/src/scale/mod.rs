//! The scale of depth: the factor by which the network's meters are multiplied.
//!
//! Depth from one image has an uncertain scale. [`ScaleMode`] selects the source of the factor: the focal
//! length, a calibration, or the floor. [`FloorGauge`] measures it on the floor of one frame,
//! [`ScaleTracker`] follows it over time.

mod error;
mod floor;
mod mode;
mod tracker;

pub use error::ScaleError;
pub use floor::{FloorGauge, FloorRatio};
pub use mode::ScaleMode;
pub use tracker::{ScaleTracker, TrackedScale};
