//! What can be wrong with what a model says of itself.

/// What is wrong with a model's description.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum ModelError {
    /// Neither metadata nor sidecar.
    #[error(
        "it has no `nunet.version` in its metadata, and there is no sidecar beside it\nhint: describe a foreign network in `{sidecar}`: [input] tensor, layout, size; [output] depth, encoding"
    )]
    Undescribed {
        /// The name that the sidecar would have.
        sidecar: String,
    },
}
