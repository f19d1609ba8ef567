//! The server's messages other than frames, as JSON text.

use serde::Serialize;

use crate::camera::CameraStatus;

/// A message to one client.
#[derive(Debug, Serialize)]
#[serde(tag = "type", rename_all = "snake_case")]
pub(crate) enum ServerMessage<'a> {
    /// The first message.
    Hello {
        protocol: u16,
        cameras: Vec<&'a str>,
        /// The color map from near to far: red, green, blue, 256 times.
        palette: Vec<u8>,
    },
    /// Before the first frame of a camera, and after its rays or its classes changed.
    Camera { camera: &'a str, classes: &'a [String], rays: Option<RaysJson<'a>> },
    /// A few times per second, if something changed.
    Status { camera: &'a str, status: CameraStatus },
    /// The answer to a probe.
    Probe(Probe),
    /// A request was wrong; the connection is closed.
    Error { message: String },
}

/// The grid of rays; `null` is a node without a ray.
#[derive(Debug, Serialize)]
pub(crate) struct RaysJson<'a> {
    pub(crate) columns: u32,
    pub(crate) rows: u32,
    pub(crate) rays: &'a [[f32; 2]],
}

/// A pixel of the last frame that was sent, at the full size of its depth map.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub(crate) struct Probe {
    pub(crate) sequence: u64,
    pub(crate) x: u32,
    pub(crate) y: u32,
    /// `null` where there is no measurement.
    pub(crate) depth: Option<f32>,
    pub(crate) label: Option<u8>,
    /// 255 = certain; `null` if it was not computed.
    pub(crate) confidence: Option<u8>,
}

impl ServerMessage<'_> {
    pub(crate) fn to_json(&self) -> String {
        // Strings, numbers and lists are always JSON; numbers that are not finite become `null`.
        serde_json::to_string(self).unwrap_or_default()
    }
}
