//! The shared-memory contract of `nunetd`: the bytes of a message, and how readers receive it from a
//! publisher.
//!
//! Each topic of a camera is an iceoryx2 service, `nunet/CAMERA/TOPIC`, with one publisher and several
//! readers. An event service, `nunet/CAMERA/wake`, wakes the readers. A message is a [`FrameHeader`] of 1024
//! bytes and a payload aligned to 64 bytes. The [`Publisher`] fills both in place, and each [`Reader`] reads
//! the same memory: nothing is copied.
//!
//! A program that only reads depth needs no other crate of nunet.
//!
//! | item | content |
//! |------|---------|
//! | [`contract`], [`nunet_types`] | the bytes of a message, also as tables for other languages |
//! | [`CameraName`], [`Limits`], [`Reservation`] | a camera's name, and how much memory it needs |
//! | [`Publisher`], [`Loan`] | the publisher's side |
//! | [`Reader`], [`Message`], [`FrameSet`] | the reader's side |
//! | [`AttitudePublisher`], [`AttitudeReader`] | the attitude of a robot that pitches, for the daemon |
//! | [`cameras`] | which cameras are published |
//! | [`access`] | which other users may read |
//! | [`orphans`] | files of killed processes |
//! | [`use_root`] | a private folder instead of the machine-wide `/tmp/iceoryx2` |
//!
//! # Guarantees
//! - The publisher never waits for a reader, and a reader never waits for another one. The newest frame wins.
//! - A late subscriber receives the last frame, also while the source is paused ([`Publisher::refresh`]).
//! - Memory is computed, checked, reserved and backed with pages before the first frame ([`Reservation`]).
//! - The memory of a message does not change until its [`Message`] is dropped.
//! - After the first frames, each loan makes one small heap allocation inside iceoryx2. There are no others.
//!
//! # Example: publish a depth map and read it in the same process
//! ```
//! use std::time::Duration;
//! use nunet_ipc::{CameraName, Encoding, Limits, Publisher, Reader, Topic, TopicPlan, Units, Wake};
//! use nunet_ipc::monotonic_nanos;
//!
//! # let root = tempfile::tempdir()?;
//! # nunet_ipc::use_root(root.path())?;
//! let camera = CameraName::new(&format!("example-{}", std::process::id()))?;
//! let plan = TopicPlan { topic: Topic::Depth, payload_bytes: 4 * 3 * size_of::<f32>() };
//! let publisher = Publisher::create(&camera, &[plan], &Limits::default())?;
//! let mut reader = Reader::open(&camera, &[Topic::Depth], Duration::from_secs(1))?;
//!
//! let mut loan = publisher.loan(Topic::Depth)?;
//! loan.slice_mut::<f32>()?.fill(1.5); // meters
//! let header = loan.header_mut();
//! (header.width, header.height, header.row_stride_bytes) = (4, 3, 16);
//! header.set_encoding(Encoding::DepthF32);
//! header.set_units(Units::Metre);
//! loan.publish(monotonic_nanos())?;
//! publisher.notify(Wake::Depth)?;
//!
//! reader.wait(Duration::from_secs(1))?; // a hint: look for frames whatever it returns
//! let frame = reader.latest(Topic::Depth)?.expect("it was sent");
//! assert_eq!(frame.depth()?, [1.5; 12]);
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

pub mod access;
mod attitude;
pub mod cameras;
mod clock;
pub mod contract;
mod error;
mod iceoryx;
mod name;
mod plan;
mod process;
mod publisher;
mod reader;
mod recovery;
mod service;

pub use crate::access::{Access, share_with};
pub use crate::attitude::{AttitudePublisher, AttitudeReader, NoAttitude};
pub use crate::clock::{monotonic_nanos, unix_nanos};
pub use crate::contract::{
    AttitudeRecord, AttitudeSample, CONTRACT_ATTRIBUTE, CONTRACT_VERSION, FrameHeader, MAX_ATTITUDE_SAMPLES,
    MAX_COEFFICIENTS, MAX_STAGES, ObstacleRecord, STAGE_NAME_BYTES, StatsRecord,
};
pub use crate::error::{IceoryxCause, IpcError, IpcErrorKind};
pub use crate::iceoryx::{ROOT_VARIABLE, root, shared_memory_prefix, use_root};
pub use crate::name::{CameraName, CameraNameError, MAX_CAMERA_NAME_BYTES};
pub use crate::plan::{Limits, Reservation, SHARED_MEMORY_FOLDER, TopicPlan, TopicReservation};
pub use crate::process::Process;
pub use crate::publisher::{
    LATE_JOINER_PERIOD, Loan, Publisher, SentPayload, check_capture_time, free_shared_memory_bytes,
};
pub use crate::reader::{FrameSet, Message, Publishers, Reader};
pub use crate::recovery::orphans;
pub use nunet_types::layout::Field;
pub use nunet_types::{
    CameraInfo, Clock, CloudPoint, DistortionModel, Encoding, ImageSize, MAX_OBSTACLE_POINTS, MAX_SECTORS,
    MAX_SIDE_PX, NO_LABEL, ObstaclePoint, ObstacleSector, PixelFormat, PixelRect, Quality, ScaleSource,
    SectorState, Topic, Units, UnknownValue, UnknownWord, Wake,
};
