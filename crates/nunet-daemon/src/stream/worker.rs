//! The inference thread: one frame after the other through the pipeline, straight into shared memory.

use std::time::Duration;

use nunet_core::clock::Clock as _;
use nunet_core::depth::Scale;
use nunet_core::pipeline::{FrameReport, Pipeline};
use tracing::{debug, error, trace_span};

use super::continuity::Continuity;
use super::mailbox::Taken;
use super::optics::Optics;
use super::pump::Lane;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{Recorder, Tally};
use crate::sink::shm::{Outlet, stage_names};
use crate::source::Frame;
use crate::telemetry::{End, Latencies, MonotonicClock, Supervisor, Totals, allocations_of_this_thread};

/// How soon a reader that joins a source that stands still gets the last frame.
const LATE_JOINER_PERIOD: Duration = Duration::from_millis(200);

/// Everything that a frame meets between the mailbox and its readers.
pub(crate) struct Worker {
    pipeline: Pipeline,
    optics: Optics,
    continuity: Continuity,
    outlet: Outlet,
    recorder: Option<Recorder>,
    metrics: Option<Metrics>,
    supervisor: Supervisor,
    totals: Totals,
    latencies: Latencies,
}

/// What is left of a stream when it has ended.
pub(crate) struct Remains {
    /// Still open, so that the last frame can be read.
    pub(crate) outlet: Outlet,
    /// The scale of the last frame.
    pub(crate) scale: Scale,
    pub(crate) totals: Totals,
    pub(crate) latencies: Latencies,
    /// What became of the recording, where there is one.
    pub(crate) recording: Option<Tally>,
}

impl Worker {
    pub(crate) fn new(
        pipeline: Pipeline,
        optics: Optics,
        outlet: Outlet,
        recorder: Option<Recorder>,
        metrics: Option<Metrics>,
    ) -> Self {
        let latencies = Latencies::new(stage_names(&pipeline));
        let (continuity, totals) = (Continuity::default(), Totals::default());
        let supervisor = Supervisor::from_environment();
        Self { pipeline, optics, continuity, outlet, recorder, metrics, supervisor, totals, latencies }
    }

    /// Works until the mailbox is closed and empty.
    pub(crate) fn run(mut self, lane: &Lane) -> Remains {
        self.supervisor.ready("the self-test has passed, frames may come");
        self.totals.start(MonotonicClock.nanos());
        loop {
            match lane.mailbox.take(LATE_JOINER_PERIOD) {
                Taken::Item(frame) => self.take_through(frame, lane),
                Taken::Nothing => self.outlet.refresh(),
                Taken::Closed => break,
            }
        }
        Supervisor::stopping();
        let scale = self.pipeline.scale();
        let recording = self.recorder.map(Recorder::finish);
        Remains { outlet: self.outlet, scale, totals: self.totals, latencies: self.latencies, recording }
    }

    fn take_through(&mut self, frame: Frame, lane: &Lane) {
        let before = allocations_of_this_thread();
        let end = self.journey(&frame);
        lane.ledger.ended(end);
        if end == End::Published {
            self.supervisor.frame_done();
        }
        let counts = lane.ledger.counts();
        self.outlet.publish_stats(&counts, &self.totals, &self.latencies);
        if let Some(metrics) = &mut self.metrics {
            metrics.update(&counts, &self.totals, &self.latencies);
        }
        if let Some(frame) = self.record(frame, end) {
            lane.mailbox.give_back(frame);
        }
        self.totals.add_allocations(before, allocations_of_this_thread());
    }

    /// Hands a published frame to the recording, where there is one; gives it back where it was not taken.
    fn record(&mut self, frame: Frame, end: End) -> Option<Frame> {
        match &mut self.recorder {
            Some(recorder) if end == End::Published => {
                let camera = self.optics.camera_of(&frame).ok().flatten();
                recorder.offer(frame, camera)
            }
            _ => Some(frame),
        }
    }

    /// One span a frame; a failure is told here and nowhere else.
    fn journey(&mut self, frame: &Frame) -> End {
        let _span = trace_span!("frame", sequence = frame.sequence).entered();
        match self.try_journey(frame) {
            Ok(()) => End::Published,
            Err(error) => {
                error!("frame {} is lost: {error:#}", frame.sequence);
                End::Failed
            }
        }
    }

    fn try_journey(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let taken_nanos = MonotonicClock.nanos();
        self.optics.follow(frame, &mut self.pipeline)?;
        if let Some(jump) = self.continuity.jump_to(frame) {
            debug!("frame {} begins anew: {jump}", frame.sequence);
            self.pipeline.reset();
        }
        let mut loans = self.outlet.loan()?;
        let report = self.pipeline.process(&frame.view()?, loans.outputs()?, &MonotonicClock)?;
        self.continuity.took(frame);
        let queue_micros = micros(frame.ready_nanos, taken_nanos);
        let processed_nanos = MonotonicClock.nanos();
        self.outlet.publish(loans, frame, &report, queue_micros)?;
        self.account(frame, &report, queue_micros, processed_nanos);
        Ok(())
    }

    fn account(&mut self, frame: &Frame, report: &FrameReport, queue_micros: u32, processed_nanos: u64) {
        let now_nanos = MonotonicClock.nanos();
        let inner = report.stages.micros().iter().copied();
        let publish = std::iter::once(micros(processed_nanos, now_nanos));
        let stages = std::iter::once(queue_micros).chain(inner).chain(publish).map(u64::from);
        self.latencies.record(micros(frame.ready_nanos, now_nanos).into(), stages);
        self.totals.add_published(now_nanos, report.bytes_copied);
    }
}

fn micros(start_nanos: u64, end_nanos: u64) -> u32 {
    u32::try_from(end_nanos.saturating_sub(start_nanos) / 1000).unwrap_or(u32::MAX)
}
