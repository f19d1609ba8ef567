//! Zenoh, as `rmw_zenoh` uses it.
//!
//! A node of ROS 2 is a Zenoh session that connects to a router. The router introduces nodes to each other;
//! messages then go from node to node. Liveliness tokens state the topics that a node publishes and
//! subscribes to. They disappear with their session.

mod attachment;
mod client;
mod config;
mod dropped;
mod graph;
mod inbox;
mod keys;
mod link;
mod place;
mod publisher;
mod router;
mod subscriber;

pub(crate) use config::check;
pub(crate) use link::{alone, shared};
