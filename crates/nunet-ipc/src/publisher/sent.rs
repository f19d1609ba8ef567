#![expect(unsafe_code, reason = "sent messages are read in place")]
//! The payload of a message after it was sent, for its publisher.

use std::marker::PhantomData;

/// The location of the payload of a sent message: an address, not a pointer, so that it can move between
/// threads.
#[derive(Debug)]
pub struct SentPayload<T> {
    address: usize,
    count: usize,
    of: PhantomData<fn() -> T>,
}

impl<T> SentPayload<T> {
    /// Records the payload of a loan before it is sent.
    pub fn of(payload: &mut [T]) -> Self {
        Self { address: payload.as_mut_ptr().expose_provenance(), count: payload.len(), of: PhantomData }
    }

    /// The payload.
    ///
    /// # Safety
    /// The message was sent, and no newer one of its topic for as long as the result is borrowed: until then
    /// the history of its service holds its memory, and no process writes into memory that was sent.
    #[must_use]
    pub unsafe fn payload<'a>(&self) -> &'a [T] {
        // SAFETY: address and count are those of a slice (see `of`); the caller keeps its memory alive and
        // unchanged.
        unsafe { std::slice::from_raw_parts(std::ptr::with_exposed_provenance(self.address), self.count) }
    }
}
