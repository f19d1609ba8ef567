//! A trusted model, opened.

mod telemetry;

pub use telemetry::{TELEMETRY_VARIABLE, Telemetry};
