//! The vocabulary that all nunet crates share: plain data types without behavior of their own.
//!
//! | item | what it is |
//! |------|------------|
//! | [`ImageSize`], [`PixelFormat`], [`PixelRect`] | the layout of an image in memory, and a part of it |
//! | [`AspectMode`] | what is done with images of another aspect ratio than the network's |
//! | [`Units`], [`ScaleSource`], [`Quality`] | the meaning of a depth map's numbers |
//! | [`CameraInfo`], [`DistortionModel`] | intrinsics and lens of a camera, as messages carry them |
//! | [`SensorRegion`] | the part of its sensor that a camera delivers |
//! | [`CloudPoint`], [`NO_LABEL`] | one point of a cloud, 16 bytes |
//! | [`Topic`], [`Encoding`], [`Clock`], [`Wake`] | the properties of a shared-memory message |
//! | [`layout`], [`contract_struct!`] | structs whose byte layout is fixed, with a table of their fields |
//! | [`Hint`], [`TypesErrorKind`] | what a user can do about an error; the kinds of this crate's errors |
//! | [`ErrorReport`] | an error with its causes and hints, as front ends print it |
//! | [`is_host_and_port`] | whether a text is an address on a network |
//! | [`shortest()`] | a number that prints as it was written |
//! | [`counted()`] | a count with its noun in the singular or plural |
//!
//! Each enumeration of the shared-memory contract has a number (in shared memory), a name (on the command
//! line, in files, in JSON) and a documentation text (in the C header). One macro writes all three, so they
//! cannot differ.
//!
//! # Example: the bytes of an image
//! ```
//! use nunet_types::{Encoding, ImageSize, PixelFormat};
//!
//! let format: PixelFormat = "yuyv".parse()?;
//! let size: ImageSize = "640x480".parse()?;
//! assert_eq!(format.min_stride(size.width), 1280);
//! assert_eq!(format.byte_len(size.width, size.height, 1280), 614_400);
//!
//! // The number that stands for it in a message's header, and back.
//! let number = u32::from(Encoding::from(format));
//! assert_eq!(Encoding::try_from(number)?.pixel_format(), Some(PixelFormat::Yuyv));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

// For `contract_struct!`, which names this crate from outside.
extern crate self as nunet_types;

mod aspect_mode;
mod camera_info;
mod classes;
mod cloud_point;
mod contract;
mod counted;
mod depth;
mod error_kind;
mod error_report;
mod hint;
mod host_port;
mod image_size;
pub mod layout;
mod message;
mod obstacle;
mod pixel_format;
mod pixel_rect;
pub mod printable;
mod sensor_region;
mod shortest;
mod vocabulary;

pub use aspect_mode::AspectMode;
pub use camera_info::{CameraInfo, DistortionModel, MAX_COEFFICIENTS};
pub use classes::NYU13_CLASSES;
pub use cloud_point::{CloudPoint, NO_LABEL};
pub use contract::CONTRACT_VERSION;
pub use counted::counted;
pub use depth::{Quality, ScaleSource, Units};
pub use error_kind::TypesErrorKind;
pub use error_report::{AsHint, ErrorReport, as_hint, flag_hint, is_usage};
pub use hint::{CAUSE_MARK, Hint, hint_of_listen, join_hint, split_hint, text_with_causes, text_with_hint};
pub use host_port::is_host_and_port;
pub use image_size::{ImageSize, ImageSizeError, MAX_SIDE_PX};
pub use message::{Clock, Encoding, MAX_FRAME_ID, Topic, Wake, default_frame_id};
pub use obstacle::{
    MAX_OBSTACLE_POINTS, MAX_SECTORS, ObstacleMap, ObstaclePoint, ObstacleSector, SectorState,
};
pub use pixel_format::PixelFormat;
pub use pixel_rect::PixelRect;
pub use sensor_region::{RegionOutside, SensorRegion};
pub use shortest::shortest;
pub use vocabulary::{UnknownValue, UnknownWord};
