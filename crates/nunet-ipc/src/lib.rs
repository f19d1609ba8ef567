//! The shared-memory contract of `nunetd`: what a frame looks like, and how it gets from its owner to its readers.
//!
//! A camera is a handful of iceoryx2 services, `nunet/CAMERA/TOPIC`, each with one owner and some readers, and an
//! event, `nunet/CAMERA/wake`. A message is a [`FrameHeader`] of 1024 bytes and a payload aligned to 64 bytes. The
//! owner ([`Publisher`]) fills both in place, readers ([`Reader`]) look at the same memory: nothing is copied.
//!
//! This crate is a leaf with plain-data types: a program that only reads depth needs nothing else of nunet.
//!
//! Read it in this order:
//!
//! | module | what |
//! |--------|------|
//! | [`nunet_types`], [`header`], [`block`], [`stats`] | the bytes of a message |
//! | [`contract`] | the same as tables, for other languages |
//! | [`name`], [`plan`] | a camera's name, and how much memory it needs |
//! | [`publisher`], [`loan`] | the owner's side |
//! | [`reader`], [`frame`] | the reader's side |
//! | [`cameras`] | which cameras there are |
//! | [`access`] | who besides the own user may read |
//! | [`orphans`] | what killed processes left behind |
//! | [`clock`] | the times that all of them share |
//!
//! # Promises
//! - The owner never waits for a reader; a reader never waits for another one. The newest frame wins.
//! - The last frame reaches a reader that comes late ([`Publisher::refresh`]).
//! - Memory is computed, checked, reserved and touched before the first frame ([`plan`]).
//! - A frame's memory stays as it is for as long as its [`Frame`] lives.
//! - After the first frames nothing is taken from the heap, but for one small piece of iceoryx2's own in each loan.

pub mod access;
pub mod block;
pub mod cameras;
pub mod clock;
pub mod contract;
pub mod error;
pub mod frame;
pub mod header;
pub mod loan;
mod mend;
pub mod name;
mod node;
pub mod orphans;
pub mod plan;
pub mod publisher;
pub mod reader;
mod service;
pub mod stats;
mod text;
mod touch;

pub use crate::access::{Access, share_with};
pub use crate::clock::{monotonic_nanos, unix_nanos};
pub use crate::error::IpcError;
pub use crate::frame::{Frame, FrameSet};
pub use crate::header::{CONTRACT_VERSION, FrameHeader};
pub use crate::loan::Loan;
pub use crate::name::{CameraName, CameraNameError};
pub use crate::node::{CONTRACT_ATTRIBUTE, Process};
pub use crate::plan::{Limits, Reservation, TopicPlan, TopicReservation, free_shared_memory_bytes};
pub use crate::publisher::{LATE_JOINER_PERIOD, Publisher};
pub use crate::reader::{Owners, Reader};
pub use crate::stats::StatsRecord;
pub use nunet_types::layout::Field;
pub use nunet_types::{
    CameraInfo, Clock, CloudPoint, DistortionModel, Encoding, ImageSize, MAX_SIDE_PX, NO_LABEL, PixelFormat,
    Quality, ScaleSource, Topic, Units, UnknownValue, UnknownWord, Wake,
};
