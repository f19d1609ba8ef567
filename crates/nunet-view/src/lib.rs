//! Image, depth, labels, confidence, cloud and obstacles live in the browser.
//!
//! [`ViewServer`] serves one page and the same results for programs. It is independent of nunetd: a program
//! with frames opens it, adds a camera, and copies frames into it while a viewer wants them.
//!
//! | path | content |
//! |---|---|
//! | `/` | the page: image, depth, labels, confidence, 3D cloud, obstacles, plots |
//! | `/api/cameras` | JSON: cameras, sizes, frame counts, rates |
//! | `/CAMERA/image.mjpeg`, `/CAMERA/depth.mjpeg` | video for `<img>`, OpenCV and others; depth in colors |
//! | `/CAMERA/frame.jpg` | the newest image |
//! | `/CAMERA/depth.png` | the newest depth map, 16 bit, millimeters, 0 = no measurement |
//! | `/ws` | WebSocket: JSON requests, binary frames ([`FrameMessage`]) |
//! | `/metrics` | text for Prometheus, if the caller provides it |
//!
//! Three rules keep viewers from disturbing the producer:
//!
//! - **No work without a viewer.** [`CameraFeed::is_wanted`] is false while no client waits for a frame, and
//!   images are encoded only when they are sent. One frame per second is kept for clients that come later.
//! - **Newest wins.** Each client has one slot. A client that is slow or stalled skips frames and holds one
//!   frame at most.
//! - **One thread.** All clients are served, and all images encoded, on the server's own thread.
//!
//! Without a token the server listens on loopback addresses only. It serves plain HTTP: use a tunnel or a
//! proxy with TLS on networks that you do not trust.
//!
//! # Example: one frame of a camera
//! ```
//! use nunet_types::{ImageSize, PixelFormat, ScaleSource, Units};
//! use nunet_view::{DepthInfo, ViewOptions, ViewServer};
//!
//! let server = ViewServer::open("127.0.0.1:0".parse()?, ViewOptions::default())?;
//! let mut feed = server.add_camera("front", &["floor".to_owned(), "wall".to_owned()]);
//! if feed.is_wanted() {
//!     let size = ImageSize::new(2, 2);
//!     let (units, scale_source) = (Units::Metre, ScaleSource::Metric);
//!     let depth = DepthInfo { size, units, scale_source, view: [0.0, 0.0, 1.0, 1.0] };
//!     feed.offer(|frame| {
//!         frame.set_image(&[0, 64, 128, 255], size, 2, PixelFormat::Mono8);
//!         frame.set_depth(&[1.0, 1.5, 2.0, f32::NAN], depth);
//!     });
//! }
//! println!("open http://{}/", server.address());
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```
//!
//! Errors have a [kind](ViewError::kind) and a [hint](nunet_types::Hint).

mod address;
mod camera;
mod encode;
mod error;
mod frame;
mod http;
mod obstacles;
mod pacing;
mod protocol;
mod server;
mod token;

pub use address::{overlapping_addresses, probe_address};
pub use camera::{CameraFeed, CameraStatus, OnDemand};
pub use encode::{DepthMap, DepthMapError};
pub use error::{ViewError, ViewErrorKind};
pub use frame::{DepthInfo, RayGrid, ViewFrame, WHOLE_IMAGE};
pub use http::MetricsText;
pub use protocol::{FrameMessage, MessageError, PROTOCOL_VERSION, Request, RequestError, Section, Watch};
pub use server::{MetricsServer, ViewConfig, ViewOptions, ViewServer, check_address};
pub use token::{Token, UncheckedToken};
