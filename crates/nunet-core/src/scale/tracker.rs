//! Tracks the factor over time: it changes slowly, and is kept while nothing is measured.

/// Measurements at the start that are averaged; after them the factor is followed slowly.
const FIRST_MEASUREMENTS: u32 = 10;
/// Time constant of the filter, seconds.
const TIME_CONSTANT_S: f32 = 2.0;
/// The factor changes by at most this share per second after the first measurements.
const MAX_RATE: f32 = 0.05;
/// A measurement that differs by more than this logarithm (20 %) is an outlier, unless it lasts.
const OUTLIER: f32 = 0.18;
/// After this many outliers in a row, they are accepted, for example after the camera was moved.
const MAX_OUTLIERS: u32 = 20;
/// Time from frame to frame if frames have no time, seconds.
const UNKNOWN_PERIOD_S: f32 = 0.1;
/// Longer gaps between frames count as this long, seconds.
const MAX_PERIOD_S: f32 = 1.0;

/// A factor, and how long ago it was measured.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TrackedScale {
    /// The factor.
    pub factor: f32,
    /// Nanoseconds from the last measurement that counted to the last frame.
    pub age_nanos: i64,
}

/// Follows a factor from frame to frame. Allocates nothing.
#[derive(Debug, Clone, Default)]
pub struct ScaleTracker {
    log: f32,
    measurements: u32,
    outliers: u32,
    last_nanos: Option<i64>,
    age_nanos: i64,
}

impl ScaleTracker {
    /// Adds a frame: the factor measured in it, if any, and its time, if known. Returns the factor to use;
    /// `None` before the first measurement.
    pub fn update(&mut self, measured: Option<f32>, time_nanos: Option<i64>) -> Option<TrackedScale> {
        let (period_s, passed_nanos) = self.advance(time_nanos);
        self.age_nanos = self.age_nanos.saturating_add(passed_nanos);
        if let Some(log) = measured.map(f32::ln).filter(|log| log.is_finite()) {
            self.take(log, period_s);
        }
        self.last()
    }

    /// The factor of the last frame.
    #[must_use]
    pub fn last(&self) -> Option<TrackedScale> {
        let scale = TrackedScale { factor: self.log.exp(), age_nanos: self.age_nanos };
        (self.measurements > 0).then_some(scale)
    }

    /// Discards all measurements: the next frame is from another camera, or independent.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// The time since the last frame, bounded for the filter, and as it is.
    fn advance(&mut self, time_nanos: Option<i64>) -> (f32, i64) {
        let unknown = (UNKNOWN_PERIOD_S, (UNKNOWN_PERIOD_S * 1e9) as i64);
        let last = std::mem::replace(&mut self.last_nanos, time_nanos);
        let passed = last.zip(time_nanos).map(|(last, now)| now.saturating_sub(last).max(0));
        passed.map_or(unknown, |nanos| ((nanos as f32 / 1e9).min(MAX_PERIOD_S), nanos))
    }

    fn take(&mut self, log: f32, period_s: f32) {
        let is_settled = self.measurements >= FIRST_MEASUREMENTS;
        let off = log - self.log;
        if is_settled && off.abs() > OUTLIER && self.outliers < MAX_OUTLIERS {
            self.outliers += 1;
            return;
        }
        if off.abs() <= OUTLIER {
            self.outliers = 0;
        }
        self.measurements = self.measurements.saturating_add(1);
        self.age_nanos = 0;
        let slow = 1.0 - (-period_s / TIME_CONSTANT_S).exp();
        let step = off * slow.max(if is_settled { 0.0 } else { 1.0 / self.measurements as f32 });
        let most = if is_settled { MAX_RATE * period_s } else { f32::INFINITY };
        self.log += step.clamp(-most, most);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FRAME_NANOS: i64 = 100_000_000;

    /// The factors after each measurement, ten frames per second from `start` on.
    fn follow(tracker: &mut ScaleTracker, start: i64, measured: &[Option<f32>]) -> Vec<f32> {
        let frames = (start..).zip(measured);
        let mut factor = |(frame, measured): (i64, &Option<f32>)| {
            tracker.update(*measured, Some(frame * FRAME_NANOS)).map_or(f32::NAN, |scale| scale.factor)
        };
        frames.map(&mut factor).collect()
    }

    #[test]
    fn the_first_measurement_counts_in_full_and_the_next_ones_are_averaged() {
        let mut tracker = ScaleTracker::default();
        assert_eq!(tracker.update(None, Some(0)), None);
        let factors = follow(&mut tracker, 1, &[Some(0.5), Some(0.55), Some(0.6)]);
        assert!((factors[0] - 0.5).abs() < 1e-6, "{factors:?}");
        assert!((factors[2] - (0.5_f32 * 0.55 * 0.6).cbrt()).abs() < 1e-5, "{factors:?}");
    }

    #[test]
    fn the_factor_is_kept_without_floor_and_its_age_grows() {
        let mut tracker = ScaleTracker::default();
        follow(&mut tracker, 0, &[Some(0.5); 5]);
        follow(&mut tracker, 5, &[None; 20]);
        let kept = tracker.last().unwrap();
        assert!((kept.factor - 0.5).abs() < 1e-6);
        assert_eq!(kept.age_nanos, 20 * FRAME_NANOS);
        follow(&mut tracker, 25, &[Some(0.5)]);
        assert_eq!(tracker.last().unwrap().age_nanos, 0);
    }

    #[test]
    fn the_rate_of_change_is_limited() {
        let mut tracker = ScaleTracker::default();
        follow(&mut tracker, 0, &[Some(1.0); 20]);
        let factors = follow(&mut tracker, 20, &[Some(1.15); 50]);
        let steps = factors.windows(2).map(|pair| pair[1] / pair[0] - 1.0);
        assert!(steps.clone().all(|step| (-1e-6..0.0051).contains(&step)), "{factors:?}");
        assert!(factors[49] > 1.1, "it follows: {factors:?}");
    }

    #[test]
    fn a_table_that_passes_by_changes_nothing_and_a_lasting_change_is_followed() {
        let mut tracker = ScaleTracker::default();
        follow(&mut tracker, 0, &[Some(0.8); 30]);
        let passing = follow(&mut tracker, 30, &[Some(1.6); 15]);
        assert!(passing.iter().all(|factor| (factor - 0.8).abs() < 1e-4), "{passing:?}");
        follow(&mut tracker, 45, &[Some(0.8); 5]);
        let lasting = follow(&mut tracker, 50, &vec![Some(1.2); 300]);
        assert!((lasting[299] - 1.2).abs() < 0.02, "{}", lasting[299]);
    }

    #[test]
    fn frames_without_a_time_or_back_in_time_do_no_harm() {
        let mut tracker = ScaleTracker::default();
        for time in [None, Some(5), Some(-5), None, Some(i64::MAX), Some(i64::MIN)] {
            let scale = tracker.update(Some(0.7), time).unwrap();
            assert!((scale.factor - 0.7).abs() < 1e-5, "{time:?} {scale:?}");
        }
        assert_eq!(tracker.update(Some(f32::NAN), None).map(|scale| scale.factor < 1.0), Some(true));
    }
}
