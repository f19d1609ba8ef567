#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for an unsafe promise that nobody uses the service to be removed"
)]
//! Mends services whose creator or last user was killed in the middle of it.
//!
//! iceoryx2 0.10 cleans up after dead nodes, but a process that dies between the first and the last file of a
//! service leaves half of it, and then nobody can open or create that service any more (`HangsInCreation`,
//! `ServiceInCorruptedState`). Owners therefore take turns while they create services: who has the turn and finds
//! half a service knows that its creator is dead.

use std::fs::File;
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, MessagingPattern, Service};
use iceoryx2::service::ServiceDetailsError;
use iceoryx2::service::service_hash::ServiceHash;
use rustix::fs::FlockOperation;
use rustix::io::Errno;

use crate::error::IpcError;
use crate::node::{Iceoryx, config, service_name};
use crate::plan::SHARED_MEMORY_FOLDER;

/// How long the owners before this one may take to create their services: a few small files each, but many cameras may
/// start at once on a busy machine.
const TURN_TIMEOUT: Duration = Duration::from_secs(60);

/// How often to ask for the turn.
const TURN_PERIOD: Duration = Duration::from_millis(2);

/// How long the last user of a service may take between removing its first and its last file.
const REMOVAL_TIME: Duration = Duration::from_millis(100);

/// The turn to create services: a lock on iceoryx2's folder, which the kernel takes back from the dead, and which
/// leaves no file of its own behind.
#[derive(Debug)]
pub(crate) struct Turn {
    _folder: File,
}

impl Turn {
    /// Waits for the turn, until `given_up` says so. A node must exist, because the folder comes with it.
    pub(crate) fn take(given_up: &dyn Fn() -> bool) -> Result<Self, IpcError> {
        let path = PathBuf::from(config().global.root_path().to_string());
        let failed = |source| IpcError::Locked { folder: path.clone(), source };
        let folder = File::open(&path).map_err(failed)?;
        let start = Instant::now();
        loop {
            match rustix::fs::flock(&folder, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => return Ok(Self { _folder: folder }),
                Err(Errno::WOULDBLOCK | Errno::INTR) if start.elapsed() < TURN_TIMEOUT && !given_up() => {
                    std::thread::sleep(TURN_PERIOD);
                }
                Err(errno) => return Err(failed(errno.into())),
            }
        }
    }

    /// Removes a service whose last user has said so and could not do it: one of another user, whom the sticky bit of
    /// `/dev/shm` stopped.
    pub(crate) fn bury(
        &self,
        node: &Node<Iceoryx>,
        name: &str,
        pattern: MessagingPattern,
    ) -> Result<(), IpcError> {
        std::thread::sleep(REMOVAL_TIME);
        // SAFETY: a service that is marked for destruction has no user left and takes none, and whoever marked it has
        // had the time to remove it; nobody creates it at the moment, because that takes the turn, which is ours.
        unsafe { node.force_remove_service(&service_name(name)?, pattern) }
            .map(drop)
            .map_err(|cause| IpcError::iceoryx(format!("remove the rest of service `{name}`"), cause))
    }

    /// Removes what is left of a service that can be neither opened nor created.
    pub(crate) fn mend(
        &self,
        node: &Node<Iceoryx>,
        name: &str,
        pattern: MessagingPattern,
    ) -> Result<(), IpcError> {
        let service = service_name(name)?;
        let path = record_of(name, pattern)?;
        if is_unfinished(&path) {
            return remove(&path);
        }
        let is_half = || match Iceoryx::details(&service, config(), pattern) {
            Ok(Some(details)) => details.dynamic_details.is_none(),
            Ok(None) => path.exists(),
            Err(error) => error == ServiceDetailsError::FailedToDeserializeStaticServiceInfo,
        };
        if !is_half() {
            return Ok(());
        }
        std::thread::sleep(REMOVAL_TIME);
        if !is_half() {
            return Ok(());
        }
        // SAFETY: a service without its second half cannot be opened, so nobody uses it; nobody creates it at the
        // moment, because that takes the turn, which is ours.
        unsafe { node.force_remove_service(&service, pattern) }
            .map(drop)
            .map_err(|cause| IpcError::iceoryx(format!("remove the rest of service `{name}`"), cause))
    }
}

/// The file that says what a service is.
pub(crate) fn record_of(name: &str, pattern: MessagingPattern) -> Result<PathBuf, IpcError> {
    let hash = ServiceHash::new::<<Iceoryx as Service>::ServiceNameHasher>(&service_name(name)?, pattern);
    let global = &config().global;
    let file = format!("{}{hash}{}", global.prefix, global.service.static_config_storage_suffix);
    Ok(PathBuf::from(global.service_dir().to_string()).join(file))
}

/// The processes that died and were not cleaned up after, of this iceoryx2 only.
pub(crate) fn dead_processes() -> Vec<u32> {
    let (mut dead, mut alive) = (Vec::new(), Vec::new());
    // A listing that fails part of the way names too few: nothing is removed that should not be.
    let listed = Node::<Iceoryx>::list(config(), |state| {
        let pid = pid_of(state.node_id().value());
        if matches!(state, NodeState::Dead(_)) {
            dead.push(pid);
        } else {
            alive.push(pid);
        }
        CallbackProgression::Continue
    });
    dead.retain(|pid| listed.is_ok() && !alive.contains(pid)); // the kernel gives numbers out again
    dead
}

/// Removes memory that dead processes created and did not live to fill. To be called before iceoryx2 cleans up: it
/// waits without end for such a record to be completed by its creator.
pub(crate) fn remove_unfilled(dead: &[u32]) {
    const OWNER_MAY_READ: u32 = 0o400; // granted when the memory is filled
    if dead.is_empty() {
        return;
    }
    for (path, id) in shared_memory() {
        let unfilled =
            path.metadata().is_ok_and(|metadata| metadata.permissions().mode() & OWNER_MAY_READ == 0);
        if unfilled && dead.contains(&pid_of(id)) {
            let _ = std::fs::remove_file(path); // another process may have been faster
        }
    }
}

/// Removes the shared memory of dead processes that iceoryx2's own cleaning missed: it goes by lists that a process
/// which dies in the midst of creating something has not written yet.
pub(crate) fn sweep(dead: &[u32]) {
    if dead.is_empty() {
        return;
    }
    let orphans: Vec<_> = shared_memory().into_iter().filter(|(_, id)| dead.contains(&pid_of(*id))).collect();
    let mut in_use = Vec::new();
    let listed = Iceoryx::list(config(), |service| {
        in_use.push(service.static_details.unique_service_id().value());
        CallbackProgression::Continue
    });
    for (path, id) in orphans {
        // A service outlives its creator while others use it. Another process may have been faster.
        if listed.is_ok() && !in_use.contains(&id) {
            let _ = std::fs::remove_file(path);
        }
    }
}

/// The files of this iceoryx2 in shared memory that belong to somebody: `PREFIX..._ID.KIND`.
fn shared_memory() -> Vec<(PathBuf, u128)> {
    let prefix = config().global.prefix.to_string();
    let entries = std::fs::read_dir(SHARED_MEMORY_FOLDER).into_iter().flatten().flatten();
    let owned = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let (stem, _kind) = name.strip_prefix(&prefix)?.rsplit_once('.')?;
        Some((entry.path(), stem.rsplit_once('_')?.1.parse().ok()?))
    });
    owned.collect()
}

/// The process that made an id: iceoryx2's `UniqueSystemId` is seconds, nanoseconds, process, counter, 32 bits each.
pub(crate) fn pid_of(id: u128) -> u32 {
    (id >> 64) as u32
}

/// iceoryx2 writes a service's file first and makes it read-only when the service is complete.
fn is_unfinished(path: &Path) -> bool {
    const OWNER_MAY_WRITE: u32 = 0o200;
    path.metadata().is_ok_and(|metadata| metadata.permissions().mode() & OWNER_MAY_WRITE != 0)
}

fn remove(path: &Path) -> Result<(), IpcError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(IpcError::Remove { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_tell_their_process() {
        let node = crate::node::create().unwrap();
        assert_eq!(pid_of(node.id().value()), std::process::id());
    }
}
