//! Connections to ROS 2, and nothing of ROS to install.
//!
//! | module | what it contains |
//! |---|---|
//! | [`environment`] | the variables of ROS 2: domain, discovery range |
//! | [`message_type`] | types of messages: names and hashes |
//! | [`name`] | names of topics |
//! | [`link`] | what a connection does: it makes publishers and subscribers of encoded messages |
//! | `dds` | the connection over DDS |
//!
//! Messages are bytes here: CDR with its four leading bytes. `nunet-mcap` encodes and decodes them.

mod connect;
#[cfg(feature = "ros2-dds")]
mod dds;
pub mod environment;
mod error;
pub mod link;
pub mod message_type;
pub mod name;

pub use connect::{connect, connect_alone};
#[cfg(feature = "ros2-dds")]
#[doc(hidden)]
pub use dds::{DatagramProbe, submessages_read};
pub use error::{Ros2Error, Ros2ErrorKind};
pub use link::{Delivery, Endpoint, Link, Publisher, Received, Subscriber, Taken};
pub use message_type::MessageType;
