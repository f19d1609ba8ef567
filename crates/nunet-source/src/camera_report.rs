//! What is known about a camera of this machine.

use std::borrow::Cow;
use std::path::PathBuf;

/// A camera of this machine.
#[derive(Debug)]
pub struct CameraReport {
    /// Its device.
    pub path: PathBuf,
    /// Its formats and sizes, or why they are unknown, with a hint.
    pub offer: Result<String, (String, Option<Cow<'static, str>>)>,
}
