//! The kinds of errors.

/// The kind of an error of this crate. Every error type has a method `kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum TypesErrorKind {
    /// A text or a size that a user chose is invalid.
    Argument,
    /// What a camera states about its images contradicts itself.
    Camera,
    /// The sender of a message wrote a number that the contract does not define.
    Contract,
}
