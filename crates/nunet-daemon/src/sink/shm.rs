//! Depth, labels, confidence, cloud and stats in shared memory. The pipeline writes its results there
//! directly.
//!
//! Not a [`Sink`](super::Sink): results are computed in the memory loaned here, and the sinks read them there
//! after publishing.
#![expect(unsafe_code, reason = "published messages are read in place")]

use std::time::Instant;

use anyhow::Context as _;
use nunet_core::camera::Camera;
use nunet_core::clock::Clock as _;
use nunet_core::pipeline::{FrameReport, Pipeline};
use nunet_engine::MonotonicClock;
use nunet_ipc::{
    CameraName, CloudPoint, Encoding, FrameHeader, IpcError, Limits, Loan, Publisher, SentPayload,
    StatsRecord, Topic, Units, Wake, monotonic_nanos,
};
use nunet_telemetry::{Counts, Latencies, RateLimit, Totals, foreign_allocations};
use nunet_types::{ImageSize, shortest};
use tracing::{info, warn};

use nunet_sink::stats_record::{self, stage_names};

use super::loans::{Loans, plans};
use super::{Results, Wants};
use crate::config::Publish;
use crate::source::Frame;

/// How often percentiles are recomputed; the ledger is updated for every frame.
const SUMMARY_PERIOD_NANOS: u64 = 500_000_000;

/// What is published, and who can read it.
pub(crate) struct ShmPublisherOptions<'a> {
    pub(crate) camera: &'a CameraName,
    pub(crate) frame_id: &'a str,
    pub(crate) publish: &'a [Publish],
    /// Whether obstacles can be read.
    pub(crate) obstacles: bool,
    /// The coordinate frame of obstacles.
    pub(crate) obstacle_frame: &'static str,
    pub(crate) limits: Limits,
    pub(crate) model: &'a str,
    /// Checked while waiting for other publishers.
    pub(crate) given_up: &'a dyn Fn() -> bool,
}

/// Publishes the results of a camera.
pub(crate) struct ShmPublisher {
    publisher: Publisher,
    topics: Vec<Topic>,
    header: FrameHeader,
    obstacle_frame: &'static str,
    size: ImageSize,
    cloud_size: ImageSize,
    cloud_stride: std::num::NonZeroU32,
    stats: StatsRecord,
    summarised_nanos: u64,
    /// The last published frame.
    last: Last,
    failures: RateLimit,
}

/// The messages of one frame.
#[derive(Debug, Default)]
struct Last {
    report: Option<FrameReport>,
    depth: Option<SentPayload<f32>>,
    labels: Option<SentPayload<u8>>,
    confidence: Option<SentPayload<u8>>,
    cloud: Option<SentPayload<CloudPoint>>,
    has_obstacles: bool,
}

impl Last {
    /// The results that were published besides depth.
    fn has(&self) -> Wants {
        Wants {
            labels: self.labels.is_some(),
            confidence: self.confidence.is_some(),
            cloud: self.cloud.is_some(),
            obstacles: self.has_obstacles,
        }
    }
}

impl ShmPublisher {
    /// Becomes the publisher of the camera's results. All memory is reserved and prefaulted here.
    pub(crate) fn open(pipeline: &Pipeline, options: &ShmPublisherOptions<'_>) -> anyhow::Result<Self> {
        let plans = plans(pipeline, options.publish, options.obstacles);
        let publisher = Publisher::create_unless(options.camera, &plans, &options.limits, options.given_up)?;
        info!("camera `{}` reserves {} of shared memory", options.camera, publisher.reservation());
        let description = pipeline.graph().description();
        let mut header = FrameHeader { model_hash: description.hash, ..FrameHeader::default() };
        header.set_frame_id(options.frame_id);
        let mut stats = StatsRecord { model_hash: description.hash, ..StatsRecord::default() };
        stats.set_model_name(options.model);
        stats.set_provider(pipeline.graph().provider().name());
        stats.set_stage_names(stage_names(pipeline, options.obstacles));
        Ok(Self {
            publisher,
            topics: plans.iter().map(|plan| plan.topic).collect(),
            header,
            obstacle_frame: options.obstacle_frame,
            size: pipeline.size(),
            cloud_size: pipeline.cloud_size(),
            cloud_stride: pipeline.cloud_stride(),
            stats,
            summarised_nanos: 0,
            last: Last::default(),
            failures: RateLimit::default(),
        })
    }

    /// Memory for depth, and for the results that a reader or a sink (`wants`) needs.
    pub(crate) fn loan(&self, wants: Wants) -> anyhow::Result<Loans> {
        self.loan_for(wants.union(Wants::of(|topic| self.publisher.has_readers(topic))))
    }

    /// Whether obstacles have readers.
    pub(crate) fn has_obstacle_readers(&self) -> bool {
        self.publisher.has_readers(Topic::Obstacles)
    }

    /// Whether the last frame was published without a result that a reader may need.
    pub(crate) fn has_omitted_results(&self) -> bool {
        let missing = Wants::of(|topic| self.topics.contains(&topic) && !self.last.has().has(topic));
        missing != Wants::default()
    }

    /// Memory for results that the last frame was published without and that a new reader needs;
    /// `None` if there is no such reader.
    pub(crate) fn loan_for_late_readers(&self) -> anyhow::Result<Option<Loans>> {
        let sent = self.last.has();
        let wants = Wants::of(|topic| !sent.has(topic) && self.publisher.has_readers(topic));
        (wants != Wants::default()).then(|| self.loan_for(wants)).transpose()
    }

    /// Always includes depth, because the pipeline always writes it.
    fn loan_for(&self, wants: Wants) -> anyhow::Result<Loans> {
        let is_wanted = |topic| wants.has(topic) && self.topics.contains(&topic);
        let loan = |topic| is_wanted(topic).then(|| self.chunk(topic)).transpose();
        Ok(Loans {
            depth: self.chunk(Topic::Depth)?,
            labels: loan(Topic::Labels)?,
            confidence: loan(Topic::Confidence)?,
            cloud: loan(Topic::Cloud)?,
            obstacles: loan(Topic::Obstacles)?,
        })
    }

    /// The results of the last published frame, in shared memory.
    pub(crate) fn last_results(&self) -> Option<Results<'_>> {
        let Last { report, depth, labels, confidence, cloud, has_obstacles: _ } = &self.last;
        let report = (*report)?;
        let depth = depth.as_ref()?;
        // SAFETY: `last` has messages that were sent. Newer ones are sent by `publish` and
        // `publish_to_late_readers`, which borrow `self` exclusively, so that none is sent while the results
        // are borrowed.
        let depth = unsafe { depth.payload() };
        // SAFETY: as above.
        let labels = labels.as_ref().map(|message| unsafe { message.payload() });
        // SAFETY: as above.
        let confidence = confidence.as_ref().map(|message| unsafe { message.payload() });
        // SAFETY: as above.
        let cloud = cloud.as_ref().map(|message| unsafe { message.payload() });
        Some(Results {
            scale: report.scale(),
            size: self.size,
            depth,
            labels,
            confidence,
            cloud_size: self.cloud_size,
            cloud,
            camera: report.camera,
            view: report.view,
            obstacles: None,
            obstacle_frame: self.obstacle_frame,
            roll_pitch_rad: None,
        })
    }

    /// Sends a frame's results, depth last, and wakes the readers once.
    pub(crate) fn publish(
        &mut self,
        loans: Loans,
        frame: &Frame,
        report: &FrameReport,
        queue_micros: u32,
    ) -> anyhow::Result<()> {
        self.describe(frame, report, queue_micros);
        let Loans { mut depth, labels, confidence, cloud, obstacles } = loans;
        self.last = Last::default();
        self.send_beside_depth([labels, confidence], cloud, report)?;
        self.send_obstacles(obstacles)?;
        let message = SentPayload::of(depth.slice_mut()?);
        send(depth, self.shaped(Encoding::DepthF32, self.size, report.camera))?;
        self.last.depth = Some(message);
        self.last.report = Some(*report);
        Ok(foreign_allocations(|| self.publisher.notify(Wake::Depth))?)
    }

    /// Sends the results that the last frame was published without. Its depth is not sent again.
    pub(crate) fn publish_to_late_readers(
        &mut self,
        loans: Loans,
        frame: &Frame,
        report: &FrameReport,
    ) -> anyhow::Result<()> {
        self.describe(frame, report, 0);
        let Loans { depth: _, labels, confidence, cloud, obstacles } = loans;
        self.send_beside_depth([labels, confidence], cloud, report)?;
        self.send_obstacles(obstacles)?;
        Ok(foreign_allocations(|| self.publisher.notify(Wake::Depth))?)
    }

    fn send_beside_depth(
        &mut self,
        [labels, confidence]: [Option<Loan>; 2],
        cloud: Option<Loan>,
        report: &FrameReport,
    ) -> anyhow::Result<()> {
        if let Some(loan) = labels {
            self.last.labels = Some(self.send_bytes(loan, Encoding::LabelsU8, report)?);
        }
        if let Some(loan) = confidence {
            self.last.confidence = Some(self.send_bytes(loan, Encoding::ConfidenceU8, report)?);
        }
        if let Some(mut loan) = cloud {
            let message = SentPayload::of(loan.slice_mut()?);
            let camera = report.camera.map(|camera| camera.subsampled(self.cloud_stride));
            send(loan, self.shaped(Encoding::Points, self.cloud_size, camera))?;
            self.last.cloud = Some(message);
        }
        Ok(())
    }

    /// Sends a map of one byte per pixel.
    fn send_bytes(
        &self,
        mut loan: Loan,
        encoding: Encoding,
        report: &FrameReport,
    ) -> anyhow::Result<SentPayload<u8>> {
        let message = SentPayload::of(loan.bytes_mut());
        let header = self.shaped(encoding, self.size, report.camera);
        send(loan, FrameHeader { units: Units::None.into(), ..header })?;
        Ok(message)
    }

    fn send_obstacles(&mut self, loan: Option<Loan>) -> anyhow::Result<()> {
        let Some(loan) = loan else { return Ok(()) };
        let mut header = self.header;
        header.set_encoding(Encoding::ObstacleRecord);
        header.set_frame_id(self.obstacle_frame);
        (header.width, header.height, header.row_stride_bytes) = (0, 0, 0);
        send(loan, header)?;
        self.last.has_obstacles = true;
        Ok(())
    }

    /// Sends the current stats. A failure is only logged, because it must not fail the frame.
    pub(crate) fn publish_stats(&mut self, counts: &Counts, totals: &Totals, latencies: &Latencies) {
        let now_nanos = MonotonicClock.nanos();
        stats_record::set_counts(&mut self.stats, counts);
        if now_nanos.saturating_sub(self.summarised_nanos) >= SUMMARY_PERIOD_NANOS {
            self.summarised_nanos = now_nanos;
            stats_record::set_summaries(&mut self.stats, totals, latencies);
        }
        if let Err(error) = self.try_publish_stats() {
            self.warn(&format!("the stats were not published: {error:#}"));
        }
    }

    /// Sends the last frame to readers that joined while the source was paused.
    pub(crate) fn refresh(&mut self) {
        if let Err(error) = self.publisher.refresh() {
            self.warn(&format!("late readers are not served: {error}"));
        }
    }

    /// Logs a failure that may repeat with every frame.
    fn warn(&mut self, text: &str) {
        if let Some(suppressed) = self.failures.allow_text(Instant::now(), text) {
            warn!("{text}{suppressed}");
        }
    }

    /// iceoryx2 0.10 allocates a few bytes for each loan, and more when a reader connects. This
    /// cannot be avoided.
    fn chunk(&self, topic: Topic) -> Result<Loan, IpcError> {
        foreign_allocations(|| self.publisher.loan(topic))
    }

    fn try_publish_stats(&self) -> anyhow::Result<()> {
        let mut loan = self.chunk(Topic::Stats)?;
        let record =
            loan.slice_mut::<StatsRecord>()?.first_mut().context("the chunk is too small for the stats")?;
        *record = self.stats;
        let mut header = self.header;
        header.set_encoding(Encoding::StatsRecord);
        send(loan, header)
    }

    /// The header fields that all topics of a frame share.
    fn describe(&mut self, frame: &Frame, report: &FrameReport, queue_micros: u32) {
        let header = &mut self.header;
        frame.identify(header);
        header.set_units(report.units);
        header.set_scale_source(report.scale_source);
        (header.scale_factor, header.scale_age_nanos) =
            (shortest(report.scale_factor), report.scale_age_nanos);
        header.set_quality(report.quality);
        header.set_view(report.view);
        header.set_stages(std::iter::once(queue_micros).chain(report.stages.micros().iter().copied()));
        header.bytes_copied = report.bytes_copied;
        header.invalid_pixels = report.invalid_pixels.into();
    }

    /// The header of one topic of a frame.
    fn shaped(&self, encoding: Encoding, size: ImageSize, camera: Option<Camera>) -> FrameHeader {
        let mut header = self.header;
        header.set_encoding(encoding);
        (header.width, header.height) = (size.width, size.height);
        header.row_stride_bytes = size.width * encoding.element_bytes().unwrap_or(0);
        if let Some(camera) = camera {
            header.set_camera(&(&camera).into());
        }
        header
    }
}

fn send(mut loan: Loan, header: FrameHeader) -> anyhow::Result<()> {
    *loan.header_mut() = header;
    foreign_allocations(|| loan.publish(monotonic_nanos()))?;
    Ok(())
}
