//! Cleanup after killed processes.
//!
//! iceoryx2 0.10 cleans up after dead nodes, and creating a node starts that. This module adds two repairs
//! that iceoryx2 does not do:
//!
//! - A process that dies between the first and the last file of a service leaves half of it, which no process
//!   can open or create again. [`lock`] finds and removes such services.
//! - A process that dies while it creates shared memory leaves files that are on no list. [`dead`] removes
//!   them. One of them is the counter that all processes share: without its removal no process could create a
//!   node again.

mod dead;
mod lock;
pub mod orphans;

use iceoryx2::node::{Node, NodeBuilder, NodeCreationFailure};
use iceoryx2::prelude::SignalHandlingMode;

use crate::access;
use crate::error::{IceoryxCause, IpcError};
use crate::iceoryx::{Iceoryx, config, root};

pub(crate) use lock::CreationLock;

/// Creates a node. This also removes what dead processes left behind.
///
/// It writes and syncs several files: a reader that waits for a publisher must not do it again and again.
pub(crate) fn create_node() -> Result<Node<Iceoryx>, IpcError> {
    access::usable_folder()?;
    let dead = dead::dead_processes();
    dead::remove_unfilled(&dead);
    let build = || {
        NodeBuilder::new()
            .config(config())
            .signal_handling_mode(SignalHandlingMode::Disabled) // signals belong to the program, not to a library
            .create::<Iceoryx>()
    };
    let node = match build() {
        Err(NodeCreationFailure::UnableToGenerateUniqueNodeId) if dead::remove_unfilled_counter() => build(),
        result => result,
    };
    let node = node
        .map_err(|cause| IpcError::CannotJoin { root: root(), cause: IceoryxCause::new(&cause, root()) })?;
    dead::remove_orphans(&dead);
    Ok(node)
}

#[cfg(test)]
mod tests {
    use crate::iceoryx::pid_of;

    #[test]
    fn the_id_of_a_node_contains_its_process() {
        let node = super::create_node().unwrap();
        assert_eq!(pid_of(node.id().value()), std::process::id());
    }

    #[test]
    fn a_counter_whose_creator_was_killed_before_it_was_filled_is_replaced() {
        use std::os::unix::fs::PermissionsExt as _;

        drop(super::create_node().unwrap());
        let counter = super::dead::counters().next().expect("a node was created");
        // As iceoryx2 leaves it before it is filled.
        std::fs::set_permissions(&counter, std::fs::Permissions::from_mode(0o200)).unwrap();
        std::thread::sleep(super::dead::CREATION_TIMEOUT); // its creator had this long
        super::create_node().unwrap();
        assert_ne!(counter.metadata().unwrap().permissions().mode() & 0o400, 0);
    }
}
