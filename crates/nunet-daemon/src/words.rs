//! What is written in one way everywhere.

/// The coordinate frame of a camera whose user names none.
pub(crate) fn default_frame_id(camera: &str) -> String {
    format!("{camera}_optical_frame")
}
