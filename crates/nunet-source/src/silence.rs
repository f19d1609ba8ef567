//! How long a camera that another process publishes has been silent.

use std::time::{Duration, Instant};

/// A connected camera that sends nothing for this time counts as away.
const SILENCE: Duration = Duration::from_secs(5);
/// How often the user is reminded that the camera is away.
const REMINDER: Duration = Duration::from_secs(10);

/// How long no frame has arrived, and when that was last reported.
#[derive(Debug, Default)]
pub(crate) struct Silence {
    /// The last frame, or when the camera was connected to.
    since: Option<Instant>,
    reminded: Option<Instant>,
    waiting: bool,
}

impl Silence {
    /// A camera that was just connected had no time to send yet.
    pub(crate) fn begins(&mut self, now: Instant) {
        self.since = Some(now);
    }

    /// Records a frame.
    pub(crate) fn ends(&mut self, now: Instant) {
        *self = Self { since: Some(now), reminded: None, waiting: false };
    }

    /// Whether the camera is away, as far as it was recorded.
    pub(crate) fn is_waiting(&self) -> bool {
        self.waiting
    }

    pub(crate) fn is_long(&self, now: Instant) -> bool {
        self.since.is_none_or(|since| now.duration_since(since) >= SILENCE)
    }

    /// Records that the camera is away. Returns whether to report it, which is once per interval.
    pub(crate) fn is_news(&mut self, now: Instant) -> bool {
        self.waiting = true;
        let news = self.reminded.is_none_or(|last| now.duration_since(last) >= REMINDER);
        if news {
            self.reminded = Some(now);
        }
        news
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_camera_that_was_just_connected_is_not_silent_and_later_is_reported_now_and_then() {
        let (mut silence, start) = (Silence::default(), Instant::now());
        let at = |seconds: f64| start + Duration::from_secs_f64(seconds);
        silence.begins(start);
        assert!(!silence.is_long(at(0.1)) && !silence.waiting);
        assert!(silence.is_long(at(5.0)));
        assert!(silence.is_news(at(5.0)) && silence.waiting);
        assert!(!silence.is_news(at(14.0)));
        assert!(silence.is_news(at(15.0)));
        silence.ends(at(16.0));
        assert!(!silence.is_long(at(20.0)) && !silence.waiting);
        assert!(silence.is_news(at(21.0)), "a new silence is reported at once");
    }

    #[test]
    fn a_camera_that_was_waited_for_is_not_back_before_its_first_frame() {
        let (mut silence, start) = (Silence::default(), Instant::now());
        assert!(silence.is_news(start), "it does not exist");
        silence.begins(start);
        assert!(silence.waiting, "it exists and has not sent anything");
        silence.ends(start);
        assert!(!silence.waiting);
    }
}
