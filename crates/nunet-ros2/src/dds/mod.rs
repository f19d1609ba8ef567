//! DDS by `dust_dds`, over a UDP transport of our own.
//!
//! The library speaks RTPS: discovery, matching, reliability, fragments. Its transport is replaced because ROS 2 needs the
//! well-known ports, discovery by unicast on one machine, and large messages that do not overflow the receive buffers of
//! subscribers.

mod addresses;
mod link;
mod peers;
mod raw_message;
mod rtps;
mod transport;

pub(crate) use link::DdsLink;
