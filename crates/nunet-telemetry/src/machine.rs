//! Facts about the machine and this process, from the kernel.

use std::time::{SystemTime, UNIX_EPOCH};

use serde_json::{Value, json};

/// The machine and the time of a measurement.
#[must_use]
pub fn host() -> Value {
    json!({
        "processor": field("/proc/cpuinfo", "model name"),
        "cores": std::thread::available_parallelism().map_or(0, std::num::NonZero::get),
        "architecture": std::env::consts::ARCH,
        "unix_seconds": SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs()),
    })
}

/// The peak memory of this process, in megabytes.
#[must_use]
pub fn peak_rss_mb() -> Option<f64> {
    let kib: f64 = field("/proc/self/status", "VmHWM")?.trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

/// Whether a signal was ignored when this process started, as under `nohup`, and stays ignored. Read from the
/// kernel's table, because querying the handler takes unsafe code.
#[must_use]
pub fn is_signal_ignored(signal: i32) -> bool {
    field("/proc/self/status", "SigIgn").is_some_and(|mask| has_signal(&mask, signal))
}

fn has_signal(mask: &str, signal: i32) -> bool {
    let mask = u64::from_str_radix(mask, 16).unwrap_or(0);
    let bit = u32::try_from(signal - 1).ok().and_then(|place| mask.checked_shr(place));
    bit.is_some_and(|bit| bit & 1 == 1)
}

/// The first `name: value` of a file of the kernel.
fn field(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    let mut pairs = text.lines().filter_map(|line| line.split_once(':'));
    pairs.find(|(key, _)| key.trim() == name).map(|(_, value)| value.trim().to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ignored_signals_are_read_from_the_kernels_table() {
        let [hup, int, pipe, term] = [1, 2, 13, 15];
        let mask = "0000000000001001";
        assert!(has_signal(mask, hup), "as under nohup");
        assert!(has_signal(mask, pipe));
        assert!(!has_signal(mask, int) && !has_signal(mask, term));
        assert!(!has_signal("none", hup) && !has_signal(mask, 0));
        assert!(is_signal_ignored(pipe), "Rust's runtime ignores it");
    }
}
