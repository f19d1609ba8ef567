//! Recordings of robots: images and cameras out of MCAP files, results into them.
//!
//! [`Recording`] reads `sensor_msgs/msg/Image`, `CompressedImage` and `CameraInfo` of ROS 2 (CDR) and Foxglove's
//! `RawImage`, `CompressedImage` and `CameraCalibration` (protobuf, JSON and CDR), from complete files, from files that were
//! cut off anywhere, and from split bags. [`RecordingWriter`] writes ROS 2 messages and embeds their schemas.
//!
//! This crate knows nothing of networks or of shared memory.

mod camera;
mod cdr;
mod channel;
mod channels;
mod compressed_depth;
mod decode;
mod encoding;
mod error;
mod file_end;
mod foxglove_json;
mod frame_record;
mod image;
mod messages;
mod mount;
mod other_files;
mod parts;
mod reader;
mod record;
mod records;
mod topics;
mod writer;

pub use camera::CameraDescription;
pub use encoding::{BayerPattern, ImageEncoding};
pub use error::{RecordingError, RecordingErrorKind};
pub use frame_record::{CloudRecord, DepthRecord, EncodedImage, FrameRecord, WriterOptions};
pub use image::RecordedImage;
pub use mount::Mount;
pub use other_files::{conversion_hint, recording_of_another_format};
pub use parts::is_recording;
pub use reader::{Next, Recording, model_of_results};
pub use writer::RecordingWriter;
