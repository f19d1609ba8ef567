//! Errors by what a program can do about them.

use super::IpcError;
use crate::name::CameraNameError;

/// What kind of failure an [`IpcError`] is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum IpcErrorKind {
    /// An argument out of range.
    Argument,
    /// Shared memory is missing or too small.
    SharedMemory,
    /// Another process publishes this camera.
    AlreadyPublished,
    /// The other side uses another version of the contract.
    ContractVersion,
    /// Readers keep a service open that was created with other limits.
    OtherLimits,
    /// No publisher appeared in time.
    NobodyPublishes,
    /// All places for readers are taken.
    TooManyReaders,
    /// This reader holds as many frames as it may.
    TooManyFramesHeld,
    /// This publisher has as many open loans as it may.
    TooManyLoans,
    /// The topic was not opened.
    NoSuchTopic,
    /// The payload has another encoding than asked for.
    WrongEncoding,
    /// The header of a message contradicts its payload.
    BadMessage,
    /// Users, groups and modes do not allow it.
    Access,
    /// The system or iceoryx2 failed.
    System,
}

impl CameraNameError {
    /// [`IpcErrorKind::Argument`].
    #[must_use]
    pub fn kind(&self) -> IpcErrorKind {
        IpcErrorKind::Argument
    }
}

impl IpcError {
    /// What kind of failure it is.
    #[must_use]
    pub fn kind(&self) -> IpcErrorKind {
        use IpcErrorKind as Kind;
        match self {
            Self::Limit { .. }
            | Self::CaptureTime { .. }
            | Self::Attitude { .. }
            | Self::PlannedTwice { .. }
            | Self::Root { .. }
            | Self::PayloadTooLarge { .. }
            | Self::WrongElement { .. }
            | Self::UnknownGroup { .. }
            | Self::AccessMode { .. } => Kind::Argument,
            Self::SharedMemoryTooSmall { .. }
            | Self::SharedMemoryMissing { .. }
            | Self::MemoryNotBacked { .. } => Kind::SharedMemory,
            Self::AlreadyPublished { .. } => Kind::AlreadyPublished,
            Self::ContractVersion { .. } => Kind::ContractVersion,
            Self::OtherLimits { .. } => Kind::OtherLimits,
            Self::NobodyPublishes { .. } => Kind::NobodyPublishes,
            Self::TooManyReaders { .. } | Self::TooManyListeners { .. } => Kind::TooManyReaders,
            Self::TooManyFramesHeld { .. } => Kind::TooManyFramesHeld,
            Self::TooManyLoans { .. } => Kind::TooManyLoans,
            Self::NoSuchTopic { .. } => Kind::NoSuchTopic,
            Self::WrongEncoding { .. } => Kind::WrongEncoding,
            Self::BadMessage { .. } => Kind::BadMessage,
            Self::Access { .. }
            | Self::FolderOfOthers { .. }
            | Self::PayloadOpen { .. }
            | Self::NoAccess { .. }
            | Self::FolderClosed { .. } => Kind::Access,
            Self::Locked { .. } | Self::Remove { .. } | Self::CannotJoin { .. } | Self::Iceoryx { .. } => {
                Kind::System
            }
        }
    }
}
