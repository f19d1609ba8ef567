//! Rate limits for log messages that can occur on every frame.

use std::fmt;
use std::hash::{DefaultHasher, Hasher as _};
use std::time::{Duration, Instant};

/// The number of messages in a row that are logged.
const BURST: u32 = 5;
/// Afterwards one message per period.
const PERIOD: Duration = Duration::from_secs(10);

/// A token bucket for one kind of message. The next logged message states how many were suppressed.
#[derive(Debug)]
pub struct RateLimit {
    tokens: u32,
    refilled: Option<Instant>,
    suppressed: u64,
    /// The last message of [`Self::allow_text`], and when it was logged.
    last: Option<(u64, Instant)>,
}

/// The number of suppressed messages since the last logged one; prints nothing for 0.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Suppressed(u64);

impl Default for RateLimit {
    fn default() -> Self {
        Self { tokens: BURST, refilled: None, suppressed: 0, last: None }
    }
}

impl RateLimit {
    /// Whether a message is logged now: `None` if not.
    pub fn allow(&mut self, now: Instant) -> Option<Suppressed> {
        let refilled = *self.refilled.get_or_insert(now);
        let periods = now.duration_since(refilled).as_secs() / PERIOD.as_secs();
        if periods > 0 {
            self.tokens = u32::try_from(periods).unwrap_or(BURST).saturating_add(self.tokens).min(BURST);
            self.refilled = Some(now);
        }
        if self.tokens == 0 {
            self.suppressed += 1;
            return None;
        }
        self.tokens -= 1;
        Some(Suppressed(std::mem::take(&mut self.suppressed)))
    }

    /// As [`Self::allow`], but a message that says the same as the last one is logged once per period:
    /// "message 7 on topic `/a`: unknown encoding" for each message of a recording.
    pub fn allow_text(&mut self, now: Instant, text: &str) -> Option<Suppressed> {
        let meaning = meaning(text);
        let repeats = self.last.is_some_and(|(last, at)| last == meaning && now.duration_since(at) < PERIOD);
        if repeats {
            self.suppressed += 1;
            return None;
        }
        let allowed = self.allow(now)?;
        self.last = Some((meaning, now));
        Some(allowed)
    }

    /// The message that a frame is lost, if [`Self::allow_text`] allows it.
    pub fn lost_frame(&mut self, now: Instant, number: u64, why: &dyn fmt::Display) -> Option<String> {
        let text = format!("frame {number} is lost: {why:#}");
        self.allow_text(now, &text).map(|suppressed| format!("{text}{suppressed}"))
    }
}

/// A hash of a text without its numbers; digits of names, which are between backticks, count.
fn meaning(text: &str) -> u64 {
    let (mut hasher, mut is_name) = (DefaultHasher::new(), false);
    for byte in text.bytes() {
        is_name ^= byte == b'`';
        if is_name || !byte.is_ascii_digit() {
            hasher.write_u8(byte);
        }
    }
    hasher.finish()
}

impl fmt::Display for Suppressed {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => Ok(()),
            1 => f.write_str(" (1 similar message was not logged)"),
            count => write!(f, " ({count} similar messages were not logged)"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn after_a_burst_one_message_per_period_is_logged_with_the_count_of_the_others() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        let mut logged = Vec::new();
        // 30 messages per second for 25 s.
        for tick in 0..750_u32 {
            if let Some(Suppressed(count)) = limit.allow(start + Duration::from_secs(1) * tick / 30) {
                logged.push((tick, count));
            }
        }
        assert_eq!(logged, [(0, 0), (1, 0), (2, 0), (3, 0), (4, 0), (300, 295), (600, 299)]);
    }

    #[test]
    fn what_differs_in_numbers_only_is_logged_once_per_period_and_each_name_once() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        let mut allow = |seconds, text: &str| {
            limit.allow_text(start + Duration::from_secs(seconds), text).map(|Suppressed(count)| count)
        };
        let logged: Vec<_> =
            (1..40).map(|n| allow(n / 10, &format!("message {n} on `/a1`: unknown"))).collect();
        assert_eq!(logged.iter().flatten().collect::<Vec<_>>(), [&0]);
        assert_eq!(allow(12, "message 41 on `/a1`: unknown"), Some(38));
        assert_eq!(
            (allow(12, "cannot read `a1.png`"), allow(12, "cannot read `a2.png`")),
            (Some(0), Some(0))
        );
    }

    #[test]
    fn frames_that_are_lost_for_one_reason_are_one_message_per_period() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        assert_eq!(limit.lost_frame(start, 7, &"no data").as_deref(), Some("frame 7 is lost: no data"));
        assert_eq!(limit.lost_frame(start, 8, &"no data"), None);
        let next = limit.lost_frame(start + PERIOD, 9, &"no data");
        assert_eq!(next, Some(format!("frame 9 is lost: no data{}", Suppressed(1))));
    }

    #[test]
    fn a_quiet_period_allows_a_burst_again_and_no_more() {
        let (mut limit, start) = (RateLimit::default(), Instant::now());
        let allowed = |limit: &mut RateLimit, at| (0..20).filter(|_| limit.allow(at).is_some()).count();
        assert_eq!(allowed(&mut limit, start), 5);
        assert_eq!(allowed(&mut limit, start + PERIOD * 1000), 5);
    }

    #[test]
    fn the_count_is_printed_only_if_messages_were_suppressed() {
        assert_eq!(Suppressed(0).to_string(), "");
        assert_eq!(Suppressed(1).to_string(), " (1 similar message was not logged)");
        assert_eq!(Suppressed(7).to_string(), " (7 similar messages were not logged)");
    }
}
