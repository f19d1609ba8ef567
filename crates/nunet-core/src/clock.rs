//! Time as an argument.

/// A monotonic clock that the caller provides.
///
/// Nanoseconds since an arbitrary start. This crate reads no clock of its own, so that a test or a replay can
/// set the time.
pub trait Clock {
    /// Nanoseconds now, never less than in an earlier call.
    fn nanos(&self) -> u64;
}

impl<F: Fn() -> u64> Clock for F {
    fn nanos(&self) -> u64 {
        self()
    }
}
