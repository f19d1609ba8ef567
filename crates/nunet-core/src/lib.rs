//! From a picture to metric depth and a point cloud.
//!
//! A frame's journey reads in the order of the modules: [`frame`] -> [`preprocess`] -> [`graph`] -> [`depth`] ->
//! [`filter`] -> [`cloud`]. A later stage may import an earlier one, never the reverse. Nothing here starts threads, opens
//! sockets, prints, or reads a clock, and every large buffer belongs to the caller.

pub mod camera;
pub mod clock;
pub mod cloud;
pub mod depth;
pub mod filter;
pub mod frame;
pub mod graph;
pub mod model;
pub mod pipeline;
pub mod plain_file;
pub mod preprocess;
pub mod text;
