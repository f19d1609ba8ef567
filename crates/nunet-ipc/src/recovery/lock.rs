#![expect(
    unsafe_code,
    reason = "iceoryx2 asks for an unsafe promise that nobody uses the service to be removed"
)]
//! The lock under which publishers create services, and the repair of services that were left incomplete.
//!
//! A process killed between the first and the last file of a service leaves half of it. iceoryx2 then reports
//! `HangsInCreation` or `ServiceInCorruptedState` to every process that opens or creates it, forever. But
//! half a service can also be one that another process is creating at this moment. To tell the two apart,
//! publishers create services under a lock that the kernel releases when its holder dies. A process that
//! holds the lock and finds half a service can be sure that its creator is dead, and may remove it.

use std::fs::File;
use std::io;
use std::os::unix::fs::PermissionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use iceoryx2::node::Node;
use iceoryx2::prelude::{MessagingPattern, Service};
use iceoryx2::service::ServiceDetailsError;
use rustix::fs::FlockOperation;
use rustix::io::Errno;

use crate::error::IpcError;
use crate::iceoryx::{Iceoryx, config, record_of, root, service_name};

/// How long the publishers before this one may take to create their services: a few small files each, but
/// many cameras may start at once on a busy machine.
const LOCK_TIMEOUT: Duration = Duration::from_secs(60);

/// How often to try to take the lock.
const LOCK_PERIOD: Duration = Duration::from_millis(2);

/// How long the last user of a service may take between removing its first and its last file.
const REMOVAL_TIME: Duration = Duration::from_millis(100);

/// The right to create services: a lock on iceoryx2's folder. It leaves no file of its own behind.
#[derive(Debug)]
pub(crate) struct CreationLock {
    _folder: File,
}

impl CreationLock {
    /// Waits for the lock until `given_up` returns true. A node must exist, because the folder is created
    /// with it.
    pub(crate) fn take(given_up: &dyn Fn() -> bool) -> Result<Self, IpcError> {
        let path = root();
        let failed = |source| IpcError::Locked { folder: path.clone(), source };
        let folder = File::open(&path).map_err(failed)?;
        let start = Instant::now();
        loop {
            match rustix::fs::flock(&folder, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => return Ok(Self { _folder: folder }),
                Err(Errno::WOULDBLOCK | Errno::INTR) if start.elapsed() < LOCK_TIMEOUT && !given_up() => {
                    std::thread::sleep(LOCK_PERIOD);
                }
                Err(errno) => return Err(failed(errno.into())),
            }
        }
    }

    /// Removes a service that its last user marked for removal but could not remove: a process of another
    /// user, which the sticky bit of `/dev/shm` stopped.
    pub(crate) fn remove_marked(
        &self,
        node: &Node<Iceoryx>,
        name: &str,
        pattern: MessagingPattern,
    ) -> Result<(), IpcError> {
        std::thread::sleep(REMOVAL_TIME);
        // SAFETY: a service that is marked for destruction has no user left and accepts none, and its last
        // user has had the time to remove it; no process creates it at the moment, because that needs the
        // lock, which we hold.
        unsafe { node.force_remove_service(&service_name(name)?, pattern) }
            .map(drop)
            .map_err(|cause| IpcError::iceoryx(format!("remove what is left of service `{name}`"), cause))
    }

    /// Removes what is left of a service that can be neither opened nor created. Does nothing for a service
    /// that is complete or absent.
    ///
    /// Three states are incomplete: the record is still writable (its creator died while writing it), the
    /// record exists without the shared part, or the record cannot be parsed. The last two also occur for a
    /// moment while the last user of a service removes it, which does not take the lock. So the service is
    /// looked at twice, [`REMOVAL_TIME`] apart.
    pub(crate) fn repair(
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
        let is_incomplete = || match Iceoryx::details(&service, config(), pattern) {
            Ok(Some(details)) => details.dynamic_details.is_none(),
            Ok(None) => path.exists(),
            Err(error) => error == ServiceDetailsError::FailedToDeserializeStaticServiceInfo,
        };
        if !is_incomplete() {
            return Ok(());
        }
        std::thread::sleep(REMOVAL_TIME);
        if !is_incomplete() {
            return Ok(());
        }
        // SAFETY: a service without its second half cannot be opened, so no process uses it; no process
        // creates it at the moment, because that takes the lock, which we hold.
        unsafe { node.force_remove_service(&service, pattern) }
            .map(drop)
            .map_err(|cause| IpcError::iceoryx(format!("remove what is left of service `{name}`"), cause))
    }
}

/// iceoryx2 writes a service's record first and makes it read-only when the service is complete.
fn is_unfinished(record: &Path) -> bool {
    const OWNER_MAY_WRITE: u32 = 0o200;
    record.metadata().is_ok_and(|metadata| metadata.permissions().mode() & OWNER_MAY_WRITE != 0)
}

fn remove(path: &Path) -> Result<(), IpcError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(IpcError::Remove { path: path.to_owned(), source })
        }
        _ => Ok(()),
    }
}
