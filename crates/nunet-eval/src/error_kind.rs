//! The kinds of errors, for front ends that map errors to exit codes.

/// The kind of an error of this crate.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum EvalErrorKind {
    /// The dataset, a file or an option is wrong: other arguments would help.
    Argument,
    /// An image or a pair of images cannot be used.
    Image,
    /// There is no true depth to compare with.
    Truth,
    /// The network did not run.
    Model,
    /// A file or folder cannot be read or written.
    System,
}
