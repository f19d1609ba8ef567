//! Results as live ROS 2 topics. They need no ROS installation.
//!
//! | module | what it contains |
//! |---|---|
//! | [`topic`] | the topics: names, types, quality of service |
//! | [`options`] | what the user can choose |
//! | `camera` | the sink of one camera: copies a frame, encodes and sends it on a thread of its own |
//! | [`node`] | what all cameras share: the connections to the network |
//!
//! `nunet-ros2-link` connects to the network. Messages are encoded by `nunet-mcap`, as in recordings. Without
//! subscribers, nothing is copied or encoded.

mod camera;
mod frame_messages;
mod messages;
pub mod node;
pub mod options;
mod publishers;
pub mod topic;

pub use node::Ros2Node;
pub use nunet_ros2_link::{LinkName, Ros2Error, Ros2ErrorKind};
pub use options::{CameraOptions, DepthFormat, Ros2Options, Topics};
pub use publishers::OutputName;
pub use topic::Topic;
