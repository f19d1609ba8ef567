//! Readers that come while a publisher has nothing to send.

use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

use nunet_ipc::LATE_JOINER_PERIOD;
use pyo3::prelude::*;

use crate::error::NunetError;

/// What is open, and a thread that serves it now and then until it is closed: taken out, or dropped. The thread touches
/// nothing of Python, so that it waits for nobody and nobody for it.
#[derive(Debug)]
pub(super) struct Served<T>(Arc<Mutex<Option<T>>>);

impl<T: Send + 'static> Served<T> {
    pub(super) fn start(open: T, serve: impl Fn(&T) + Send + 'static) -> PyResult<Self> {
        let open = Arc::new(Mutex::new(Some(open)));
        let served = Self(Arc::clone(&open));
        let look = move || {
            loop {
                std::thread::sleep(LATE_JOINER_PERIOD);
                match &*open.lock().unwrap_or_else(PoisonError::into_inner) {
                    Some(open) => serve(open),
                    None => return,
                }
            }
        };
        let started = std::thread::Builder::new().name("late readers".into()).spawn(look);
        started.map(|_| served).map_err(|error| {
            NunetError::new_err(format!("cannot start the thread that serves late readers: {error}"))
        })
    }
}

impl<T> Deref for Served<T> {
    type Target = Mutex<Option<T>>;

    fn deref(&self) -> &Self::Target {
        &self.0
    }
}

impl<T> Drop for Served<T> {
    /// Here and not on the thread, which may be looking: the camera's name is free when its publisher is gone.
    fn drop(&mut self) {
        let open = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        drop(open);
    }
}
