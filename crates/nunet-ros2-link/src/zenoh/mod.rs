//! Zenoh, as `rmw_zenoh` uses it.
//!
//! A node of ROS 2 is a Zenoh session that connects to a router. The router introduces nodes to each other;
//! messages then go from node to node. Who publishes and subscribes what is stated in liveliness tokens, which
//! disappear with their session.

mod attachment;
mod config;
mod dropped;
mod graph;
mod inbox;
mod keys;
mod link;
mod publisher;
mod router;
mod subscriber;

pub(crate) use config::check;
pub(crate) use link::{alone, shared};
