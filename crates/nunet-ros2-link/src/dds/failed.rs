//! Failures of the library.

use dust_dds::infrastructure::error::DdsError;

use crate::error::Ros2Error;

pub(super) fn failed(action: &'static str) -> impl Fn(DdsError) -> Ros2Error {
    move |error| Ros2Error::Middleware { action, reason: error.to_string() }
}
