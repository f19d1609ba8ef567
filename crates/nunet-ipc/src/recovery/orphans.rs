//! Files of killed processes.
//!
//! A process that is killed leaves its shared memory and its places in services. The next process that
//! creates a publisher or a reader cleans up after it. These functions list the dead processes
//! (`nunetd doctor`) and clean up at once.

use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::CallbackProgression;

use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, check_root, config};

/// A dead process whose files still exist.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Orphan {
    /// Its id.
    pub pid: u32,
    /// The file name of its program; empty when it was killed before it wrote the name.
    pub executable: String,
}

/// What [`clean`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cleaning {
    /// Dead processes whose files were removed.
    pub removed: usize,
    /// Dead processes whose files could not be removed: they belong to another user or another version of
    /// iceoryx2, or another process is removing them.
    pub failed: usize,
}

/// Lists dead processes, without removing anything.
///
/// # Errors
/// [`IpcError::Iceoryx`] when iceoryx2's folder cannot be read.
pub fn list() -> Result<Vec<Orphan>, IpcError> {
    check_root()?;
    let mut orphans = Vec::new();
    Node::<Iceoryx>::list(config(), |state| {
        if let NodeState::Dead(dead) = state {
            let pid = dead.id().pid::<Iceoryx>().map_or(0, |pid| pid.value().cast_unsigned());
            let executable = dead.details().as_ref().map(|details| details.executable().to_string());
            orphans.push(Orphan { pid, executable: executable.unwrap_or_default() });
        }
        CallbackProgression::Continue
    })
    .map_err(|cause| IpcError::iceoryx("list the processes that use iceoryx2", cause))?;
    Ok(orphans)
}

/// Removes what dead processes left behind.
///
/// # Errors
/// [`IpcError::CannotJoin`].
pub fn clean() -> Result<Cleaning, IpcError> {
    let before = list()?.len();
    drop(super::create_node()?); // creating a node cleans up, and so does dropping it
    let failed = list()?.len();
    Ok(Cleaning { removed: before.saturating_sub(failed), failed })
}
