//! What can go wrong between an owner and its readers.

use std::io;
use std::path::PathBuf;
use std::time::Duration;

use crate::name::CameraName;
use crate::node::Process;
use crate::plan::{Reservation, SHARED_MEMORY_FOLDER, megabytes};
use nunet_types::{Encoding, Topic};

/// Everything that can go wrong in this crate, but for what has its own small type
/// ([`CameraNameError`](crate::CameraNameError), [`UnknownValue`](crate::UnknownValue)).
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum IpcError {
    /// A limit that makes no sense.
    #[error(
        "limit `{limit}` is `{value}`, but expected 1 to {most}\nhint: memory is reserved for each: as few as needed"
    )]
    Limit {
        /// Its name.
        limit: &'static str,
        /// What was asked for.
        value: usize,
        /// The largest allowed.
        most: usize,
    },
    /// The same topic twice in a plan.
    #[error("topic `{topic}` is planned twice")]
    PlannedTwice {
        /// The topic.
        topic: Topic,
    },
    /// The reservation does not fit.
    #[error(
        "the camera needs {reservation} of shared memory, but {SHARED_MEMORY_FOLDER} has {:.1} MB free\n\
         hint: give it more (docker: `--shm-size`, otherwise `mount -o remount,size=256m {SHARED_MEMORY_FOLDER}`), \
         publish fewer topics, a coarser cloud, or allow fewer readers",
        megabytes(*free_bytes)
    )]
    SharedMemoryTooSmall {
        /// What is needed, by topic.
        reservation: Reservation,
        /// What there is.
        free_bytes: u64,
    },
    /// There is no shared memory on this machine.
    #[error("cannot ask {SHARED_MEMORY_FOLDER} for its free space\nhint: mount a tmpfs there")]
    SharedMemoryMissing {
        /// What the system said.
        source: io::Error,
    },
    /// The memory was promised but could not be had: somebody else took it in between.
    #[error(
        "the memory of topic `{topic}` could not be backed by pages\nhint: another program filled {SHARED_MEMORY_FOLDER} at the same moment; see `df -h {SHARED_MEMORY_FOLDER}`"
    )]
    MemoryNotBacked {
        /// The topic.
        topic: Topic,
        /// What the system said.
        source: io::Error,
    },
    /// Somebody else publishes this.
    #[error(
        "camera `{camera}` is already published: topic `{topic}` belongs to {owner}\nhint: stop it, or choose another camera name"
    )]
    AlreadyOwned {
        /// The camera.
        camera: CameraName,
        /// The first topic that is taken.
        topic: Topic,
        /// Who has it.
        owner: Process,
    },
    /// A service of that name belongs to another version of the contract.
    #[error(
        "service `{service}` speaks version `{found}` of the nunet contract, but this program speaks `{expected}`\n\
         hint: run the same version on both sides"
    )]
    ContractVersion {
        /// The service.
        service: String,
        /// Its attribute, or `none`.
        found: String,
        /// Ours.
        expected: u32,
    },
    /// A service was left open by readers of an owner that had other limits.
    #[error(
        "service `{service}` is still open with other limits than asked for\n\
         hint: its readers keep the old one alive; stop them, or ask for the same limits"
    )]
    OtherLimits {
        /// The service.
        service: String,
    },
    /// Nobody published in time.
    #[error(
        "no `{service}` after {} s\nhint: is the owner of the camera running, under this name and as a user who shares memory with this one?",
        timeout.as_secs_f64()
    )]
    NobodyPublishes {
        /// The service that is missing.
        service: String,
        /// How long it was waited for.
        timeout: Duration,
    },
    /// There are as many readers as the owner allows.
    #[error(
        "topic `{topic}` of camera `{camera}` has no room for another reader: all {limit} places are taken\n\
         hint: stop one, or let the owner allow more: `nunetd --readers N`"
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
    #[error(
        "camera `{camera}` has no room for another listener: all {limit} places are taken\nhint: stop a reader"
    )]
    TooManyListeners {
        /// The camera.
        camera: CameraName,
        /// How many may listen.
        limit: usize,
    },
    /// A reader keeps more frames than it may.
    #[error(
        "this reader already holds {limit} frames of topic `{topic}`, as many as it may\n\
         hint: drop a frame before taking the next one, or copy what must live longer"
    )]
    TooManyFramesHeld {
        /// The topic.
        topic: Topic,
        /// How many may be held.
        limit: usize,
    },
    /// An owner fills more frames than it may.
    #[error(
        "no free chunk of topic `{topic}`\nhint: publish or drop a loan first; at most {limit} may be open at a time"
    )]
    TooManyLoans {
        /// The topic.
        topic: Topic,
        /// How many may be filled.
        limit: usize,
    },
    /// The topic is not among those planned or opened.
    #[error(
        "topic `{topic}` is not one of this camera's: {}\nhint: open it with `{topic}` among its topics",
        list(has)
    )]
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
        /// What there is room for.
        planned: usize,
    },
    /// A payload cannot be looked at in this way.
    #[error("a payload of {payload_bytes} bytes is no slice of `{element}` ({element_bytes} bytes each)")]
    WrongElement {
        /// The type asked for.
        element: &'static str,
        /// Its size.
        element_bytes: usize,
        /// The payload's.
        payload_bytes: usize,
    },
    /// A view of something else than what is there.
    #[error("the payload is `{found}`, not `{expected}`\nhint: the header's `encoding` tells how to read it")]
    WrongEncoding {
        /// What was asked for.
        expected: Encoding,
        /// What is there.
        found: String,
    },
    /// A header that contradicts its payload.
    #[error(
        "a message of topic `{topic}` contradicts itself: {detail}\nhint: the sender does not keep to the contract"
    )]
    BadMessage {
        /// The topic.
        topic: Topic,
        /// What is wrong.
        detail: String,
    },
    /// Another owner has been creating its services for too long.
    #[error("cannot lock `{}` to create services\nhint: another owner seems to hang there; see `fuser {}`", folder.display(), folder.display())]
    Locked {
        /// iceoryx2's folder of services.
        folder: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// Something that a killed process left behind could not be removed.
    #[error("cannot remove `{}`, which a killed process left behind", path.display())]
    Remove {
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: io::Error,
    },
    /// No group of that name.
    #[error(
        "there is no group `{group}` in `/etc/group`\nhint: `groupadd {group}`, or give a group by its number"
    )]
    UnknownGroup {
        /// What was asked for.
        group: String,
    },
    /// A mode that does not do what it says.
    #[error(
        "payload cannot have mode 0{mode:o}; expected 0640 or 0660\n\
         hint: 0640 lets the group read, 0660 lets it write as well; others join the group"
    )]
    AccessMode {
        /// What was asked for.
        mode: u32,
    },
    /// A file cannot be given to a group.
    #[error(
        "cannot give `{path}` to group {gid}\n\
         hint: the user must be a member of the group (`usermod -aG {gid} USER`, then log in again)"
    )]
    Access {
        /// The file.
        path: PathBuf,
        /// The group.
        gid: u32,
        /// Why not.
        source: io::Error,
    },
    /// iceoryx2's folder belongs to somebody who has not opened it.
    #[error(
        "`{folder}` belongs to user {uid}, who has not opened it to group {gid}\n\
         hint: start nunetd first, or remove the folder if nobody uses it"
    )]
    FolderOfOthers {
        /// The folder.
        folder: PathBuf,
        /// Its owner.
        uid: u32,
        /// The group.
        gid: u32,
    },
    /// Somebody opened payload to everybody.
    #[error(
        "everybody may write `{path}`, whose mode is {mode:o}\nhint: chmod o-w {path}, or restart its owner"
    )]
    PayloadOpen {
        /// The file.
        path: PathBuf,
        /// Its mode.
        mode: u32,
    },
    /// This user is neither the owner of iceoryx2's folder nor in its group.
    #[error(
        "this user may not use `{folder}`: it belongs to user {uid} and group {group}\n\
         hint: run as that user, or join a group that was let in (`nunetd --access-group GROUP`, `usermod -aG GROUP USER`, \
         then log in again)"
    )]
    NoAccess {
        /// The folder.
        folder: PathBuf,
        /// Its owner.
        uid: u32,
        /// Its group.
        group: String,
    },
    /// This process cannot take part in shared memory at all.
    #[error(
        "cannot join iceoryx2: it says `{cause}`\n\
         hint: its files belong to whoever made them: run as the same user, see that `/dev/shm` and `/tmp/iceoryx2` \
         are writable, and remove `/tmp/iceoryx2` if nobody uses it"
    )]
    CannotJoin {
        /// iceoryx2's word for the reason.
        cause: String,
    },
    /// iceoryx2 could not do it.
    #[error("cannot {action}: iceoryx2 says `{cause}`")]
    Iceoryx {
        /// What was tried.
        action: String,
        /// Its word for the reason.
        cause: String,
    },
}

fn list(topics: &[Topic]) -> String {
    topics.iter().map(|topic| format!("`{topic}`")).collect::<Vec<_>>().join(", ")
}

impl IpcError {
    /// Wraps an error of iceoryx2, whose types do not leave this crate.
    pub(crate) fn iceoryx(action: impl Into<String>, cause: impl std::fmt::Debug) -> Self {
        Self::Iceoryx { action: action.into(), cause: format!("{cause:?}") }
    }
}
