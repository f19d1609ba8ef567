//! `--ros2 dds` and `--ros2 zenoh`: the results as topics of ROS 2.

use nunet_ros2::{CameraOptions, Ros2Node, Ros2Options};

use super::{Sink, SinkContext};
use crate::exit::WithHint;

/// Connects to ROS 2, if `options` say so.
///
/// # Errors
/// The network cannot be used.
pub(crate) fn open_node(options: &Ros2Options) -> anyhow::Result<Option<Ros2Node>> {
    if options.links.is_empty() {
        return Ok(None);
    }
    let opened = Ros2Node::open(options);
    opened.map(Some).map_err(|error| WithHint::plain("cannot connect to ROS 2").because(error).into())
}

/// Opens the sink if `--ros2` is given.
pub(super) fn open(context: &SinkContext<'_>) -> anyhow::Result<Option<Box<dyn Sink>>> {
    let Some(node) = context.ros2 else { return Ok(None) };
    let (config, common) = (context.config, context.common);
    let counts = context.message_counts("ros2");
    let about = [
        ("model", common.model.name.clone()),
        ("model SHA-256", common.model.hash.clone()),
        ("provider", common.provider.to_owned()),
        // Nothing is published before the self-test has passed.
        ("self-test", "passed".to_owned()),
    ];
    // The robot that publishes the images publishes the transform of their frame, too.
    let has_own_frame = config.is_frame_id_chosen || !config.source.name.properties().states_frame_id;
    let mount = config.mount.filter(|_| has_own_frame).map(Into::into);
    let options = CameraOptions { mount, about: &about, ..context.camera_options(&counts) };
    let sink = node.add_camera(&options);
    let in_camera =
        |error| WithHint::plain(format!("cannot publish camera `{}` in ROS 2", config.name)).because(error);
    Ok(Some(sink.map_err(in_camera)?))
}
