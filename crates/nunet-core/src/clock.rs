//! Time as an argument.

/// A monotonic clock that the caller owns.
///
/// Nanoseconds since a start of its own choosing; only differences mean anything. This crate never reads a clock by
/// itself, so that a test or a replay decides what time it is.
pub trait Clock {
    /// Nanoseconds now, never less than in an earlier call.
    fn nanos(&self) -> u64;
}

impl<F: Fn() -> u64> Clock for F {
    fn nanos(&self) -> u64 {
        self()
    }
}
