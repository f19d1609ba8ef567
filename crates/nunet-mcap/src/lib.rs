//! Robots' recordings: pictures and cameras out of MCAP files, results into them.
//!
//! [`Recording`] reads `sensor_msgs/msg/Image`, `CompressedImage` and `CameraInfo` of ROS 2 (CDR) and Foxglove's
//! `RawImage`, `CompressedImage` and `CameraCalibration` (protobuf and JSON), from whole files and from files that were
//! cut anywhere. [`RecordingWriter`] writes ROS 2 messages whose schemas lie in the file.
//!
//! Nothing here knows of networks or of shared memory.

mod cdr;
mod channels;
mod error;
mod foxglove_messages;
mod messages;
mod mount;
mod picture;
mod reader;
mod records;
mod writer;

pub use error::RecordingError;
pub use mount::Mount;
pub use picture::{CameraDescription, Encoding, Picture};
pub use reader::{Next, Recording, model_of_results};
pub use writer::{CloudRecord, DepthRecord, EncodedPicture, FrameRecord, RecordingWriter, WriterOptions};
