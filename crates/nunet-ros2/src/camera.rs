//! The sink of one camera. The inference thread copies a frame only if something subscribes to it; a thread
//! of this sink encodes and sends it. While that thread is busy, a newer frame replaces the waiting one.

mod diagnostics;
mod other_publishers;

use std::sync::atomic::{AtomicU32, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use nunet_core::depth::Scale;
use nunet_mcap::CameraMount;
use nunet_mcap::ros::{Header, RosMessage, encode};
use nunet_ros2_link::{Link, MessagePublisher, Ros2Error};
use nunet_sink::record::RecordedFrame;
use nunet_sink::results::Results;
use nunet_sink::sink::{FinishingSink, Outcome, PublishedFrame, Sink, Status, Wants};
use nunet_source::{Mailbox, Reuse, Taken};
use nunet_telemetry::{Counts, MessageCounts, RateLimit, Stability};
use nunet_types::counted;
use tracing::{info, warn};

use self::other_publishers::OtherPublishers;
use crate::frame_messages::FrameEncoder;
use crate::messages::{LabelInfo, header_now};
use crate::options::{CameraOptions, DepthFormat};
use crate::publishers::{
    Connections, OutputName, TopicPublishers, WITH_DEPTH, WITH_OBSTACLES, WITHOUT_FRAME, bit,
};
use crate::topic::Topic;

/// How often the subscribers are counted: the first frame that a new one gets is so much later at most.
const COUNT_PERIOD: Duration = Duration::from_millis(100);
/// ROS' aggregator expects diagnostics about once per second.
const DIAGNOSTICS_PERIOD: Duration = Duration::from_secs(1);

/// A copy of a frame on its way to the thread.
#[derive(Default)]
struct FrameCopy {
    record: RecordedFrame,
    /// The topics that something subscribed to when it was copied. What others need is of an earlier frame.
    wanted: u32,
}

impl Reuse for FrameCopy {
    fn release(&mut self) {}
}

/// What both threads know.
struct Shared {
    mailbox: Mailbox<FrameCopy>,
    /// The topics that something subscribes to.
    wanted: AtomicU32,
    counts: MessageCounts,
    output: OutputName,
    state: Mutex<CameraState>,
}

/// The last frame and the stream, for diagnostics.
#[derive(Debug, Clone, Copy, Default)]
struct CameraState {
    is_up: bool,
    frames: Counts,
    fps: f64,
    /// `None` before the first frame.
    capture_unix_nanos: Option<i64>,
    total_micros: u32,
    scale: Option<Scale>,
    /// `None` while it is unknown.
    stability: Option<Stability>,
    is_unstable: bool,
    without_attitude: u64,
}

impl Shared {
    fn state(&self) -> MutexGuard<'_, CameraState> {
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// The inference thread's side.
pub(crate) struct Ros2Sink {
    shared: Arc<Shared>,
    thread: JoinHandle<()>,
}

impl Sink for Ros2Sink {
    fn wants(&self) -> Wants {
        let wanted = self.shared.wanted.load(Ordering::Relaxed);
        Wants {
            labels: wanted & bit(Topic::Labels) != 0,
            confidence: wanted & bit(Topic::Confidence) != 0,
            cloud: wanted & bit(Topic::Points) != 0,
            obstacles: wanted & WITH_OBSTACLES != 0,
        }
    }

    fn on_frame(&mut self, published: &PublishedFrame<'_>) {
        let PublishedFrame { frame, camera, results, timings } = published;
        let mut state = self.shared.state();
        state.capture_unix_nanos = Some(frame.capture.unix_nanos);
        state.total_micros = timings.total_micros;
        state.scale = Some(results.scale);
        drop(state);
        let wanted = self.shared.wanted.load(Ordering::Relaxed);
        if wanted & !WITHOUT_FRAME == 0 {
            return;
        }
        let mut copy = self.shared.mailbox.used().unwrap_or_default();
        if wanted & bit(Topic::Image) != 0 {
            copy.record.copy_frame(frame, *camera);
        }
        copy.wanted = wanted;
        copy.record.frame.capture = frame.capture;
        copy.record.frame.frame_id.clone_from(&frame.frame_id);
        copy.record.camera = *camera;
        copy.record.copy_results(&only(results, wanted));
        if self.shared.mailbox.put_latest(copy) == nunet_source::Put::Replaced {
            self.shared.counts.add_superseded();
        }
    }

    fn on_status(&mut self, status: &Status<'_>) {
        let mut state = self.shared.state();
        (state.is_up, state.frames, state.fps) = (status.is_up, *status.counts, status.totals.fps());
        state.without_attitude = status.totals.without_attitude;
        let stability = &status.totals.stability;
        (state.stability, state.is_unstable) = (stability.recent(), stability.is_unstable());
    }

    fn messages(&self) -> Option<(&'static str, MessageCounts)> {
        Some((self.shared.output.id, self.shared.counts.clone()))
    }

    /// The waiting frame is still sent.
    fn finish(self: Box<Self>, _last: Option<&Results<'_>>) -> FinishingSink {
        self.shared.mailbox.close();
        let Self { shared, thread } = *self;
        FinishingSink::new(move |timeout| {
            let output = shared.output.text;
            let waited = timeout.wait(output, || thread.is_finished(), || shared.counts.sent());
            let failure = match waited {
                Ok(()) => thread.join().err().map(|_| "the thread panicked".to_owned()),
                Err(why) => Some(why.to_string()),
            };
            let (sent, not_taken) = (shared.counts.sent(), shared.counts.not_taken());
            let superseded = shared.counts.superseded();
            let (sent, superseded) = (counted(sent, "message"), counted(superseded, "frame"));
            info!("{output}: {sent} sent, {not_taken} not taken, {superseded} superseded");
            if let Some(why) = failure {
                warn!("the last messages for {output} were not sent: {why}");
                return Ok(Outcome::Lost);
            }
            Ok(Outcome::Done)
        })
    }
}

/// The side that encodes and sends.
pub(crate) struct CameraThread {
    shared: Arc<Shared>,
    outputs: TopicPublishers,
    encoder: FrameEncoder,
    name: String,
    frame_id: String,
    classes: Vec<String>,
    mount: Option<CameraMount>,
    about: Vec<(&'static str, String)>,
    message: Vec<u8>,
    failures: RateLimit,
    others: OtherPublishers,
    /// Connections that have not announced the node yet.
    unannounced: Vec<Arc<dyn Link>>,
    links: Vec<Arc<dyn Link>>,
}

impl CameraThread {
    /// Starts the thread of a camera.
    pub(crate) fn start(
        camera: &CameraOptions<'_>,
        depth: DepthFormat,
        outputs: TopicPublishers,
        connections: Connections,
    ) -> Result<Ros2Sink, Ros2Error> {
        let side = Self::new(camera, depth, outputs, connections);
        let shared = Arc::clone(&side.shared);
        let thread = std::thread::Builder::new().name(shared.output.id.to_owned()).spawn(|| side.run());
        Ok(Ros2Sink { shared, thread: thread.map_err(Ros2Error::Thread)? })
    }

    fn new(
        camera: &CameraOptions<'_>,
        depth: DepthFormat,
        outputs: TopicPublishers,
        Connections { output, links, unannounced }: Connections,
    ) -> Self {
        let shared = Arc::new(Shared {
            mailbox: Mailbox::default(),
            wanted: AtomicU32::new(0),
            counts: camera.counts.clone(),
            output,
            state: Mutex::default(),
        });
        let own_topics = outputs.iter().map(|(topic, _)| *topic).filter(|topic| topic.is_of_one_camera());
        let own_topics = own_topics.map(|topic| topic.of_camera(camera.name)).collect();
        Self {
            shared,
            outputs,
            encoder: FrameEncoder::new(camera.frame_id, depth),
            name: camera.name.to_owned(),
            frame_id: camera.frame_id.to_owned(),
            classes: camera.classes.to_vec(),
            mount: camera.mount,
            about: camera.about.to_vec(),
            message: Vec::new(),
            failures: RateLimit::default(),
            others: OtherPublishers::new(own_topics, Instant::now()),
            unannounced,
            links,
        }
    }

    fn run(mut self) {
        self.send_kept();
        let (mut counted, mut diagnosed) = (None::<Instant>, Instant::now());
        loop {
            if counted.is_none_or(|last| last.elapsed() >= COUNT_PERIOD) {
                self.shared.wanted.store(self.outputs.wanted(), Ordering::Relaxed);
                counted = Some(Instant::now());
            }
            if diagnosed.elapsed() >= DIAGNOSTICS_PERIOD {
                self.unannounced.retain(|link| link.announce_nodes().is_err());
                self.check_links();
                self.others.check(&self.links, Instant::now());
                self.send_diagnostics();
                diagnosed = Instant::now();
            }
            match self.shared.mailbox.take(COUNT_PERIOD) {
                Taken::Item(copy) => {
                    self.follow_frame_id(&copy.record.frame.frame_id);
                    self.send_frame(&copy);
                    self.shared.mailbox.give_back(copy);
                }
                Taken::Nothing => {}
                Taken::Closed => break,
            }
        }
        self.check_links();
    }

    /// Counts the messages that connections dropped, and states which connections do not work.
    fn check_links(&self) {
        let counts = &self.shared.counts;
        counts.add_dropped(self.links.iter().map(|link| link.take_dropped()).sum());
        counts.set_problems(self.links.iter().filter_map(|link| link.problem()).collect());
    }

    /// Images of another node state their own coordinate frame. What is kept must name it, too.
    fn follow_frame_id(&mut self, stated: &str) {
        if !stated.is_empty() && stated != self.frame_id {
            stated.clone_into(&mut self.frame_id);
            self.send_kept();
        }
    }

    /// What late subscribers get.
    fn send_kept(&mut self) {
        let header = Header { frame_id: self.frame_id.as_str().into(), ..header_now() };
        let encoded = encode(&LabelInfo::new(header.clone(), &self.classes), &mut self.message);
        let label_info = encoded.map(|()| self.message.clone());
        self.keep(Topic::LabelInfo, label_info);
        if let Some(mount) = self.mount {
            let header = Header { frame_id: self.frame_id.as_str().into(), ..header_now() };
            let encoded = RosMessage::TfStatic(mount).encode(&header, &mut self.message);
            let transform = encoded.map(|()| self.message.clone());
            self.keep(Topic::TfStatic, transform);
        }
    }

    /// Sends a message that the transport keeps. It is not counted, because how many subscribers get it is
    /// decided later.
    fn keep(&self, topic: Topic, message: Result<Vec<u8>, String>) {
        match message {
            Ok(message) => self.outputs.of(topic).iter().for_each(|one| {
                one.send(&message);
            }),
            Err(reason) => warn!("cannot encode `{topic}`: {reason}"),
        }
    }

    /// Sends all topics of a frame that something subscribes to.
    fn send_frame(&mut self, FrameCopy { record, wanted }: &FrameCopy) {
        let Self { shared, outputs, encoder, failures, .. } = self;
        let wanted = wanted & !WITHOUT_FRAME;
        for (topic, publishers) in outputs.iter().filter(|(topic, _)| wanted & bit(*topic) != 0) {
            match encoder.encode(*topic, record) {
                Ok(Some(message)) => send_counted(publishers, message, &shared.counts),
                Ok(None) => {}
                Err(error) => {
                    if let Some(suppressed) = failures.allow(Instant::now()) {
                        warn!("cannot send `{topic}`: {error:#}{suppressed}");
                    }
                }
            }
        }
    }

    fn send_diagnostics(&self) {
        if self.shared.wanted.load(Ordering::Relaxed) & bit(Topic::Diagnostics) == 0 {
            return;
        }
        let state = *self.shared.state();
        let array = self.diagnostics(&state);
        let mut message = Vec::new();
        match encode(&array, &mut message) {
            Ok(()) => send_counted(self.outputs.of(Topic::Diagnostics), &message, &self.shared.counts),
            Err(reason) => warn!("cannot encode `{}`: {reason}", Topic::Diagnostics),
        }
    }
}

/// The results that messages of these topics are made of: the others are not copied.
fn only<'a>(results: &Results<'a>, wanted: u32) -> Results<'a> {
    let needs = |topics: u32| wanted & topics != 0;
    Results {
        depth: if needs(WITH_DEPTH) { results.depth } else { &[] },
        labels: results.labels.filter(|_| needs(bit(Topic::Labels))),
        confidence: results.confidence.filter(|_| needs(bit(Topic::Confidence))),
        cloud: results.cloud.filter(|_| needs(bit(Topic::Points))),
        obstacles: results.obstacles.filter(|_| needs(WITH_OBSTACLES)),
        ..*results
    }
}

/// Sends a message by those `publishers` that have subscribers.
fn send_counted(publishers: &[Box<dyn MessagePublisher>], message: &[u8], counts: &MessageCounts) {
    publishers.iter().filter(|one| one.subscribers() > 0).for_each(|one| counts.add(one.send(message)));
}

#[cfg(test)]
mod tests;
