//! A camera's part of the inference thread: one frame after the other through its pipeline, straight into shared memory.

use std::time::{Duration, Instant};

use nunet_core::clock::Clock as _;
use nunet_core::depth::Scale;
use nunet_core::pipeline::{FrameReport, Pipeline};
use nunet_ipc::LATE_JOINER_PERIOD;
use tracing::{debug, error, trace_span, warn};

use super::continuity::Continuity;
use super::mailbox::Taken;
use super::optics::Optics;
use super::pump::Lane;
use super::turns::{Player, Turn};
use crate::sink::collect::Collector;
use crate::sink::metrics::Metrics;
use crate::sink::recording::{Ending, Recorder};
use crate::sink::shm::{Outlet, stage_names};
use crate::sink::writing::Writing;
use crate::source::Frame;
use crate::telemetry::{Counts, End, Latencies, MonotonicClock, Totals, allocations_of_this_thread};

/// Everything that a camera's frame meets between the mailbox and its readers.
pub(crate) struct Worker {
    pipeline: Pipeline,
    optics: Optics,
    continuity: Continuity,
    outlet: Outlet,
    sinks: Sinks,
    totals: Totals,
    latencies: Latencies,
    /// What readers and metrics were told last.
    told: Counts,
    served: Instant,
    /// The last frame, while somebody may still come for what it went out without.
    kept: Option<Frame>,
}

/// Where results go beside shared memory.
#[derive(Default)]
pub(crate) struct Sinks {
    pub(crate) recorder: Option<Recorder>,
    pub(crate) collector: Option<Collector>,
    pub(crate) metrics: Option<Metrics>,
}

/// What is left of a camera when it has ended.
pub(crate) struct Remains {
    /// The scale of the last frame.
    pub(crate) scale: Scale,
    pub(crate) totals: Totals,
    pub(crate) latencies: Latencies,
    /// The recording, where there is one; its last records may still be on their way to the disk.
    pub(crate) recording: Option<Ending>,
    /// The last frame's files, where they are wanted; they may still be on their way to the disk.
    pub(crate) files: anyhow::Result<Option<Writing>>,
}

impl Worker {
    pub(crate) fn new(pipeline: Pipeline, optics: Optics, outlet: Outlet, sinks: Sinks) -> Self {
        let latencies = Latencies::new(stage_names(&pipeline));
        let (continuity, totals) = (Continuity::default(), Totals::default());
        let (told, served) = (Counts::default(), Instant::now());
        Self { pipeline, optics, continuity, outlet, sinks, totals, latencies, told, served, kept: None }
    }
}

impl Player for Worker {
    type Remains = Remains;

    fn begin(mut self) -> Self {
        self.totals.start(MonotonicClock.nanos());
        self
    }

    /// Takes the frame that waits, if there is one. It goes on waiting while the recording has no room for it, so that
    /// nobody else's turn does.
    fn turn(&mut self, lane: &Lane) -> Turn {
        if lane.stop.requested() {
            return self.wind_up(lane);
        }
        if let Some(recorder) = &mut self.sinks.recorder {
            recorder.look_after_the_disk();
            if !recorder.has_room() {
                self.rest(lane);
                return Turn::Nothing;
            }
        }
        match lane.mailbox.take(Duration::ZERO) {
            Taken::Item(frame) => {
                // First of all: a source in shared memory lends few frames.
                self.kept.take().into_iter().for_each(|kept| lane.mailbox.give_back(kept));
                Turn::Frame(self.take_through(frame, lane))
            }
            Taken::Nothing => {
                self.rest(lane);
                Turn::Nothing
            }
            Taken::Closed => Turn::Over,
        }
    }

    /// The writing of files begins, and the memory is given back. No disk is waited for: other cameras go on.
    fn end(mut self, lane: &Lane) -> Remains {
        let counts = lane.ledger.counts();
        self.outlet.publish_stats(&counts, &self.totals, &self.latencies);
        if let Some(metrics) = &mut self.sinks.metrics {
            metrics.end(&counts, &self.totals, &self.latencies);
        }
        let scale = self.pipeline.scale();
        let recording = self.sinks.recorder.map(Recorder::end);
        let files = self.sinks.collector.map_or(Ok(None), |collector| collector.write(&self.outlet));
        Remains { scale, totals: self.totals, latencies: self.latencies, recording, files }
    }
}

impl Worker {
    /// A stop finishes the frame in work, not the one that waits, whatever that one waits for. The source's thread
    /// supersedes it as well: who comes first counts it.
    fn wind_up(&mut self, lane: &Lane) -> Turn {
        // Asked first: once it is closed, nothing comes into it any more.
        let closed = lane.mailbox.wait_closed(Duration::ZERO);
        if lane.mailbox.recall() {
            lane.ledger.ended(End::Superseded);
        }
        if closed {
            return Turn::Over;
        }
        self.rest(lane);
        Turn::Nothing
    }

    /// The source stands still: now and then somebody may have come to read, and frames may have failed on their way here.
    fn rest(&mut self, lane: &Lane) {
        if self.served.elapsed() < LATE_JOINER_PERIOD {
            return;
        }
        self.served = Instant::now();
        self.outlet.refresh();
        if !lane.stop.requested() {
            self.serve_late_readers();
        }
        let up = !lane.is_waiting();
        if lane.ledger.counts() != self.told {
            self.tell(lane, up);
        } else if let Some(metrics) = &self.sinks.metrics {
            metrics.tell_health(up);
        }
    }

    /// Gives out the figures as they are now. What a caller of the metrics was in the way of is told again later.
    fn tell(&mut self, lane: &Lane, up: bool) {
        let counts = lane.ledger.counts();
        self.outlet.publish_stats(&counts, &self.totals, &self.latencies);
        let metrics = self.sinks.metrics.as_mut();
        if metrics.is_none_or(|metrics| metrics.update(up, &counts, &self.totals, &self.latencies)) {
            self.told = counts;
        }
    }

    fn take_through(&mut self, frame: Frame, lane: &Lane) -> End {
        let before = allocations_of_this_thread();
        let end = self.journey(&frame);
        lane.ledger.ended(end);
        self.tell(lane, true);
        match self.record(frame, end) {
            Some(frame) if end == End::Published && self.may_be_asked_again() => self.kept = Some(frame),
            Some(frame) => lane.mailbox.give_back(frame),
            None => {}
        }
        self.totals.add_allocations(before, allocations_of_this_thread());
        self.served = Instant::now();
        end
    }

    /// Whether somebody who comes later could read something of the last frame that was not made, and it can be made then:
    /// what a network or a filter remembers must not see a frame twice.
    fn may_be_asked_again(&self) -> bool {
        self.outlet.left_something_out() && self.pipeline.is_stateless()
    }

    /// Makes labels and cloud of the last frame for readers that came since. The frame has been counted; this is work for
    /// readers and no frame.
    fn serve_late_readers(&mut self) {
        let Some(frame) = self.kept.take() else { return };
        match self.try_serve_late_readers(&frame) {
            Ok(()) => self.kept = Some(frame),
            // It would fail again, five times a second.
            Err(error) => warn!("late readers of frame {} are not served: {error:#}", frame.sequence),
        }
    }

    fn try_serve_late_readers(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let Some(mut loans) = self.outlet.loan_for_late_readers()? else { return Ok(()) };
        let report = self.pipeline.process(&frame.view()?, loans.outputs()?, &MonotonicClock)?;
        self.outlet.publish_to_late_readers(loans, frame, &report)
    }

    /// Hands a published frame to the recording, where there is one; gives it back where it was not taken.
    fn record(&mut self, frame: Frame, end: End) -> Option<Frame> {
        match &mut self.sinks.recorder {
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
