//! Checks of a plan before anything is created.

use crate::error::IpcError;
use crate::plan::{Limits, Reservation, SHARED_MEMORY_FOLDER, TopicPlan};

/// The largest limit; a larger value is probably a typing error.
const MAX_LIMIT: usize = 64;

impl Limits {
    /// Checks that each limit is 1 to [`MAX_LIMIT`].
    pub(crate) fn check(&self) -> Result<(), IpcError> {
        let limits = [
            ("max_readers", self.max_readers),
            ("max_cloud_readers", self.max_cloud_readers),
            ("max_held_frames", self.max_held_frames),
            ("max_loans", self.max_loans),
        ];
        for (limit, value) in limits {
            if !(1..=MAX_LIMIT).contains(&value) {
                return Err(IpcError::Limit { limit, value, most: MAX_LIMIT });
            }
        }
        Ok(())
    }
}

impl Reservation {
    /// Compares the needed memory with the free memory.
    ///
    /// # Errors
    /// [`IpcError::SharedMemoryTooSmall`].
    pub fn check(&self, free_bytes: u64) -> Result<(), IpcError> {
        if self.total_bytes() <= free_bytes {
            return Ok(());
        }
        Err(IpcError::SharedMemoryTooSmall { reservation: self.clone(), free_bytes })
    }
}

/// Bytes that this user may still take from [`SHARED_MEMORY_FOLDER`].
///
/// # Errors
/// [`IpcError::SharedMemoryMissing`] when there is no such file system.
pub fn free_shared_memory_bytes() -> Result<u64, IpcError> {
    let found = rustix::fs::statvfs(SHARED_MEMORY_FOLDER)
        .map_err(|error| IpcError::SharedMemoryMissing { source: error.into() })?;
    Ok(found.f_bavail * found.f_frsize)
}

pub(super) fn refuse_repetition(plans: &[TopicPlan]) -> Result<(), IpcError> {
    for (index, plan) in plans.iter().enumerate() {
        if plans[..index].iter().any(|earlier| earlier.topic == plan.topic) {
            return Err(IpcError::PlannedTwice { topic: plan.topic });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use nunet_types::Hint as _;

    use super::*;
    use crate::plan::tests::vga;

    #[test]
    fn too_little_memory_is_refused_with_both_sizes_and_a_hint() {
        let reservation = Reservation::new(&vga(), &Limits::default());
        let error = reservation.check(32 << 20).unwrap_err();
        let IpcError::SharedMemoryTooSmall { reservation: needed, free_bytes } = &error else {
            panic!("{error}")
        };
        assert_eq!((needed, *free_bytes), (&reservation, 32 << 20));
        assert!((54_000_000..55_000_000).contains(&needed.total_bytes()), "{needed}");
        assert!(error.hint().unwrap().contains("--shm-size"), "{error:?}");
        reservation.check(64 << 20).unwrap();
    }

    #[test]
    fn a_limit_of_zero_or_of_a_million_is_refused() {
        for max_readers in [0, 1_000_000] {
            let limits = Limits { max_readers, ..Limits::default() };
            assert!(matches!(limits.check(), Err(IpcError::Limit { limit: "max_readers", .. })));
        }
    }
}
