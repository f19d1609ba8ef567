//! Proof that the stages of a graph fit together, before anything runs.

/// Why stages do not fit together.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WiringError {
    /// `every` of 0.
    #[error("stage `{stage}` has `every = 0`\nhint: 1 runs it for each frame, 2 for each second one")]
    EveryZero {
        /// The stage.
        stage: String,
    },
}
