//! The machine of the measurement.

use nunet_ipc::unix_nanos;
use serde_json::{Value, json};

pub(in crate::subcommands) fn json() -> Value {
    json!({
        "processor": processor(),
        "cores": std::thread::available_parallelism().map_or(0, std::num::NonZero::get),
        "architecture": std::env::consts::ARCH,
        "unix_seconds": unix_nanos() / 1_000_000_000,
    })
}

/// The peak memory of this process, in megabytes.
pub(super) fn peak_rss_mb() -> Option<f64> {
    let kib: f64 = field("/proc/self/status", "VmHWM")?.trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

fn processor() -> Option<String> {
    field("/proc/cpuinfo", "model name")
}

/// The first `name: value` of a file of the kernel.
fn field(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    let mut pairs = text.lines().filter_map(|line| line.split_once(':'));
    pairs.find(|(key, _)| key.trim() == name).map(|(_, value)| value.trim().to_owned())
}
