//! The shared-memory contract of `nunetd`.
pub mod block;
pub mod error;
pub mod frame;
pub mod header;
mod layout;
pub mod loan;
pub mod name;
mod node;
pub mod plain;
pub mod plan;
pub mod publisher;
pub mod reader;
mod service;
pub mod stats;
mod touch;
pub mod vocabulary;

pub use crate::error::IpcError;
pub use crate::frame::{Frame, FrameSet};
pub use crate::header::{CONTRACT_VERSION, FrameHeader};
pub use crate::layout::Field;
pub use crate::loan::Loan;
pub use crate::name::{CameraName, CameraNameError};
pub use crate::node::{CONTRACT_ATTRIBUTE, Process};
pub use crate::plain::{Plain, Point};
pub use crate::plan::{Limits, Reservation, TopicPlan, TopicReservation, free_shared_memory_bytes};
pub use crate::publisher::Publisher;
pub use crate::reader::Reader;
pub use crate::stats::StatsRecord;
pub use crate::vocabulary::{
    Clock, DistortionModel, Encoding, Quality, ScaleSource, Topic, Units, UnknownValue, UnknownWord, Wake,
};
