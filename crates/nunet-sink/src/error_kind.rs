//! The kinds of errors, for front ends that map errors to exit codes.

/// The kind of an error of this crate. Every error type has a method `kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum SinkErrorKind {
    /// An output cannot be written where the user wants it: another one would help.
    Argument,
    /// The reader of standard output has closed its pipe.
    ClosedPipe,
    /// Files were not written in time.
    TimedOut,
    /// The system failed.
    System,
}
