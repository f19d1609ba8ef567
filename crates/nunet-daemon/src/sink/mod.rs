//! Outputs. Results are computed and published in shared memory, and then passed to each [`Sink`].
//!
//! The sinks are in `nunet-sink`. To add one, write a file there that implements [`Sink`], a file here with
//! its `open` function, and one line in [`REGISTRY`].

pub(crate) mod foxglove_channels;
pub(crate) mod last_frame;
pub(crate) mod loans;
pub(crate) mod mavlink;
pub(crate) mod metrics;
pub(crate) mod recording;
pub(crate) mod ros2;
pub(crate) mod shm;
pub(crate) mod stats;
#[cfg(test)]
mod tests;
pub(crate) mod view;

use std::path::Path;

use nunet_core::pipeline::Pipeline;
use nunet_foxglove::FoxgloveServer;
use nunet_ros2::{CameraOptions, Ros2Node};
pub(crate) use nunet_sink::queue::OnRoom;
pub(crate) use nunet_sink::results::Results;
pub(crate) use nunet_sink::sink::{FinishingSink, PublishedFrame, Sink, Status, Timings, Wants};
use nunet_telemetry::{MessageCounts, Metrics};
use nunet_view::ViewServer;

use self::stats::Common;
use crate::config::CameraConfig;

/// All sinks. Shared memory is not one of them: it is always on.
pub(crate) const REGISTRY: &[OpenSink] = &[
    recording::open,
    last_frame::open,
    metrics::open,
    view::open,
    mavlink::open,
    ros2::open,
    foxglove_channels::open,
];

/// Opens a sink; `None` if it is not configured.
pub(crate) type OpenSink = fn(&SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>>;

/// The inputs of a sink's `open` function.
pub(crate) struct SinkContext<'a> {
    /// The configuration of the camera.
    pub(crate) config: &'a CameraConfig,
    /// The file to record into: it does not exist yet, or may be overwritten.
    pub(crate) record: Option<&'a Path>,
    pub(crate) common: Common<'a>,
    pub(crate) pipeline: &'a Pipeline,
    /// Whether there is a stage that finds obstacles.
    pub(crate) has_obstacles: bool,
    /// The metrics of all cameras, if they are served.
    pub(crate) metrics: Option<&'a Metrics>,
    /// The connection of all cameras to ROS 2, if configured.
    pub(crate) ros2: Option<&'a Ros2Node>,
    /// The server for Foxglove of all cameras, if configured.
    pub(crate) foxglove: Option<&'a FoxgloveServer>,
    /// The live view of all cameras, if configured.
    pub(crate) view: Option<&'a ViewServer>,
    /// To be called when a sink that had no room has room again.
    pub(crate) on_room: OnRoom,
}

impl SinkContext<'_> {
    /// The counts of the messages of an output.
    fn message_counts(&self, output: &'static str) -> MessageCounts {
        self.metrics.map(|metrics| metrics.messages(self.config.name.as_str(), output)).unwrap_or_default()
    }

    /// The camera of an output that sends messages.
    fn camera_options<'a>(&'a self, counts: &'a MessageCounts) -> CameraOptions<'a> {
        let (config, graph) = (self.config, self.pipeline.graph());
        CameraOptions {
            name: config.name.as_str(),
            frame_id: &config.frame_id,
            classes: self.common.classes,
            mount: config.mount.map(Into::into),
            has_labels: graph.has_labels(),
            has_confidence: graph.has_confidence(),
            has_obstacles: self.has_obstacles,
            counts,
            about: &[],
        }
    }
}

/// Opens all configured sinks.
pub(crate) fn open_all(context: &SinkContext<'_>) -> anyhow::Result<Vec<Box<dyn Sink>>> {
    REGISTRY.iter().filter_map(|open| open(context).transpose()).collect()
}
