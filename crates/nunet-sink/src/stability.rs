//! Warns of depth that drifts or flickers while the image does not change.

use std::str::FromStr;
use std::time::Instant;

use nunet_core::pipeline::FrameReport;
use nunet_telemetry::{RateLimit, Stability, Totals};
use tracing::warn;

/// The share above which recent drift or flicker is too much; `None` for never. As text, a number of percent
/// or `off`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct StabilityLimit(pub Option<f64>);

impl Default for StabilityLimit {
    fn default() -> Self {
        Self(Some(0.05))
    }
}

impl FromStr for StabilityLimit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "off" {
            return Ok(Self(None));
        }
        let percent = text.parse().ok().filter(|percent: &f64| *percent > 0.0 && *percent <= 100.0);
        let share = percent.map(|percent| Self(Some(percent / 100.0)));
        share.ok_or_else(|| {
            format!("expected `off` or a number of percent up to 100, such as `5`, got `{text}`")
        })
    }
}

/// Warns when depth becomes unstable, with a rate limit.
#[derive(Debug, Default)]
pub struct StabilityWarning {
    limit: RateLimit,
    was_unstable: bool,
}

impl StabilityWarning {
    /// Adds a frame's drift and flicker to the totals of its stream. Warns if the recent ones have just risen
    /// above the limit there.
    pub fn check(&mut self, sequence: u64, report: &FrameReport, totals: &mut Totals) {
        totals.stability.add(
            report
                .stability
                .map(|change| Stability { drift: change.drift.into(), flicker: change.flicker.into() }),
        );
        let is_unstable = totals.stability.is_unstable();
        let begins = !std::mem::replace(&mut self.was_unstable, is_unstable) && is_unstable;
        let Some(Stability { drift, flicker }) = totals.stability.recent().filter(|_| begins) else { return };
        if let Some(suppressed) = self.limit.allow(Instant::now()) {
            let hint = "check light, focus and exposure; the temporal filter reduces flicker";
            let (drift, flicker) = (100.0 * drift, 100.0 * flicker);
            warn!(
                hint,
                "depth is unstable at frame {sequence} although the image does not change: per frame, drift is \
                 {drift:+.1} % and flicker {flicker:.1} %{suppressed}"
            );
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_limit_is_percent_or_off() {
        assert_eq!("5".parse(), Ok(StabilityLimit::default()));
        assert_eq!("off".parse(), Ok(StabilityLimit(None)));
        for wrong in ["0", "-1", "101", "NaN", "inf", "", "5 %"] {
            let error = wrong.parse::<StabilityLimit>().unwrap_err();
            assert!(error.contains(wrong), "{error}");
        }
    }
}
