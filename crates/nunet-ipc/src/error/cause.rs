//! iceoryx2's failures in plain words.
//!
//! iceoryx2 names a failure by a variant such as `InsufficientPermissions` and keeps the system's reason in
//! its log. So the variant decides what failed, and the folders that iceoryx2 uses are looked at to find out
//! why.

use std::fmt;
use std::fs::{create_dir, metadata, read_dir, remove_dir};
use std::io;
use std::os::unix::fs::MetadataExt as _;
use std::path::{Path, PathBuf};

use rustix::fs::{StatVfsMountFlags, statvfs};
use rustix::io::Errno;
use rustix::process::{Resource, geteuid, getrlimit};

use super::folder::{PERMISSIONS, closed, hint_for_closed, is_closed_by_mode, no_access};
use crate::plan::SHARED_MEMORY_FOLDER;

/// Why iceoryx2 failed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct IceoryxCause {
    problem: Problem,
    /// The folder of iceoryx2's files.
    root: PathBuf,
    /// iceoryx2's own name of the failure, which `Debug` shows.
    variant: String,
}

#[derive(Debug, Clone, PartialEq, Eq)]
enum Problem {
    /// A folder is on a file system that is mounted read-only.
    ReadOnly(PathBuf),
    /// A folder has no space left for a small file.
    Full(PathBuf),
    /// Nothing can be created in a folder.
    NoAccess { folder: PathBuf, uid: u32 },
    /// A folder belongs to this user, but its mode closes it.
    Closed { folder: PathBuf, mode: u32 },
    /// The process has as many files open as it may.
    TooManyFiles,
    /// The process may write files of so many bytes at most.
    SmallFiles(u64),
    /// Access was denied, but to which file is unknown.
    Denied,
    /// Files were written by another version of nunet or iceoryx2.
    OtherVersion,
    /// Files contradict each other.
    Damaged,
    /// Another process creates or removes the same files.
    Busy,
    /// All places for processes, readers or publishers are taken.
    NoPlace,
    /// Files or memory cannot be created.
    NotCreated,
    /// The memory of the other side cannot be opened.
    NotMapped,
    /// A signal.
    Interrupted,
    /// A failure of iceoryx2 that says no more.
    Internal,
}

impl IceoryxCause {
    /// From an error of iceoryx2, whose variant is the innermost name of its debug text.
    pub(crate) fn new(error: &dyn fmt::Debug, root: PathBuf) -> Self {
        let text = format!("{error:?}");
        let innermost = text.trim_end_matches(')').rsplit('(').next().unwrap_or_default();
        let problem = Problem::of(innermost);
        let problem =
            if problem.may_be_the_machine() { on_this_machine(&root).unwrap_or(problem) } else { problem };
        Self { problem, root, variant: text }
    }

    /// What a user can do about it.
    pub(crate) fn hint(&self) -> String {
        let root = self.root.display();
        match &self.problem {
            Problem::ReadOnly(folder) => format!(
                "remount `{}` so that it can be written, or set NUNET_IPC_ROOT to a folder that can",
                folder.display()
            ),
            Problem::Full(folder) => {
                format!("free some space; `df -h -i {}` shows what is left", folder.display())
            }
            Problem::NoAccess { .. } => {
                "set NUNET_IPC_ROOT to a folder that this user may write, or run as that user".to_owned()
            }
            Problem::Closed { folder, .. } => hint_for_closed(folder),
            Problem::TooManyFiles => "raise the limit with `ulimit -n 1024`".to_owned(),
            Problem::SmallFiles(_) => "raise the limit with `ulimit -f unlimited`".to_owned(),
            Problem::Denied => format!(
                "run as the user who created the files in `{root}` and {SHARED_MEMORY_FOLDER}, or join the group that \
                 they are shared with"
            ),
            Problem::OtherVersion => {
                "run the same version of nunet and iceoryx2 in all processes, or set NUNET_IPC_ROOT to a folder of its \
                 own for each version"
                    .to_owned()
            }
            Problem::Damaged => {
                format!("stop every program that uses iceoryx2, then remove `{root}` and start again")
            }
            Problem::Busy => "try again in a moment; if it stays, stop the other process".to_owned(),
            Problem::NoPlace => "stop a reader or a publisher of this camera".to_owned(),
            Problem::NotCreated | Problem::NotMapped => format!(
                "check that `{root}` and {SHARED_MEMORY_FOLDER} can be written and have space, and the limits of this \
                 process (`ulimit -a`)"
            ),
            Problem::Interrupted => "start it again".to_owned(),
            Problem::Internal => {
                "set IOX2_LOG_LEVEL=debug to see the log of iceoryx2, which has the details".to_owned()
            }
        }
    }
}

impl fmt::Display for IceoryxCause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match &self.problem {
            Problem::ReadOnly(folder) => write!(f, "`{}` is on a read-only file system", folder.display()),
            Problem::Full(folder) => write!(f, "`{}` is full", folder.display()),
            Problem::NoAccess { folder, uid } => f.write_str(&no_access(folder, *uid)),
            Problem::Closed { folder, mode } => f.write_str(&closed(folder, *mode)),
            Problem::TooManyFiles => f.write_str("this process has as many files open as it may"),
            Problem::SmallFiles(bytes) => write!(f, "this process may write files of at most {bytes} bytes"),
            Problem::Denied => f.write_str("access to a file of another user was denied"),
            Problem::OtherVersion => f.write_str("another version of nunet or iceoryx2 wrote its files"),
            Problem::Damaged => f.write_str("its files are damaged"),
            Problem::Busy => f.write_str("another process is creating or removing it"),
            Problem::NoPlace => f.write_str("all its places are taken"),
            Problem::NotCreated => f.write_str("its files or its memory cannot be created"),
            Problem::NotMapped => f.write_str("the memory of the other process cannot be opened"),
            Problem::Interrupted => f.write_str("a signal interrupted it"),
            Problem::Internal => f.write_str("iceoryx2 failed without a reason"),
        }
    }
}

impl Problem {
    /// From the name of a variant in iceoryx2's error types. Names that are not known are internal failures.
    fn of(variant: &str) -> Self {
        let begins = |starts: &[&str]| starts.iter().any(|start| variant.starts_with(start));
        match variant {
            "InsufficientPermissions" => Self::Denied,
            "VersionMismatch" | "InvalidTypeDefinition" | "DoesNotSupportRequestedMaxEventId" => {
                Self::OtherVersion
            }
            "ServiceInCorruptedState"
            | "ServiceInInconsistentState"
            | "SystemCorrupted"
            | "ConnectionCorrupted"
            | "DoesNotExist" => Self::Damaged,
            "HangsInCreation"
            | "IsBeingCreatedByAnotherInstance"
            | "SystemInFlux"
            | "IsMarkedForDestruction"
            | "AlreadyExists"
            | "AnotherInstanceIsCleaningUpTheNode" => Self::Busy,
            "OutOfMemory"
            | "InsufficientResources"
            | "ResourceCreationFailed"
            | "ServiceConfigCouldNotBeCreated" => Self::NotCreated,
            "UnableToMapSendersDataSegment" | "FailedToEstablishConnection" => Self::NotMapped,
            "Interrupt" | "TerminationRequest" => Self::Interrupted,
            _ if begins(&["Incompatible"]) => Self::OtherVersion,
            _ if begins(&["FailedToOpenStatic", "FailedToReadStatic", "FailedToDeserialize"]) => {
                Self::Damaged
            }
            _ if begins(&["ExceedsMax", "DoesNotSupportRequested"]) => Self::NoPlace,
            _ if begins(&["UnableToCreate", "UnableToGenerate"]) => Self::NotCreated,
            _ => Self::Internal,
        }
    }

    /// Whether the state of this machine may explain it better than iceoryx2 does.
    fn may_be_the_machine(&self) -> bool {
        matches!(self, Self::Denied | Self::NotCreated | Self::NotMapped | Self::Internal | Self::Damaged)
    }
}

/// What is wrong with the folders and limits that iceoryx2 needs, if anything is.
fn on_this_machine(root: &Path) -> Option<Problem> {
    if has_too_many_files() {
        return Some(Problem::TooManyFiles);
    }
    if let Some(problem) = small_files(getrlimit(Resource::Fsize).current) {
        return Some(problem);
    }
    [root, Path::new(SHARED_MEMORY_FOLDER)].into_iter().find_map(problem_of)
}

/// A limit of the size of files that the memory of a camera exceeds.
fn small_files(limit: Option<u64>) -> Option<Problem> {
    /// The memory that a camera of 640x480 is promised to fit in.
    const CAMERA_BYTES: u64 = 64 << 20;
    limit.filter(|&limit| limit < CAMERA_BYTES).map(Problem::SmallFiles)
}

/// Whether this process is close to its limit of open files: iceoryx2 opens several at once and closes them
/// if one fails.
fn has_too_many_files() -> bool {
    const AT_ONCE: u64 = 10;
    let open = match read_dir("/proc/self/fd") {
        Ok(files) => files.count() as u64,
        Err(error) => return error.raw_os_error() == Some(Errno::MFILE.raw_os_error()),
    };
    let limit = getrlimit(Resource::Nofile).current.unwrap_or(u64::MAX);
    open.saturating_add(AT_ONCE) > limit
}

/// What is wrong with a folder, or with the folder in which it would have to be created.
fn problem_of(folder: &Path) -> Option<Problem> {
    /// A file system with less than this has no space for the few small files that iceoryx2 writes.
    const SMALL_FILES_BYTES: u64 = 64 << 10;
    let folder = folder.ancestors().find(|folder| folder.exists())?;
    let system = statvfs(folder).ok()?;
    if system.f_flag.contains(StatVfsMountFlags::RDONLY) {
        return Some(Problem::ReadOnly(folder.to_owned()));
    }
    // File systems without a limit, such as `/proc`, say that they have 0 of 0.
    let no_bytes = system.f_blocks > 0 && system.f_bavail * system.f_frsize < SMALL_FILES_BYTES;
    let no_files = system.f_files > 0 && system.f_favail == 0;
    if no_bytes || no_files {
        return Some(Problem::Full(folder.to_owned()));
    }
    // Not asked but tried: some file systems refuse what their permissions allow.
    let probe = folder.join(format!("nunet-{}", std::process::id()));
    let found = metadata(folder).ok()?;
    match create_dir(&probe) {
        Ok(()) => {
            let _ = remove_dir(&probe); // an empty folder that stays does no harm
            None
        }
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => None,
        Err(_) => Some(refused(folder.to_owned(), found.uid(), found.mode())),
    }
}

/// Why this user can create nothing in a folder of `uid`.
fn refused(folder: PathBuf, uid: u32, mode: u32) -> Problem {
    if is_closed_by_mode(uid, mode, geteuid()) {
        Problem::Closed { folder, mode: mode & PERMISSIONS }
    } else {
        Problem::NoAccess { folder, uid }
    }
}

#[cfg(test)]
mod tests {
    use iceoryx2::node::NodeCreationFailure;
    use iceoryx2::port::LoanError;
    use iceoryx2::port::publisher::PublisherCreateError;
    use iceoryx2::service::builder::event::{EventCreateError, EventOpenError, EventOpenOrCreateError};

    use nunet_types::Hint as _;
    use rustix::process::Uid;

    use super::*;
    use crate::error::IpcError;

    /// Names of another program's types are not words: `EventCreateError`.
    fn has_a_type_name(text: &str) -> bool {
        let is_camel =
            |word: &str| word.chars().skip(1).any(char::is_uppercase) && word.chars().any(char::is_lowercase);
        text.split(|c: char| !c.is_alphanumeric()).any(is_camel)
    }

    #[test]
    fn the_innermost_variant_decides_and_no_name_of_a_type_is_shown() {
        let created =
            |error| Box::new(EventOpenOrCreateError::EventCreateError(error)) as Box<dyn fmt::Debug>;
        let opened = |error| Box::new(EventOpenOrCreateError::EventOpenError(error)) as Box<dyn fmt::Debug>;
        let errors: [(Box<dyn fmt::Debug>, &str, Problem); 9] = [
            (created(EventCreateError::InsufficientPermissions), "InsufficientPermissions", Problem::Denied),
            (
                created(EventCreateError::ServiceConfigCouldNotBeCreated),
                "ServiceConfigCouldNotBeCreated",
                Problem::NotCreated,
            ),
            (opened(EventOpenError::VersionMismatch), "VersionMismatch", Problem::OtherVersion),
            (opened(EventOpenError::ExceedsMaxNumberOfNodes), "ExceedsMaxNumberOfNodes", Problem::NoPlace),
            (opened(EventOpenError::ServiceInCorruptedState), "ServiceInCorruptedState", Problem::Damaged),
            (Box::new(EventOpenOrCreateError::SystemInFlux), "SystemInFlux", Problem::Busy),
            (Box::new(LoanError::OutOfMemory), "OutOfMemory", Problem::NotCreated),
            (
                Box::new(PublisherCreateError::UnableToCreateDataSegment),
                "UnableToCreateDataSegment",
                Problem::NotCreated,
            ),
            (Box::new(NodeCreationFailure::InternalError), "InternalError", Problem::Internal),
        ];
        let root = std::env::temp_dir();
        for (error, variant, expected) in errors {
            assert_eq!(Problem::of(variant), expected, "{variant}");
            // A machine whose `/dev/shm` is full or closed explains some of them otherwise.
            let machine = expected.may_be_the_machine().then(|| on_this_machine(&root)).flatten();
            let cause = IceoryxCause::new(&*error, root.clone());
            assert_eq!(cause.problem, machine.unwrap_or(expected), "{variant}");
            assert!(!has_a_type_name(&cause.to_string()), "{cause}");
            let hint = cause.hint();
            assert!(!hint.is_empty() && !hint.ends_with('.'), "{hint}");
        }
        assert!(has_a_type_name("EventOpenError(InternalFailure)"));
        assert_eq!(Problem::of("a name of a later version"), Problem::Internal);
    }

    #[test]
    fn a_folder_that_its_own_mode_closes_is_not_blamed_on_another_user() {
        let user = Uid::from_raw(1000);
        for mode in [0o040_000, 0o040_077, 0o041_500, 0o040_600] {
            assert!(is_closed_by_mode(1000, mode, user), "{mode:o}");
            assert!(!is_closed_by_mode(1001, mode, user), "{mode:o}");
            assert!(!is_closed_by_mode(0, mode, Uid::ROOT), "{mode:o}");
        }
        assert!(!is_closed_by_mode(1000, 0o040_700, user));
    }

    #[test]
    fn a_folder_is_refused_with_one_text_before_iceoryx2_is_asked_and_after() {
        let folder = PathBuf::from("/tmp/robot");
        let cause = |problem| IceoryxCause { problem, root: folder.clone(), variant: String::new() };
        let closed = cause(Problem::Closed { folder: folder.clone(), mode: 0 });
        let error = IpcError::FolderClosed { folder: folder.clone(), mode: 0 };
        let hint = closed.hint();
        assert_eq!(closed.to_string(), error.to_string());
        assert_eq!(Some(hint.as_str()), error.hint().as_deref());
        assert!(hint.contains("chmod u+rwx /tmp/robot") && hint.contains("umask"));
        let refused = cause(Problem::NoAccess { folder: folder.clone(), uid: 7 });
        let error = IpcError::NoAccess { folder: folder.clone(), uid: 7, group: "5".to_owned() };
        assert_eq!(format!("{refused} and group 5"), error.to_string());
    }

    #[test]
    fn only_a_small_limit_of_the_size_of_files_is_a_problem() {
        assert_eq!(small_files(Some(1024)), Some(Problem::SmallFiles(1024)));
        assert_eq!((small_files(None), small_files(Some(1 << 30))), (None, None));
    }

    #[test]
    fn a_folder_that_cannot_be_created_is_explained_by_the_one_that_holds_it() {
        let folder = tempfile::tempdir().unwrap();
        assert_eq!(problem_of(&folder.path().join("a/b")), None);
        // It is read-only, or refuses new folders to every user.
        let problem = problem_of(Path::new("/sys/nunet"));
        assert!(matches!(problem, Some(Problem::ReadOnly(_) | Problem::NoAccess { .. })), "{problem:?}");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 0, "the probe is removed");
    }
}
