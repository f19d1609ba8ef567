//! One camera's work on the inference thread: computes results in shared memory and passes them to sinks.

mod late_readers;

use std::time::{Duration, Instant};

use nunet_core::clock::Clock as _;
use nunet_core::depth::Scale;
use nunet_core::pipeline::{FrameReport, Pipeline};
use nunet_engine::{MonotonicClock, details_of};
use nunet_ipc::LATE_JOINER_PERIOD;
use nunet_sink::attitude::AttitudeStage;
use nunet_sink::empty_depth::EmptyDepthWarning;
use nunet_sink::obstacles::ObstacleStage;
use nunet_sink::stability::{StabilityLimit, StabilityWarning};
use nunet_sink::stats_record::stage_names;
use nunet_telemetry::{
    Counts, FrameEnd, Latencies, MessageCounts, RateLimit, Totals, allocations_of_this_thread, micros_between,
};
use nunet_types::{PixelRect, counted};
use tracing::{debug, error, trace_span};

use super::round_robin::{Poll, RoundRobinTask};
use super::state::StreamState;
use crate::exit::{is_usage, warn_of_camera};
use crate::sink::loans::Loans;
use crate::sink::shm::ShmPublisher;
use crate::sink::{FinishingSink, PublishedFrame, Results, Sink, Status, Timings, Wants};
use crate::source::{CameraResolver, Continuity, Frame, Taken};

/// If this many frames fail before the first one is published, the next ones would fail too.
const MAX_FAILURES_BEFORE_FIRST_FRAME: u32 = 30;

/// The work between a camera's mailbox and its readers and sinks.
pub(crate) struct StreamTask {
    pipeline: Pipeline,
    camera: CameraResolver,
    continuity: Continuity,
    publisher: ShmPublisher,
    obstacles: Option<ObstacleStage>,
    /// For obstacles, the labels of a frame whose labels no reader and no sink needs.
    spare_labels: Vec<u8>,
    attitude: Option<AttitudeStage>,
    sinks: Vec<Box<dyn Sink>>,
    totals: Totals,
    latencies: Latencies,
    /// The counts that were last reported to readers and sinks.
    last_reported: Counts,
    served: Instant,
    /// The last frame, if missing results can still be computed from it.
    kept: Option<Frame>,
    lost: RateLimit,
    empty_depth: EmptyDepthWarning,
    stability: StabilityWarning,
    failures: u32,
    /// Why the stream cannot continue.
    failure: Option<anyhow::Error>,
}

/// The result of a camera after its end.
pub(crate) struct StreamSummary {
    /// The scale of the last frame.
    pub(crate) scale: Scale,
    /// The part of the last image that depth covers.
    pub(crate) view: PixelRect,
    pub(crate) totals: Totals,
    pub(crate) latencies: Latencies,
    /// The counts of messages to other machines.
    pub(crate) messages: Vec<(&'static str, MessageCounts)>,
    /// The sinks, which may still write their last frames.
    pub(crate) sinks: Vec<FinishingSink>,
    /// Why frames could not be processed at all.
    pub(crate) failure: Option<anyhow::Error>,
}

impl StreamTask {
    pub(crate) fn new(
        pipeline: Pipeline,
        camera: CameraResolver,
        publisher: ShmPublisher,
        sinks: Vec<Box<dyn Sink>>,
    ) -> Self {
        Self {
            latencies: Latencies::new(stage_names(&pipeline, false)),
            pipeline,
            camera,
            continuity: Continuity::default(),
            publisher,
            obstacles: None,
            spare_labels: Vec::new(),
            attitude: None,
            sinks,
            totals: Totals::default(),
            last_reported: Counts::default(),
            served: Instant::now(),
            kept: None,
            lost: RateLimit::default(),
            empty_depth: EmptyDepthWarning::default(),
            stability: StabilityWarning::default(),
            failures: 0,
            failure: None,
        }
    }

    /// Adds a stage that finds obstacles, and one that follows the attitude of the robot.
    pub(crate) fn with_stages(
        self,
        obstacles: Option<ObstacleStage>,
        attitude: Option<AttitudeStage>,
    ) -> Self {
        let latencies = Latencies::new(stage_names(&self.pipeline, obstacles.is_some()));
        let has_labels = obstacles.is_some() && self.pipeline.graph().has_labels();
        let spare_labels = vec![0; if has_labels { self.pipeline.size().pixel_count() } else { 0 }];
        Self { latencies, obstacles, spare_labels, attitude, ..self }
    }

    /// The same with another limit of drift and flicker.
    pub(crate) fn with_stability_limit(mut self, limit: StabilityLimit) -> Self {
        self.totals.stability.set_limit(limit.0);
        self
    }
}

#[cfg(test)]
impl StreamTask {
    /// Replaces the camera.
    pub(super) fn with_camera(self, camera: CameraResolver) -> Self {
        Self { camera, ..self }
    }
}

impl RoundRobinTask for StreamTask {
    type Summary = StreamSummary;

    fn begin(mut self) -> Self {
        self.totals.start(MonotonicClock.nanos());
        self
    }

    /// Takes the waiting frame, if there is one. If a sink has no room, the frame stays in the mailbox, so
    /// that other cameras do not wait.
    fn poll(&mut self, state: &StreamState) -> Poll {
        if state.stop.requested() || self.failure.is_some() {
            return self.wind_up(state);
        }
        // Every sink is checked: it may have to warn that it stalls.
        let full = self.sinks.iter_mut().filter_map(|sink| (!sink.has_room()).then_some(())).count();
        if full > 0 {
            self.idle(state);
            return Poll::Idle;
        }
        match state.mailbox.take(Duration::ZERO) {
            Taken::Item(frame) => {
                // First: a source in shared memory lends few frames.
                self.kept.take().into_iter().for_each(|kept| state.mailbox.give_back(kept));
                Poll::Frame(self.handle_frame(frame, state))
            }
            Taken::Nothing => {
                self.idle(state);
                Poll::Idle
            }
            Taken::Closed => Poll::Ended,
        }
    }

    /// Sinks begin to finish, and shared memory is released. It does not wait: other cameras continue.
    fn end(mut self, state: &StreamState) -> StreamSummary {
        self.report_stats(state, false);
        let mut last = self.publisher.last_results();
        if let Some(last) = &mut last {
            last.obstacles = self.obstacles.as_ref().and_then(ObstacleStage::last);
        }
        let messages = self.sinks.iter().filter_map(|sink| sink.messages()).collect();
        let sinks = self.sinks.into_iter().map(|sink| sink.finish(last.as_ref())).collect();
        StreamSummary {
            scale: self.pipeline.scale(),
            view: self.pipeline.framing().view(),
            totals: self.totals,
            latencies: self.latencies,
            messages,
            sinks,
            failure: self.failure,
        }
    }
}

impl StreamTask {
    /// A stop finishes the frame being processed, not the waiting one. This thread or the capture thread
    /// supersedes the waiting one; the first of them counts it.
    fn wind_up(&mut self, state: &StreamState) -> Poll {
        // Checked first: a closed mailbox takes no more frames.
        let closed = state.mailbox.wait_closed(Duration::ZERO);
        if state.mailbox.recall() {
            state.ledger.ended(FrameEnd::Superseded);
        }
        if closed {
            return Poll::Ended;
        }
        self.idle(state);
        Poll::Idle
    }

    /// The source is paused: readers may have joined meanwhile, and frames may have failed before they came
    /// here.
    fn idle(&mut self, state: &StreamState) {
        self.give_back_if_requested(state);
        if self.served.elapsed() < LATE_JOINER_PERIOD {
            return;
        }
        self.served = Instant::now();
        self.publisher.refresh();
        if !state.stop.requested() {
            self.serve_late_readers();
        }
        self.report_stats(state, !state.is_waiting());
    }

    /// Passes the current counts and latencies to readers and sinks.
    fn report_stats(&mut self, state: &StreamState, is_up: bool) {
        let counts = state.ledger.counts();
        if counts != self.last_reported || !is_up {
            self.publisher.publish_stats(&counts, &self.totals, &self.latencies);
            self.last_reported = counts;
        }
        let status = Status { is_up, counts: &counts, totals: &self.totals };
        self.sinks.iter_mut().for_each(|sink| sink.on_status(&status));
    }

    fn handle_frame(&mut self, frame: Frame, state: &StreamState) -> FrameEnd {
        let before = allocations_of_this_thread();
        let end = self.process_frame(&frame);
        state.ledger.ended(end);
        self.report_stats(state, true);
        if self.failure.is_some() {
            state.mailbox.close();
        }
        self.keep_or_give_back(frame, end, state);
        self.totals.add_allocations(before, allocations_of_this_thread());
        self.served = Instant::now();
        end
    }

    /// One span per frame. A failure is logged here and nowhere else.
    fn process_frame(&mut self, frame: &Frame) -> FrameEnd {
        let _span = trace_span!("frame", sequence = frame.sequence).entered();
        match self.try_process_frame(frame) {
            Ok(()) => {
                self.failures = 0;
                FrameEnd::Published
            }
            Err(error) => {
                self.fail(frame, error);
                FrameEnd::Failed
            }
        }
    }

    /// A failed frame is lost; the stream continues, unless all following frames would fail too.
    fn fail(&mut self, frame: &Frame, error: anyhow::Error) {
        self.failures = self.failures.saturating_add(1);
        let is_first = self.totals.frames() == 0;
        if is_usage(&error) {
            self.failure = Some(error);
        } else if is_first && self.failures >= MAX_FAILURES_BEFORE_FIRST_FRAME {
            self.failure =
                Some(error.context(format!("the first {} failed", counted(self.failures, "frame"))));
        } else if let Some(text) = self.lost.lost_frame(Instant::now(), frame.sequence, &error) {
            error!("{text}");
            details_of(error.as_ref()).into_iter().for_each(|text| debug!("ONNX Runtime's message: {text}"));
        }
    }

    fn try_process_frame(&mut self, frame: &Frame) -> anyhow::Result<()> {
        let taken_nanos = MonotonicClock.nanos();
        warn_of_camera(&self.camera.update(frame, &mut self.pipeline)?);
        if let Some(reason) = self.continuity.discontinuity_to(frame) {
            debug!("frame {} does not follow the last one: {reason}", frame.sequence);
            self.pipeline.reset();
            self.obstacles.iter_mut().for_each(ObstacleStage::reset);
        }
        self.pipeline.set_frame_nanos(frame.capture.nanos);
        if let Some(attitude) = &mut self.attitude {
            attitude.follow(frame, &mut self.pipeline, self.obstacles.as_mut());
            self.totals.without_attitude = attitude.frames_without();
        }
        let wants = self.sinks.iter().map(|sink| sink.wants()).fold(Wants::default(), Wants::union);
        let mut loans = self.publisher.loan(wants)?;
        let with_obstacles = wants.obstacles || self.publisher.has_obstacle_readers();
        let report = self.process(frame, &mut loans, with_obstacles)?;
        self.continuity.took(frame);
        self.empty_depth.check(frame.sequence, &report, self.pipeline.size());
        self.stability.check(frame.sequence, &report, &mut self.totals);
        let queue_micros = micros_between(frame.ready_nanos, taken_nanos);
        let processed_nanos = MonotonicClock.nanos();
        self.publisher.publish(loans, frame, &report, queue_micros)?;
        self.account(frame, &report, queue_micros, processed_nanos, with_obstacles);
        Ok(())
    }

    /// Computes a frame's results into `loans`: the pipeline, then obstacles if needed.
    fn process(
        &mut self,
        frame: &Frame,
        loans: &mut Loans,
        with_obstacles: bool,
    ) -> anyhow::Result<FrameReport> {
        let spare = with_obstacles.then_some(&mut self.spare_labels[..]).filter(|labels| !labels.is_empty());
        let mut outputs = loans.outputs(spare)?;
        let mut report = self.pipeline.process(&frame.view()?, outputs.reborrow(), &MonotonicClock)?;
        report.bytes_copied += frame.bytes_copied;
        let Some(stage) = &mut self.obstacles else { return Ok(report) };
        let start_nanos = MonotonicClock.nanos();
        if with_obstacles {
            let options = stage.config().options;
            let image = outputs.depth_image(self.pipeline.confidence());
            let camera = self.pipeline.points_camera();
            let found = stage.detect(camera, &image, frame.capture.nanos, Instant::now())?;
            let used_attitude = self.attitude.as_ref().is_some_and(AttitudeStage::is_known);
            loans.set_obstacles(found, &options, used_attitude)?;
        }
        report.stages.push(start_nanos, if with_obstacles { MonotonicClock.nanos() } else { start_nanos });
        Ok(report)
    }

    /// Counts a published frame and passes it to the sinks.
    fn account(
        &mut self,
        frame: &Frame,
        report: &FrameReport,
        queue_micros: u32,
        processed_nanos: u64,
        with_obstacles: bool,
    ) {
        let now_nanos = MonotonicClock.nanos();
        let timings = Timings {
            total_micros: micros_between(frame.ready_nanos, now_nanos),
            queue_micros,
            inner_micros: report.stages.micros(),
            publish_micros: micros_between(processed_nanos, now_nanos),
        };
        self.latencies.record(timings.total_micros.into(), timings.stages().map(u64::from));
        self.totals.add_published(now_nanos, report.bytes_copied);
        let Some(results) = self.publisher.last_results().filter(|_| !self.sinks.is_empty()) else { return };
        let obstacles = self.obstacles.as_ref().filter(|_| with_obstacles).and_then(ObstacleStage::last);
        let roll_pitch_rad = self.attitude.as_ref().and_then(AttitudeStage::roll_pitch_rad);
        let results = Results { obstacles, roll_pitch_rad, ..results };
        let camera = self.camera.camera_of(frame).ok().flatten();
        let published = PublishedFrame { frame, camera, results, timings };
        self.sinks.iter_mut().for_each(|sink| sink.on_frame(&published));
    }
}
