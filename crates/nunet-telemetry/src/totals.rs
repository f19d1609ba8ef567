//! Sums over a stream, for the values per frame.

use crate::allocations::{Allocations, allocations_of_this_thread};
use crate::stability::StabilityTotals;

/// Allocations of so many frames at the start are not counted, because buffers are allocated then.
const FIRST_FRAMES: u64 = 16;

/// Sums over the published frames of a stream.
#[derive(Debug, Default, Clone)]
pub struct Totals {
    start_nanos: u64,
    last_nanos: u64,
    frames: u64,
    bytes_copied: u64,
    steady_frames: u64,
    steady_allocations: Allocations,
    /// Frames for which no attitude of the robot was found, although it is read.
    pub without_attitude: u64,
    /// Drift and flicker of depth.
    pub stability: StabilityTotals,
}

impl Totals {
    /// Marks the beginning of the stream.
    pub fn start(&mut self, now_nanos: u64) {
        self.start_nanos = now_nanos;
        self.last_nanos = now_nanos;
    }

    /// Adds a published frame.
    pub fn add_published(&mut self, now_nanos: u64, bytes_copied: u64) {
        self.last_nanos = now_nanos;
        self.frames += 1;
        self.bytes_copied += bytes_copied;
    }

    /// How many frames were published.
    pub fn frames(&self) -> u64 {
        self.frames
    }

    /// Adds another stream.
    pub fn join(&mut self, other: &Self) {
        self.start_nanos = self.start_nanos.min(other.start_nanos);
        self.last_nanos = self.last_nanos.max(other.last_nanos);
        self.frames += other.frames;
        self.bytes_copied += other.bytes_copied;
        self.steady_frames += other.steady_frames;
        self.steady_allocations.own += other.steady_allocations.own;
        self.steady_allocations.foreign += other.steady_allocations.foreign;
        self.without_attitude += other.without_attitude;
        self.stability.join(&other.stability);
    }

    /// The inference thread's allocations before and after one frame.
    pub fn add_allocations(&mut self, before: Allocations, after: Allocations) {
        if self.frames > FIRST_FRAMES {
            self.steady_frames += 1;
            self.steady_allocations.own += after.own - before.own;
            self.steady_allocations.foreign += after.foreign - before.foreign;
        }
    }

    /// Published frames per second.
    pub fn fps(&self) -> f64 {
        let seconds = self.last_nanos.saturating_sub(self.start_nanos) as f64 / 1e9;
        if seconds > 0.0 { self.frames as f64 / seconds } else { 0.0 }
    }

    /// Mean over all published frames.
    pub fn bytes_copied_per_frame(&self) -> f64 {
        self.bytes_copied as f64 / self.frames.max(1) as f64
    }

    /// Mean heap allocations of nunet's crates, over the frames after the first 16; `None` without such
    /// frames, or with another allocator.
    pub fn allocations_per_frame(&self) -> Option<f64> {
        self.per_steady_frame(self.steady_allocations.own)
    }

    /// Mean heap allocations of iceoryx2, which allocates a few bytes for each message.
    pub fn foreign_allocations_per_frame(&self) -> Option<f64> {
        self.per_steady_frame(self.steady_allocations.foreign)
    }

    fn per_steady_frame(&self, sum: u64) -> Option<f64> {
        let counting = allocations_of_this_thread() != Allocations::default();
        (counting && self.steady_frames > 0).then(|| sum as f64 / self.steady_frames as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rates_and_means_of_a_known_stream() {
        let mut totals = Totals::default();
        totals.start(1_000_000_000);
        for frame in 1..=20 {
            totals.add_published(1_000_000_000 + frame * 100_000_000, 300);
        }
        assert!((totals.fps() - 10.0).abs() < 1e-9);
        assert!((totals.bytes_copied_per_frame() - 300.0).abs() < 1e-9);
    }

    #[test]
    fn two_concurrent_streams_have_the_sum_of_their_rates() {
        let stream = |period: u64, frames: u64, bytes: u64| {
            let mut totals = Totals::default();
            totals.start(1_000_000_000);
            (1..=frames).for_each(|frame| totals.add_published(1_000_000_000 + frame * period, bytes));
            totals
        };
        let mut both = stream(100_000_000, 20, 300);
        both.join(&stream(50_000_000, 20, 100));
        assert!((both.fps() - 20.0).abs() < 1e-9, "40 frames in 2 s");
        assert!((both.bytes_copied_per_frame() - 200.0).abs() < 1e-9);
    }

    #[test]
    fn a_stream_without_frames_has_no_rate() {
        let totals = Totals::default();
        assert_eq!(totals.fps(), 0.0);
        assert_eq!(totals.bytes_copied_per_frame(), 0.0);
        assert_eq!(totals.allocations_per_frame(), None);
    }
}
