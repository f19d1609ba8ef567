//! Values that a fork of the process must not use. It inherits shared memory and sockets, but neither
//! iceoryx2's records of which thread holds a lock nor which threads compute.

use pyo3::prelude::*;

use crate::error::{NunetError, hinted};

/// A value that belongs to the process that made it. A fork can neither use nor drop it: dropping would
/// remove files, release memory that the parent still uses, or wait for threads that a fork does not have.
#[derive(Debug)]
pub(crate) struct ForkGuard<T> {
    // `None` only while it is dropped.
    value: Option<T>,
    pid: u32,
}

impl<T> ForkGuard<T> {
    pub(crate) fn new(value: T) -> Self {
        Self { value: Some(value), pid: std::process::id() }
    }

    /// The value.
    ///
    /// # Errors
    /// `NunetError` in a fork; it names `what`.
    pub(crate) fn get(&self, what: &str) -> PyResult<&T> {
        match &self.value {
            Some(value) if self.pid == std::process::id() => Ok(value),
            _ => Err(self.inherited(what)),
        }
    }

    fn inherited(&self, what: &str) -> PyErr {
        let (made, here) = (self.pid, std::process::id());
        hinted::<NunetError>(
            format!("this {what} belongs to process {made}, but this is process {here}, a fork of it"),
            "make it in the process that uses it, or start processes with multiprocessing.get_context(\"spawn\")",
        )
    }
}

impl<T> Drop for ForkGuard<T> {
    fn drop(&mut self) {
        if self.pid != std::process::id() {
            std::mem::forget(self.value.take());
        }
    }
}
