//! The rate at which a source that is not live delivers its frames.

use std::str::FromStr;
use std::time::{Duration, Instant};

/// The rate at which frames are taken.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rate {
    /// Every frame, as fast as possible.
    Max,
    /// Frames a second, like a camera: the latest wins.
    Hz(f64),
}

/// The highest rate. No camera is that fast, so a higher one is a typing error.
pub(crate) const MAX_HZ: f64 = 10_000.0;
/// One frame in three hours: longer periods could overflow a [`Duration`].
const MIN_HZ: f64 = 0.0001;

impl FromStr for Rate {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "max" {
            return Ok(Self::Max);
        }
        match text.parse::<f64>() {
            Ok(hz) if (MIN_HZ..=MAX_HZ).contains(&hz) => Ok(Self::Hz(hz)),
            _ => Err(format!("expected `max` or frames a second from {MIN_HZ} to {MAX_HZ}, got `{text}`")),
        }
    }
}

/// Schedules frames at a fixed rate, without drift.
#[derive(Debug)]
pub struct Pacer {
    period: Duration,
    /// When the next frame is due.
    due: Instant,
}

impl Pacer {
    /// A schedule whose first frame is due now; none for [`Rate::Max`].
    pub fn new(rate: Rate, now: Instant) -> Option<Self> {
        match rate {
            Rate::Max => None,
            Rate::Hz(hz) => Some(Self { period: Duration::from_secs_f64(1.0 / hz), due: now }),
        }
    }

    /// How long to wait for the next frame. A source that fell behind by more than a frame skips what it
    /// missed instead of catching up.
    pub fn wait(&mut self, now: Instant) -> Duration {
        if now > self.due + self.period {
            self.due = now;
        }
        let wait = self.due.saturating_duration_since(now);
        self.due += self.period;
        wait
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_max_or_a_sensible_number() {
        assert_eq!("max".parse(), Ok(Rate::Max));
        assert_eq!("29.97".parse(), Ok(Rate::Hz(29.97)));
        for wrong in ["0", "-1", "nan", "inf", "1e9", "", "fast", "1e-20", "0.00009"] {
            let error = wrong.parse::<Rate>().unwrap_err();
            assert_eq!(
                error,
                format!("expected `max` or frames a second from 0.0001 to 10000, got `{wrong}`")
            );
        }
    }

    #[test]
    fn the_slowest_rate_has_a_schedule() {
        let start = Instant::now();
        let mut pacer = Pacer::new("0.0001".parse().unwrap(), start).unwrap();
        assert_eq!(pacer.wait(start), Duration::ZERO);
        assert_eq!(pacer.wait(start), Duration::from_secs(10_000));
    }

    #[test]
    fn the_schedule_does_not_drift_and_skips_what_was_missed() {
        let start = Instant::now();
        let ms = Duration::from_millis;
        let mut pacer = Pacer::new(Rate::Hz(10.0), start).unwrap();
        assert_eq!(pacer.wait(start), ms(0));
        assert_eq!(pacer.wait(start + ms(30)), ms(70));
        assert_eq!(pacer.wait(start + ms(130)), ms(70));
        assert_eq!(pacer.wait(start + ms(900)), ms(0), "far behind: due at once");
        assert_eq!(pacer.wait(start + ms(910)), ms(90), "and a new schedule from there");
    }
}
