//! Results as live ROS 2 topics, and nothing of ROS to install.
//!
//! | module | what it contains |
//! |---|---|
//! | [`topic`] | the topics: names, types, quality of service |
//! | [`options`] | what the user can choose |
//! | [`environment`] | the variables of ROS 2: domain, discovery range |
//! | `camera` | the sink of one camera: copies a frame, encodes and sends it on a thread of its own |
//! | [`node`] | what all cameras share: the connections to the network |
//!
//! Messages are encoded by `nunet-mcap`, as in recordings. Without subscribers, nothing is copied or encoded.

mod camera;
#[cfg(feature = "ros2-dds")]
mod dds;
pub mod environment;
mod error;
mod frame_messages;
mod link;
mod messages;
pub mod node;
pub mod options;
pub mod topic;

#[cfg(feature = "ros2-dds")]
#[doc(hidden)]
pub use dds::submessages_read;
pub use error::{Ros2Error, Ros2ErrorKind};
pub use node::Ros2Node;
pub use options::{CameraOptions, DepthFormat, LinkName, Ros2Options, Topics};
pub use topic::Topic;
