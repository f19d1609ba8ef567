//! What iceoryx2's own cleanup of dead processes misses.

use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use iceoryx2::node::{Node, NodeState};
use iceoryx2::prelude::{CallbackProgression, Service as _};

use crate::iceoryx::{Iceoryx, config, pid_of, shared_memory_prefix};
use crate::plan::SHARED_MEMORY_FOLDER;

/// The processes that died without cleaning up, of this root only.
pub(super) fn dead_processes() -> Vec<u32> {
    let (mut dead, mut alive) = (Vec::new(), Vec::new());
    // A listing that fails halfway names too few processes: nothing is removed that is in use.
    let listed = Node::<Iceoryx>::list(config(), |state| {
        let pid = pid_of(state.node_id().value());
        if matches!(state, NodeState::Dead(_)) {
            dead.push(pid);
        } else {
            alive.push(pid);
        }
        CallbackProgression::Continue
    });
    dead.retain(|pid| listed.is_ok() && !alive.contains(pid)); // process ids are reused
    dead
}

/// Removes memory that dead processes created but did not fill. Call it before iceoryx2 cleans up, which
/// waits without a limit for the creator to complete such a file.
pub(super) fn remove_unfilled(dead: &[u32]) {
    if dead.is_empty() {
        return;
    }
    for (path, id) in shared_memory() {
        if is_unfilled(&path) && dead.contains(&pid_of(id)) {
            let _ = std::fs::remove_file(path); // another process may have been faster
        }
    }
}

/// How long iceoryx2 waits for another process to fill memory that it created.
pub(super) const CREATION_TIMEOUT: Duration = Duration::from_millis(500);

/// Removes the counter of nodes if its creator died before it filled it; returns whether there was one.
/// iceoryx2 would wait for the creator each time. The file names no process, so its age decides: a live
/// creator takes microseconds.
pub(super) fn remove_unfilled_counter() -> bool {
    let is_old = |path: &PathBuf| {
        let created = path.metadata().and_then(|metadata| metadata.modified());
        created.ok().and_then(|created| created.elapsed().ok()).is_some_and(|age| age >= CREATION_TIMEOUT)
    };
    let unfilled: Vec<_> = counters().filter(|path| is_unfilled(path) && is_old(path)).collect();
    unfilled.iter().for_each(|path| drop(std::fs::remove_file(path))); // another process may have been faster
    !unfilled.is_empty()
}

/// The counters of this root in shared memory.
pub(super) fn counters() -> impl Iterator<Item = PathBuf> {
    let prefix = shared_memory_prefix();
    let entries = std::fs::read_dir(SHARED_MEMORY_FOLDER).into_iter().flatten().flatten();
    let owned = entries.filter(move |entry| {
        let name = entry.file_name();
        name.to_str().is_some_and(|name| name.starts_with(&prefix) && name.ends_with(".global_mgmt"))
    });
    owned.map(|entry| entry.path())
}

/// Whether memory was created but not filled: iceoryx2 lets its owner read it when it is.
fn is_unfilled(path: &Path) -> bool {
    const OWNER_MAY_READ: u32 = 0o400;
    path.metadata().is_ok_and(|metadata| metadata.permissions().mode() & OWNER_MAY_READ == 0)
}

/// Removes the shared memory of dead processes that iceoryx2's own cleanup missed: it uses lists that a
/// process killed while it creates something has not written yet.
pub(super) fn remove_orphans(dead: &[u32]) {
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
        // A service outlives its creator while others use it.
        if listed.is_ok() && !in_use.contains(&id) {
            let _ = std::fs::remove_file(path); // another process may have been faster
        }
    }
}

/// The files of this root in shared memory whose names contain an id: `PREFIX..._ID.KIND`.
fn shared_memory() -> Vec<(PathBuf, u128)> {
    let prefix = shared_memory_prefix();
    let entries = std::fs::read_dir(SHARED_MEMORY_FOLDER).into_iter().flatten().flatten();
    let owned = entries.filter_map(|entry| {
        let name = entry.file_name().into_string().ok()?;
        let (stem, _kind) = name.strip_prefix(&prefix)?.rsplit_once('.')?;
        Some((entry.path(), stem.rsplit_once('_')?.1.parse().ok()?))
    });
    owned.collect()
}
