//! `--out DIR`: the last frame as files.

use nunet_sink::last_frame::last_frame_into;

use super::{Sink, SinkContext};

/// Opens the sink if `--out` is given. The folder exists by now.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let has_obstacles = context.has_obstacles;
    Ok(context.config.out.clone().map(|folder| last_frame_into(folder, has_obstacles)))
}
