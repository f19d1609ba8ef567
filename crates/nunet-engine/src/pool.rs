//! Result buffers that are reused once they are dropped, because the first write to new memory pages takes
//! longer than writing the results.

use std::ops::{Deref, DerefMut};
use std::sync::{Arc, Mutex, PoisonError};

/// How many unused buffers are kept.
const MAX_KEPT: usize = 4;

type Unused<T> = Arc<Mutex<Vec<Vec<T>>>>;

/// The buffers of one kind of result.
#[derive(Debug, Default)]
pub(crate) struct Pool<T>(Unused<T>);

/// A buffer that returns to its pool when dropped, even after the model was dropped.
#[derive(Debug)]
pub struct Pooled<T> {
    values: Vec<T>,
    unused: Unused<T>,
}

impl<T: Copy + Default> Pool<T> {
    /// A buffer of `count` values, which may be those of an older result: write them before you read them.
    pub(crate) fn take(&self, count: usize) -> Pooled<T> {
        let mut values = lock(&self.0).pop().unwrap_or_default();
        values.resize(count, T::default());
        Pooled { values, unused: Arc::clone(&self.0) }
    }
}

impl<T> Deref for Pooled<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values
    }
}

impl<T> DerefMut for Pooled<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values
    }
}

impl<T> Drop for Pooled<T> {
    fn drop(&mut self) {
        let mut unused = lock(&self.unused);
        if unused.len() < MAX_KEPT {
            unused.push(std::mem::take(&mut self.values));
        }
    }
}

/// Ignores poisoning, because the list is complete after each step.
fn lock<T>(unused: &Unused<T>) -> std::sync::MutexGuard<'_, Vec<Vec<T>>> {
    unused.lock().unwrap_or_else(PoisonError::into_inner)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_dropped_buffer_is_reused_and_two_never_share_memory() {
        let pool = Pool::<f32>::default();
        let (first, second) = (pool.take(8), pool.take(8));
        let (one, other) = (first.as_ptr(), second.as_ptr());
        assert_ne!(one, other);
        drop(first);
        assert_eq!(pool.take(8).as_ptr(), one);
        assert_eq!(pool.take(4).len(), 4, "of another size");
        drop((second, pool));
    }

    #[test]
    fn a_bounded_number_of_unused_buffers_is_kept() {
        let pool = Pool::<u8>::default();
        let buffers: Vec<_> = (0..3 * MAX_KEPT).map(|_| pool.take(16)).collect();
        drop(buffers);
        assert_eq!(lock(&pool.0).len(), MAX_KEPT);
    }
}
