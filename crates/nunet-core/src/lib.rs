//! Computes metric depth and a point cloud from an image.
//!
//! [`pipeline`] calls the modules in the order in which they process a frame: [`frame`] -> [`preprocess`] ->
//! [`graph`] -> [`depth`] -> [`filter`] -> [`cloud`]. [`obstacle`] follows on demand, and [`scale`] measures
//! the scale of depth on the floor. A later module may import an earlier one, never the reverse. This crate
//! starts no threads, opens no sockets, prints nothing and reads no clock. The caller provides every large
//! buffer.
//!
//! # Example: depth, labels and points of one image
//! ```no_run
//! use nunet_core::camera::Calibration;
//! use nunet_core::cloud::CloudPoint;
//! use nunet_core::frame::{ImageView, PixelFormat};
//! use nunet_core::graph::{GraphOptions, Runtime, SerialGraph};
//! use nunet_core::pipeline::{Outputs, Pipeline, PipelineOptions};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! // A camera of 640x480 with its calibration, as ROS's camera_calibration writes it.
//! let bytes = vec![0; 640 * 480 * 3];
//! let frame = ImageView::packed(&bytes, 640, 480, PixelFormat::Rgb8)?;
//! let camera = Calibration::parse(&std::fs::read_to_string("front.yaml")?)?.at_size(640, 480)?;
//!
//! // The network: `ORT_DISABLE_TELEMETRY=1` keeps ONNX Runtime off the network.
//! let runtime = Runtime::load("libonnxruntime.so".as_ref())?;
//! let graph = SerialGraph::load("wnet_c.onnx".as_ref(), &runtime, &GraphOptions::default())?;
//! let options = PipelineOptions { camera: Some(camera), ..PipelineOptions::default() };
//! let mut pipeline = Pipeline::new(graph, options)?;
//! let clock = || 0; // pass a real clock to measure times
//! pipeline.selftest(&clock)?;
//!
//! // Results are written into buffers of the caller, at the network's size.
//! let pixels = pipeline.size().pixel_count();
//! let (mut depth_m, mut labels) = (vec![0.0; pixels], vec![0; pixels]);
//! let mut cloud = vec![CloudPoint::NONE; pixels];
//! let (labels, cloud) = (Some(&mut labels[..]), Some(&mut cloud[..]));
//! let outputs = Outputs { depth_m: &mut depth_m, labels, confidence: None, cloud };
//! let report = pipeline.process(&frame, outputs, &clock)?;
//! println!("{} of {pixels} pixels without depth", report.invalid_pixels);
//! # Ok(())
//! # }
//! ```
//!
//! Errors have a `kind` ([`ErrorKind`]) and may have a hint ([`hint_of`]).

pub mod camera;
pub mod clock;
pub mod cloud;
pub mod depth;
mod error_kind;
pub mod filter;
pub mod frame;
pub mod framing;
pub mod graph;
mod hints;
mod label_roles;
pub mod model;
pub mod obstacle;
pub mod pipeline;
pub mod plain_file;
pub mod preprocess;
pub mod scale;
pub mod stability;
pub mod text;

pub use error_kind::ErrorKind;
pub use hints::{as_hint, hint_of};
