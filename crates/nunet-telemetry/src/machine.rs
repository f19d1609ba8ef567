//! Facts about the machine and this process, from the kernel.

/// The peak memory of this process, in megabytes.
#[must_use]
pub fn peak_rss_mb() -> Option<f64> {
    let kib: f64 = field("/proc/self/status", "VmHWM")?.trim_end_matches("kB").trim().parse().ok()?;
    Some(kib * 1024.0 / 1e6)
}

/// The processor's name, if the kernel states it.
#[must_use]
pub fn processor() -> Option<String> {
    field("/proc/cpuinfo", "model name")
}

/// The first `name: value` of a file of the kernel.
fn field(file: &str, name: &str) -> Option<String> {
    let text = std::fs::read_to_string(file).ok()?;
    let mut pairs = text.lines().filter_map(|line| line.split_once(':'));
    pairs.find(|(key, _)| key.trim() == name).map(|(_, value)| value.trim().to_owned())
}
