//! The time of each stage of a frame, in a list that never allocates.

use crate::graph::MAX_STAGES;

/// The stages of a serial graph, and what the pipeline does before and after it: preprocessing, decoding,
/// four filters, the cloud, and room for one more.
pub const MAX_TIMED_STAGES: usize = MAX_STAGES + 8;

/// Microseconds of each stage, in the order in which the stages ran. The names are known once, at load; the
/// n-th time belongs to the n-th name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct StageTimes {
    micros: [u32; MAX_TIMED_STAGES],
    count: usize,
}

impl StageTimes {
    /// Adds the time of the next stage, from the clock's nanoseconds before and after it.
    ///
    /// A stage beyond [`MAX_TIMED_STAGES`] is not kept; manifests are too short for that.
    pub fn push(&mut self, start_nanos: u64, end_nanos: u64) {
        if let Some(slot) = self.micros.get_mut(self.count) {
            *slot = u32::try_from(end_nanos.saturating_sub(start_nanos) / 1000).unwrap_or(u32::MAX);
            self.count += 1;
        }
    }

    /// Adds the times of stages that ran after these.
    pub fn extend(&mut self, later: &Self) {
        for &micros in later.micros() {
            if let Some(slot) = self.micros.get_mut(self.count) {
                *slot = micros;
                self.count += 1;
            }
        }
    }

    /// Microseconds, one for each stage.
    #[must_use]
    pub fn micros(&self) -> &[u32] {
        &self.micros[..self.count]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_kept_in_the_order_in_which_stages_ran() {
        let mut graph = StageTimes::default();
        graph.push(5_000, 12_000);
        let mut times = StageTimes::default();
        times.push(1_000, 3_500);
        times.extend(&graph);
        assert_eq!(times.micros(), [2, 7]);
    }

    #[test]
    fn a_clock_that_steps_back_gives_zero() {
        let mut times = StageTimes::default();
        times.push(9_000, 1_000);
        assert_eq!(times.micros(), [0]);
    }

    #[test]
    fn more_stages_than_there_is_room_for_are_dropped() {
        let mut times = StageTimes::default();
        for _ in 0..MAX_TIMED_STAGES + 3 {
            times.push(0, 1_000);
        }
        assert_eq!(times.micros().len(), MAX_TIMED_STAGES);
    }
}
