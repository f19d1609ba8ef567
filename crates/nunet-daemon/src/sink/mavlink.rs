//! `--mavlink URL`: obstacles for an autopilot.

use nunet_sink::mavlink::mavlink_sink;

use super::{Sink, SinkContext};

/// Opens the sink if `--mavlink` is given and there is a stage that finds obstacles.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let address = context.config.mavlink.clone().filter(|_| context.has_obstacles);
    address.map(|address| mavlink_sink(address, context.on_room.clone())).transpose()
}
