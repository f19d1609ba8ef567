//! Depth, labels, cloud and figures into shared memory, where the pipeline writes them itself.

use anyhow::Context as _;
use nunet_core::camera::Camera;
use nunet_core::clock::Clock as _;
use nunet_core::pipeline::{FrameReport, Outputs, Pipeline};
use nunet_ipc::{
    CameraName, CloudPoint, Encoding, FrameHeader, IpcError, Limits, Loan, Publisher, StatsRecord, Topic,
    TopicPlan, Units, Wake, monotonic_nanos,
};
use tracing::{info, warn};

use crate::cli::{MAX_FRAME_ID, Publish};
use crate::exit::BadArguments;
use crate::source::Frame;
use crate::telemetry::{Counts, Latencies, MonotonicClock, Totals, foreign_allocations};
use crate::words;

/// How often percentiles are computed anew; the ledger is of every frame.
const SUMMARY_PERIOD_NANOS: u64 = 500_000_000;

/// The times of a frame that the pipeline does not see: waiting before it, publishing after it.
const QUEUE: &str = "queue";
const PUBLISH: &str = "publish";

/// The stages of a frame in the order of the header's and the statistics' times. `publish` is not in the header of
/// the frame itself, which is written before it.
pub(crate) fn stage_names(pipeline: &Pipeline) -> impl Iterator<Item = &str> {
    let inner = pipeline.stage_names().iter().map(String::as_str);
    std::iter::once(QUEUE).chain(inner).chain(std::iter::once(PUBLISH))
}

/// What an outlet publishes, and for whom.
pub(crate) struct OutletOptions<'a> {
    pub(crate) camera: &'a CameraName,
    pub(crate) frame_id: Option<&'a str>,
    pub(crate) publish: &'a [Publish],
    pub(crate) limits: Limits,
    pub(crate) model: &'a str,
    /// Asked while other owners are waited for.
    pub(crate) given_up: &'a dyn Fn() -> bool,
}

/// The owner of a camera's results.
pub(crate) struct Outlet {
    publisher: Publisher,
    topics: Vec<Topic>,
    header: FrameHeader,
    size: (u32, u32),
    cloud_size: (u32, u32),
    cloud_stride: std::num::NonZeroU32,
    stats: StatsRecord,
    summarised_nanos: u64,
    /// What went out of the last frame beside depth.
    sent: Sent,
}

/// Results that are made only where somebody reads them.
#[derive(Debug, Clone, Copy, Default)]
struct Sent {
    labels: bool,
    cloud: bool,
}

/// Chunks of shared memory for one frame's results.
pub(crate) struct Loans {
    depth: Loan,
    labels: Option<Loan>,
    cloud: Option<Loan>,
}

impl Loans {
    /// The chunks as the pipeline fills them.
    pub(crate) fn outputs(&mut self) -> anyhow::Result<Outputs<'_>> {
        let points = self.cloud.as_mut().map(Loan::slice_mut).transpose()?;
        Ok(Outputs {
            depth_m: self.depth.slice_mut()?,
            labels: self.labels.as_mut().map(Loan::bytes_mut),
            cloud: points,
        })
    }
}

/// The coordinate frame of depth and cloud: the one asked for, else the camera's own.
///
/// # Errors
/// One that would be cut.
pub(crate) fn frame_id(camera: &CameraName, asked: Option<&str>) -> Result<String, BadArguments> {
    let frame_id = asked.map_or_else(|| words::default_frame_id(camera.as_str()), str::to_owned);
    if frame_id.len() <= MAX_FRAME_ID {
        return Ok(frame_id);
    }
    Err(BadArguments(format!(
        "the coordinate frame `{frame_id}` of camera `{camera}` is {} bytes long; expected at most {MAX_FRAME_ID}\n\
         hint: `--frame-id` names another, or give the camera a shorter name",
        frame_id.len()
    )))
}

impl Outlet {
    /// Becomes the owner of the camera's results; all memory is reserved and touched here.
    pub(crate) fn open(pipeline: &Pipeline, options: &OutletOptions<'_>) -> anyhow::Result<Self> {
        let frame_id = frame_id(options.camera, options.frame_id)?;
        let plans = plans(pipeline, options.publish);
        let publisher = Publisher::create_unless(options.camera, &plans, &options.limits, options.given_up)?;
        info!("camera `{}` reserves {} of shared memory", options.camera, publisher.reservation());
        let description = pipeline.graph().description();
        let mut header = FrameHeader { model_hash: description.hash, ..FrameHeader::default() };
        header.set_frame_id(&frame_id);
        let mut stats = StatsRecord { model_hash: description.hash, ..StatsRecord::default() };
        stats.set_model_name(options.model);
        stats.set_provider(pipeline.graph().provider().name());
        stats.set_stage_names(stage_names(pipeline));
        Ok(Self {
            publisher,
            topics: plans.iter().map(|plan| plan.topic).collect(),
            header,
            size: pipeline.size(),
            cloud_size: pipeline.cloud_size(),
            cloud_stride: pipeline.cloud_stride(),
            stats,
            summarised_nanos: 0,
            sent: Sent::default(),
        })
    }

    /// What is published of a frame.
    pub(crate) fn topics(&self) -> &[Topic] {
        &self.topics
    }

    /// Chunks for the results that somebody reads; depth always.
    pub(crate) fn loan(&self) -> anyhow::Result<Loans> {
        self.loan_beside(Sent::default())
    }

    /// Whether the last frame went out without something that somebody could have read.
    pub(crate) fn left_something_out(&self) -> bool {
        let Sent { labels, cloud } = self.sent;
        [(labels, Topic::Labels), (cloud, Topic::Cloud)]
            .iter()
            .any(|(sent, topic)| !sent && self.topics.contains(topic))
    }

    /// Chunks for what the last frame went out without and somebody has come to read; `None` where nobody has.
    pub(crate) fn loan_for_late_readers(&self) -> anyhow::Result<Option<Loans>> {
        let Sent { labels, cloud } = self.sent;
        let late = |sent: bool, topic| !sent && self.publisher.has_readers(topic);
        let anybody = late(labels, Topic::Labels) || late(cloud, Topic::Cloud);
        anybody.then(|| self.loan_beside(self.sent)).transpose()
    }

    /// Depth always: the pipeline writes it in any case.
    fn loan_beside(&self, sent: Sent) -> anyhow::Result<Loans> {
        let wanted = |sent: bool, topic| {
            (!sent && self.publisher.has_readers(topic)).then(|| self.chunk(topic)).transpose()
        };
        Ok(Loans {
            depth: self.chunk(Topic::Depth)?,
            labels: wanted(sent.labels, Topic::Labels)?,
            cloud: wanted(sent.cloud, Topic::Cloud)?,
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
        let Loans { depth, labels, cloud } = loans;
        self.sent = Sent::default();
        self.send_beside_depth(labels, cloud, report)?;
        send(depth, self.shaped(Encoding::DepthF32, self.size, report.camera))?;
        self.wake()
    }

    /// Sends what the last frame went out without. Its depth is with its readers: it is not sent twice.
    pub(crate) fn publish_to_late_readers(
        &mut self,
        loans: Loans,
        frame: &Frame,
        report: &FrameReport,
    ) -> anyhow::Result<()> {
        self.describe(frame, report, 0);
        let Loans { depth: _, labels, cloud } = loans;
        self.send_beside_depth(labels, cloud, report)?;
        self.wake()
    }

    fn send_beside_depth(
        &mut self,
        labels: Option<Loan>,
        cloud: Option<Loan>,
        report: &FrameReport,
    ) -> anyhow::Result<()> {
        if let Some(loan) = labels {
            let header = self.shaped(Encoding::LabelsU8, self.size, report.camera);
            send(loan, FrameHeader { units: Units::None.into(), ..header })?;
            self.sent.labels = true;
        }
        if let Some(loan) = cloud {
            let camera = report.camera.map(|camera| camera.subsampled(self.cloud_stride));
            send(loan, self.shaped(Encoding::Points, self.cloud_size, camera))?;
            self.sent.cloud = true;
        }
        Ok(())
    }

    fn wake(&self) -> anyhow::Result<()> {
        Ok(foreign_allocations(|| self.publisher.notify(Wake::Depth))?)
    }

    /// Sends the running figures; they are not worth a frame when that fails.
    pub(crate) fn publish_stats(&mut self, counts: &Counts, totals: &Totals, latencies: &Latencies) {
        let now_nanos = MonotonicClock.nanos();
        set_counts(&mut self.stats, counts);
        if now_nanos.saturating_sub(self.summarised_nanos) >= SUMMARY_PERIOD_NANOS {
            self.summarised_nanos = now_nanos;
            set_summaries(&mut self.stats, totals, latencies);
        }
        if let Err(error) = self.try_publish_stats() {
            warn!("the figures are not published: {error:#}");
        }
    }

    /// Hands the last frame to readers that came while the source stood still.
    pub(crate) fn refresh(&self) {
        if let Err(error) = self.publisher.refresh() {
            warn!("late readers are not served: {error}");
        }
    }

    /// iceoryx2 takes a few bytes of heap for each loan, and more when a reader comes; there is no way around it in
    /// 0.10.
    fn chunk(&self, topic: Topic) -> Result<Loan, IpcError> {
        foreign_allocations(|| self.publisher.loan(topic))
    }

    fn try_publish_stats(&self) -> anyhow::Result<()> {
        let mut loan = self.chunk(Topic::Stats)?;
        let record =
            loan.slice_mut::<StatsRecord>()?.first_mut().context("the chunk is too small for the figures")?;
        *record = self.stats;
        let mut header = self.header;
        header.set_encoding(Encoding::StatsRecord);
        send(loan, header)
    }

    /// What all topics of a frame say.
    fn describe(&mut self, frame: &Frame, report: &FrameReport, queue_micros: u32) {
        let header = &mut self.header;
        header.sequence = frame.sequence;
        header.capture_nanos = frame.capture.nanos;
        header.capture_unix_nanos = frame.capture.unix_nanos;
        header.set_capture_clock(frame.capture.clock);
        header.set_units(report.units);
        header.set_scale_source(report.scale_source);
        header.set_quality(report.quality);
        header.set_stages(std::iter::once(queue_micros).chain(report.stages.micros().iter().copied()));
        header.bytes_copied = report.bytes_copied;
        header.invalid_pixels = report.invalid_pixels.into();
    }

    /// What one topic of a frame says.
    fn shaped(&self, encoding: Encoding, (width, height): (u32, u32), camera: Option<Camera>) -> FrameHeader {
        let mut header = self.header;
        header.set_encoding(encoding);
        (header.width, header.height) = (width, height);
        header.row_stride_bytes = width * encoding.element_bytes().unwrap_or(0);
        if let Some(camera) = camera {
            header.set_camera(&(&camera).into());
        }
        header
    }
}

/// The topics of a pipeline's results.
pub(crate) fn plans(pipeline: &Pipeline, publish: &[Publish]) -> Vec<TopicPlan> {
    let pixels = |(width, height): (u32, u32)| width as usize * height as usize;
    let (size, points) = (pixels(pipeline.size()), pixels(pipeline.cloud_size()));
    let labels = publish.contains(&Publish::Labels) && pipeline.graph().has_labels();
    let cloud = publish.contains(&Publish::Cloud);
    let all = [
        (true, Topic::Depth, size * size_of::<f32>()),
        (labels, Topic::Labels, size),
        (cloud, Topic::Cloud, points * size_of::<CloudPoint>()),
        (true, Topic::Stats, size_of::<StatsRecord>()),
    ];
    let wanted = all.into_iter().filter(|(wanted, ..)| *wanted);
    wanted.map(|(_, topic, payload_bytes)| TopicPlan { topic, payload_bytes }).collect()
}

fn send(mut loan: Loan, header: FrameHeader) -> anyhow::Result<()> {
    *loan.header_mut() = header;
    foreign_allocations(|| loan.publish(monotonic_nanos()))?;
    Ok(())
}

fn set_counts(record: &mut StatsRecord, counts: &Counts) {
    record.captured = counts.captured;
    record.published = counts.published;
    record.superseded = counts.superseded;
    record.failed = counts.failed;
    record.in_flight = counts.in_flight;
}

fn set_summaries(record: &mut StatsRecord, totals: &Totals, latencies: &Latencies) {
    const US_PER_MS: f64 = 1e3;
    record.fps = totals.fps();
    record.bytes_copied_per_frame = totals.bytes_copied_per_frame();
    record.allocations_per_frame = totals.allocations_per_frame().unwrap_or(f64::NAN);
    let total = latencies.total();
    record.total_p50_us = total.p50 * US_PER_MS;
    record.total_p90_us = total.p90 * US_PER_MS;
    record.total_p99_us = total.p99 * US_PER_MS;
    record.total_max_us = total.max * US_PER_MS;
    record.total_mean_us = total.mean * US_PER_MS;
    for (index, (_, stage)) in latencies.stages().enumerate().take(record.stage_p50_us.len()) {
        record.stage_p50_us[index] = stage.p50 * US_PER_MS;
        record.stage_p90_us[index] = stage.p90 * US_PER_MS;
        record.stage_p99_us[index] = stage.p99 * US_PER_MS;
        record.stage_max_us[index] = stage.max * US_PER_MS;
        record.stage_mean_us[index] = stage.mean * US_PER_MS;
    }
}
