//! How often a client receives a frame.

use std::time::Duration;

use tokio::time::Instant;

/// Spaces the frames of one client so that neither a rate of frames nor a rate of bits is exceeded on
/// average.
#[derive(Debug, Clone, Copy)]
pub(crate) struct ClientPacer {
    interval: Duration,
    seconds_per_byte: f64,
    due: Instant,
}

impl ClientPacer {
    /// Both limits are positive.
    pub(crate) fn new(max_fps: f32, max_mbit_per_s: f32) -> Self {
        Self {
            interval: Duration::from_secs_f32(1.0 / max_fps),
            seconds_per_byte: 8e-6 / f64::from(max_mbit_per_s),
            due: Instant::now(),
        }
    }

    /// Waits until the next frame may be sent.
    pub(crate) async fn ready(&self) {
        tokio::time::sleep_until(self.due).await;
    }

    /// Counts a frame that is sent at `now`. The unused time of one and a half frames is carried over, so
    /// that a source of exactly the permitted rate loses no frames to jitter.
    pub(crate) fn sent(&mut self, bytes: usize, now: Instant) {
        let cost = self.interval.max(Duration::from_secs_f64(bytes as f64 * self.seconds_per_byte));
        let earliest = now.checked_sub(cost * 3 / 2).unwrap_or(now);
        self.due = self.due.max(earliest) + cost;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames sent within `seconds` from a source of `source_fps`.
    fn sent(mut pacer: ClientPacer, source_fps: f64, bytes: usize, seconds: f64) -> u32 {
        let start = pacer.due;
        let mut count = 0;
        for frame in 0..(seconds * source_fps) as u32 {
            let now = start + Duration::from_secs_f64(f64::from(frame) / source_fps);
            if now >= pacer.due {
                pacer.sent(bytes, now);
                count += 1;
            }
        }
        count
    }

    #[test]
    fn a_source_of_the_permitted_rate_is_not_thinned() {
        // Rounded intervals may cost the first one.
        let count = sent(ClientPacer::new(15.0, 1000.0), 15.0, 1000, 10.0);
        assert!((149..=150).contains(&count), "{count} frames in 10 s");
    }

    #[test]
    fn a_faster_source_is_thinned_to_the_permitted_rate() {
        let count = sent(ClientPacer::new(15.0, 1000.0), 50.0, 1000, 10.0);
        assert!((145..=152).contains(&count), "{count} frames in 10 s");
    }

    #[test]
    fn large_frames_keep_to_the_permitted_bits() {
        // 40 kB per frame: 3 Mbit/s are 9.4 frames per second.
        let count = sent(ClientPacer::new(30.0, 3.0), 100.0, 40_000, 10.0);
        assert!((90..=95).contains(&count), "{count} frames in 10 s");
    }
}
