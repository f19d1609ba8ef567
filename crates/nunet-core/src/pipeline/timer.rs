//! The time of each stage of a frame.

use crate::clock::Clock;
use crate::graph::{GraphReport, StageTimes};

/// Measures the stages of one frame.
pub(super) struct StageTimer<'a> {
    clock: &'a dyn Clock,
    stages: StageTimes,
}

impl<'a> StageTimer<'a> {
    pub(super) fn new(clock: &'a dyn Clock) -> Self {
        Self { clock, stages: StageTimes::default() }
    }

    /// Runs a stage and adds its time.
    pub(super) fn time<T>(&mut self, stage: impl FnOnce() -> T) -> T {
        let start = self.clock.nanos();
        let result = stage();
        self.stages.push(start, self.clock.nanos());
        result
    }

    /// Adds the times of the graph's stages.
    pub(super) fn extend(&mut self, run: GraphReport) -> GraphReport {
        self.stages.extend(&run.stages);
        run
    }

    /// For stages that measure themselves.
    pub(super) fn stages(&mut self) -> &mut StageTimes {
        &mut self.stages
    }

    pub(super) fn finish(self) -> StageTimes {
        self.stages
    }
}
