//! Sources of frames: images on disk, pipes, programs, recordings, V4L2 cameras, shared memory, ROS 2.
//!
//! [`SourceName::parse`] chooses a kind of source, [`SourceName::open`] opens it, and [`Source::fill`] reads
//! one [`Frame`] after the other. Adding a source takes a file of its own and a line in the registry
//! (`registry.rs`). A [`Mailbox`] passes frames from the thread that reads a source to the one that processes
//! them.
//!
//! # Example: the images of a folder
//! ```
//! use nunet_source::{Fill, Frame, OpenOptions, SourceName};
//!
//! # let folder = tempfile::tempdir()?;
//! # image::RgbImage::from_pixel(4, 2, image::Rgb([7, 8, 9])).save(folder.path().join("a.png"))?;
//! let mut source = SourceName::parse(&folder.path().to_string_lossy()).open(OpenOptions::default())?;
//! let mut frame = Frame::default();
//! while let Fill::Frame = source.fill(&mut frame) {
//!     assert_eq!(frame.size.to_string(), "4x2");
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

#[cfg(not(all(feature = "ros2", feature = "v4l2")))]
mod absent;
mod bit_depth;
mod camera_file;
mod camera_report;
mod camera_resolver;
mod camera_settings;
mod command;
mod continuity;
#[cfg_attr(
    not(any(feature = "mcap", feature = "v4l2")),
    allow(dead_code, reason = "recordings and cameras have the other layouts")
)]
mod convert;
mod demo;
mod error;
mod files;
mod frame;
mod health;
mod image_file;
mod jpeg;
mod listing;
mod mailbox;
mod notify;
mod orientation;
mod pipe;
mod rate;
mod read_image;
#[cfg(feature = "mcap")]
mod recorded_image;
#[cfg(feature = "mcap")]
mod recording;
mod registry;
#[cfg(feature = "ros2")]
mod ros2;
mod rotated;
mod rotation;
mod secret;
mod shm;
mod silence;
mod source;
mod source_type;
#[cfg(feature = "v4l2")]
mod v4l2;

#[cfg(not(feature = "v4l2"))]
pub use absent::cameras;
pub use bit_depth::{BitDepthCheck, DimImages};
pub use camera_file::CameraFile;
pub use camera_report::CameraReport;
pub use camera_resolver::{CameraGeometry, CameraNews, CameraResolver, read_calibration};
pub use camera_settings::{CameraSetting, CameraSettings};
pub use continuity::{Continuity, Discontinuity};
pub use error::{SourceError, SourceErrorKind};
pub use frame::{CaptureTime, Frame, Pixels};
pub use image_file::{
    DecodedFile, IMAGE_EXTENSIONS, SingleChannelImage, decode, decode_file, decode_numbers, glance,
};
pub use listing::{list, listed_files, would_list};
pub use mailbox::{Mailbox, Put, Reuse, Taken};
pub use notify::Notify;
pub use pipe::open_pipe;
pub use rate::{Pacer, Rate};
pub use read_image::{ReadImage, read_image};
#[cfg(feature = "mcap")]
pub use recording::{RecordingSource, from_recording_error};
pub use registry::SourceName;
#[cfg(feature = "ros2")]
pub use ros2::Ros2Source;
pub use rotated::Rotated;
pub use rotation::{Rotation, Rotator};
pub use secret::without_passwords;
pub use shm::camera_in;
pub use source::{Fill, OpenOptions, Source, StartingWith, first_frame};
pub use source_type::{Exclusive, Properties, SizeUse, SourceType};
#[cfg(feature = "v4l2")]
pub use v4l2::cameras;
