//! The diagnostics of one camera's stream.

use nunet_telemetry::{Counts, Stability};

use super::{CameraState, CameraThread};
use crate::messages::{DiagnosticArray, DiagnosticStatus, KeyValue, header_now};

impl CameraThread {
    /// The stream as one status. Its level is WARN while depth is unstable.
    pub(super) fn diagnostics(&self, state: &CameraState) -> DiagnosticArray<'_> {
        let header = header_now();
        // A camera in shared memory may state any time.
        let age_nanos = |captured: i64| header.stamp.unix_nanos().saturating_sub(captured);
        let age_ms = |captured: i64| format!("{:.1}", age_nanos(captured) as f64 / 1e6);
        let age = state.capture_unix_nanos.map_or_else(|| "none".to_owned(), age_ms);
        let Counts { captured, published, superseded, failed, in_flight } = state.frames;
        let counts = &self.shared.counts;
        let percent = |share: fn(Stability) -> f64| {
            state.stability.map_or_else(|| "unknown".to_owned(), |now| format!("{:.2}", 100.0 * share(now)))
        };
        let values = [
            ("frames per second", format!("{:.2}", state.fps)),
            ("age of the last frame, ms", age),
            ("latency of the last frame, ms", format!("{:.2}", f64::from(state.total_micros) / 1e3)),
            ("units", state.scale.map_or("none", |scale| scale.units.name()).to_owned()),
            ("scale source", state.scale.map_or("none", |scale| scale.source.name()).to_owned()),
            ("scale factor", state.scale.map_or(0.0, |scale| scale.factor).to_string()),
            ("depth drift, % per frame", percent(|now| now.drift)),
            ("depth flicker, % per frame", percent(|now| now.flicker)),
            ("frames without the robot's attitude", state.without_attitude.to_string()),
            ("captured", captured.to_string()),
            ("published", published.to_string()),
            ("superseded", superseded.to_string()),
            ("failed", failed.to_string()),
            ("in flight", in_flight.to_string()),
            ("ROS 2 messages sent", counts.sent().to_string()),
            ("ROS 2 messages not taken", counts.not_taken().to_string()),
            ("ROS 2 frames superseded", counts.superseded().to_string()),
        ];
        let values = values.into_iter().chain(self.about.iter().cloned());
        let (level, message) = DiagnosticStatus::of_stream(state.is_up, state.is_unstable, counts.problems());
        let status = DiagnosticStatus {
            level,
            name: format!("nunetd: {}", self.name),
            message,
            hardware_id: &self.name,
            values: values.map(|(key, value)| KeyValue { key, value }).collect(),
        };
        DiagnosticArray { header, status: vec![status] }
    }
}
