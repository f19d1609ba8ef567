//! Recordings: reads images and cameras from MCAP files, and writes results into them.
//!
//! [`Recording`] reads `sensor_msgs/msg/Image`, `CompressedImage` and `CameraInfo` of ROS 2 (CDR) and
//! Foxglove's `RawImage`, `CompressedImage` and `CameraCalibration` (protobuf, JSON and CDR), from complete
//! files, truncated files, and split bags. [`RecordingWriter`] writes ROS 2 messages and embeds their
//! schemas.
//!
//! This crate does not depend on networks or shared memory.
//!
//! # Example: record a frame, and read it back
//! ```
//! use nunet_mcap::{
//!     DepthRecord, EncodedImage, FrameRecord, Next, RecordedImage, Recording, RecordingWriter, ScaleRecord,
//!     WriterOptions,
//! };
//!
//! # let folder = tempfile::tempdir()?;
//! # let path = folder.path().join("front.mcap");
//! # let mut png = std::io::Cursor::new(Vec::new());
//! # image::RgbImage::new(4, 2).write_to(&mut png, image::ImageFormat::Png)?;
//! # let png = png.into_inner();
//! let options = WriterOptions {
//!     camera: "front".to_owned(),
//!     frame_id: "front_optical_frame".to_owned(),
//!     mount: None,
//!     about: Default::default(),
//!     force: false,
//! };
//! let mut writer = RecordingWriter::create(&path, options)?;
//! let depth_m: Vec<u8> = [1.5_f32; 8].into_iter().flat_map(f32::to_le_bytes).collect();
//! writer.write(&FrameRecord {
//!     log_nanos: 1_000,
//!     stamp_nanos: 1_000,
//!     image: Some(EncodedImage { format: "png", data: &png }),
//!     camera: None,
//!     depth: DepthRecord { scale: ScaleRecord::default(), width: 4, height: 2, bytes: &depth_m },
//!     depth_camera: None,
//!     labels: None,
//!     confidence: None,
//!     cloud: None,
//! })?;
//! writer.finish()?;
//!
//! let images = Recording::open(&path, None)?;
//! assert_eq!(images.topic(), "/front/image_raw/compressed");
//! let mut depths = Recording::open_depth(&path, None)?;
//! let mut depth = RecordedImage::default();
//! while !matches!(depths.next(&mut depth), Next::Image) {}
//! assert_eq!((depth.width, depth.depth_m()), (4, vec![1.5; 8]));
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Errors have a [kind](RecordingError::kind) and a [hint](nunet_types::Hint).

mod attitude;
mod bag;
mod camera;
mod camera_topic;
mod cdr;
mod channel;
mod channels;
mod chunk;
mod compressed_depth;
mod damage;
mod decode;
mod encoding;
mod error;
mod file_end;
mod foxglove_json;
mod frame_record;
mod image;
mod image_error;
mod json_fields;
mod live;
mod messages;
mod mount;
mod obstacles;
mod other_files;
mod parts;
mod peek;
mod reader;
mod record;
mod records;
pub mod ros;
mod text;
mod topics;
mod writer;

pub use camera::CameraDescription;
pub use camera_topic::camera_topic;
pub use encoding::{BayerPattern, ImageEncoding};
pub use error::{RecordingError, RecordingErrorKind};
pub use frame_record::{CloudRecord, DepthRecord, EncodedImage, FrameRecord, ScaleRecord, WriterOptions};
pub use image::RecordedImage;
pub use live::TopicDecoder;
pub use mount::{BASE_FRAME, CameraMount};
pub use obstacles::ObstacleMapRecord;
pub use other_files::{conversion_hint, recording_of_another_format};
pub use parts::{files, is_recording};
pub use reader::{Next, Recording, model_of_results};
pub use writer::RecordingWriter;
