//! The kinds of errors, for front ends that map errors to exit codes and exceptions.

/// The kind of an error of this crate. Every error type has a method `kind`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum ErrorKind {
    /// An option or its text is invalid.
    Argument,
    /// The bytes of an image do not fit its size and format.
    Image,
    /// Intrinsics, a lens or a calibration are invalid, or do not fit the image.
    Camera,
    /// A model file, its metadata or its sidecar cannot be used.
    Model,
    /// The stages of a graph do not fit together.
    Wiring,
    /// The ONNX Runtime library or an execution provider is not available.
    Runtime,
    /// A buffer of the caller has the wrong size or type.
    Buffer,
    /// A network could not run, or its self-test failed.
    Inference,
}
