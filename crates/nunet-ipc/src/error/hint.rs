//! What a user can do about each error.

use std::borrow::Cow;

use nunet_types::Hint;

use super::IpcError;
use super::folder::hint_for_closed;
use crate::plan::SHARED_MEMORY_FOLDER;

impl Hint for IpcError {
    fn hint(&self) -> Option<Cow<'static, str>> {
        self.fixed_hint().map(Cow::Borrowed).or_else(|| self.specific_hint().map(Cow::Owned))
    }
}

impl IpcError {
    /// Hints that do not depend on the values of the error.
    fn fixed_hint(&self) -> Option<&'static str> {
        Some(match self {
            Self::Limit { .. } => "memory is reserved for each one, so allow as few as you need",
            Self::CaptureTime { .. } => "if the capture time is unknown, give the current time of the clock",
            Self::Attitude { .. } => "give angles in radians: 90 degrees are 1.571",
            Self::Root { .. } => {
                "set NUNET_IPC_ROOT to an absolute path of at most 40 bytes, such as /tmp/robot"
            }
            Self::SharedMemoryMissing { .. } => "mount a tmpfs there",
            Self::AlreadyPublished { .. } => "stop it, or choose another camera name",
            Self::ContractVersion { .. } => "run the same version on both sides",
            Self::OtherLimits { .. } => {
                "readers of the previous publisher keep it open; stop them, or request the same limits"
            }
            Self::NobodyPublishes { .. } => {
                "check that the camera's publisher runs under this name, and as a user who shares memory with this one"
            }
            Self::TooManyReaders { .. } => "stop a reader, or let the publisher allow more readers",
            Self::TooManyListeners { .. } => "stop a reader",
            Self::TooManyFramesHeld { .. } => {
                "drop a frame before you take the next one, or copy what must live longer"
            }
            Self::TooManyLoans { .. } => "publish or drop a loan first",
            Self::WrongEncoding { .. } => "read the header's `encoding` to see how to read the payload",
            Self::BadMessage { .. } => "the sender does not follow the contract; update or report it",
            Self::AccessMode { .. } => {
                "use 0640 to let the group read, or 0660 to let it write as well; other users must join the group"
            }
            Self::FolderOfOthers { .. } => "start nunetd first, or remove the folder if no process uses it",
            _ => return None,
        })
    }

    /// Hints that name a file, a group or a topic.
    fn specific_hint(&self) -> Option<String> {
        Some(match self {
            Self::SharedMemoryTooSmall { .. } => format!(
                "enlarge it (docker: `--shm-size`, otherwise `mount -o remount,size=256m {SHARED_MEMORY_FOLDER}`), \
                 publish fewer topics or a coarser cloud, or allow fewer readers"
            ),
            Self::MemoryNotBacked { .. } => format!(
                "another program filled {SHARED_MEMORY_FOLDER} at the same moment; see `df -h {SHARED_MEMORY_FOLDER}`"
            ),
            Self::NoSuchTopic { topic, .. } => format!("open it with `{topic}` among its topics"),
            Self::Locked { folder, .. } => {
                format!("another publisher seems to hang; find it with `fuser {}`", folder.display())
            }
            Self::UnknownGroup { group } => {
                format!("create it with `groupadd {group}`, or pass a group by its number")
            }
            Self::Access { gid, .. } => {
                format!("make the user a member of the group (`usermod -aG {gid} USER`), then log in again")
            }
            Self::PayloadOpen { path, .. } => {
                format!("run `chmod o-w {}`, or restart its publisher", path.display())
            }
            Self::NoAccess { uid, .. } => format!(
                "run as user {uid}, or join a group that the publisher shares its memory with \
                 (`usermod -aG GROUP USER`), then log in again"
            ),
            Self::FolderClosed { folder, .. } => hint_for_closed(folder),
            Self::CannotJoin { cause, .. } | Self::Iceoryx { cause, .. } => cause.hint(),
            _ => return None,
        })
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::Topic;

    use super::*;

    #[test]
    fn a_hint_is_not_part_of_the_text_and_names_no_option_of_a_program() {
        let errors = [
            IpcError::Limit { limit: "max_readers", value: 0, most: 64 },
            IpcError::CaptureTime { topic: Topic::Rgb, nanos: -1 },
            IpcError::SharedMemoryMissing { source: std::io::Error::other("gone") },
            IpcError::UnknownGroup { group: "robots".into() },
            IpcError::iceoryx("publish", "InternalFailure"),
            IpcError::NoAccess { folder: "/tmp/iceoryx2".into(), uid: 7, group: "`robots` (5)".into() },
            IpcError::FolderClosed { folder: "/tmp/iceoryx2".into(), mode: 0 },
        ];
        for error in errors {
            let hint = error.hint().unwrap();
            assert!(!error.to_string().contains("hint") && !error.to_string().contains(&*hint), "{error}");
            assert!(!hint.contains("nunetd --") && !hint.ends_with('.'), "{hint}");
        }
    }
}
