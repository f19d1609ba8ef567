//! Which other users may read.
//!
//! iceoryx2 creates its files for one user only; its option for more users opens them to every user, for
//! writing too. Here the files are given to a group after they were created: payload may be read, and the
//! bookkeeping of readers and publishers may also be written. A process that arrives in between waits,
//! because iceoryx2 treats a file that it cannot open yet as one that is not finished.
//!
//! A publisher shares with the group of [`share_with`]. A reader follows: if iceoryx2's folder belongs to a
//! group, it gives its own files to that group, because the publisher must write them.

use std::fs::{DirBuilder, File, Metadata, Permissions, metadata, read_dir, read_to_string, set_permissions};
use std::io;
use std::os::fd::AsRawFd as _;
use std::os::unix::fs::{DirBuilderExt as _, FileTypeExt as _, MetadataExt as _, PermissionsExt as _, chown};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nunet_types::counted;
use rustix::fs::{Access as Asked, AtFlags, CWD, Mode, OFlags};
use rustix::io::Errno;

use crate::error::{IpcError, PERMISSIONS, is_closed_by_mode};
use crate::iceoryx::{check_root, config, pid_of, root, shared_memory_prefix};
use crate::plan::SHARED_MEMORY_FOLDER;

/// The list of group names and numbers. Groups of a directory service are not in it; pass those by number.
const GROUPS: &str = "/etc/group";

/// Of folders: each member of the group may create files and remove its own.
const FOLDER_MODE: u32 = 0o1770;
/// Of a folder before it is given to the group.
const OWNER_ALL: u32 = 0o700;
/// The bits of a folder's mode that open it to a group.
const GROUP_ALL: u32 = 0o070;
/// Of files that both sides write: connections, places in services, sockets for wake-ups.
const BOOKS_MODE: u32 = 0o660;
/// Of the files that describe services.
const RECORD_MODE: u32 = 0o440;
/// Of payload by default: the group reads.
const PAYLOAD_MODE: u32 = 0o640;

const OWNER_MAY_READ: u32 = 0o400;
const OWNER_MAY_WRITE: u32 = 0o200;

/// A group that may read what this process publishes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Access {
    gid: u32,
    /// `None`: the mode of payload does not change.
    payload_mode: Option<u32>,
}

static SHARED: OnceLock<Access> = OnceLock::new();

impl Access {
    /// Members of `group`, a name or a number, read payload and cannot write it.
    ///
    /// # Errors
    /// [`IpcError::UnknownGroup`].
    pub fn of_group(group: &str) -> Result<Self, IpcError> {
        let unknown = || IpcError::UnknownGroup { group: group.to_owned() };
        let gid = group.parse().ok().or_else(|| gid_in(&read_to_string(GROUPS).unwrap_or_default(), group));
        Ok(Self { gid: gid.ok_or_else(unknown)?, payload_mode: Some(PAYLOAD_MODE) })
    }

    /// Sets the mode of payload: 0640, or 0660 to let the group write it as well.
    ///
    /// # Errors
    /// [`IpcError::AccessMode`] for any other mode. Other users cannot get read access alone: a reader must
    /// write the bookkeeping.
    pub fn with_mode(self, mode: u32) -> Result<Self, IpcError> {
        match mode {
            0o640 | 0o660 => Ok(Self { payload_mode: Some(mode), ..self }),
            _ => Err(IpcError::AccessMode { mode }),
        }
    }

    /// The group of iceoryx2's folder, if it was opened to one.
    fn of_folder() -> Option<Self> {
        let folder = metadata(root()).ok()?;
        let is_shared = folder.mode() & GROUP_ALL == GROUP_ALL;
        is_shared.then(|| Self { gid: folder.gid(), payload_mode: None })
    }

    /// The mode that a file of this name and mode must get; `None` for files that are not finished or do not
    /// change.
    ///
    /// The files that show whether a process lives are not shared. A process that could see that another
    /// user's process is dead would try to clean up after it. The sticky bit of `/dev/shm` would stop it
    /// halfway, and leave a service that neither works nor can be repaired.
    fn mode_of(self, name: &str, mode: u32) -> Option<u32> {
        let (_, kind) = name.rsplit_once('.')?;
        let is_filled = mode & OWNER_MAY_READ != 0;
        match kind {
            "data" => self.payload_mode.filter(|_| is_filled),
            "connection" | "dynamic" | "event_mgmt" => is_filled.then_some(BOOKS_MODE),
            "event" => Some(BOOKS_MODE),
            "service" => (mode & OWNER_MAY_WRITE == 0).then_some(RECORD_MODE),
            _ => None,
        }
    }

    /// Gives a file of this user to the group; does nothing for files of other users.
    fn give(self, path: &Path) -> Result<(), IpcError> {
        match self.try_give(path) {
            // Its process has ended meanwhile.
            Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(()),
            Err(source) => Err(IpcError::Access { path: path.to_owned(), gid: self.gid, source }),
            Ok(()) => Ok(()),
        }
    }

    /// Uses a descriptor that follows no link: other users can write to the folder and could replace the
    /// name.
    fn try_give(self, path: &Path) -> io::Result<()> {
        let flags = OFlags::PATH | OFlags::NOFOLLOW | OFlags::CLOEXEC;
        let file = File::from(rustix::fs::open(path, flags, Mode::empty())?);
        let found = file.metadata()?;
        let kind = found.file_type();
        if found.uid() != rustix::process::geteuid().as_raw()
            || !(kind.is_file() || kind.is_dir() || kind.is_socket())
        {
            return Ok(());
        }
        let name = path.file_name().map(|name| name.to_string_lossy()).unwrap_or_default();
        let wanted = if kind.is_dir() { Some(FOLDER_MODE) } else { self.mode_of(&name, found.mode()) };
        let Some(mode) = wanted else { return Ok(()) };
        let itself = PathBuf::from(format!("/proc/self/fd/{}", file.as_raw_fd()));
        if found.gid() != self.gid {
            chown(&itself, None, Some(self.gid))?;
        }
        if found.mode() & 0o7777 != mode {
            set_permissions(&itself, Permissions::from_mode(mode))?;
        }
        Ok(())
    }

    /// Creates iceoryx2's folders and opens them to the group. Those of another user must have been opened by
    /// that user.
    fn open_folders(self) -> Result<(), IpcError> {
        for folder in folders() {
            let made = DirBuilder::new().mode(OWNER_ALL).create(&folder);
            let failed = |source| IpcError::Access { path: folder.clone(), gid: self.gid, source };
            match made {
                Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(failed(error)),
                _ => self.give(&folder)?,
            }
            let found = metadata(&folder).map_err(failed)?;
            if found.gid() != self.gid || found.mode() & GROUP_ALL != GROUP_ALL {
                return Err(IpcError::FolderOfOthers { folder, uid: found.uid(), gid: self.gid });
            }
        }
        Ok(())
    }

    /// Gives the files of this process, and those of `services`, to the group.
    fn give_own(self, services: &[u128]) -> Result<(), IpcError> {
        let process = std::process::id();
        let is_own = |name: &str| {
            let mut ids = name.split(['_', '.']).filter_map(|part| part.parse::<u128>().ok());
            ids.any(|id| pid_of(id) == process || services.contains(&id))
        };
        let prefix = shared_memory_prefix();
        let mut all = entries(Path::new(SHARED_MEMORY_FOLDER)).chain(entries(&root()));
        all.try_for_each(
            |(path, name)| {
                if name.starts_with(&prefix) && is_own(&name) { self.give(&path) } else { Ok(()) }
            },
        )
    }
}

/// Lets a group read what this process publishes from now on. Call it before the first publisher or reader; a
/// second call changes nothing.
///
/// # Errors
/// [`IpcError::Access`] where this user may not give files to that group, [`IpcError::FolderOfOthers`].
pub fn share_with(access: Access) -> Result<(), IpcError> {
    access.open_folders()?;
    SHARED.get_or_init(|| access);
    Ok(())
}

/// Checks that this user may use iceoryx2's folder. Returns one line of text.
///
/// # Errors
/// [`IpcError::NoAccess`], [`IpcError::FolderClosed`].
pub fn check_folder() -> Result<String, IpcError> {
    let folder = root();
    let Some(found) = usable_folder()? else { return Ok(format!("`{}` is not there yet", folder.display())) };
    let (mode, shown) = (found.mode() & 0o7777, folder.display());
    Ok(if mode & GROUP_ALL == GROUP_ALL {
        format!("`{shown}` is open to group {} (mode {mode:o})", group_name(found.gid()))
    } else {
        format!("`{shown}` is for user {} alone (mode {mode:o})", found.uid())
    })
}

/// Checks that this user may use iceoryx2's folder, if it is there. For a loop that waits: it makes one
/// system call, unless there is something to report.
///
/// # Errors
/// Those of [`usable_folder`].
pub(crate) fn check_usable() -> Result<(), IpcError> {
    // With a slash at the end, so that a file at its place is an error too.
    match ask_for_folder(&root().join("")) {
        Ok(()) | Err(Errno::NOENT) => Ok(()),
        Err(_) => usable_folder().map(drop),
    }
}

/// Asks the system whether this user may list a folder, enter it and create files in it.
fn ask_for_folder(folder: &Path) -> Result<(), Errno> {
    let asked = Asked::READ_OK | Asked::WRITE_OK | Asked::EXEC_OK;
    rustix::fs::accessat(CWD, folder, asked, AtFlags::EACCESS)
}

/// iceoryx2's folder, if it is there and this user may use it.
///
/// # Errors
/// [`IpcError::NoAccess`], [`IpcError::FolderClosed`].
pub(crate) fn usable_folder() -> Result<Option<Metadata>, IpcError> {
    check_root()?;
    let folder = root();
    let Ok(found) = metadata(&folder) else { return Ok(None) };
    if !found.is_dir() {
        return Err(IpcError::Root { root: folder, reason: "it is not a folder" });
    }
    let access = ask_for_folder(&folder);
    if access == Err(Errno::ROFS) {
        return Err(IpcError::Root { root: folder, reason: "its file system is read-only" });
    }
    if access.is_err() {
        return Err(no_access(folder, &found));
    }
    Ok(Some(found))
}

fn no_access(folder: PathBuf, found: &Metadata) -> IpcError {
    if is_closed_by_mode(found.uid(), found.mode(), rustix::process::geteuid()) {
        return IpcError::FolderClosed { folder, mode: found.mode() & PERMISSIONS };
    }
    IpcError::NoAccess { folder, uid: found.uid(), group: group_name(found.gid()) }
}

/// Checks that not every user may write the payload in shared memory. Returns one line of text.
///
/// # Errors
/// [`IpcError::PayloadOpen`] if every user may write some of it.
pub fn check_files() -> Result<String, IpcError> {
    const OTHERS_WRITE: u32 = 0o002;
    let prefix = shared_memory_prefix();
    let payload = entries(Path::new(SHARED_MEMORY_FOLDER));
    let payload = payload.filter(|(_, name)| name.starts_with(&prefix) && name.ends_with(".data"));
    let (mut count, mut readers, mut writers) = (0, Vec::new(), Vec::new());
    for (path, _) in payload {
        let Ok(found) = metadata(&path) else { continue };
        if found.mode() & OTHERS_WRITE != 0 {
            return Err(IpcError::PayloadOpen { path, mode: found.mode() & 0o777 });
        }
        count += 1;
        for (bit, groups) in [(0o040, &mut readers), (0o020, &mut writers)] {
            let group = group_name(found.gid());
            if found.mode() & bit != 0 && !groups.contains(&group) {
                groups.push(group);
            }
        }
    }
    let users =
        |groups: Vec<String>| if groups.is_empty() { "no group".to_owned() } else { groups.join(", ") };
    let segments = counted(count, "segment");
    Ok(format!("{segments} of payload, read by {}, written by {}", users(readers), users(writers)))
}

/// Gives the files that a publisher has created so far to the group of [`share_with`]: those with the process
/// id in one of their ids, and those of its services, which may be older than the process.
pub(crate) fn share_published(services: &[u128], records: &[PathBuf]) -> Result<(), IpcError> {
    let Some(&access) = SHARED.get() else { return Ok(()) };
    access.give_own(services)?;
    records.iter().try_for_each(|record| access.give(record))
}

/// Gives the files that a reader has created so far to the group of iceoryx2's folder, if it is open to one.
pub(crate) fn share_read() -> Result<(), IpcError> {
    let access = SHARED.get().copied().or_else(Access::of_folder);
    access.map_or(Ok(()), |access| access.give_own(&[]))
}

/// Whether the files of this process are shared with a group.
pub(crate) fn is_shared() -> bool {
    SHARED.get().is_some() || Access::of_folder().is_some()
}

/// The folders of iceoryx2's files that are not memory.
fn folders() -> [PathBuf; 3] {
    let global = &config().global;
    [root(), PathBuf::from(global.service_dir().to_string()), PathBuf::from(global.node_dir().to_string())]
}

/// Paths and names in a folder; empty if there is no such folder.
fn entries(folder: &Path) -> impl Iterator<Item = (PathBuf, String)> + use<> {
    let entries = read_dir(folder).into_iter().flatten().flatten();
    entries.filter_map(|entry| Some((entry.path(), entry.file_name().into_string().ok()?)))
}

/// `name:password:number:members` a line.
fn gid_in(groups: &str, name: &str) -> Option<u32> {
    let mut lines = groups.lines().map(|line| line.split(':'));
    lines.find_map(|mut fields| (fields.next()? == name).then(|| fields.nth(1)?.parse().ok())?)
}

/// A group's name where it is known here, and its number.
fn group_name(gid: u32) -> String {
    let groups = read_to_string(GROUPS).unwrap_or_default();
    let mut names = groups.lines().filter_map(|line| line.split(':').next());
    match names.find(|name| gid_in(&groups, name) == Some(gid)) {
        Some(name) => format!("`{name}` ({gid})"),
        None => gid.to_string(),
    }
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;
    use crate::error::IpcErrorKind;

    #[test]
    fn groups_are_shown_by_name_and_number() {
        let groups = "root:x:0:\nrobots:x:1234:ann,bob\nbroken\nodd:x:none:\n";
        assert_eq!(gid_in(groups, "robots"), Some(1234));
        assert_eq!(gid_in(groups, "robot"), None);
        assert_eq!(gid_in(groups, "broken"), None);
        assert_eq!(gid_in(groups, "odd"), None);
        assert_eq!(Access::of_group("4321").unwrap().gid, 4321);
        assert_eq!(Access::of_group("root").unwrap().gid, 0);
        let error = Access::of_group("no such group").unwrap_err();
        assert_eq!(error.kind(), IpcErrorKind::Argument);
        assert!(matches!(&error, IpcError::UnknownGroup { group } if group == "no such group"), "{error}");
        assert!(error.hint().is_some());
    }

    #[test]
    fn the_group_may_read_payload_and_write_records_and_unfinished_files_are_skipped() {
        let access = Access { gid: 0, payload_mode: Some(0o640) };
        for (name, mode, expected) in [
            ("iox2_1_2.data", 0o600, Some(0o640)),
            ("iox2_1_2.data", 0o200, None),
            ("iox2_1_2_3.connection", 0o600, Some(0o660)),
            ("iox2_1_2.dynamic", 0o200, None),
            ("iox2_1.event", 0o600, Some(0o660)),
            ("iox2_1.service", 0o400, Some(0o440)),
            ("iox2_1.service", 0o600, None),
            ("iox2_node.0_10_0.global_mgmt", 0o666, None),
            ("iox2_1.node_monitor", 0o600, None),
            ("nothing", 0o600, None),
        ] {
            assert_eq!(access.mode_of(name, mode), expected, "{name} of {mode:o}");
        }
        let reader = Access { gid: 0, payload_mode: None };
        assert_eq!(reader.mode_of("iox2_1_2.data", 0o600), None, "a reader gives away no payload");
    }

    #[test]
    fn modes_without_effect_are_refused() {
        let access = Access { gid: 0, payload_mode: None };
        assert_eq!(access.with_mode(0o660).unwrap().payload_mode, Some(0o660));
        for mode in [0o644, 0o600, 0o777, 0] {
            let error = access.with_mode(mode).unwrap_err();
            assert!(matches!(error, IpcError::AccessMode { mode: refused } if refused == mode), "{error}");
            assert!(error.hint().is_some());
        }
    }

    #[test]
    fn a_link_is_not_followed() {
        let folder = tempfile::tempdir().unwrap();
        let (target, link) = (folder.path().join("secret"), folder.path().join("iox2_1.event"));
        std::fs::write(&target, "x").unwrap();
        set_permissions(&target, Permissions::from_mode(0o600)).unwrap();
        std::os::unix::fs::symlink(&target, &link).unwrap();
        let gid = rustix::process::getegid().as_raw();
        let access = Access { gid, payload_mode: Some(0o640) };
        access.give(&link).unwrap();
        assert_eq!(metadata(&target).unwrap().mode() & 0o777, 0o600);
        let own = folder.path().join("iox2_2.event");
        std::fs::write(&own, "x").unwrap();
        access.give(&own).unwrap();
        assert_eq!(metadata(&own).unwrap().mode() & 0o777, 0o660);
        access.give(&folder.path().join("gone.event")).unwrap();
    }
}
