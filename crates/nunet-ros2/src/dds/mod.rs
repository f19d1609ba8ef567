//! DDS by `dust_dds`, over a UDP transport of our own.
//!
//! The library speaks RTPS: discovery, matching, reliability, fragments. Its transport is replaced because ROS 2 needs the
//! well-known ports, discovery by unicast on one machine, and large messages that do not overflow the receive buffers of
//! subscribers.

mod addresses;
mod announcement;
mod found;
mod guard;
mod health;
mod link;
mod peers;
mod raw_message;
mod receiving;
mod rtps;
mod sending;
mod transport;

pub use guard::submessages_read;
pub(crate) use link::DdsLink;
