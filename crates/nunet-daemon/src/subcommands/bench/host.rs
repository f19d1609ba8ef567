//! The machine of the measurement.

use nunet_ipc::unix_nanos;
use nunet_telemetry::processor;
use serde_json::{Value, json};

pub(in crate::subcommands) fn json() -> Value {
    json!({
        "processor": processor(),
        "cores": std::thread::available_parallelism().map_or(0, std::num::NonZero::get),
        "architecture": std::env::consts::ARCH,
        "unix_seconds": unix_nanos() / 1_000_000_000,
    })
}
