//! Late subscribers of a publisher that has nothing to send.

use std::ops::Deref;
use std::sync::{Arc, Mutex, PoisonError};

use nunet_ipc::LATE_JOINER_PERIOD;
use pyo3::prelude::*;

use crate::error::NunetError;

/// A publisher, and a thread that serves late subscribers at a fixed period until the publisher is taken out
/// or dropped. The thread uses nothing of Python, so neither can block the other.
#[derive(Debug)]
pub(super) struct Served<T>(Arc<Mutex<Option<T>>>);

impl<T: Send + 'static> Served<T> {
    pub(super) fn start(open: T, serve: impl Fn(&T) + Send + 'static) -> PyResult<Self> {
        let open = Arc::new(Mutex::new(Some(open)));
        let served = Self(Arc::clone(&open));
        let serve_periodically = move || {
            loop {
                std::thread::sleep(LATE_JOINER_PERIOD);
                match &*open.lock().unwrap_or_else(PoisonError::into_inner) {
                    Some(open) => serve(open),
                    None => return,
                }
            }
        };
        let started = std::thread::Builder::new().name("late readers".into()).spawn(serve_periodically);
        started.map(|_| served).map_err(|error| {
            NunetError::new_err(format!("cannot start the thread that serves late subscribers: {error}"))
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
    /// Drops the publisher here and not on the thread, so that its name is free as soon as this returns.
    fn drop(&mut self) {
        let open = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        drop(open);
    }
}
