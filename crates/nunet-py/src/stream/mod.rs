//! Frames of other processes, and images for them, in shared memory without a copy.

mod attitude;
mod errors;
mod feed;
mod frame;
mod header;
mod late;
mod layout;
mod loan;
mod port;
mod publisher;
mod sample;
mod stats;
mod subscribe;
mod topics;
mod wait;

use pyo3::prelude::*;

pub(crate) fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    subscribe::register(module)?;
    publisher::register(module)?;
    module.add_class::<attitude::PyAttitudePublisher>()?;
    module.add_class::<frame::PyFrame>()?;
    module.add_class::<header::FrameHeader>()?;
    module.add_class::<stats::PyStats>()?;
    module.add_class::<loan::PyLoan>()
}
