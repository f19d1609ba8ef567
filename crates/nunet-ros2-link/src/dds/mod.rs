//! DDS by `dust_dds`, over a UDP transport of our own.
//!
//! The library speaks RTPS: discovery, matching, reliability, fragments. Its transport is replaced because
//! ROS 2 needs the well-known ports, discovery by unicast on one machine, and large messages that do not
//! overflow the receive buffers of subscribers. Messages for subscribers of this process do not go through
//! the library at all, which would decode them by their type and keep those that are not read.

mod addresses;
mod announcement;
mod failed;
mod found;
mod guard;
mod health;
mod inbox;
mod link;
mod nodes;
mod pace;
mod peers;
mod probe;
mod qos;
mod raw_message;
mod receiving;
mod rtps;
mod sending;
mod subscriber;
mod transport;
mod user_data;

pub use guard::submessages_read;
pub(crate) use link::{alone, shared};
pub use probe::DatagramProbe;
