//! What a process made, its fork must not use: shared memory and sockets are inherited, but neither are iceoryx2's records
//! of who holds what, nor the threads that compute.

use pyo3::prelude::*;

use crate::error::NunetError;

/// A value that belongs to the process that made it. A fork can neither use nor drop it: dropping would remove files,
/// give back memory that the parent still uses, or wait for threads that did not come along.
#[derive(Debug)]
pub(crate) struct Own<T> {
    // Taken out only by `drop`.
    value: Option<T>,
    pid: u32,
}

impl<T> Own<T> {
    pub(crate) fn new(value: T) -> Self {
        Self { value: Some(value), pid: std::process::id() }
    }

    /// The value; an error that names `what` in a fork.
    pub(crate) fn get(&self, what: &str) -> PyResult<&T> {
        match &self.value {
            Some(value) if self.pid == std::process::id() => Ok(value),
            _ => Err(self.inherited(what)),
        }
    }

    fn inherited(&self, what: &str) -> PyErr {
        let (made, here) = (self.pid, std::process::id());
        NunetError::new_err(format!(
            "this {what} belongs to process {made}, and this is process {here}, which was forked from it\n\
             hint: make it in the process that uses it, or start processes with \
             multiprocessing.get_context(\"spawn\")"
        ))
    }
}

impl<T> Drop for Own<T> {
    fn drop(&mut self) {
        if self.pid != std::process::id() {
            std::mem::forget(self.value.take());
        }
    }
}
