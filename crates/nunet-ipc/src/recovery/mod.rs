//! Cleaning up after processes that were killed.
//!
//! iceoryx2 0.10 cleans up after dead nodes, and creating a node starts that. Two things it cannot do are done here:
//!
//! - A process that dies between the first and the last file of a service leaves half of it, which nobody can open or
//!   create again. [`lock`] finds and removes such services.
//! - A process that dies while it creates shared memory leaves files that are on no list. [`dead`] removes them.

mod dead;
mod lock;
pub mod orphans;

use iceoryx2::node::{Node, NodeBuilder};
use iceoryx2::prelude::SignalHandlingMode;

use crate::access;
use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, check_root, config, root};

pub(crate) use lock::CreationLock;

/// Creates a node. This also removes what dead processes left behind.
///
/// It writes and syncs several files: a reader that waits for a publisher must not do it again and again.
pub(crate) fn create_node() -> Result<Node<Iceoryx>, IpcError> {
    check_root()?;
    access::check_folder()?;
    let dead = dead::dead_processes();
    dead::remove_unfilled(&dead);
    let node = NodeBuilder::new()
        .config(config())
        .signal_handling_mode(SignalHandlingMode::Disabled) // signals belong to the program, not to a library
        .create::<Iceoryx>()
        .map_err(|cause| IpcError::CannotJoin { root: root(), cause: format!("{cause:?}") })?;
    dead::remove_orphans(&dead);
    Ok(node)
}

#[cfg(test)]
mod tests {
    use crate::iceoryx::pid_of;

    #[test]
    fn the_id_of_a_node_contains_its_process() {
        crate::iceoryx::use_test_root();
        let node = super::create_node().unwrap();
        assert_eq!(pid_of(node.id().value()), std::process::id());
    }
}
