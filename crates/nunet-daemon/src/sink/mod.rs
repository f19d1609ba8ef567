//! Where results go. Results are computed in shared memory, published there, and then passed to each [`Sink`].
//!
//! To add a sink, write a file that implements [`Sink`] and has an `open` function, and add one line to [`REGISTRY`].

pub(crate) mod last_frame;
pub(crate) mod loans;
pub(crate) mod metrics;
pub(crate) mod recording;
pub(crate) mod shm;
pub(crate) mod stats;
#[cfg(test)]
mod tests;
pub(crate) mod view;
pub(crate) mod writing;

use std::path::Path;

use nunet_core::camera::Camera;
use nunet_core::pipeline::Pipeline;
pub(crate) use nunet_sink::queue;
pub(crate) use nunet_sink::queue::OnRoom;
pub(crate) use nunet_sink::results::Results;
use nunet_telemetry::{Counts, DrainTimeout, Metrics, Totals};
use nunet_view::ViewServer;

use self::stats::Common;
use crate::Outcome;
use crate::config::CameraConfig;
use crate::source::Frame;

/// All sinks but shared memory, which is always on.
pub(crate) const REGISTRY: &[OpenSink] = &[recording::open, last_frame::open, metrics::open, view::open];

/// Opens a sink; `None` if it is not configured.
pub(crate) type OpenSink = fn(&SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>>;

/// The inputs of a sink's `open` function.
pub(crate) struct SinkContext<'a> {
    /// The configuration of the camera.
    pub(crate) config: &'a CameraConfig,
    /// The file that `config.record` means: it does not exist yet, or may be overwritten.
    pub(crate) record: Option<&'a Path>,
    pub(crate) common: Common<'a>,
    pub(crate) pipeline: &'a Pipeline,
    /// Whether there is a stage that finds obstacles.
    pub(crate) has_obstacles: bool,
    /// The metrics of all cameras, if they are served.
    pub(crate) metrics: Option<&'a Metrics>,
    /// The live view of all cameras, if configured.
    pub(crate) view: Option<&'a ViewServer>,
    /// To be called when a sink that had no room has room again.
    pub(crate) on_room: OnRoom,
}

/// Takes the results of one camera. All its functions run on the inference thread and must not block: a sink that writes
/// copies what it needs into a queue of its own ([`queue::SinkQueue`]).
pub(crate) trait Sink: Send {
    /// The results that it takes. A result that no sink and no reader takes is not computed; depth always is.
    fn wants(&self) -> Wants;

    /// Takes a frame that was just published. If it has no room, it drops the frame and counts it.
    fn on_frame(&mut self, frame: &PublishedFrame<'_>);

    /// Takes the counts, after each frame and about five times per second while the source is paused.
    fn on_status(&mut self, _status: &Status<'_>) {}

    /// Whether the next frame may be processed. While it returns false, a source that has all its frames waits. It must
    /// return true for a live source, whose frames are dropped instead.
    fn has_room(&mut self) -> bool {
        true
    }

    /// Ends the stream; `last` are the results of the last frame. Like the other functions it must not block: pending
    /// writes are left to the returned value.
    fn finish(self: Box<Self>, last: Option<&Results<'_>>) -> FinishingSink;
}

/// Opens all configured sinks.
pub(crate) fn open_all(context: &SinkContext<'_>) -> anyhow::Result<Vec<Box<dyn Sink>>> {
    REGISTRY.iter().filter_map(|open| open(context).transpose()).collect()
}

/// The results that a sink takes of each frame beside depth.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub(crate) struct Wants {
    pub(crate) labels: bool,
    pub(crate) cloud: bool,
    pub(crate) obstacles: bool,
}

impl Wants {
    pub(crate) fn union(self, other: Self) -> Self {
        Self {
            labels: self.labels || other.labels,
            cloud: self.cloud || other.cloud,
            obstacles: self.obstacles || other.obstacles,
        }
    }
}

/// A published frame.
#[derive(Clone, Copy)]
pub(crate) struct PublishedFrame<'a> {
    /// The image and its times.
    pub(crate) frame: &'a Frame,
    /// The camera at the size of the image, if it is known.
    pub(crate) camera: Option<Camera>,
    pub(crate) results: Results<'a>,
    pub(crate) timings: Timings<'a>,
}

/// How long a frame took.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Timings<'a> {
    /// From the source to the wake-up of the readers.
    pub(crate) total_micros: u32,
    /// Waiting for the inference thread.
    pub(crate) queue_micros: u32,
    /// The stages of the pipeline.
    pub(crate) inner_micros: &'a [u32],
    pub(crate) publish_micros: u32,
}

impl Timings<'_> {
    /// In the order of [`shm::stage_names`].
    pub(crate) fn stages(&self) -> impl Iterator<Item = u32> {
        let inner = self.inner_micros.iter().copied();
        std::iter::once(self.queue_micros).chain(inner).chain(std::iter::once(self.publish_micros))
    }
}

/// The state of a stream.
pub(crate) struct Status<'a> {
    /// Whether the source gives frames: false while it waits, and at the end.
    pub(crate) is_up: bool,
    pub(crate) counts: &'a Counts,
    pub(crate) totals: &'a Totals,
}

/// A sink that takes no more frames; earlier ones may still be on their way to the disk.
pub(crate) struct FinishingSink(Box<WaitForSink>);

type WaitForSink = dyn FnOnce(&mut DrainTimeout<'_>) -> anyhow::Result<Outcome> + Send;

impl FinishingSink {
    /// `wait` returns whether everything was written, and logs what was lost.
    pub(crate) fn new(
        wait: impl FnOnce(&mut DrainTimeout<'_>) -> anyhow::Result<Outcome> + Send + 'static,
    ) -> Self {
        Self(Box::new(wait))
    }

    /// Nothing is left to do.
    pub(crate) fn done() -> Self {
        Self::new(|_| Ok(Outcome::Done))
    }

    /// Waits until everything is written, within `timeout`.
    ///
    /// # Errors
    /// The sink could not write.
    pub(crate) fn wait(self, timeout: &mut DrainTimeout<'_>) -> anyhow::Result<Outcome> {
        (self.0)(timeout)
    }
}
