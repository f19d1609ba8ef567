//! The trait of all outputs, and the data that the stream passes to it.

use nunet_core::camera::Camera;
use nunet_source::Frame;
use nunet_telemetry::{Counts, DrainTimeout, MessageCounts, Totals};
use nunet_types::Topic;

use crate::results::Results;

/// The outcome of an operation that did not fail.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Outcome {
    /// Everything was done.
    Done,
    /// Finished, but frames or data were lost; the counts have been printed.
    Lost,
}

/// Receives the results of one camera. All its functions run on the inference thread and must not block: a
/// sink that writes copies what it needs into a queue of its own ([`SinkQueue`](crate::queue::SinkQueue)).
pub trait Sink: Send {
    /// The results that it needs. A result that no sink and no reader needs is not computed, except depth.
    fn wants(&self) -> Wants;

    /// Takes a frame that was just published. If it has no room, it drops the frame and counts it.
    fn on_frame(&mut self, frame: &PublishedFrame<'_>);

    /// Takes the counts, after each frame and about five times per second while the source is paused.
    fn on_status(&mut self, _status: &Status<'_>) {}

    /// Whether the next frame may be processed. While it returns false, a source that is not live waits. It
    /// must return true for a live source, whose frames are dropped instead.
    fn has_room(&mut self) -> bool {
        true
    }

    /// The counts of its messages, under the name of the output such as `ros2`, if it sends messages to other
    /// machines.
    fn messages(&self) -> Option<(&'static str, MessageCounts)> {
        None
    }

    /// Ends the stream; `last` are the results of the last frame. Like the other functions it must not block:
    /// pending writes are left to the returned value.
    fn finish(self: Box<Self>, last: Option<&Results<'_>>) -> FinishingSink;
}

/// The results that a sink needs of each frame besides depth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Wants {
    /// Class labels.
    pub labels: bool,
    /// The confidence of depth.
    pub confidence: bool,
    /// The point cloud.
    pub cloud: bool,
    /// Obstacles.
    pub obstacles: bool,
}

impl Wants {
    /// The results whose topics are wanted.
    #[must_use]
    pub fn of(is_wanted: impl Fn(Topic) -> bool) -> Self {
        Self {
            labels: is_wanted(Topic::Labels),
            confidence: is_wanted(Topic::Confidence),
            cloud: is_wanted(Topic::Cloud),
            obstacles: is_wanted(Topic::Obstacles),
        }
    }

    /// Whether the result of a topic is among them.
    #[must_use]
    pub fn has(self, topic: Topic) -> bool {
        match topic {
            Topic::Labels => self.labels,
            Topic::Confidence => self.confidence,
            Topic::Cloud => self.cloud,
            Topic::Obstacles => self.obstacles,
            Topic::Rgb | Topic::Depth | Topic::Stats | Topic::Attitude => false,
        }
    }

    /// The results that either of two sinks needs.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self::of(|topic| self.has(topic) || other.has(topic))
    }
}

/// A published frame.
#[derive(Clone, Copy)]
pub struct PublishedFrame<'a> {
    /// The image and its times.
    pub frame: &'a Frame,
    /// The camera at the size of the image, if it is known.
    pub camera: Option<Camera>,
    /// The results, in shared memory.
    pub results: Results<'a>,
    /// How long it took.
    pub timings: Timings<'a>,
}

/// How long a frame took, microseconds.
#[derive(Debug, Clone, Copy)]
pub struct Timings<'a> {
    /// From the source to the wake-up of the readers.
    pub total_micros: u32,
    /// Waiting for the inference thread.
    pub queue_micros: u32,
    /// The stages of the pipeline.
    pub inner_micros: &'a [u32],
    /// Publishing in shared memory.
    pub publish_micros: u32,
}

impl Timings<'_> {
    /// Queue, the stages of the pipeline, publishing; microseconds.
    pub fn stages(&self) -> impl Iterator<Item = u32> {
        let inner = self.inner_micros.iter().copied();
        std::iter::once(self.queue_micros).chain(inner).chain(std::iter::once(self.publish_micros))
    }
}

/// The state of a stream.
pub struct Status<'a> {
    /// Whether the source delivers frames: false while it waits, and at the end.
    pub is_up: bool,
    /// Frames by outcome.
    pub counts: &'a Counts,
    /// Rates and sums over the whole stream.
    pub totals: &'a Totals,
}

/// A sink that takes no more frames; earlier ones may still be on their way to the disk.
pub struct FinishingSink(Box<WaitForSink>);

type WaitForSink = dyn FnOnce(&mut DrainTimeout<'_>) -> anyhow::Result<Outcome> + Send;

impl FinishingSink {
    /// `wait` returns whether everything was written, and logs what was lost.
    pub fn new(wait: impl FnOnce(&mut DrainTimeout<'_>) -> anyhow::Result<Outcome> + Send + 'static) -> Self {
        Self(Box::new(wait))
    }

    /// Nothing is left to do.
    #[must_use]
    pub fn done() -> Self {
        Self::new(|_| Ok(Outcome::Done))
    }

    /// Waits until everything is written, within `timeout`.
    ///
    /// # Errors
    /// The sink could not write.
    pub fn wait(self, timeout: &mut DrainTimeout<'_>) -> anyhow::Result<Outcome> {
        (self.0)(timeout)
    }
}
