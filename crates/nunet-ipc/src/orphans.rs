//! What processes left behind that did not end in good order.
//!
//! A process that is killed leaves its shared memory and its places in services. Whoever creates an owner or a
//! reader next cleans up after it; this is for looking (`nunetd doctor`) and for cleaning at once.

use iceoryx2::node::{Node, NodeState, NodeView};
use iceoryx2::prelude::CallbackProgression;

use crate::error::IpcError;
use crate::node::{self, Iceoryx, config};

/// A process that is gone while something of it is still there.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Orphan {
    /// The id it had.
    pub pid: u32,
    /// Its program's file name; empty when it was killed before it could write it down.
    pub executable: String,
}

/// What [`clean`] did.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Cleaning {
    /// Dead processes whose remains are gone.
    pub removed: usize,
    /// Dead processes whose remains could not be removed: of another user, of another version of iceoryx2, or being
    /// removed by somebody else at this moment.
    pub failed: usize,
}

/// Lists the dead, without touching anything.
///
/// # Errors
/// [`IpcError::Iceoryx`] when iceoryx2's folder cannot be read.
pub fn list() -> Result<Vec<Orphan>, IpcError> {
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

/// Removes what the dead left behind.
///
/// # Errors
/// [`IpcError::CannotJoin`].
pub fn clean() -> Result<Cleaning, IpcError> {
    let before = list()?.len();
    drop(node::create()?); // joining cleans up, and so does leaving
    let failed = list()?.len();
    Ok(Cleaning { removed: before.saturating_sub(failed), failed })
}
