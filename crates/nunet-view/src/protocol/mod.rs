//! The WebSocket's messages: requests and other messages as JSON text, frames as bytes.

mod message;
mod number;
mod report;
mod request;

pub use message::{FrameMessage, MessageError, PROTOCOL_VERSION, Section};
pub(crate) use message::{FrameParts, encode};
pub(crate) use report::{Probe, RaysJson, ServerMessage};
pub(crate) use request::MAX_REQUEST_BYTES;
pub use request::{Request, RequestError, Watch};
