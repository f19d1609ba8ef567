//! The errors of publishers and readers.

mod cause;
mod folder;
mod hint;
mod kind;

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use nunet_types::{Encoding, Topic, counted};

use crate::name::CameraName;
use crate::plan::{Reservation, SHARED_MEMORY_FOLDER, megabytes};
use crate::process::Process;

pub use cause::IceoryxCause;
pub(crate) use folder::{PERMISSIONS, is_closed_by_mode};
pub use kind::IpcErrorKind;

/// The errors of this crate, except those with a type of their own
/// ([`CameraNameError`](crate::CameraNameError), [`UnknownValue`](crate::UnknownValue)).
///
/// The text says what failed; [`kind`](Self::kind) is for programs; [`Hint`](nunet_types::Hint) says what to
/// do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IpcError {
    /// A limit out of range.
    #[error("limit `{limit}` is `{value}`, expected 1 to {most}")]
    Limit {
        /// Its name.
        limit: &'static str,
        /// What was asked for.
        value: usize,
        /// The largest allowed.
        most: usize,
    },
    /// A capture time before the zero of its clock.
    #[error("topic `{topic}`: `capture_nanos` is `{nanos}`, expected 0 or more")]
    CaptureTime {
        /// The topic of the message.
        topic: Topic,
        /// The time, nanoseconds.
        nanos: i64,
    },
    /// An angle that is not a number, or beyond a turn.
    #[error("attitude: {angle} is {value}, expected -2π to 2π")]
    Attitude {
        /// Which one.
        angle: &'static str,
        /// Its value.
        value: f32,
    },
    /// The same topic twice in a plan.
    #[error("topic `{topic}` is planned twice")]
    PlannedTwice {
        /// The topic.
        topic: Topic,
    },
    /// The folder for iceoryx2's files cannot be used.
    #[error("cannot use `{}` as the root of shared memory: {reason}", root.display())]
    Root {
        /// The folder that was asked for.
        root: PathBuf,
        /// Why not.
        reason: &'static str,
    },
    /// The reservation does not fit.
    #[error(
        "the camera needs {reservation} of shared memory, but {SHARED_MEMORY_FOLDER} has {:.1} MB free",
        megabytes(*free_bytes)
    )]
    SharedMemoryTooSmall {
        /// What is needed, by topic.
        reservation: Reservation,
        /// What is free.
        free_bytes: u64,
    },
    /// There is no shared memory on this machine.
    #[error("cannot read the free space of {SHARED_MEMORY_FOLDER}")]
    SharedMemoryMissing {
        /// The system's reason.
        source: io::Error,
    },
    /// The memory was free when it was checked, but another program took it.
    #[error("cannot back the memory of topic `{topic}` with pages")]
    MemoryNotBacked {
        /// The topic.
        topic: Topic,
        /// The system's reason.
        source: io::Error,
    },
    /// Another process publishes this.
    #[error("camera `{camera}` is already published: topic `{topic}` belongs to {publisher}")]
    AlreadyPublished {
        /// The camera.
        camera: CameraName,
        /// The first topic that is taken.
        topic: Topic,
        /// Its publisher.
        publisher: Process,
    },
    /// A service of that name belongs to another version of the contract.
    #[error(
        "service `{service}` speaks version `{found}` of the nunet contract, but this program speaks `{expected}`"
    )]
    ContractVersion {
        /// The service.
        service: String,
        /// Its attribute, or `none`.
        found: String,
        /// Ours.
        expected: u32,
    },
    /// Readers keep a service open that was created with other limits.
    #[error("service `{service}` is still open with other limits than requested")]
    OtherLimits {
        /// The service.
        service: String,
    },
    /// No publisher appeared in time.
    #[error("no `{service}` after {} s", timeout.as_secs_f64())]
    NobodyPublishes {
        /// The service that is missing.
        service: String,
        /// How long the reader waited.
        timeout: Duration,
    },
    /// There are as many readers as the publisher allows.
    #[error(
        "topic `{topic}` of camera `{camera}` has no room for another reader: it may have {}",
        counted(*limit, "reader")
    )]
    TooManyReaders {
        /// The camera.
        camera: CameraName,
        /// The topic.
        topic: Topic,
        /// How many may read.
        limit: usize,
    },
    /// As many listeners as the camera's event service has room for.
    #[error("camera `{camera}` has no room for another listener: it may have {}", counted(*limit, "listener"))]
    TooManyListeners {
        /// The camera.
        camera: CameraName,
        /// How many may listen.
        limit: usize,
    },
    /// A reader holds as many frames as it may.
    #[error("this reader already holds {} of topic `{topic}`, which is its limit", counted(*limit, "frame"))]
    TooManyFramesHeld {
        /// The topic.
        topic: Topic,
        /// How many may be held.
        limit: usize,
    },
    /// A publisher has as many open loans as it may.
    #[error("no free chunk of topic `{topic}`: at most {} may be open at a time", counted(*limit, "loan"))]
    TooManyLoans {
        /// The topic.
        topic: Topic,
        /// How many may be open.
        limit: usize,
    },
    /// The topic is not among those planned or opened.
    #[error("topic `{topic}` was not opened, only {}", list(has))]
    NoSuchTopic {
        /// The topic asked for.
        topic: Topic,
        /// Those there are.
        has: Vec<Topic>,
    },
    /// More bytes than planned.
    #[error(
        "a payload of `{payload_bytes}` bytes does not fit into topic `{topic}`, which was planned for {planned}"
    )]
    PayloadTooLarge {
        /// The topic.
        topic: Topic,
        /// What was asked for.
        payload_bytes: usize,
        /// The largest value that fits.
        planned: usize,
    },
    /// A payload is not a whole number of elements.
    #[error("a payload of {payload_bytes} bytes is not a slice of `{element}` ({element_bytes} bytes each)")]
    WrongElement {
        /// The type asked for.
        element: &'static str,
        /// Its size.
        element_bytes: usize,
        /// The payload's.
        payload_bytes: usize,
    },
    /// The payload has another encoding than asked for.
    #[error("the payload is `{found}`, not `{expected}`")]
    WrongEncoding {
        /// What was asked for.
        expected: Encoding,
        /// What is there.
        found: String,
    },
    /// A header that contradicts its payload.
    #[error("a message of topic `{topic}` contradicts itself: {detail}")]
    BadMessage {
        /// The topic.
        topic: Topic,
        /// What is wrong.
        detail: String,
    },
    /// Another publisher has been creating its services for too long.
    #[error("cannot lock `{}` to create services", folder.display())]
    Locked {
        /// iceoryx2's folder.
        folder: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// A file that a killed process left behind cannot be removed.
    #[error("cannot remove `{}`, which a killed process left behind", path.display())]
    Remove {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: io::Error,
    },
    /// No group of that name.
    #[error("there is no group `{group}` in `/etc/group`")]
    UnknownGroup {
        /// What was asked for.
        group: String,
    },
    /// A mode that cannot be granted.
    #[error("payload cannot have mode 0{mode:o}, expected 0640 or 0660")]
    AccessMode {
        /// What was asked for.
        mode: u32,
    },
    /// A file cannot be given to a group.
    #[error("cannot give `{path}` to group {gid}")]
    Access {
        /// The file.
        path: PathBuf,
        /// The group.
        gid: u32,
        /// The system's reason.
        source: io::Error,
    },
    /// iceoryx2's folder belongs to another user, who has not shared it with the group.
    #[error("`{folder}` belongs to user {uid}, who has not opened it to group {gid}")]
    FolderOfOthers {
        /// The folder.
        folder: PathBuf,
        /// Its owner.
        uid: u32,
        /// The group.
        gid: u32,
    },
    /// Every user may write payload.
    #[error("every user may write `{path}`, whose mode is {mode:o}")]
    PayloadOpen {
        /// The file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// This user is neither the owner of iceoryx2's folder nor in its group.
    #[error("{} and group {group}", folder::no_access(folder, *uid))]
    NoAccess {
        /// The folder.
        folder: PathBuf,
        /// Its owner.
        uid: u32,
        /// Its group.
        group: String,
    },
    /// iceoryx2's folder belongs to this user, but its mode closes it.
    #[error("{}", folder::closed(folder, *mode))]
    FolderClosed {
        /// The folder.
        folder: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// This process cannot use shared memory at all.
    #[error("cannot use shared memory with the folder `{}`: {cause}", root.display())]
    CannotJoin {
        /// iceoryx2's folder.
        root: PathBuf,
        /// Why.
        cause: IceoryxCause,
    },
    /// iceoryx2 failed.
    #[error("cannot {action}: {cause}")]
    Iceoryx {
        /// What was tried.
        action: String,
        /// Why.
        cause: IceoryxCause,
    },
}

fn list(topics: &[Topic]) -> String {
    topics.iter().map(|topic| format!("`{topic}`")).collect::<Vec<_>>().join(", ")
}
