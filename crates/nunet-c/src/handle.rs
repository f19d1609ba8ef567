//! Handles: numbers that C sees as pointers.
//!
//! A C program may use a reader that it has closed, close it twice, or pass a frame where a loan is wanted.
//! Were a handle the address of its object, each of these would be undefined behavior. So it is a number that
//! is never used again, and is looked up: an unknown number is an error. *Rejected:* addresses with a magic
//! number in front, which read freed memory to find out that it was freed.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::status::{Failure, StatusCode};

/// The open handles of one kind.
#[derive(Debug)]
pub(crate) struct Table<T> {
    kind: &'static str,
    open: Mutex<BTreeMap<usize, HandleEntry<T>>>,
}

#[derive(Debug)]
struct HandleEntry<T> {
    process: u32,
    value: Arc<Mutex<T>>,
}

/// Handles look like addresses of something aligned, because some tools expect that of pointers.
const STEP: usize = 64;

impl<T> Table<T> {
    /// An empty table; `kind` is how errors name what is in it.
    pub(crate) const fn new(kind: &'static str) -> Self {
        Self { kind, open: Mutex::new(BTreeMap::new()) }
    }

    /// Adds a value and returns its handle.
    pub(crate) fn insert<H>(&self, value: T) -> *mut H {
        // One counter for all tables: a handle of another kind is in none but its own.
        static NEXT: AtomicUsize = AtomicUsize::new(STEP);
        let number = NEXT.fetch_add(STEP, Ordering::Relaxed);
        let entry = HandleEntry { process: std::process::id(), value: Arc::new(Mutex::new(value)) };
        locked(&self.open).insert(number, entry);
        std::ptr::without_provenance_mut(number)
    }

    /// The value of a handle. It stays valid while it is in use here, even if another thread closes it.
    pub(crate) fn get<H>(&self, handle: *const H) -> Result<Arc<Mutex<T>>, Failure> {
        self.refuse_null(handle)?;
        let open = locked(&self.open);
        let entry = open.get(&handle.addr()).ok_or_else(|| self.closed())?;
        if entry.process != std::process::id() {
            return Err(self.forked());
        }
        Ok(Arc::clone(&entry.value))
    }

    /// Closes a handle and returns its value. `None` for NULL, as with `free`, and in a forked process,
    /// where dropping the value would remove the parent's resources.
    pub(crate) fn remove<H>(&self, handle: *const H) -> Result<Option<Arc<Mutex<T>>>, Failure> {
        if handle.is_null() {
            return Ok(None);
        }
        let entry = locked(&self.open).remove(&handle.addr()).ok_or_else(|| self.closed())?;
        if entry.process == std::process::id() {
            return Ok(Some(entry.value));
        }
        std::mem::forget(entry.value);
        Ok(None)
    }

    /// Refuses NULL where something is needed.
    pub(crate) fn refuse_null<H>(&self, handle: *const H) -> Result<(), Failure> {
        if handle.is_null() {
            let kind = self.kind;
            return Err(Failure::argument(format!("the {kind} is NULL"))
                .hint("check the status of the call that should have returned it"));
        }
        Ok(())
    }

    pub(crate) fn closed(&self) -> Failure {
        let kind = self.kind;
        Failure::new(StatusCode::Closed, format!("this {kind} is not open")).hint(
            "do not use a handle after it was closed, released or sent, or where another kind is expected",
        )
    }

    fn forked(&self) -> Failure {
        let kind = self.kind;
        let message = format!("this {kind} belongs to the process that this one was forked from");
        Failure::new(StatusCode::Forked, message).hint("open one after the fork")
    }
}

/// A lock, also after a panic in another thread: the values behind it are sound at each step, and the panic
/// was reported.
pub(crate) fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    static TEXTS: Table<&str> = Table::new("text");
    static OTHERS: Table<&str> = Table::new("other");

    #[test]
    fn a_handle_is_an_error_after_its_end() {
        let handle: *mut u8 = TEXTS.insert("a");
        assert_eq!(*locked(&TEXTS.get(handle).unwrap()), "a");
        assert!(TEXTS.remove(handle).unwrap().is_some());
        assert_eq!(TEXTS.get(handle).unwrap_err().status, StatusCode::Closed);
        assert_eq!(TEXTS.remove(handle).unwrap_err().status, StatusCode::Closed);
    }

    #[test]
    fn a_handle_of_another_kind_is_an_error() {
        let handle: *mut u8 = TEXTS.insert("b");
        let failure = OTHERS.get(handle).unwrap_err();
        assert_eq!(failure.status, StatusCode::Closed);
        assert_eq!(failure.message, "this other is not open");
        assert!(failure.hint.is_some());
        assert!(TEXTS.remove(handle).unwrap().is_some());
    }

    #[test]
    fn null_is_refused_but_may_be_closed() {
        assert_eq!(TEXTS.get::<u8>(std::ptr::null()).unwrap_err().status, StatusCode::BadArgument);
        assert!(TEXTS.remove::<u8>(std::ptr::null()).unwrap().is_none());
    }

    #[test]
    fn a_value_in_use_outlives_its_handle() {
        let handle: *mut u8 = TEXTS.insert("c");
        let kept = TEXTS.get(handle).unwrap();
        drop(TEXTS.remove(handle).unwrap());
        assert_eq!(*locked(&kept), "c");
    }
}
