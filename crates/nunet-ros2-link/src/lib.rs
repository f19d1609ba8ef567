//! Connections to ROS 2 over DDS and Zenoh. They need no ROS installation.
//!
//! | module | what it contains |
//! |---|---|
//! | [`environment`] | the variables of ROS 2: domain, discovery range, Zenoh's configuration |
//! | `static_peer` | machines beyond the discovery range |
//! | [`link_name`] | which network a connection uses: DDS or Zenoh |
//! | [`message_type`] | types of messages: names and hashes |
//! | [`name`] | names of topics and types |
//! | [`link`] | what a connection does: it makes publishers and subscribers of encoded messages |
//! | `dds` | the connection over DDS |
//! | `zenoh` | the connection over Zenoh |
//! | `queue` | received messages that wait |
//!
//! Messages are bytes here: CDR with its four leading bytes. `nunet-mcap` encodes and decodes them.

mod connect;
#[cfg(feature = "ros2-dds")]
mod dds;
pub mod environment;
mod error;
pub mod link;
pub mod link_name;
pub mod message_type;
pub mod name;
#[cfg(any(feature = "ros2-dds", feature = "ros2-zenoh"))]
mod queue;
mod static_peer;
#[cfg(feature = "ros2-zenoh")]
mod zenoh;

pub use connect::{check, connect, connect_alone};
#[cfg(feature = "ros2-dds")]
#[doc(hidden)]
pub use dds::{DatagramProbe, submessages_read};
pub use error::{Ros2Error, Ros2ErrorKind};
pub use link::{Arrival, Delivery, Endpoint, Link, MessagePublisher, MessageSubscriber, Received};
pub use link_name::{LinkName, ZenohEndpoint};
pub use message_type::MessageType;
pub use static_peer::StaticPeer;
